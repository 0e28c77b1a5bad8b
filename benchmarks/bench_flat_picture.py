"""``spectrabox flat --picture`` of a calibrated session: seconds, processor seconds and memory, by
photos of several sizes.

The photo shows a chart and, on its right half, 256 fields that go from one published test colour to
another, under light that falls off by a third, with 1 % of noise. A pixel of the picture is a tile
of four of the photo's.
"""
from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from fractions import Fraction
from pathlib import Path

import numpy as np

from spectrabox.fixtures import lamp
from spectrabox.fixtures.demo_photos import camera_sensitivities
from spectrabox.fixtures.flat_sample import (
    chart_corners,
    lamplight,
    surface_signals,
    vignetting,
    write_photo,
)
from spectrabox.fixtures.paints import NM, chart_truth
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra.named_spectra import test_reflectances

FIELDS = 16                 # along either side
CHART, LEFT = (0.05, 0.06, 0.40), 0.5
REGION = (0.55, 0.06, 0.60, 0.10)
LAMPS = [(-0.2, -1.1, 2.9, 1.0), (2.1, 1.0, 3.4, 0.25)]


def write_colours(path: Path, megapixels: float) -> None:
    """Write the photo."""
    width = width_of(megapixels)
    size = round(width / 3) * 2, width
    rng = np.random.default_rng(1)
    sets = test_reflectances(grid_from_nm(NM[20:-30]))
    surfaces = np.pad(np.clip(np.vstack(list(sets.values())), 0, 1), ((0, 0), (20, 30)), "edge")
    responses = camera_sensitivities() * lamp.radiance(NM)
    chosen = surfaces[rng.integers(len(surfaces), size=2 * FIELDS**2)] @ responses.T
    picture = surface_signals(size, responses, chart_truth(rng), chart_corners(*CHART), [],
                              np.full(NM.size, 0.2))
    first, second = chosen.astype(np.float32).reshape(2, FIELDS, FIELDS, 3)
    left = round(LEFT * width)
    column = np.arange(width - left) * FIELDS // (width - left)
    for y in range(size[0]):
        row, share = divmod(y * FIELDS / size[0], 1)
        picture[y, left:] = (first[int(row)] + share * (second - first)[int(row)])[column]
    light = lamplight(size, LAMPS, 0.08) * vignetting(size, 0.95)
    picture *= light[..., None].astype(np.float32)
    write_photo(path, picture, Fraction(1, 60), rng)


def region_of(megapixels: float) -> str:
    """The option that names a region of the photo."""
    return "--region=ground=" + ",".join(str(round(side * width_of(megapixels)))
                                         for side in REGION)


def width_of(megapixels: float) -> int:
    """Of a photo of 3 : 2, in pixels."""
    return round((1e6 * megapixels * 1.5) ** 0.5 / 2) * 2


def measured(words: list[str]) -> dict[str, float]:
    """One whole process."""
    started = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", "spectrabox", *words],
                               stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(words)} failed")
    return {"seconds": time.perf_counter() - started,
            "processor_seconds": used.ru_utime + used.ru_stime, "GiB": used.ru_maxrss / 2**20}


def row(megapixels: float) -> dict[str, float]:
    """The command of a session that is calibrated already."""
    with tempfile.TemporaryDirectory() as folder:
        photo = Path(folder) / "photo.dng"
        # by another process: on Linux the memory of a process counts as its children's too
        subprocess.run([sys.executable, "-m", "benchmarks.bench_flat_picture", "--write",
                        str(photo), "--megapixels", str(megapixels)], check=True)
        words = ["flat", str(photo), region_of(megapixels)]
        measured(words)
        found = measured([*words, "--picture"])
        written = Path(folder) / "photo-flat" / "results" / "picture"
        return {"megapixels": megapixels, **found,
                "written_GiB": sum(file.stat().st_size for file in written.iterdir()) / 2**30}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megapixels", type=float, nargs="+", default=[4, 24])
    parser.add_argument("--write", type=Path, help="only write the photo of the first size")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    if asked.write:
        write_colours(asked.write, asked.megapixels[0])
        return
    rows = [row(megapixels) for megapixels in asked.megapixels]
    if asked.json:
        print(json.dumps(rows))
        return
    print("".join(f"{name:>19}" for name in rows[0]))
    for each in rows:
        print("".join(f"{value:19.2f}" for value in each.values()))


if __name__ == "__main__":
    main()
