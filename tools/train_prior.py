"""Trains the prior that ships with the project, surface_families.npz, or one of your own.

    python -m tools.train_prior DATA --out surface_families.npz
    python -m tools.train_prior --library paint=pigments --library textile=cloth --out mine.npz

DATA holds the libraries that sampling/prior/models/surface_families.md lists, one folder each. A
library of your own is a folder of measured reflectances, after the family of its surfaces, or
"mixed". Each library and each model of a family is left out in turn; what the calibrated bands did
on it is printed.
"""
from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, save_prior

from tools.prior_calibration import LeftOut, band_figures, train
from tools.prior_training import MIXED, Library

LIBRARIES = {"paint": ("kremer_pigments", "ntu_watercolour"), MIXED: ("rawtoaces190",),
             "earth": ("usgs_minerals", "cassava")}
CAMERA, LIGHT, SEED = "Nikon 5100 (NPL)", "D65", 0      # that bands are calibrated with


def response() -> np.ndarray:
    """Response (3, 61) that the bands are calibrated with, rows summing to 1."""
    fine = visible_grid()
    return relative_response(CAMERA, LIGHT, fine) @ interpolation_matrix(PRIOR_GRID.nm, fine.nm)


def table(prior: LogitMixture, left_out: Sequence[LeftOut]) -> str:
    """What the calibrated 95 % bands did on each part left out, its family stated and not."""
    lines = [f"{'left out':<20} {'family':<8} {'curves':>6}"
             + f" | {'RMSE':>7} {'95 % holds':>10} {'width':>6}" * 2 + "   (none stated | stated)"]
    for part in left_out:
        line = f"{part.name:<20} {part.family:<8} {part.curves:6d}"
        for kind, judgement in (("unstated", part.unstated), ("stated", part.stated)):
            if judgement is None:
                line += f" | {'only where stated':>25}"
            else:
                coverage, width = band_figures(prior, part, kind)
                line += f" | {judgement.rmse:7.4f} {coverage:10.3f} {width:6.3f}"
        lines.append(line)
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("data", type=Path, nargs="?", help="folder of the shipped libraries")
    parser.add_argument("--library", action="append", default=[], metavar="FAMILY=FOLDER")
    parser.add_argument("--out", type=Path, required=True, help="the .npz to write")
    given = parser.parse_args(arguments)
    if (given.data is None) == (not given.library):
        parser.error("give DATA or --library FAMILY=FOLDER")
    folders = [text.partition("=")[::2] for text in given.library] if given.library else \
        [(family, given.data / name) for family, names in LIBRARIES.items() for name in names]
    libraries: dict[str, list[Library]] = {}
    for family, folder in folders:
        path = Path(folder)
        libraries.setdefault(family, []).append((path.resolve().name, read_library(path)))
    prior, left_out = train(libraries, response(), SEED)
    save_prior(given.out, prior)
    print(table(prior, left_out))


if __name__ == "__main__":
    main()
