"""Lamps of a kind that the prior does not hold: how far products err, kind by kind.

One kind of lamp after another is left out of the prior, and lamps of that kind, published and by
formula, light simulated charts (see bench_unknown_light.py) that cameras photograph whose makers
are left out too. What the fit states of the products' errors is held against the errors made. The
widening of ``calibrate.products.product_fit`` is the factor by which standard errors are to be
multiplied so that the 90 % band of the products holds 90 % on average over the kinds; it is set
from this table with its default seed. Surfaces are 30 published test colours.

``--probabilities`` asks instead whether the stated probability of a kind is the share of charts it
is right for: measured lamps of lights/, daylights by a model of the atmosphere [Bird & Riordan
1986] and tinted filaments, none of them in the prior, cameras of makers that are left out, a
quarter with another infrared cut, and patches off by 1 to 1.6 % a band and 0 to 2.5 % in common.
It also counts how often a kind or a temperature is contradicted that is right, or wrong.
``--published`` takes published lamps in place of measured ones, each left out of the prior with all
that are nearly it; the power of the evidence in ``calibrate.products.product_fit`` is the one
of least log loss there.
"""
from __future__ import annotations

import argparse
import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from spectrabox.calibrate.doubts import KIND_CONTRADICTS, nats_against
from spectrabox.calibrate.prior.learnt_prior import CameraDatabase, read_camera_database
from spectrabox.calibrate.products.lamps import (
    CCT_MIRED_SD,
    Lamps,
    all_lamps,
    blackbodies,
    colour_temperatures,
    product_prior,
)
from spectrabox.calibrate.products.product_fit import (
    EVIDENCE_POWER,
    SEED,
    WIDENING,
    fit_products,
    kind_probabilities,
)
from spectrabox.calibrate.products.product_posterior import posterior_of_products
from spectrabox.radiometry.records.spectra import UnknownLight
from spectrabox.radiometry.spectra.light_words import LIGHT_KINDS
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_unknown_light import (
    GRID,
    SURFACES,
    judged,
    lamps_without,
    products_found,
    simulated,
)
from benchmarks.bench_unknown_makers import makers_of, prior_without

NORMAL_90, HELD, BOOTSTRAPS = 1.645, 0.90, 50
NAMES = {"halogen": r"Filament|Planckian Radiation [23]",      # of measured lamps
         "fluorescent": r"Fluoresc|Discharge|\.FT\.| FL$|SON|FL3|HPS|Metal Halide|MCRI-\d+: [FH]",
         "led": r"LED|RGB|PHOS|Vio|^leds|rgb"}
EDGES = (0, 0.05, 0.2, 0.4, 0.6, 0.75, 0.9, 0.97, 1)      # of the stated probability
POWERS = (0.5, 0.6, 0.7, 0.75, 0.8, 0.9, 1.0)
NEARLY = 0.1                # rms, of a mean of 1: a lamp that stands for another
STATEMENTS = ("right kind", "wrong kind", "right temperature", "wrong temperature")
FAR_MIRED = 60              # of a temperature that is wrong
PATCH_ERRORS = ((0.01, 0.0), (0.008, 0.012), (0.016, 0.025))    # of a band, in common
# extraterrestrial sunlight, W m-2 um-1, and absorption of ozone, cm-1 [Bird & Riordan 1986]
SUN_NM = np.r_[400:560:10, 570, 593, 610, 630, 656, 668, 690, 710]
SUN = np.array([1479, 1701, 1740, 1587, 1837, 2005, 2043, 1987, 2027, 1896, 1909, 1927, 1831, 1891,
                1898, 1892, 1840, 1768, 1728, 1658, 1524, 1531, 1420, 1399])
OZONE = np.array([0, 0, 0, 0, 0, 3, 6, 9, 14, 21, 30, 40, 48, 63, 75, 85, 120, 119, 120, 90, 65, 51,
                  28, 18]) / 1000
EXACT = 1e-12               # of a product's whole mass: what is held at zero has no error


