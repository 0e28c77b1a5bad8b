"""What bands hold by family, level and wavelength, before and after: two priors on surfaces that
neither was trained on.

The surfaces are simulated by other formulas than those of the prior's models (other_surfaces.py),
each judged with no family stated and with its own, and the sets that colour-science ships, with
none. ``--before`` is the file of an earlier prior, of any format that this program ever wrote.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.spectra.named_spectra import relative_response, test_reflectances
from spectrabox.sampling.prior.mixture import (
    EDGE,
    PRIOR_GRID,
    LogitMixture,
    load_prior,
    of_families,
)
from spectrabox.sampling.prior.mixture_posterior import calibrated_bands, posterior

from benchmarks.other_surfaces import OTHERS

LEVELS = (0.5, 0.8, 0.9, 0.95)
TENTHS = np.array_split(np.arange(PRIOR_GRID.nm.size), 10)
BRIGHT = 0.6


def earlier_prior(path: Path) -> LogitMixture:
    """A prior of this or an earlier format; the first knew one family and one factor a level."""
    with np.load(path) as stored:
        arrays = {name: np.asarray(stored[name]) for name in stored.files}
    families = tuple(arrays["families"].tolist()) if "families" in arrays else ("any",)
    shape = (len(families), arrays["levels"].size, PRIOR_GRID.nm.size)
    factors = arrays["band_factors"].astype(float)
    factors = factors if factors.ndim == 3 else np.broadcast_to(factors[:, None], shape)
    return LogitMixture(
        PRIOR_GRID.nm, arrays["weights"], arrays["means"].astype(float),
        arrays["covariances"].astype(float), families,
        arrays.get("family", np.zeros(arrays["weights"].size)), arrays["levels"], factors,
        arrays.get("stated_factors", factors).astype(float), float(arrays["curve_factor"]),
        float(arrays["familiar_surprise"]), float(arrays.get("width_power", 0.0)),
        str(arrays["source"]))


def judged(prior: LogitMixture, response: np.ndarray, truth: np.ndarray) -> dict[str, Any]:
    """Figures of the bands for noise-free signals of reflectances (n, 61)."""
    bands = len(response)
    mixture = posterior(prior, response, truth @ response.T, np.zeros((bands, bands)))
    mean, ends = calibrated_bands(prior, mixture, LEVELS)
    held = {level: (truth >= lower) & (truth <= upper)
            for level, (lower, upper) in zip(LEVELS, ends, strict=True)}
    lower, upper = ends[-1]
    tenths = [float(held[0.95][:, tenth].mean()) for tenth in TENTHS]
    bright = truth > BRIGHT
    return {"rmse": float(np.sqrt(np.mean((mean - truth)**2, axis=1)).mean()),
            "holds": {str(level): float(inside.mean()) for level, inside in held.items()},
            "width": float(np.mean(upper - lower)), "tenths": tenths,
            "bright": float(held[0.95][bright].mean()) if bright.any() else None}


def rows_of(prior: LogitMixture, response: np.ndarray, count: int,
            seed: int) -> list[dict[str, Any]]:
    """Figures of every set of surfaces, with no family stated and with its own."""
    rows = []
    for number, (make, family) in enumerate(OTHERS.items()):
        truth = np.clip(make(np.random.default_rng(seed + number), count), EDGE, 1 - EDGE)
        stated = judged(of_families(prior, [family]), response, truth) \
            if family in prior.families else None
        rows.append({"name": f"simulated {make.__name__}", "stated": stated}
                    | judged(prior, response, truth))
    for name, values in test_reflectances(PRIOR_GRID).items():
        truth = values[np.all((values >= 0) & (values <= 1), axis=1)]
        halves = {f"{name}, even half": truth[::2], f"{name}, odd half": truth[1::2]} \
            if name == "CES99" else {name: truth}
        rows += [{"name": half, "stated": None} | judged(prior, response, curves)
                 for half, curves in halves.items()]
    return rows


def line(row: dict[str, Any]) -> str:
    """One row of the table, as Markdown."""
    stated, bright = row["stated"], row["bright"]
    cells = [row["name"], f"{row['rmse']:.3f}",
             " / ".join(f"{row['holds'][str(level)]:.2f}" for level in LEVELS[:-1]),
             f"{row['holds']['0.95']:.3f}", f"{row['width']:.3f}", f"{row['tenths'][0]:.2f}",
             f"{min(row['tenths']):.2f}", "" if bright is None else f"{bright:.2f}",
             "" if stated is None else
             f"{stated['rmse']:.3f}, {stated['holds']['0.95']:.3f}, {stated['width']:.3f}"]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, help="file of an earlier prior")
    parser.add_argument("--sensitivity", default="CIE 1931 2 Degree Standard Observer")
    parser.add_argument("--light", default="D65")
    parser.add_argument("--count", type=int, default=300, help="of each simulated set")
    parser.add_argument("--seed", type=int, default=1000, help="of the first simulated set")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of tables")
    arguments = parser.parse_args()
    fine = visible_grid(1)
    response = relative_response(arguments.sensitivity, arguments.light, fine) \
        @ interpolation_matrix(PRIOR_GRID.nm, fine.nm)
    priors = {"before": earlier_prior(arguments.before)} if arguments.before else {}
    priors["after"] = load_prior()
    tables = {name: rows_of(prior, response, arguments.count, arguments.seed)
              for name, prior in priors.items()}
    if arguments.json:
        print(json.dumps(tables))
        return
    for name, rows in tables.items():
        print(f"\n{name}, {arguments.sensitivity} under {arguments.light}\n")
        print("| set | RMSE | 50 / 80 / 90 % hold | 95 % holds | width | 400-430 nm | worst tenth "
              "| bright | family stated: RMSE, holds, width |")
        print("|--|--|--|--|--|--|--|--|--|")
        print("\n".join(line(row) for row in rows))
        print(f"\nmean width {np.mean([row['width'] for row in rows]):.3f}, RMSE "
              f"{np.mean([row['rmse'] for row in rows]):.4f}")


if __name__ == "__main__":
    main()
