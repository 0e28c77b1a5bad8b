"""Recovery of a spectrum from X, Y, Z: the five methods of colour-science beside ``sb.sample``,
with their times in one run.

    python -m benchmarks.bench_from_colour

The surfaces are published test colours that the prior never saw, 400-700 nm: every third of CES99
(CIE 224) and all of the NIST CQS. Each method gets the X, Y, Z of a surface under D65, as
``colour.XYZ_to_sd`` takes them; ``sb.sample`` gets the same, one after the other and all at once.
"""
from __future__ import annotations

import argparse
import json
import time
import warnings

import colour
import numpy as np

import spectrabox as sb
from spectrabox.radiometry.appearance import ciede2000, reflectance_to_lab
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.sampling.prior.mixture import PRIOR_GRID

METHODS = ("Jakob 2019", "Mallett 2019", "Meng 2015", "Otsu 2018", "Smits 1999")
SETS = {"CES99": slice(0, None, 3), "NIST CQS test colours": slice(None)}
NM = PRIOR_GRID.nm


def tristimulus(reflectances: np.ndarray) -> np.ndarray:
    """X, Y, Z (S, 3) under D65, Y = 100 of white, of reflectances (S, 61) at every 5 nm."""
    shape = colour.SpectralShape(400, 700, 5)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape).values[:, None]
    weights = cmfs.values * light
    return np.asarray(100 * reflectances @ weights / weights[:, 1].sum())


def by_colour(method: str, xyz: np.ndarray) -> np.ndarray:
    """The spectrum (61,) that a method of colour-science gives."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")         # of colours outside what a method was fitted to
        made = colour.XYZ_to_sd(xyz / 100, method=method)
    return np.interp(NM, made.wavelengths, made.values)


def judged(true: np.ndarray, recovered: np.ndarray) -> dict[str, float]:
    """RMSE of the spectra with the standard error of its mean over surfaces, and how far colours
    are off under the light that they were given for and another (mean CIEDE2000).
    """
    each = np.sqrt(np.mean((recovered - true) ** 2, axis=1))
    labs = [[np.array([reflectance_to_lab(NM, one, light) for one in spectra])
             for spectra in (true, recovered)] for light in ("D65", "A")]
    return {"rmse": float(each.mean()), "error": float(each.std(ddof=1) / np.sqrt(len(each))),
            **{f"dE00 {light}": float(ciede2000(*lab).mean())
               for light, lab in zip(("D65", "A"), labs, strict=True)}}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    as_json = parser.parse_args().json
    sets = test_reflectances(PRIOR_GRID)
    true = np.concatenate([sets[name][part] for name, part in SETS.items()])
    xyz = tristimulus(true)
    rows = []
    sb.sample(xyz=xyz[0])                       # what is loaded once is not in the times
    for method in METHODS:
        by_colour(method, xyz[0])
        began = time.process_time()
        recovered = np.array([by_colour(method, one) for one in xyz])
        rows.append({"method": f"colour, {method}", **judged(true, recovered),
                     "ms": 1000 * (time.process_time() - began) / len(xyz)})
    began = time.process_time()
    single = [sb.sample(xyz=one, noise=0.001) for one in xyz]
    means = np.array([one.mean for one in single])
    ours = {"method": "sb.sample, one by one", **judged(true, means),
            "ms": 1000 * (time.process_time() - began) / len(xyz)}
    bands = np.array([one.band() for one in single])
    held = np.mean((bands[:, 0] <= true) & (true <= bands[:, 1]), axis=1)
    rows.append(ours | {"held": float(held.mean()),
                        "held_error": float(held.std(ddof=1) / np.sqrt(len(held))),
                        "width": float(np.mean(bands[:, 1] - bands[:, 0]))})
    began = time.process_time()
    many = sb.sample(xyz=xyz, noise=0.001)
    means = np.array([one.mean for one in many.values()])
    rows.append({"method": "sb.sample, all at once", **judged(true, means),
                 "ms": 1000 * (time.process_time() - began) / len(xyz)})
    if as_json:
        print(json.dumps(rows))
        return
    print(f"{len(true)} surfaces; milliseconds of processor a spectrum\n")
    print("| method | RMSE | dE00 under D65 | under A | 95 % band holds (width) | ms |")
    print("|---|---|---|---|---|---|")
    for row in rows:
        band = f"{row['held']:.3f} ± {row['held_error']:.3f} ({row['width']:.3f})" \
            if "held" in row else "no band" if row["method"].startswith("colour") else "the same"
        print(f"| {row['method']} | {row['rmse']:.4f} ± {row['error']:.4f} | {row['dE00 D65']:.2f} "
              f"| {row['dE00 A']:.2f} | {band} | {row['ms']:.1f} |")


if __name__ == "__main__":
    main()
