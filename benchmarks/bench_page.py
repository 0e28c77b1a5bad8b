"""From the address of a session's page to a 24-megapixel photo on the screen, in headless Chromium.

    python benchmarks/bench_page.py [--megapixels 24] [--times 3]

Each time a server of its own is started, as ``spectrabox open`` does; wall time is from the address
to the photo drawn, processor time that of the server alone, its imports left out.
"""
from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from fractions import Fraction
from pathlib import Path

import numpy as np

from spectrabox.fixtures.flat_sample import write_photo

SESSION = """[photos]
object = "photo.dng"
[light]
spectrum = "D65"
[regions.card]
rect = [10, 10, 90, 90]
"""
TICKS = 100.0       # of processor time in /proc, a second


def main() -> None:
    """Print a line for each time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megapixels", type=float, default=24)
    parser.add_argument("--times", type=int, default=3)
    asked = parser.parse_args()
    from playwright.sync_api import sync_playwright
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        session = Path(folder)
        _write_session(session, asked.megapixels)
        chromium = driver.chromium.launch(executable_path=shutil.which("chromium"),
                                          args=["--no-sandbox"])
        for _ in range(asked.times):
            wall, processor = _once(session, chromium)
            print(f"{asked.megapixels:g} megapixels on screen after {wall:.2f} s; server "
                  f"{processor:.2f} s of processor time")
        chromium.close()


def _write_session(folder: Path, megapixels: float) -> None:
    height = round(np.sqrt(megapixels * 1e6 / 1.5) / 8) * 2     # blocks of four pixels a side
    across = np.random.default_rng(2).uniform(0.1, 0.9, (height // 50 + 1, height // 33 + 1, 3))
    light = across.repeat(50, 0).repeat(50, 1)[:height, :round(1.5 * height) // 2 * 2]
    write_photo(folder / "photo.dng", light.repeat(4, 0).repeat(4, 1), Fraction(1, 60),
                np.random.default_rng(1))
    (folder / "session.toml").write_text(SESSION, encoding="utf-8")


def _once(session: Path, chromium: object) -> tuple[float, float]:
    with subprocess.Popen([sys.executable, "-m", "spectrabox", "open", str(session),
                           "--no-browser"], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        address = next(line for line in server.stdout if "http://" in line).strip()
        address = address[address.index("http://"):]
        page = chromium.new_page(viewport={"width": 1400, "height": 1000})  # type: ignore[attr-defined]
        before, start = _processor_s(server.pid), time.perf_counter()
        page.goto(address)
        page.wait_for_selector("body[data-photo]", timeout=60_000)
        wall, processor = time.perf_counter() - start, _processor_s(server.pid) - before
        page.close()
        server.terminate()
    return wall, processor


def _processor_s(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


if __name__ == "__main__":
    main()
