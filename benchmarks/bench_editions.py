"""How surely a photo tells whether its ColorChecker was made before or since November 2014.

Charts are drawn as copies of either edition and photographed by cameras whose maker the prior does
not hold, as others photograph (``bench_unknown_makers --real``): in daylight and by a filament,
with light that falls off, glare, and patches that are off. The light is stated nearly, or not at
all. Printed is how often the evidence is for the edition that it was, and, of charts of which it is
beyond so many nats, how many there are and how many of them are named rightly.

    python -m benchmarks.bench_editions --data FOLDER
"""
from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.radiometry.chart import CLASSIC, COPIES_BEFORE_2014
from spectrabox.radiometry.charts.references import ChartCopies, editions
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.records.spectra import UnknownLight
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_unknown_makers import (
    GRID,
    makers_of,
    prior_without,
    read_camera_database,
    real_photo,
)

LIMITS = (1, 2, 3, 4, 5)        # nats


def evidence(edition: ChartCopies, truth: np.ndarray, light: str, stated: bool,
             prior: CameraPrior, rng: np.random.Generator) -> float | None:
    """Nats for the edition since 2014 over the one before, of a photo of a copy of one; None where
    the photo is refused.
    """
    photo = real_photo(truth, edition.drawn(rng), light, rng)
    if not stated:
        photo = replace(photo, light=UnknownLight())
    try:
        copy = calibrate_chart([photo], GRID, prior=prior).copy
    except SpectraboxError:
        return None
    return None if copy is None else -copy.evidence[COPIES_BEFORE_2014]


def main() -> None:
    """Print a row for each number of nats, with the light unknown and stated."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/")
    parser.add_argument("--every", type=int, default=1, help="of the cameras, one in so many")
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    makers = makers_of(database)
    for stated in (False, True):
        nats: list[float] = []      # for the edition that it was
        for camera in range(0, len(makers), arguments.every):
            curves = database.curves[camera]
            truth = on_grid(database.nm, curves / curves.max(), GRID, database.names[camera])
            prior = prior_without(database, makers == makers[camera])
            for kind, light in enumerate(("daylight", "filament")):
                for number, edition in enumerate(editions(CLASSIC)):
                    since = evidence(edition, truth, light, stated, prior,
                                     np.random.default_rng([camera, number, kind, 43]))
                    if since is not None:
                        nats.append(-since if edition.name == COPIES_BEFORE_2014 else since)
        right = np.array(nats)
        print(f"light {'stated' if stated else 'unknown'}: {right.size} charts, evidence for the "
              f"right edition of {np.mean(right > 0):.0%}, median {np.median(right):.1f} nats")
        for limit in LIMITS:
            told = np.abs(right) > limit
            print(f"  beyond {limit} nats {told.mean():4.0%}, of these right "
                  f"{np.mean(right[told] > 0):4.0%}")


if __name__ == "__main__":
    main()
