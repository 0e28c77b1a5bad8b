"""How near families of surfaces made by physics come to measured reflectances, and how fast.

For every measured curve the nearest of as many that each family makes, root mean square over
400-700 nm. A family is compared on the curves that it is the nearest to, and on those known to be
of it: the leaves and the one skin among the patches of rawtoaces190, the skin of CIE 13.3, and the
grey patches of charts. Mixtures of measured pigments are made of Kremer's and compared with others.
"""
from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.sampling.prior.families.catalogue import FAMILIES
from spectrabox.sampling.prior.families.paint import pigment_mixtures
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import GRID

LIBRARIES = ("kremer_pigments", "ntu_watercolour", "rawtoaces190", "usgs_minerals", "cassava")
LEAVES, SKIN = [9, 10, 79, 80, 82, 84, 85, 86, 87, 88, 89], [17]    # of rawtoaces190
MAX_CURVES = 400


def nearest(curves: np.ndarray, made: np.ndarray) -> np.ndarray:
    """Distance (n,) of every curve (n, P) to the nearest that was made."""
    return np.array([np.sqrt(np.min(np.mean((made - curve)**2, axis=1))) for curve in curves])


def measured_sets(data: Path | None) -> dict[str, np.ndarray]:
    """Curves (n, 61) by name of their set."""
    sets = dict(test_reflectances(GRID))
    sets["skin of CIE 13.3"] = sets["CIE 13.3 test colours"][[28]]
    sets["grey patches"] = np.concatenate([sets[name][18:24] for name in ("BabelColor Average",
                                                                          "ISO 17321-1")])
    for name in LIBRARIES if data is not None else ():
        sets[name] = read_library(data / "reflectance" / name).reflectances
    if data is not None:
        sets["leaves of rawtoaces190"] = sets["rawtoaces190"][LEAVES]
        sets["skin of rawtoaces190"] = sets["rawtoaces190"][SKIN]
    return {name: curves[np.random.default_rng(1).permutation(len(curves))[:MAX_CURVES]]
            for name, curves in sets.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder with reflectance/; without it only the "
                        "sets that colour-science ships")
    parser.add_argument("--made", type=int, default=4000, help="reflectances of each model")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    sets, made, seconds = measured_sets(arguments.data), {}, {}
    models = {f"{name}: {model.__name__}": model for name, family in FAMILIES.items()
              for model in family.models | family.stated_models}
    if "kremer_pigments" in sets:
        models["paint: mixtures"] = lambda rng, count: pigment_mixtures(rng, count,
                                                                        sets["kremer_pigments"])
    for name, model in models.items():
        started = time.perf_counter()
        made[name] = model(np.random.default_rng(0), arguments.made)
        seconds[name] = time.perf_counter() - started
    rows = []
    for name, curves in sets.items():
        distance = np.array([nearest(curves, one) for one in made.values()])
        best = distance.argmin(axis=0)
        rows.append({"set": name, "curves": len(curves),
                     "nearest": float(np.median(distance.min(axis=0))),
                     "models": {model: {"curves": mine.size, "distance": float(np.median(mine))}
                                for index, model in enumerate(made)
                                if (mine := distance[index, best == index]).size}})
    if arguments.json:
        print(json.dumps({"sets": rows, "seconds": seconds}))
        return
    for row in rows:
        models_shown = ", ".join(f"{model} {one['curves']} ({one['distance']:.3f})"
                                 for model, one in row["models"].items())
        print(f"{row['set']:<24} {row['curves']:4d} curves, nearest {row['nearest']:.3f}: "
              f"{models_shown}")
    print(f"made {arguments.made} of each in " + ", ".join(f"{name} {taken:.2f} s"
                                                           for name, taken in seconds.items()))


if __name__ == "__main__":
    main()
