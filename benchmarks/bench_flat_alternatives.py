"""Flat samples beside a chart, by ``spectrabox flat`` and by what a user would do otherwise.

The photos are those of bench_flat.py, and every method is given the same: the 24 patches of the
chart with their published average, and the mean signal of each region.

    least squares       reflectance = M signal, M from the patches, with a ridge that is chosen by
                        leaving each patch out [Heikkinen et al. 2007]; of the three signals, or
                        of their six root-polynomial terms of degree 2
    Wiener              linear estimate of least mean square error from the patches' statistics
                        about their mean, noise by leaving each patch out; with camera and light
                        known, the reflectances' covariance and the noise that the patches show
                        [Shimano 2006]
    root-polynomial     camera signals to X, Y, Z under D65 by terms of degree 2 [Finlayson,
    regression          Mackiewicz & Hurlbert 2015], then one spectrum of that colour [Otsu et al.
                        2018; Jakob & Hanika 2019], all by colour-science

None of them knows how the light falls off from the chart to a region. So each is tried twice: with
the signals as photographed, and with those divided by the light that ``spectrabox flat`` found,
which is more than a user has.
"""
from __future__ import annotations

import argparse
import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.appearance import ciede2000, lab_from_xyz, tristimulus_weights
from spectrabox.radiometry.chart import COPIES_SINCE_2014, chart_reflectances
from spectrabox.radiometry.colour_science import upsampled
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra.spectrum_files import on_grid
from spectrabox.session.kept_stages import FinishedRun

from benchmarks.bench_flat import KINDS, FlatCase, figures_of_case, flat_cases, summary

GRID = grid_from_nm(np.arange(400.0, 701.0, 5.0))
LIGHTS = ("D65", "A", "FL11")
FIGURES = ("rmse", *LIGHTS)
RIDGES = np.logspace(-8, 0, 33)         # of the mean square of the terms
OURS = "spectrabox flat, light unknown"
UNEVEN, EVENED = "as photographed", "fall-off known"


