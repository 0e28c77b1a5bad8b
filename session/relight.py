"""The scene of a finished session under another light, as an observer would see it, and how far the
draws differ there.

Spectra that one camera cannot tell apart under its light may look different under another: the
spread of colours of the draws says by how much, before anybody measures.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from spectrabox.radiometry.appearance import ciede2000, lab_from_xyz
from spectrabox.radiometry.colour_science import adapted_srgb
from spectrabox.radiometry.records import Calibration, WavelengthGrid
from spectrabox.radiometry.spectra.named_spectra import light as named_light
from spectrabox.radiometry.spectra.named_spectra import sensitivities as named_observer
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.reconstruct.rendering.renderer import load_scene, render, start_mitsuba
from spectrabox.reconstruct.scene.scene_xml import scene_xml
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.pipeline import FinishedRun
from spectrabox.session.stages.scenes import read_session_scene
from spectrabox.session.stages.stored_records import calibrations_of, joint_of, samples_of

OBSERVER = "CIE 1931 2 Degree Standard Observer"
WHITE_PERCENTILE = 99.5            # percentile of luminance that the picture shows as white
DRAWS = 400                 # of each material whose colours are compared


@dataclass(frozen=True)
class ColourSpread:
    """Colour of one material under the light: of the mean spectrum, and how far its draws lie from
    it.
    """

    name: str
    lab: tuple[float, float, float]  # of the mean, white being reflectance 1 under the same light
    # CIEDE2000 of the draws against the mean; None where the spectrum was given
    delta_e00_median: float | None
    delta_e00_95: float | None


@dataclass(frozen=True)
class Relit:
    """X, Y, Z (H, W, 3), Y being 1 for a perfect white as bright as ``WHITE_PERCENTILE``, and the
    materials' colours.
    """

    xyz: np.ndarray
    picture: np.ndarray  # (H, W, 3) uint8, sRGB, adapted from the light's white to D65
    colours: tuple[ColourSpread, ...]
    notes: tuple[str, ...] = ()     # how surely the light by itself is known


def relight(config: SessionConfig, run: FinishedRun, *, light: str | None, observer: str,
            size: tuple[int, int],
            spp: int, device: str) -> Relit:
    """Render the scene with the means of the draws.

    Parameters
    ----------
    light : str or None
        A CIE illuminant or a file; None for the session's own.
    observer : str
        Colour-matching functions by name or from a file of three curves.
    size : (width, height) in pixels

    Raises
    ------
    InputError
        If light or observer are not known.
    """
    joint, calibration = joint_of(run.stored), calibrations_of(config, run.stored)[0]
    grid = joint.grid
    power = named_light(light, grid) if light is not None else _own_light(calibration, grid)
    matching = named_observer(observer, grid)
    drawn = {name: samples_of(run.stored, name)[0]
             for name, known in zip(joint.materials, joint.known, strict=True) if not known}
    means = {name: np.interp(grid.nm, drawn[name].grid.nm, drawn[name].spectra.mean(axis=0))
             if name in drawn else spectrum
             for name, spectrum in zip(joint.materials, joint.spectra, strict=True)}
    scene = read_session_scene(config)
    start_mitsuba(device)
    xml = scene_xml(scene, reflectances={config.bsdfs[name]: np.clip(mean, 0, 1)
                                         for name, mean in means.items()},
                    light=power, bands=dict(zip("XYZ", matching, strict=True)),
                    range_nm=(grid.nm[0], grid.nm[-1]), size=size)
    xyz, _ = render(load_scene(xml), spp, config.session.seed)
    xyz = xyz / np.percentile(xyz[..., 1], WHITE_PERCENTILE)
    white = _tristimulus(np.ones_like(grid.nm), grid, power, matching)
    colours = tuple(_spread(name, means[name], drawn.get(name), grid, power, matching)
                    for name in means)
    known = calibration.light_posterior
    notes = () if light is not None or known is None else (
        "nobody measured the session's light: rendered under the most likely one",
        *known.sentences)
    return Relit(xyz, adapted_srgb(xyz, white), colours, notes)


def _own_light(calibration: Calibration, grid: WavelengthGrid) -> np.ndarray:
    """The session's light (P,); its most likely spectrum where the chart alone tells it."""
    known = calibration.light_posterior
    return spectrum_on_grid(calibration.light, grid) if known is None else np.asarray(
        np.interp(grid.nm, known.grid.nm, known.mean))


def _tristimulus(reflectances: np.ndarray, grid: WavelengthGrid, power: np.ndarray,
                 matching: np.ndarray) -> np.ndarray:
    """X, Y, Z (..., 3), Y being 1 for a reflectance of 1."""
    weights = matching * power * grid.weights_nm
    xyz: np.ndarray = reflectances @ weights.T / weights[1].sum()
    return xyz


def _spread(name: str, mean: np.ndarray, draws: Any, grid: WavelengthGrid, power: np.ndarray,
            matching: np.ndarray) -> ColourSpread:
    white = _tristimulus(np.ones_like(grid.nm), grid, power, matching)
    lab = lab_from_xyz(_tristimulus(mean, grid, power, matching), white)
    median = upper = None
    if draws is not None:
        # From all over: samplers of several modes give their draws mode after mode.
        some = np.linspace(0, len(draws.spectra) - 1, min(DRAWS, len(draws.spectra))).astype(int)
        spectra = np.array([np.interp(grid.nm, draws.grid.nm, draws.spectra[index])
                            for index in some])
        others = lab_from_xyz(_tristimulus(spectra, grid, power, matching), white)
        differences = ciede2000(others, lab)
        median, upper = float(np.median(differences)), float(np.quantile(differences, 0.95))
    return ColourSpread(name, (float(lab[0]), float(lab[1]), float(lab[2])), median, upper)
