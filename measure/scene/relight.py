"""A reconstructed scene under another light, as an observer would see it.

Spectra that one camera cannot tell apart under its light may look different under another: the
spread of colours of the draws says by how much, before anybody measures.
"""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spectrabox.radiometry import appearance, colour_science
from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.records.spectra import SpectrumSamples, WavelengthGrid
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.reconstruct.rendering import renderer
from spectrabox.reconstruct.scene import scene_file, stated
from spectrabox.reconstruct.scene.scene_xml import NO_TEXTURES, scene_xml

WHITE_PERCENTILE = 99.5            # percentile of luminance that the picture shows as white
DRAWS = 400                 # of each material whose colours are compared
ColourSpread = tuple[list[float], float | None, float | None]       # as of `colour_spread`


def relight(scene: scene_file.SceneFile, bsdfs: Mapping[str, str],
            spectra: Mapping[str, np.ndarray | SpectrumSamples], grid: WavelengthGrid,
            light: np.ndarray, observer: np.ndarray, *, size: tuple[int, int], spp: int,
            seed: int, textures: Mapping[str, Path] = NO_TEXTURES
            ) -> tuple[np.ndarray, np.ndarray, dict[str, ColourSpread]]:
    """Render a scene under a light with the means of the draws. The renderer has been started.

    Parameters
    ----------
    scene : SceneFile
    bsdfs : mapping
        From each material to its BSDF in the scene.
    spectra : mapping
        From each material to its reflectance (P,), or to its draws.
    grid : WavelengthGrid
    light : (P,) array
        Relative power of every light; the scene says how strong each is beside the others.
    observer : (3, P) array
        Colour-matching functions.
    size : (width, height)
        In pixels.
    spp : int
        Paths per pixel.
    seed : int
        Of the paths.
    textures : mapping
        From ids of shapes to the files of their spectra, where a picture found them.

    Returns
    -------
    xyz : (H, W, 3) array
        X, Y, Z, Y being 1 for a perfect white as bright as ``WHITE_PERCENTILE``.
    picture : (H, W, 3) array
        uint8, sRGB, adapted from the light's white to D65.
    colours : dict
        From each material to what `colour_spread` returns.
    """
    means = {name: np.interp(grid.nm, known.grid.nm, known.spectra.mean(axis=0))
             if isinstance(known, SpectrumSamples) else known for name, known in spectra.items()}
    xml = scene_xml(scene, reflectances={bsdfs[name]: np.clip(mean, 0, 1)
                                         for name, mean in means.items()},
                    light={name: light * unit[0] for name, unit in stated.strengths(scene).items()},
                    bands=dict(zip("XYZ", observer, strict=True)),
                    range_nm=(grid.nm[0], grid.nm[-1]), size=size, textures=textures)
    if textures:
        renderer.register_spectral_texture()
    xyz, _ = renderer.render(renderer.load_scene(xml), spp, seed)
    xyz = xyz / np.percentile(xyz[..., 1], WHITE_PERCENTILE)
    white = _tristimulus(np.ones_like(grid.nm), grid, light, observer)
    colours = {name: colour_spread(means[name],
                                   known if isinstance(known, SpectrumSamples) else None,
                                   grid, light, observer) for name, known in spectra.items()}
    return xyz, colour_science.adapted_srgb(xyz, white), colours


def light_by_itself(calibration: Calibration, grid: WavelengthGrid) -> np.ndarray:
    """The light (P,) of a calibration; its most likely spectrum where only the chart tells it.

    Parameters
    ----------
    calibration : Calibration
    grid : WavelengthGrid
    """
    known = calibration.light_posterior
    return spectrum_on_grid(calibration.light, grid) if known is None else np.asarray(
        np.interp(grid.nm, known.grid.nm, known.mean))


def _tristimulus(reflectances: np.ndarray, grid: WavelengthGrid, power: np.ndarray,
                 matching: np.ndarray) -> np.ndarray:
    """X, Y, Z (..., 3), Y being 1 for a reflectance of 1."""
    weights = matching * power * grid.weights_nm
    xyz: np.ndarray = reflectances @ weights.T / weights[1].sum()
    return xyz


def colour_spread(mean: np.ndarray, draws: SpectrumSamples | None, grid: WavelengthGrid,
                  power: np.ndarray, matching: np.ndarray) -> ColourSpread:
    """Colour of a material under a light, and how far its draws lie from it.

    Parameters
    ----------
    mean : (P,) array
        Its reflectance.
    draws : SpectrumSamples or None
    grid : WavelengthGrid
    power : (P,) array
        Of the light.
    matching : (3, P) array
        Colour-matching functions.

    Returns
    -------
    lab : list of three floats
        Of the mean, white being reflectance 1 under the same light.
    median, upper : float or None
        Of CIEDE2000 of the draws against the mean, and its 95 % quantile; None where the spectrum
        was given.
    """
    white = _tristimulus(np.ones_like(grid.nm), grid, power, matching)
    lab = appearance.lab_from_xyz(_tristimulus(mean, grid, power, matching), white)
    median = upper = None
    if draws is not None:
        # From all over: samplers of several modes give their draws mode after mode.
        some = np.linspace(0, len(draws.spectra) - 1, min(DRAWS, len(draws.spectra))).astype(int)
        spectra = np.array([np.interp(grid.nm, draws.grid.nm, draws.spectra[index])
                            for index in some])
        others = appearance.lab_from_xyz(_tristimulus(spectra, grid, power, matching), white)
        differences = appearance.ciede2000(others, lab)
        median, upper = float(np.median(differences)), float(np.quantile(differences, 0.95))
    return lab.tolist(), median, upper