def least_squares(terms: np.ndarray, reflectances: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Reflectances (n, P) by ridge regression.

    Parameters
    ----------
    terms : (I, T) array
        Of the patches.
    reflectances : (I, P) array
        Of the patches.
    wanted : (n, T) array
        Terms of the samples.
    """
    gram = terms.T @ terms
    def solved(ridge: float) -> np.ndarray:
        return np.asarray(np.linalg.inv(
            gram + ridge * np.trace(gram) / len(gram) * np.eye(len(gram))) @ terms.T)
    def left_out(ridge: float) -> float:
        hat = terms @ solved(ridge)
        off = (reflectances - hat @ reflectances) / (1 - np.diag(hat))[:, None]
        return float(np.mean(off**2))
    return np.asarray(wanted @ solved(min(RIDGES, key=left_out)) @ reflectances)


def wiener_of_chart(patches: np.ndarray, reflectances: np.ndarray,
                    samples: np.ndarray) -> np.ndarray:
    """The same about the patches' mean: covariances of reflectance and signal, and white noise."""
    centre, mean = patches.mean(axis=0), reflectances.mean(axis=0)
    return mean + least_squares(patches - centre, reflectances - mean, samples - centre)


def wiener_of_model(products: np.ndarray, patches: np.ndarray, reflectances: np.ndarray,
                    samples: np.ndarray) -> np.ndarray:
    """Reflectances (n, P) by Wiener's filter with known products (K, P), rows summing to 1."""
    seen = reflectances @ products.T
    gain = np.sum(patches * seen, axis=0) / np.sum(seen**2, axis=0)
    noise = np.mean((patches / gain - seen) ** 2)
    mean, prior = reflectances.mean(axis=0), np.cov(reflectances, rowvar=False)
    block = products @ prior @ products.T + noise * np.eye(len(products))
    return np.asarray(mean + (samples / gain - mean @ products.T)
                      @ np.linalg.solve(block, products @ prior))


def root_polynomial(patches: np.ndarray, reflectances: np.ndarray,
                    samples: np.ndarray) -> np.ndarray:
    """X, Y, Z (n, 3) under D65, over the perfect reflector's."""
    from colour.characterisation import (
        apply_matrix_colour_correction_Finlayson2015,
        matrix_colour_correction_Finlayson2015,
    )
    weights = tristimulus_weights(GRID.nm, "D65")
    matrix = matrix_colour_correction_Finlayson2015(patches, reflectances @ weights.T, 2)
    return np.asarray(apply_matrix_colour_correction_Finlayson2015(samples, matrix, 2)
                      / weights.sum(axis=1))


def alternatives(case: FlatCase, patches: np.ndarray, samples: np.ndarray) -> dict[str, np.ndarray]:
    """Reflectances (n, P) by each method.

    Parameters
    ----------
    case : FlatCase
    patches : (24, K) array
    samples : (n, K) array
    """
    from colour.characterisation import polynomial_expansion_Finlayson2015
    reflectances = chart_reflectances(COPIES_SINCE_2014, GRID)
    scale = patches.max(axis=0)
    patches, samples = patches / scale, samples / scale
    fine = np.array([np.interp(np.arange(400.0, 701.0), NM, row) for row in case.products])
    products = fine @ np.array([np.interp(np.arange(400.0, 701.0), GRID.nm, unit)
                                for unit in np.eye(GRID.nm.size)]).T
    products = products / products.sum(axis=1, keepdims=True)
    xyz = root_polynomial(patches, reflectances, samples)
    terms = [polynomial_expansion_Finlayson2015(signals, 2) for signals in (patches, samples)]
    return {
        "least squares": least_squares(patches, reflectances, samples),
        "least squares, root-polynomial terms": least_squares(terms[0], reflectances, terms[1]),
        "Wiener": wiener_of_chart(patches, reflectances, samples),
        "Wiener, camera and light known": wiener_of_model(products, patches, reflectances, samples),
        **{f"root-polynomial regression, {method}": np.array(
            [upsampled(np.maximum(one, 1e-3), GRID, method) for one in xyz])
            for method in ("Otsu 2018", "Jakob 2019")}}


def figures(found: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """RMSE and CIEDE2000 under each light, means over the samples.

    Parameters
    ----------
    found, truth : (n, P) arrays
    """
    row = {"rmse": float(np.sqrt(np.mean((found - truth) ** 2, axis=1)).mean())}
    for light in LIGHTS:
        weights = tristimulus_weights(GRID.nm, light)
        labs = [lab_from_xyz(np.maximum(spectra, 0) @ weights.T, weights.sum(axis=1))
                for spectra in (found, truth)]
        row[light] = float(np.mean(ciede2000(*labs)))
    return row


def signals_of_run(run: FinishedRun) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Signals of patches (24, K) and regions (R, K), and the light on each that was found."""
    records = run.records
    assert records.calibrate.chart is not None
    field = records.calibrate.chart.irradiance
    return (records.charts[""].samples.mean, records.photo.regions[""].mean,
            field / np.exp(np.log(field).mean()),
            np.array([level for level, _ in records.flat_signals.light[""].values()]))


def judged(case: FlatCase) -> dict[str, dict[str, float]]:
    """Figures of every method on one photo."""
    truth = np.array([on_grid(NM, surface, GRID, "surface") for surface in case.surfaces])
    rows = {}
    for kind, run in case.runs.items():
        names = [f"s{number}" for number in range(len(truth))]
        means = np.array([np.interp(GRID.nm, *_mean(run, name)) for name in names])
        rows[f"spectrabox flat, light {kind}"] = figures(means, truth)
    patches, samples, field, light = signals_of_run(case.runs["unknown"])
    for words, by_patch, by_sample in ((UNEVEN, 1.0, 1.0),
                                       (EVENED, field[:, None], light[:, None])):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")     # of colours outside what Jakob & Hanika fit
            found = alternatives(case, patches / by_patch, samples / by_sample)
        rows |= {f"{name}; {words}": figures(spectra, truth) for name, spectra in found.items()}
    return rows


def _mean(run: FinishedRun, name: str) -> tuple[np.ndarray, np.ndarray]:
    summary = run.records.spectra[name]
    return summary.grid.nm, summary.mean


def measure(data: Path, cases: int, seed: int) -> tuple[dict[str, dict[str, list[float]]],
                                                          dict[str, Any]]:
    """Mean and standard error of every figure of every method, cases counting once each, and of
    what it is above ours with nothing known; and the summary of bench_flat.py on the same photos.
    """
    rows: list[dict[str, dict[str, float]]] = []
    of_bands = []
    for number, case in enumerate(flat_cases(data, cases, seed), start=1):
        if set(case.runs) == set(KINDS):
            rows.append(judged(case))
            of_bands.append(figures_of_case(case))
        print(f"{number}/{cases} {case.camera} {' '.join(case.refused)}",
              json.dumps({"methods": rows[-1:], "bands": of_bands[-1:]}), file=sys.stderr,
              flush=True)
    table: dict[str, dict[str, list[float]]] = {}
    for method in rows[0]:
        table[method] = {}
        for name in FIGURES:
            ours, theirs = (np.array([row[one][name] for row in rows]) for one in (OURS, method))
            table[method][name] = [float(value) for part in (theirs, theirs - ours)
                                   for value in (part.mean(),
                                                 part.std(ddof=1) / np.sqrt(len(rows)))]
    return table, summary(of_bands)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/ and lights/")
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    table, bands = measure(asked.data, asked.cases, asked.seed)
    if asked.json:
        print(json.dumps({"methods": table, "bands": bands}))
        return
    print("| method | RMSE | dE00, D65 | A | FL11 |\n|---|---|---|---|---|")
    for method, row in table.items():
        digits = {name: 4 if name == "rmse" else 2 for name in FIGURES}
        print(f"| {method} | " + " | ".join(
            f"{row[name][0]:.{digits[name]}f} ± {row[name][1]:.{digits[name]}f}"
            for name in FIGURES) + " |")
    near = [f"{method}, {name}: {row[name][2]:+.4f} ± {row[name][3]:.4f}" for method, row
            in table.items() if method != OURS for name in FIGURES
            if row[name][2] < 2 * row[name][3]]
    print("not behind by two standard errors, photo by photo:", *(near or ["none"]), sep="\n")
    print(json.dumps(bands, indent=1))


if __name__ == "__main__":
    main()
