"""Photos under narrow lamps by a colour camera: the strongest channel of each, or every channel.

A Nikon 5100 before LED lamps of Gaussian spectra: 24 patches that are off by 1 %, light and camera
unknown, 40 published colours, noise of 0.2 to 0.4 %. Printed are RMSE, share that the 95 % band
holds and its width, the bands and those that do not depend on each other, and processor seconds of
the chart's fit and of 40 posteriors. ``--picture`` counts processor seconds of pictures of 3, 6, 12
and 36 bands, of 24 patches and of shaded mixtures of colours, and what they cost to three bands;
``--fits`` those of the chart's fit in 3, 9, 18 and 36 bands, and of all that ``flat`` computes of
four samples.
"""
from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.capture.develop.developed import DARK_CHANNEL
from spectrabox.fixtures.paints import NM, chart_copy
from spectrabox.measure.held_out_spectra import held_out_patches
from spectrabox.measure.pictures.uplift import uplift_image
from spectrabox.measure.regions.flat_signals import flat_signals
from spectrabox.measure.regions.white import FlatErrors, FlatPhoto, white_at_regions
from spectrabox.measure.shoot.options import Sampling
from spectrabox.measure.surfaces.surface_signals import errors_by_cause, measurement
from spectrabox.measure.surfaces.surface_spectra import sample_surfaces
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.error_model import (
    DISAGREEMENT,
    PHOTO_NOISE,
    SENSITIVITIES,
    WHITE,
    proportional_covariance,
    sensitivity_covariance,
)
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.interreflection import relative_response
from spectrabox.radiometry.records.photos import LinearImage, PatchSamples, PhotoKind, RegionSamples
from spectrabox.radiometry.records.spectra import SurfaceSignals, UnknownLight
from spectrabox.radiometry.spectra.named_spectra import sensitivities, test_reflectances
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior

CAMERA, COLOURS, SEED = "Nikon 5100 (NPL)", 40, 1
PATCHES_OFF, WELL_EXPOSED = 0.01, 0.8
NOISE_OF_PATCHES, NOISE_OF_COLOURS = 0.002, 0.004   # at WELL_EXPOSED, shot noise


def responses(lamps: int, width_nm: float) -> np.ndarray:
    """Camera x lamp x step (lamps * 3, P)."""
    centres = np.linspace(420, 680, lamps)[:, None]
    leds = np.exp(-0.5 * ((FINE_GRID.nm - centres) / (width_nm / 2.355)) ** 2)
    curves = sensitivities(CAMERA, FINE_GRID)
    return np.vstack([led * curves for led in leds]) * FINE_GRID.weights_nm


