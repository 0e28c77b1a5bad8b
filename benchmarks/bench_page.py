"""Milliseconds from pointer and rectangle to a spectrum on the page of a photo, and whole commands.

A photo of 24 megapixels is opened as an operator opens it, ``spectrabox open PHOTO``, and asked as
a browser asks. Opening counts from the start of the command to the first spectrum; pointing is the
median of ``TIMES`` answers at different positions; a rectangle is marked and its spectrum asked
for. The alternative is the command ``spectrabox flat`` with one region, in the same run: what an
operator waits for without the page. ``processor`` is what page and run took of it, which other
work on the machine does not change.
"""
from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import urllib.parse
import urllib.request
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.flat_sample import (
    box,
    chart_corners,
    lamplight,
    surface_signals,
    write_photo,
)
from spectrabox.fixtures.lamp import radiance
from spectrabox.fixtures.paints import NM, chart_copy, paint

SIZE, TIMES = (4000, 6000), 20
PAINT = (0.58, 0.06, 0.74, 0.22)        # left, top, right, bottom, in widths of the picture
SPECTRABOX = [sys.executable, "-m", "spectrabox"]


class OpenPage:
    """The page of a photo, as the command serves it."""

    def __init__(self, photo: Path) -> None:
        self._process = subprocess.Popen([*SPECTRABOX, "open", "--no-browser", str(photo)],
                                         stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                                         text=True)
        assert self._process.stdout is not None
        address, _, self._token = self._process.stdout.readline().strip().partition("/?token=")
        self._address = address

    def ask(self, path: str, body: object = None, **query: object) -> Any:
        """An answer of the page."""
        request = urllib.request.Request(
            f"{self._address}{path}?{urllib.parse.urlencode(query)}",
            data=None if body is None else json.dumps(body).encode(),
            headers={"Authorization": f"Bearer {self._token}"})
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)

    def close(self) -> None:
        """End it as Ctrl-C does."""
        self._process.send_signal(signal.SIGINT)
        self._process.wait(10)


def write_big_photo(path: Path) -> None:
    """A chart and a red paint under one lamp."""
    responses = camera_sensitivities() * radiance(NM)
    light = lamplight(SIZE, [(0.1, 0.2, 1.4, 1.0)])
    flat = surface_signals(SIZE, responses, chart_copy(np.random.default_rng(1)),
                           chart_corners(0.06, 0.08, 0.45), [(box(*PAINT), paint("red_wall")[1])],
                           np.full(NM.size, 0.2))
    write_photo(path, flat * (light / light.max())[..., None], Fraction(1, 60),
                np.random.default_rng(3))


def seconds_of(start: float) -> float:
    return time.perf_counter() - start


def processor_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Print the table."""
    os.environ["OMP_NUM_THREADS"] = "1"
    with tempfile.TemporaryDirectory() as folder:
        photo = Path(folder) / "big.dng"
        write_big_photo(photo)
        left, top, right, bottom = (round(SIZE[1] * value) for value in PAINT)
        start, used = time.perf_counter(), processor_s()
        page = OpenPage(photo)
        while not (state := page.ask("/api/state"))["live"]["ready"]:
            assert not state["live"]["error"], state["live"]["error"]
            time.sleep(0.05)
        page.ask("/api/spectrum", role="photo", x0=left + 99, y0=top + 99, x1=left + 123,
                 y1=top + 123)
        opening = seconds_of(start)
        pointing = []
        for x in np.linspace(left + 50, right - 50, TIMES).round():
            start = time.perf_counter()
            answer = page.ask("/api/spectrum", role="photo", x0=x, y0=top + 200, x1=x + 24,
                              y1=top + 224)
            pointing.append(seconds_of(start))
            assert "mean" in answer, answer
        dragging = []
        for number in range(5):
            start = time.perf_counter()
            corners = [[left + 60 + number, top + 60], [right - 60, bottom - 60]]
            state = page.ask("/api/mark", {"digest": state["digest"], "mark": {
                "kind": "region", "name": "paint", "points": corners}})
            answer = page.ask("/api/region", name="paint")
            dragging.append(seconds_of(start))
            assert "mean" in answer, answer
        page.close()
        processor = processor_s() - used
        start, used = time.perf_counter(), processor_s()
        subprocess.run([*SPECTRABOX, "flat", str(photo), "--session", f"{folder}/other",
                        "--region", f"paint={left + 60},{top + 60},{right - 60},{bottom - 60}",
                        "--quiet"], check=True, capture_output=True)
        command, flat_processor = seconds_of(start), processor_s() - used
        print(f"{'':24}{'time':>10}{'flat / it':>12}")
        for name, seconds in (("opening to a spectrum", opening),
                              ("pointer to spectrum", float(np.median(pointing))),
                              ("rectangle to spectrum", float(np.median(dragging))),
                              ("spectrabox flat", command)):
            print(f"{name:24}{1000 * seconds:8.0f} ms{command / seconds:12.1f}")
        print(f"processor: page with its run {processor:.1f} s, flat {flat_processor:.1f} s")


if __name__ == "__main__":
    main()
