"""A small Cornell box as an inverse problem, for the tests of the engines."""
from __future__ import annotations

import numpy as np

from spectrabox.fixtures.cornell_box import MATERIALS, cornell_box_xml
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.calibration import Calibration, LightScale, SensitivityFit
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind
from spectrabox.radiometry.records.spectra import Outcome, Quantity, Spectrum
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.view import MaterialSpec, PhotoView

GRID = visible_grid(5)
WIDTH = 32
BANDS = ("R", "G", "B")
TRUTH = {"white": 0.75 + 0.1 * np.sin((GRID.nm - 400) / 90),
         "green": 0.1 + 0.4 * np.exp(-((GRID.nm - 530) / 40) ** 2),
         "red": 0.08 + 0.5 / (1 + np.exp((600 - GRID.nm) / 15))}


def camera(light=None):
    """Three Gaussian bands; the light rises from 400 to 700 nm unless one is given."""
    curves = np.exp(-0.5 * ((GRID.nm - np.array([[600.0], [540.0], [460.0]])) / 30) ** 2)
    light = 1 + (GRID.nm - 400) / 300 if light is None else light
    fit = SensitivityFit(GRID, curves, None, None, None, None, None, None, None, "given",
                         Outcome.CONVERGED)
    return Calibration(fit, Spectrum(GRID, light, Quantity.RADIANCE, "given"), None,
                       np.zeros((3, 3)), ())


def scene(folder, xml=None, **options):
    """The box, or other XML, read as an operator's file."""
    path = folder / "box.xml"
    path.write_text(cornell_box_xml(WIDTH, **options) if xml is None else xml, encoding="utf-8")
    return read_scene(path, folder)


def photo_of(signal, variance=None, saturated=None):
    """A photo with this signal (H, W, K)."""
    variance = np.full(signal.shape, 1e-8) if variance is None else variance
    saturated = np.zeros(signal.shape, dtype=bool) if saturated is None else saturated
    return LinearImage(signal.astype(np.float32), variance.astype(np.float32), saturated, 1.0, None,
                       None, None, PhotoKind.LINEAR_FILE, "", "box.exr", "")


def specs(known=()):
    """The three materials; those named are given their true spectrum."""
    return tuple(MaterialSpec(name, name, TRUTH[name] if name in known else None)
                 for name in MATERIALS)


def plain_settings(coefficients, **chosen):
    """Settings whose answer rests on the photo and its stated errors: nothing read off the scene,
    and the smooth prior, of the transport engine unless another is chosen.
    """
    plain = {"engine": "transport", "errors_from_scene": False, "spectrum_prior": "smooth"}
    return InversionSettings(coefficients, **plain | chosen)


SCALE_ONE = LightScale(1.0, None, None, "given")


def view_of(scene_file, photo=None, *, light=None, scale=SCALE_ONE, materials=None):
    """A view of the box: a white photo, the scale 1 and three unknown materials unless others are
    given.
    """
    photo = photo_of(np.ones((WIDTH, WIDTH, 3))) if photo is None else photo
    return PhotoView("photo", scene_file, photo, camera(light), BANDS,
                     specs() if materials is None else materials, scale)