def photographed(reflectances: np.ndarray, response: np.ndarray, noise: float,
                 rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Signals (n, K) and their standard errors, white well exposed in every lamp's best channel."""
    white = response.sum(axis=1).reshape(-1, 3)
    exposure = WELL_EXPOSED / np.repeat(white.max(axis=1), 3)
    signal = reflectances @ response.T * exposure
    error = noise * np.sqrt(np.maximum(signal, 1e-4) * WELL_EXPOSED) + 2e-5
    return signal + error * rng.standard_normal(signal.shape), error


def row(lamps: int, width_nm: float, every: bool) -> str:
    """One line of the table."""
    rng = np.random.default_rng(SEED)
    response = responses(lamps, width_nm)
    white = response.sum(axis=1).reshape(-1, 3)
    share = (white / white.max(axis=1, keepdims=True)).ravel()
    used = share > DARK_CHANNEL if every else share == 1
    bands = int(used.sum())
    patches = np.array([np.interp(FINE_GRID.nm, NM, each)
                        for each in chart_copy(np.random.default_rng(SEED))])
    seen, error = photographed(patches * (1 + PATCHES_OFF * rng.standard_normal((24, 1))),
                               response, NOISE_OF_PATCHES, rng)
    sets = test_reflectances(FINE_GRID)
    truth = np.vstack([sets["CES99"][::3], sets["NIST CQS test colours"][::3]])
    truth = truth[(truth.min(axis=1) > 0.003) & (truth.max(axis=1) < 0.997)][:COLOURS]
    signal, noise = photographed(truth, response, NOISE_OF_COLOURS, rng)
    nothing = np.zeros((24, bands))
    samples = PatchSamples(seen[:, used], error[:, used, None] ** 2 * np.eye(bands), np.ones(24),
                           nothing, nothing)
    started = time.process_time()
    made = calibrate_chart([ChartPhoto(samples, patches, UnknownLight())], FINE_GRID)
    fitted = time.process_time() - started
    assert made.prior_fit is not None and made.white is not None
    level = made.white.level
    relative = signal[:, used] / level
    own, common = made.prior_fit.patch_error
    surfaces = SurfaceSignals(tuple(map(str, range(len(truth)))), (False,) * len(truth), FINE_GRID,
                              truth, tuple(map(str, range(bands))), np.zeros(bands, int),
                              relative_response(made.calibration, FINE_GRID), relative, {})
    surfaces = replace(surfaces, errors={
        PHOTO_NOISE: (noise[:, used] / level)[:, :, None] ** 2 * np.eye(bands),
        SENSITIVITIES: sensitivity_covariance([made.calibration], surfaces),
        WHITE: proportional_covariance(relative, made.white.covariance[:bands, :bands]),
        DISAGREEMENT: proportional_covariance(relative, own**2 * np.eye(bands) + common**2)})
    figures, prior = [], load_prior()
    for number, spectrum in enumerate(truth):
        solved = solve_posterior(prior, measurement(surfaces, number))
        coarse = np.interp(PRIOR_GRID.nm, FINE_GRID.nm, spectrum)
        lower, upper = solved.band(0.95)
        figures.append((np.sqrt(np.mean((solved.mean - coarse) ** 2)),
                        np.mean((lower <= coarse) & (coarse <= upper)), np.mean(upper - lower)))
    rmse, holds, width = np.mean(figures, axis=0)
    independent = len(next(iter(errors_by_cause(surfaces, 0).values())))
    return (f"{lamps:3d} lamps of {width_nm:g} nm, {'every' if every else 'strongest':9s} "
            f"{bands:3d} bands ({independent}): RMSE {rmse:.4f}, holds {holds:.3f}, width "
            f"{width:.3f}; fit {fitted:.1f} s, posteriors "
            f"{time.process_time() - started - fitted:.1f} s")


def bands_of(bands: int) -> np.ndarray:
    """Camera x lamp x step (bands, P): daylight, or as many LED lamps as give so many channels."""
    return sensitivities(CAMERA, FINE_GRID) * FINE_GRID.weights_nm if bands == 3 \
        else responses(bands // 3, max(60, 2160 / bands))


def flat_s(bands: int) -> tuple[float, float]:
    """Processor seconds of the chart's fit, and of all that ``flat`` computes of four samples."""
    rng, response = np.random.default_rng(SEED), bands_of(bands)
    patches = np.array([np.interp(FINE_GRID.nm, NM, each)
                        for each in chart_copy(np.random.default_rng(SEED))])
    seen, error = photographed(patches * (1 + PATCHES_OFF * rng.standard_normal((24, 1))),
                               response, NOISE_OF_PATCHES, rng)
    nothing, each = np.zeros((24, bands)), np.eye(bands)
    started = time.process_time()
    made = calibrate_chart([ChartPhoto(
        PatchSamples(seen, error[:, :, None] ** 2 * each, np.ones(24), nothing, nothing), patches,
        UnknownLight())], FINE_GRID)
    fitted = time.process_time() - started
    held_out_patches(made, patches)
    assert made.prior_fit is not None and made.white is not None
    truth = test_reflectances(FINE_GRID)["CES99"][[5, 30, 50, 80]]
    signal, noise = photographed(truth, response, NOISE_OF_COLOURS, rng)
    names, image = ("a", "b", "c", "d"), np.full((40, 60, bands), 0.2, np.float32)
    photo = LinearImage(image, 1e-6 * image, image > 1, 1.0, 0.01, None, None, PhotoKind.RAW,
                        "camera", "photo", "")
    quads = 5 + 30 * CLASSIC.centres_uv[:, None] + np.array([[0, 0], [3, 0], [3, 3], [0, 3]])
    points = np.full((4, 25, 2), 20.0) + rng.uniform(0, 5, (4, 25, 2))
    shown = FlatPhoto("photo", RegionSamples(names, signal, noise[:, :, None] ** 2 * each,
                                             np.full(4, 100), 0 * signal, points),
                      photo, photo, True, quads, CLASSIC, made.white, made.calibration)
    errors = FlatErrors(0.0, 0.002, made.prior_fit.patch_error)
    any_family: dict[str, tuple[str, ...]] = dict.fromkeys(names, ())
    signals = flat_signals([shown], [white_at_regions(shown, {}, errors)], any_family, {},
                           tuple(map(str, range(bands))), errors)
    sample_surfaces(signals, Sampling(), 0, any_family, lambda done, what: None)
    return fitted, time.process_time() - started


def picture_s(bands: int, side: int, patches: bool) -> tuple[float, float]:
    """Processor seconds of a picture of spectra, and its RMSE."""
    response = bands_of(bands) @ interpolation_matrix(PRIOR_GRID.nm, FINE_GRID.nm)
    response = response / response.sum(axis=1, keepdims=True)
    rng, count = np.random.default_rng(SEED), side * side
    colours = np.clip(np.vstack(list(test_reflectances(PRIOR_GRID).values())), 0.004, 0.996)
    truth = colours.astype(np.float32)[np.arange(count) % 24]
    if not patches:
        one, other = colours.astype(np.float32)[rng.integers(len(colours), size=(2, count))]
        share = rng.beta(0.15, 0.15, (count, 1)).astype(np.float32)
        truth = (share * one + (1 - share) * other) * rng.uniform(0.3, 1, (count, 1))
    noisy = truth @ response.T * (1 + 0.01 * rng.standard_normal((count, bands)))
    image = noisy.astype(np.float32).reshape(side, side, bands)
    started = time.process_time()
    mean, _ = uplift_image(image, response, load_prior())
    taken = time.process_time() - started
    return taken, float(np.sqrt(np.mean((mean.reshape(count, -1) - truth)**2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--lamps", default="4:80,6:40,12:25", help="number:width in nm, ...")
    parser.add_argument("--picture", type=int, default=0, help="pixels a side of pictures; none "
                        "by default")
    parser.add_argument("--fits", action="store_true", help="chart fits of 3 to 36 bands")
    asked = parser.parse_args()
    for word in filter(None, asked.lamps.split(",")):
        lamps, width_nm = word.split(":")
        for every in (False, True):
            print(row(int(lamps), float(width_nm), every), flush=True)
    first: tuple[float, float] | None = None
    for bands in (3, 9, 18, 36) if asked.fits else ():
        fit, whole = flat_s(bands)
        first = first or (fit, whole)
        print(f"{bands} bands: chart fit {fit:.1f} s, {fit / first[0]:.1f} of three bands; flat "
              f"{whole:.1f} s, {whole / first[1]:.1f} of three bands", flush=True)
    for patches in (True, False) if asked.picture else ():
        seconds: dict[int, float] = {}
        for bands in (3, 6, 12, 36):
            seconds[bands], rmse = picture_s(bands, asked.picture, patches)
            print(f"{asked.picture**2} pixels of {'patches' if patches else 'mixtures'}, {bands} "
                  f"bands: {seconds[bands]:.1f} s, {seconds[bands] / seconds[3]:.2f} of three "
                  f"bands, RMSE {rmse:.4f}", flush=True)


if __name__ == "__main__":
    main()