def run(database: CameraDatabase, kind: int, cases: int,
        rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
    """Errors of products in standard errors before widening, and figures of bands, of a kind."""
    lamps, makers = all_lamps(), np.asarray(makers_of(database))
    rest = lamps_without(lamps, lamps.kind != kind)
    of_kind = np.flatnonzero(lamps.kind == kind)
    share = lamps.weights[of_kind] / lamps.weights[of_kind].sum()
    sets = test_reflectances(GRID)
    tests = np.vstack([sets["CES99"], sets["NIST CQS test colours"]])
    errors, rows = [], []
    for _ in range(cases):
        camera, lamp = rng.integers(len(makers)), rng.choice(of_kind, p=share)
        prior = prior_without(database, makers == makers[camera])
        curves = on_grid(database.nm, database.curves[camera] / database.curves[camera].max(),
                         GRID, database.names[camera])
        case = simulated(curves, lamps.spectra[lamp],
                         tests[rng.choice(len(tests), SURFACES, replace=False)], rng)
        found, _ = fit_products([case.photo], prior, rest, GRID, "unknown light")
        nodes, truth, error = products_found(case, found)
        errors.append(np.abs(nodes - truth) / np.maximum(error / WIDENING, EXACT))
        rows.append(judged(case, prior, rest, found))
        print(".", end="", flush=True)
    return np.array(errors), {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def daylight(rng: np.random.Generator) -> np.ndarray:
    """Sun, low sun, shade or overcast sky, a quarter of them through window glass (P,)."""
    sky_alone, um = rng.random() < 0.4, SUN_NM / 1000
    zenith = rng.uniform(76, 86) if rng.random() < 0.3 else rng.uniform(20, 70)
    cosine = np.cos(np.radians(zenith))
    air = 1 / (cosine + 0.15 * (93.885 - zenith) ** -1.253)
    rayleigh = np.exp(-air / (um**4 * (115.6406 - 1.335 / um**2)))
    haze = np.exp(-air * rng.uniform(0.02, 0.2) * um ** -rng.uniform(0.6, 1.6))
    above = SUN * cosine * np.exp(-air * rng.uniform(0.25, 0.4) * OZONE)
    direct = above * rayleigh * haze
    sky = above * (0.5 * (1 - rayleigh**0.95) * haze**0.5 + 0.7 * rayleigh**1.5 * (1 - haze))
    global_light = np.interp(GRID.nm, SUN_NM, (rng.uniform(0, 0.1) if sky_alone else rng.uniform(
        0.3, 3.0)) * direct + sky)
    glass = rng.uniform(0.3, 1.5) * (rng.random() < 0.25)
    return np.asarray(global_light * np.exp(-glass * (
        0.1 * np.exp(-0.5 * ((GRID.nm - 760) / 120) ** 2)
        + 0.05 * np.exp(-0.5 * ((GRID.nm - 390) / 25) ** 2))))


def kind_by_name(name: str) -> int | None:
    """Index of the kind of a measured lamp; None where its name does not tell."""
    return next((LIGHT_KINDS.index(kind) for kind, words in NAMES.items()
                 if re.search(words, name)), None)


def asked_lamp(kind: int, known: Lamps, measured: tuple[np.ndarray, np.ndarray], published: bool,
               rng: np.random.Generator) -> tuple[np.ndarray, Lamps]:
    """A lamp (P,) of a kind that the prior does not hold, and the lamps of the prior."""
    if published and kind > 1:
        lamp = known.spectra[rng.choice([index for index in np.flatnonzero(known.kind == kind)
                                         if "formula" not in known.names[index]])]
        off = np.sqrt(np.mean((known.spectra - lamp) ** 2, axis=1))
        rest = lamps_without(known, off > NEARLY)
        share = np.bincount(known.kind, known.weights)
        weights = rest.weights * (share / np.bincount(rest.kind, rest.weights))[rest.kind]
        return lamp, replace(rest, weights=weights)
    if kind == 0:
        return daylight(rng), known
    if kind == 1 and (published or rng.random() < 0.5):
        tint = np.exp(0.15 * rng.standard_normal() * (GRID.nm - 550) / 150)
        return blackbodies(rng.uniform(2400, 3400, 1))[0] * tint, known
    return measured[0][rng.choice(np.flatnonzero(measured[1] == kind))], known


def probabilities(data: Path, database: CameraDatabase, cases: int, published: bool,
                  rng: np.random.Generator) -> dict[str, Any]:
    """Stated probabilities of the kinds against the share of charts that they are right for."""
    makers, known, stated, right = np.asarray(makers_of(database)), all_lamps(), [], []
    against: dict[str, list[float]] = {name: [] for name in STATEMENTS}
    other = np.random.default_rng(cases)        # of the stated temperatures
    with np.load(data / "lights" / "lights_for_checks.npz") as stored:
        measured = (np.array([np.interp(GRID.nm, stored["wavelengths_nm"], spectrum)
                              for spectrum in stored["spectra"]]),
                    np.array([kind_by_name(str(name)) for name in stored["names"]]))
    share = np.bincount(known.kind, known.weights)
    for _ in range(cases):
        kind, camera = rng.choice(len(share), p=share), rng.integers(len(makers))
        lamp, lamps = asked_lamp(kind, known, measured, published, rng)
        curves = on_grid(database.nm, database.curves[camera], GRID, database.names[camera])
        if rng.random() < 0.25:
            leak = np.exp(rng.uniform(0, 1.2) * np.clip((GRID.nm - 600) / 60, 0, 1.5))
            cut = 1 / (1 + np.exp((GRID.nm - rng.uniform(640, 690)) / 12))
            curves = curves * (leak if rng.random() < 0.5 else cut)
        photo = simulated(curves / curves.max(), lamp, np.zeros((0, GRID.nm.size)), rng,
                          *PATCH_ERRORS[rng.integers(len(PATCH_ERRORS))]).photo
        prior = product_prior(prior_without(database, makers == makers[camera]), lamps, SEED)
        posterior = posterior_of_products([photo], prior)
        stated.append(kind_probabilities(posterior))
        mired = 1e6 / float(colour_temperatures(lamp[None])[0])
        wrong = other.uniform(130, 380)         # 2600 to 7700 K
        said_of_it = [("right kind", UnknownLight(kind=LIGHT_KINDS[kind])),
                      *(("wrong kind", UnknownLight(kind=name))
                        for name in LIGHT_KINDS if name != LIGHT_KINDS[kind]),
                      ("right temperature", UnknownLight(
                          cct=1e6 / (mired + CCT_MIRED_SD * other.standard_normal())))]
        if abs(wrong - mired) > FAR_MIRED:
            said_of_it.append(("wrong temperature", UnknownLight(cct=1e6 / wrong)))
        for name, light in said_of_it:
            against[name].append(nats_against(posterior, light))
        right.append(np.arange(len(share)) == kind)
    said, true = np.array(stated), np.array(right)
    rows = []
    for low, high in pairwise(EDGES):
        chosen = true[(said > low) & (said <= high)]
        if chosen.size:
            held = chosen.mean()
            rows.append([low, high, chosen.size, said[(said > low) & (said <= high)].mean(), held,
                         np.sqrt(max(held * (1 - held), 1 / chosen.size) / chosen.size)])
    # stated = prior^(1 - power) posterior^power, up to a factor
    posterior = (said / share**(1 - EVIDENCE_POWER)) ** (1 / EVIDENCE_POWER)
    losses = {}
    for power in POWERS:
        tempered = share**(1 - power) * posterior**power
        losses[power] = round(float(-np.log((tempered / tempered.sum(axis=1, keepdims=True))[true]
                                            ).mean()), 4)
    return {"contradicted": {name: [len(nats), float(np.mean(np.array(nats) > KIND_CONTRADICTS))]
                             for name, nats in against.items()},
            "log loss by power": losses, "rows": np.round(rows, 3).tolist(),
            "most likely kind": [float(said.max(axis=1).mean()), float(np.mean(
                np.argmax(said, axis=1) == np.argmax(true, axis=1)))]}


def widening(errors: list[np.ndarray]) -> float:
    """The factor at which 90 % bands hold 90 % in the mean over kinds, each (cases, K, N) errors in
    stated standard errors.
    """
    factors = np.arange(0.5, 4.0, 0.01)
    held = [np.mean([np.mean(of_kind < NORMAL_90 * factor) for of_kind in errors])
            for factor in factors]
    return float(factors[np.searchsorted(held, HELD)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/")
    parser.add_argument("--cases", type=int, default=15, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--probabilities", action="store_true", help="of the kinds alone")
    parser.add_argument("--published", action="store_true", help="published lamps, left out")
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    if arguments.probabilities:
        with threadpool_limits(1):
            print(json.dumps(probabilities(arguments.data, database, arguments.cases,
                                           arguments.published,
                                           np.random.default_rng(arguments.seed)), indent=1))
        return
    table, errors = {}, []
    with threadpool_limits(1):
        for kind, name in enumerate(LIGHT_KINDS):
            of_kind, figures = run(database, kind, arguments.cases,
                                   np.random.default_rng([arguments.seed, kind]))
            errors.append(of_kind)
            table[name] = {"needs": float(np.quantile(of_kind, HELD) / NORMAL_90), **figures}
    rng = np.random.default_rng(arguments.seed)
    again = [widening([of_kind[rng.integers(len(of_kind), size=len(of_kind))]
                       for of_kind in errors]) for _ in range(BOOTSTRAPS)]
    print()
    print(json.dumps({"kinds": table, "widening": widening(errors),
                      "its standard error, charts drawn again": float(np.std(again)),
                      "widening in use": WIDENING}, indent=1))


if __name__ == "__main__":
    main()
