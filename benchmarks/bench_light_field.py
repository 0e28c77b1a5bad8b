"""The light away from a chart, under one lamp and two, and two kinds of light named by a chart.

Fields of small lamps 0.8 to 3 picture widths above the sample, with ambient light and vignetting
(fixtures/flat_sample.py shares no code with what is judged), over a chart at the left of the
picture whose patches err by 0.8 %: by distance from the chart in its widths the error of the log
light at points of the picture, its bias, the slope of the estimate against the truth, the stated
error, how often the 95 % band holds, and which share of the stated variance a photo of the same
chart by the same lens under other lamps repeats.

``--data FOLDER`` photographs charts between two small lamps of different measured spectra instead,
0.15 to 1 picture widths above them, by cameras of makers that are left out of the prior, the light
stated in half of the cases: how often the warning of two kinds of light is given, by how far the
light's colour drifts over the chart. Every second chart has one lamp.
"""
from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_equations import FIELD_SD, field_terms
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.light_field import light_at_regions
from spectrabox.calibrate.prior.learnt_prior import read_camera_database
from spectrabox.fixtures.flat_sample import lamplight, vignetting
from spectrabox.radiometry import chart_causes
from spectrabox.radiometry.chart import CLASSIC, chart_reflectances, plane_centres
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.calibration import ChartWhite
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_unknown_makers import makers_of, prior_without

SIZE, CHART, POINTS = (200, 300), 0.22, 15      # rows, columns; the chart's share of the width
CORNER = np.array([0.05, 0.26])                 # of the chart, in widths of the picture
PATCH_ERROR, NORMAL_95 = 0.008, 1.96
DISTANCES = (0.0, 0.5, 1.0, 1.6, 2.6)           # from the chart, in its widths
DRIFTS = (0.0, 0.01, 0.02, 0.04, 0.08, np.inf)
GRID = visible_grid()


def field(lamps: int, rng: np.random.Generator) -> np.ndarray:
    """Light (H, W) over a picture, before the lens."""
    places = [(*rng.uniform(-0.6, 1.6, 2), rng.uniform(0.8, 3.0), strength)
              for strength in [1.0, rng.uniform(0.3, 1.0)][:lamps]]
    return lamplight(SIZE, places, rng.uniform(0, 0.3))


def from_side(side: int, rng: np.random.Generator) -> np.ndarray:
    """Light (H, W) of a small lamp at one side of the chart, 0.15 to 1 picture widths above it."""
    x, y = CORNER + CHART * np.array([0.5 + side * rng.uniform(0.2, 2.0), rng.uniform(-0.5, 1.2)])
    return lamplight(SIZE, [(x, y, rng.uniform(0.15, 1.0), 1.0)])


def in_plane(places: np.ndarray) -> np.ndarray:
    """Points (n, 2) of the picture, given in its widths, in the plane of the chart."""
    return np.asarray((places - CORNER) / CHART)


def in_picture(places: np.ndarray) -> np.ndarray:
    """The same from the middle of the picture, half of its diagonal being 1."""
    middle = np.array([0.5, 0.5 * SIZE[0] / SIZE[1]])
    return np.asarray((places - middle) / np.hypot(*middle))


