"""Photos of scenes with known spectra: Mitsuba's ``path`` with its spectral film, and a measured
camera.
"""
from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import colour
import numpy as np

from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.calibration import Calibration, SensitivityFit
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind
from spectrabox.radiometry.records.spectra import Outcome, Quantity, Spectrum
from spectrabox.reconstruct.rendering.renderer import load_scene, render
from spectrabox.reconstruct.scene.scene_file import SceneFile, read_scene
from spectrabox.reconstruct.scene.scene_xml import scene_xml
from spectrabox.reconstruct.settings import InversionSettings

GRID = visible_grid()
BANDS = ("R", "G", "B")
PASSES = 4


def measured_camera(light: np.ndarray | None = None) -> Calibration:
    """A measured camera without error, under a constant light or the one given (P,)."""
    camera = colour.MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    curves = np.array([np.interp(GRID.nm, camera.wavelengths, curve) for curve in camera.values.T])
    fit = SensitivityFit(GRID, curves / curves.max(), None, None, None, None, None, None, None,
                         "measured", Outcome.CONVERGED)
    values = np.ones(GRID.nm.size) if light is None else light
    return Calibration(fit, Spectrum(GRID, values, Quantity.RADIANCE, "given"), None,
                       np.zeros((3, 3)), ())


def scene_of(xml: str) -> SceneFile:
    """XML text read as an operator's scene."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.xml"
        path.write_text(xml, encoding="utf-8")
        return read_scene(path)


def photograph(scene: SceneFile, truth: Mapping[str, np.ndarray], calibration: Calibration,
               spp: int,
               seed: int = 77) -> LinearImage:
    """Photo of the scene with true reflectances (P,) by BSDF id; its variance is that of the
    rendering.
    """
    xml = scene_xml(scene, reflectances=truth, light=calibration.light.values, integrator="path",
                    bands=dict(zip(BANDS, calibration.sensitivity.curves, strict=True)),
                    range_nm=(GRID.nm[0], GRID.nm[-1]), size=(scene.width, scene.height))
    signal, variance = render(load_scene(xml), spp, seed, PASSES)
    return LinearImage(signal.astype(np.float32), variance.astype(np.float32),
                       np.zeros(signal.shape, bool), 1.0, None, None, None, PhotoKind.LINEAR_FILE,
                       "", "rendered", "")


def plain_settings(coefficients: int, engine: str = "transport", steps: int = 160,
                   spp: int = 16) -> InversionSettings:
    """Settings whose answer rests on the photo and its stated errors: nothing read off the scene,
    and the smooth prior.
    """
    return InversionSettings(coefficients, steps, spp, engine=engine, errors_from_scene=False,
                             spectrum_prior="smooth")


def spectrum_rmse(found: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square difference of two spectra."""
    return float(np.sqrt(np.mean((found - truth) ** 2)))
