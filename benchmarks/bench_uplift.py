"""``spectrabox uplift`` as a user types it: seconds, CPU seconds, memory and what is written, by
pictures of one megapixel and more.

The pictures are the demo's 24 measured reflectances in patches, shaded, with 1 % of noise. With
``--colours`` ``sb.uplift`` of 256 x 256 random colours of sRGB, in CPU seconds and as a multiple of
the import of what it needs, which the first pixels pay.
"""
from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.session.signals.signal_options import response_of_names

CAMERA, LIGHT = "Nikon 5100 (NPL)", "D65"
ROWS = 64


def write_picture(path: Path, height: int, width: int) -> None:
    """A chart of measured reflectances as the camera sees it, some rows at a time."""
    reflectances = next(iter(test_reflectances(PRIOR_GRID).values()))[:24]
    patches = np.clip(reflectances, 0, 1) @ response_of_names(CAMERA, LIGHT).T
    columns = patches.reshape(4, 6, 3)[:, np.arange(width) * 6 // width]
    shade = 0.7 + 0.3 * np.cos(6 * np.arange(width) / width)[:, None]
    rng = np.random.default_rng(0)
    spec = oiio.ImageSpec(width, height, 3, oiio.HALF)
    file = oiio.ImageOutput.create(str(path))
    file.open(str(path), spec)
    for first in range(0, height, ROWS):
        rows = np.arange(first, min(first + ROWS, height))
        noise = 1 + 0.01 * rng.standard_normal((len(rows), width, 3))
        signal = columns[rows * 4 // height] * shade * noise
        file.write_scanlines(first, first + len(rows), 0, signal.astype(np.float32))
    file.close()


def row(megapixels: float, options: list[str]) -> dict[str, float]:
    """One whole process."""
    side = round(1000 * megapixels**0.5)
    with tempfile.TemporaryDirectory() as folder:
        picture, out = Path(folder) / "picture.exr", Path(folder) / "out"
        write_picture(picture, side, side)
        started = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-m", "spectrabox", "uplift", str(picture), "-o", str(out),
             "--sensitivity", CAMERA, "--light", LIGHT, *options])
        _, status, used = os.wait4(process.pid, 0)
        taken = time.perf_counter() - started
        if status:
            raise SystemExit("uplift failed")
        return {"megapixels": megapixels, "s": taken, "cpu_s": used.ru_utime + used.ru_stime,
                "memory_mb": used.ru_maxrss / 1024,
                "written_mb": sum(path.stat().st_size for path in out.iterdir()) / 1e6}


MANY_COLOURS = """
import time
started = time.process_time()
import numpy as np
import spectrabox as sb
sb.uplift(np.full((1, 1, 3), 0.5), encoded=True, progress=False)
imported = time.process_time()
image = np.random.default_rng(0).integers(0, 256, (256, 256, 3), dtype=np.uint8)
sb.uplift(image, encoded=True, progress=False)
print(imported - started, time.process_time() - imported)
"""


def of_many_colours() -> tuple[float, float]:
    """CPU seconds of the import with the first pixel, and of a picture of random colours."""
    done = subprocess.run([sys.executable, "-c", MANY_COLOURS], check=True, text=True,
                          capture_output=True, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"})
    first, picture = map(float, done.stdout.split())
    return first, picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megapixels", type=float, nargs="+", default=[1, 12])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--colours", action="store_true", help="random colours by sb.uplift alone")
    parser.add_argument("options", nargs="*", help="of the command, after --")
    arguments = parser.parse_args()
    if arguments.colours:
        print(f"{'import s':>10} {'picture s':>10} {'ratio':>7}")
        for _ in range(arguments.repeats):
            first, picture = of_many_colours()
            print(f"{first:10.2f} {picture:10.2f} {picture / first:7.2f}", flush=True)
        return
    print(f"{'megapixels':>10} {'s':>7} {'CPU s':>7} {'memory MB':>10} {'written MB':>11}")
    for megapixels in arguments.megapixels:
        runs = [row(megapixels, arguments.options) for _ in range(arguments.repeats)]
        best = min(runs, key=lambda run: run["s"])
        print(f"{best['megapixels']:10g} {best['s']:7.1f} {best['cpu_s']:7.1f} "
              f"{best['memory_mb']:10.0f} {best['written_mb']:11.0f}", flush=True)


if __name__ == "__main__":
    main()
