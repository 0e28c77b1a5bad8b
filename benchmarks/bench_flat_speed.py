"""``spectrabox flat`` from a photo to its report, and then ``--picture`` of the calibrated session:
seconds, processor seconds and memory, by photos of several sizes.

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
from typing import Any

import numpy as np

from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.flat_sample import (
    chart_corners,
    lamplight,
    surface_signals,
    vignetting,
    write_photo,
)
from spectrabox.fixtures.paints import NM, chart_copy
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra.named_spectra import test_reflectances

FIELDS = 16                 # along either side
CHART, LEFT = (0.05, 0.06, 0.40), 0.5
REGIONS = {"first": (0.505, 0.005, 0.525, 0.03), "second": (0.60, 0.10, 0.62, 0.12),
           "table": (0.10, 0.45, 0.20, 0.55)}      # in widths of the photo
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
    picture = surface_signals(size, responses, chart_copy(rng), chart_corners(*CHART), [],
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


def regions_of(megapixels: float) -> list[str]:
    """Options that name three regions of the photo."""
    width = width_of(megapixels)
    return [f"--region={name}={','.join(str(round(side * width)) for side in rect)}"
            for name, rect in REGIONS.items()]


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


def rows_of(megapixels: float) -> list[dict[str, Any]]:
    """The command on a new photo, its code warm, and the picture of a session that is calibrated.
    """
    with tempfile.TemporaryDirectory() as folder:
        photo = Path(folder) / "photo.dng"
        # by another process: on Linux the memory of a process counts as its children's too
        subprocess.run([sys.executable, "-m", "benchmarks.bench_flat_speed", "--write", str(photo),
                        "--megapixels", str(megapixels)], check=True)
        words = ["flat", str(photo), *regions_of(megapixels), "--session"]
        warm, session = (str(Path(folder) / name) for name in ("warm", "session"))
        measured([*words, warm])
        return [{"what": what, "megapixels": megapixels, **measured([*words, session, *more])}
                for what, more in (("three regions", []), ("then a picture", ["--picture"]))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megapixels", type=float, nargs="+", default=[4, 24])
    parser.add_argument("--write", type=Path, help="only write the photo of the first size")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    if asked.write:
        write_colours(asked.write, asked.megapixels[0])
        return
    rows = [row for megapixels in asked.megapixels for row in rows_of(megapixels)]
    if asked.json:
        print(json.dumps(rows))
        return
    print("".join(f"{name:>19}" for name in rows[0]))
    for each in rows:
        print("".join(f"{value:>19}" if isinstance(value, str) else f"{value:19.2f}"
                      for value in each.values()))


if __name__ == "__main__":
    main()