def read_at(light: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The log light (n,) at places (n, 2)."""
    column, row = (places * SIZE[1]).astype(int).T
    return np.asarray(np.log(light[row, column]))


def away_from_chart(lamps: int, fields: int, rng: np.random.Generator) -> np.ndarray:
    """Distance, error, stated error, true and estimated log light, and the error of a photo under
    other lamps (6, fields x POINTS).
    """
    again = np.random.default_rng(fields)
    patches = CORNER + CHART * plane_centres()
    terms = np.column_stack([np.ones(len(patches)), field_terms(in_plane(patches))])
    beforehand = np.diag(np.r_[0.0, np.full(terms.shape[1] - 1, FIELD_SD**-2)])
    covariance = np.linalg.inv(terms.T @ terms / PATCH_ERROR**2 + beforehand)
    whole = np.pad(covariance, (0, 1))
    whole[-1, -1] = 1e-12                       # no glare
    rows = []

    def estimate(seen: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        level, *shape = covariance @ terms.T @ seen / PATCH_ERROR**2
        white, _, shown, errors = light_at_regions(
            ChartWhite(np.exp([level]), np.array(shape), np.zeros(1), whole),
            [in_plane(each) for each in (patches, *places[:, None])],
            [in_picture(each) for each in (patches, *places[:, None])], False)
        carry = np.column_stack([np.ones(POINTS), np.zeros(POINTS), np.eye(POINTS)])
        return np.log(white) + shown, np.sqrt(np.diag(carry @ errors @ carry.T))

    for _ in range(fields):
        light, lens = field(lamps, rng), vignetting(SIZE, rng.uniform(0.7, 1))
        places = np.column_stack([rng.uniform(0.02, 0.98, POINTS), rng.uniform(0.02, 0.64, POINTS)])
        patch_errors = PATCH_ERROR * rng.standard_normal(len(patches))
        lights = [light * lens, field(lamps, again) * lens]
        (found, spread), (other, _) = (estimate(read_at(one, patches) + patch_errors, places)
                                       for one in lights)
        true = read_at(lights[0], places)
        outside = np.maximum(np.maximum(patches.min(axis=0) - places, places
                                        - patches.max(axis=0)), 0)
        level = read_at(lights[0], patches).mean()
        rows.append([np.hypot(*outside.T) / CHART, found - true, spread, true - level,
                     found - level, other - read_at(lights[1], places)])
    return np.hstack(rows)


def named(data: Path, cases: int, rng: np.random.Generator) -> np.ndarray:
    """Drift of the light's colour over a chart and whether two kinds are named (cases, 2)."""
    database = read_camera_database(data / "cameras")
    makers = np.asarray(makers_of(database))
    with np.load(data / "lights" / "lights_for_checks.npz") as stored:
        spectra = np.array([np.interp(GRID.nm, stored["wavelengths_nm"], spectrum)
                            for spectrum in stored["spectra"]])
    reflectances = chart_reflectances("BabelColor Average", GRID)
    patches = CORNER + CHART * plane_centres()
    rows = []
    for case in range(cases):
        camera, lamps = rng.integers(len(makers)), spectra[rng.choice(len(spectra), 2, False)]
        curves = on_grid(database.nm, database.curves[camera], GRID, database.names[camera])
        lights = [np.exp(read_at(from_side(side, rng), patches)) for side in (-1, 1)]
        share = rng.uniform(0, 1) if case % 2 else 0.0
        signal = sum(part * light[:, None] * (reflectances @ (curves * lamp * GRID.weights_nm).T)
                     for part, light, lamp in zip((1 - share, share), lights, lamps, strict=True))
        white = sum(part * light[:, None] * (curves * lamp).sum(axis=1)
                    for part, light, lamp in zip((1 - share, share), lights, lamps, strict=True))
        colour = np.log(white / white.mean(axis=1, keepdims=True))
        own, common = rng.choice([0.002, 0.008, 0.016]), rng.choice([0.003, 0.012, 0.025])
        signal = signal * (1 + own * rng.standard_normal(signal.shape)
                           + common * rng.standard_normal((len(signal), 1)))
        zero = np.zeros(signal.shape)
        samples = PatchSamples(signal / signal.max(), np.zeros((24, 3, 3)), np.ones(24), zero, zero)
        mixed = (1 - share) * lamps[0] + share * lamps[1]
        known = (Spectrum(GRID, mixed, Quantity.RELATIVE, "stated") if rng.random() < 0.5
                 else UnknownLight())
        photo = ChartPhoto(samples, reflectances, known, chart=CLASSIC)
        try:
            made = calibrate_chart([photo], GRID, prior=prior_without(
                database, makers == makers[camera])).calibration
        except SpectraboxError:
            continue                            # a refusal is no PASS
        # by itself, or among the causes that the photo leaves open
        warned = any(one.code == "light.two-kinds"
                     or chart_causes.TWO_LIGHTS in one.values.get("causes", ())
                     for one in made.findings)
        rows.append([np.ptp(colour, axis=0).max() * (share > 0), warned])   # one lamp: round-off
    return np.array(rows)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder with cameras/ and lights/")
    parser.add_argument("--cases", type=int, default=60, help="fields, or charts")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    with threadpool_limits(1):
        if asked.data:
            drift, warned = named(asked.data, asked.cases, np.random.default_rng(asked.seed)).T
            print("drift of colour       charts  named")
            for low, high in [(-1.0, 0.0), *pairwise(DRIFTS)]:
                chosen = (drift > low) & (drift <= high)
                if chosen.any():
                    print(f"{max(low, 0):5.0%} to {high:5.0%}       {chosen.sum():4d}  "
                          f"{warned[chosen].mean():5.0%}")
            return
        print("from the chart  lamps  points   rms     bias   slope  stated  95 % band holds  "
              "repeated")
        for lamps in (1, 2):
            away, error, stated, true, estimate, other = away_from_chart(
                lamps, asked.cases, np.random.default_rng([asked.seed, lamps]))
            for low, high in pairwise(DISTANCES):
                of = (away > low) & (away <= high)
                slope = np.polyfit(true[of], estimate[of], 1)[0]
                print(f"{low:.1f} to {high:.1f}      {lamps:5d}  {of.sum():6d}  "
                      f"{np.sqrt(np.mean(error[of]**2)):6.1%}  {error[of].mean():6.1%}  "
                      f"{slope:5.2f}  {np.sqrt(np.mean(stated[of]**2)):6.1%}  "
                      f"{np.mean(np.abs(error[of]) < NORMAL_95 * stated[of]):6.1%}            "
                      f"{np.mean(error[of] * other[of]) / np.mean(stated[of]**2):5.2f}")


if __name__ == "__main__":
    main()
