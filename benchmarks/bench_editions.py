"""How surely a photo tells whether its ColorChecker was made before or since November 2014.

Charts are drawn as copies of either edition and photographed by cameras whose maker the prior does
not hold, as others photograph (``bench_unknown_makers --real``): daylight or filament, light that
falls off, glare, patches that are off. The light is stated nearly, or not at all. Printed are the
evidence, in nats for the edition since 2014, and what it is worth: of charts of which even odds
would make 90 % or more, how many there are and how many of them are right.

    python -m benchmarks.bench_editions --data FOLDER
"""
from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from spectrabox.calibrate.chart_calibration import CalibrationOptions, calibrate_chart
from spectrabox.radiometry.chart import CLASSIC, COPIES_BEFORE_2014
from spectrabox.radiometry.charts.classic_copies import ChartCopies, editions
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

SURE = np.log(9)        # nats: even odds make 90 % of it


def evidence(edition: ChartCopies, truth: np.ndarray, light: str, stated: bool,
             options: CalibrationOptions, rng: np.random.Generator) -> float | None:
    """Nats for the edition since 2014 over the one before, of a photo of a copy of one; None where
    the photo is refused.
    """
    photo = real_photo(truth, edition.drawn(rng), light, rng)
    if not stated:
        photo = replace(photo, light=UnknownLight())
    try:
        copy = calibrate_chart([photo], GRID, options).copy
    except SpectraboxError:
        return None
    return None if copy is None else -copy.evidence[COPIES_BEFORE_2014]


def main() -> None:
    """Print a row for each light that is stated or not, and for each edition."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/")
    parser.add_argument("--every", type=int, default=1, help="of the cameras, one in so many")
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    makers, kinds = makers_of(database), ("daylight", "filament")
    for stated in (False, True):
        nats: dict[str, list[float]] = {}
        for camera in range(0, len(makers), arguments.every):
            curves = database.curves[camera]
            truth = on_grid(database.nm, curves / curves.max(), GRID, database.names[camera])
            options = CalibrationOptions(prior=prior_without(database,
                                                             makers == makers[camera]))
            for number, edition in enumerate(editions(CLASSIC)):
                each = evidence(edition, truth, kinds[camera // arguments.every % 2], stated,
                                options, np.random.default_rng([camera, number, 43]))
                nats.setdefault(edition.name, []).extend([] if each is None else [each])
        print("light stated" if stated else "light unknown")
        right = {name: np.array(values) * (1 if name != COPIES_BEFORE_2014 else -1)
                 for name, values in nats.items()}
        for name, values in right.items():
            low, middle, high = np.percentile(values, (10, 50, 90))
            print(f"  {name:40s} n {len(values):3d}  nats for it {middle:5.1f} ({low:.1f} to "
                  f"{high:.1f})  right {np.mean(values > 0):4.0%}  sure and right "
                  f"{np.mean(values > SURE):4.0%}  sure and wrong {np.mean(values < -SURE):4.0%}")
        every = np.concatenate(list(right.values()))
        print(f"  surprise {np.mean(np.logaddexp(0, -every)):.2f} nats a chart by even odds "
              f"({np.log(2):.2f}: nothing is told)")


if __name__ == "__main__":
    main()
