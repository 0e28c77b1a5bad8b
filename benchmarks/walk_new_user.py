"""A new user's way from a box measured with a tape, and two photos of it, to a report.

    python benchmarks/walk_new_user.py [--photos DIR] [--out DIR] [--seed 1]

A script is the operator: it types the same commands and values and clicks the same places in the
page (headless Chromium) as a person would. Measures carry a tape's errors and clicks a hand's; the
photos are the demo's. It prints every operation, what the machine took, an estimate of what a
person takes for the same, and how far the spectra are from the truth, which the session never saw.
"""
from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.fixtures.demo_session import write_demo_session
from spectrabox.fixtures.paints import paint
from spectrabox.session.box.box_camera import corners_in_photo
from spectrabox.session.config.session_file import read_session

# Seconds of a person: keystroke-level model of Card, Moran and Newell (1983); reading a tape and
# aiming at a corner are our own guesses, on the long side.
KEY_S, POINT_S, CLICK_S, THINK_S, HANDS_S, TAPE_S, AIM_S = 0.28, 1.1, 0.2, 1.35, 0.4, 15.0, 4.0
TAPE_MM, PLACE_MM, LAMP_MM, TURN_DEG, CLICK_PX = 1.0, 2.0, 3.0, 0.5, 1.0    # standard deviations
# what the demo's box is, by the line of session.toml that holds it
TRUE = {"width_mm": ([480], TAPE_MM), "height_mm": ([330], TAPE_MM), "depth_mm": ([400], TAPE_MM),
        "size_mm": ([120, 120, 120], TAPE_MM), "object at_mm": ([-50, 0, -200], PLACE_MM),
        "turn_deg": ([28], TURN_DEG), "lamp at_mm": ([50, 270, 380], LAMP_MM),
        "radius_mm": ([8], 0.0), "chart at_mm": ([90, 170, -360], PLACE_MM),
        "chart look_at_mm": ([90, 170, 0], PLACE_MM)}
PHOTO_PX = 1248, 832
ON_FLOOR, FACING = "object at_mm", "chart look_at_mm"   # 0 above the floor; as the chart itself
CORNERS = ("back bottom left", "back bottom right", "back top left", "back top right",
           "block front bottom left", "block front bottom right", "block front top left",
           "block front top right")


@dataclass
class Diary:
    """What was done, and how long a person and the machine take for it."""

    steps: list[tuple[str, int, float, float]] = field(default_factory=list)

    def add(self, what: str, operations: int, person_s: float, machine_s: float) -> None:
        """Note one step and print it."""
        self.steps.append((what, operations, person_s, machine_s))
        print(f"{what:<62} {operations:>4} {person_s:>7.0f} s {machine_s:>7.1f} s", flush=True)

    def end(self) -> None:
        """Print the sums."""
        operations, person, machine = (sum(step[k] for step in self.steps) for k in (1, 2, 3))
        print(f"{'together':<62} {operations:>4} {person:>7.0f} s {machine:>7.1f} s")


def main() -> None:
    """Walk the way once."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, help="the demo's; made anew by default")
    parser.add_argument("--out", type=Path, help="where pictures of the page go")
    parser.add_argument("--flat", action="store_true", help="with a third photo, of a white card")
    parser.add_argument("--seed", type=int, default=1, help="of the tape's and the hand's errors")
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    with tempfile.TemporaryDirectory() as folder:
        photos, session = asked.photos, Path(folder) / "mybox"
        if photos is None:
            write_demo_session(Path(folder) / "demo", 1)
            photos = Path(folder) / "demo" / "photos"
        print(f"{'step':<62} {'ops':>4} {'person':>9} {'machine':>9}")
        diary = Diary()
        _commands(session, photos, asked.flat, diary)
        seen = _corners(session)
        _measures(session, rng, diary)
        _page(session, seen, rng, diary, asked.out)
        diary.end()
        _score(session)


def typed(text: str) -> float:
    """Seconds to think of a line and type it."""
    return THINK_S + KEY_S * (len(text) + 1)


def _commands(session: Path, photos: Path, flat: bool, diary: Diary) -> None:
    start = time.perf_counter()
    _run("new", str(session), "--template", "box")
    diary.add("spectrabox new mybox --template box", 1, typed("spectrabox new mybox --template "
                                                              "box"),
              time.perf_counter() - start)
    names = ["box.dng", "chart.dng", *(["flat.dng"] if flat else [])]
    for name in names:
        shutil.copy(photos / name, session / "photos" / name)
    if flat:
        path = session / "session.toml"
        path.write_text(path.read_text(encoding="utf-8").replace("# flat =", "flat ="),
                        encoding="utf-8")
    diary.add(f"{len(names)} photos dragged into mybox/photos", len(names),
              len(names) * (THINK_S + 2 * (POINT_S + CLICK_S)), 0.0)


def _corners(session: Path) -> dict[str, tuple[float, float]]:
    """Where a person sees the corners: the template, as it comes, is the demo's box."""
    return corners_in_photo(read_session(session))


def _measures(session: Path, rng: np.random.Generator, diary: Diary) -> None:
    """Type what the tape says in place of the template's values."""
    path = session / "session.toml"
    text = path.read_text(encoding="utf-8")
    keys, values, readings = 0, 0, 0
    measured: dict[str, list[float]] = {}
    for name, (true, error) in TRUE.items():
        read = [round(float(value + rng.normal(0, error)), 0) for value in true]
        if name == ON_FLOOR:
            read[1] = 0.0
        if name == FACING:
            read = [*measured["chart at_mm"][:2], 0.0]
        measured[name] = read
        readings += 0 if name == FACING else len(read)
        shown = ", ".join(f"{value:g}" for value in read)
        shown = f"[{shown}]" if len(read) > 1 else shown
        text, count = _typed_into(text, name, shown)
        assert count == 1, name
        keys += len(shown)
        values += 1
    # the focal length is not known: the camera comes from the corners
    text, count = re.subn(r"\nfov_deg = [^\n]*", "", text)
    assert count == 1
    path.write_text(text, encoding="utf-8")
    diary.add("box, block, lamp and chart measured with a tape", readings, readings * TAPE_S, 0.0)
    diary.add("values typed into session.toml, the line fov_deg deleted", values + 1,
              (values + 1) * (THINK_S + POINT_S + CLICK_S + 2 * HANDS_S) + keys * KEY_S, 0.0)


def _typed_into(text: str, name: str, value: str) -> tuple[str, int]:
    table, _, key = name.rpartition(" ")
    heads = {"object": "[[scene.box.objects]]", "lamp": "[scene.box.lamp]",
             "chart": "[scene.box.chart]", "": ""}
    lead = re.escape(heads[table]) + r"(?:(?!\n\[).)*?" if table else ""
    return re.subn(rf"({lead}\n{key} = )(\[[^\]]*\]|[-\d.]+)", rf"\g<1>{value}", text, count=1,
                   flags=re.DOTALL)


def _page(session: Path, seen: dict[str, tuple[float, float]], rng: np.random.Generator,
          diary: Diary, out: Path | None) -> None:
    from playwright.sync_api import sync_playwright
    start = time.perf_counter()
    with subprocess.Popen([sys.executable, "-m", "spectrabox", "open", str(session),
                           "--no-browser"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                          text=True) as server, sync_playwright() as driver:
        try:
            assert server.stdout is not None
            address = next(line for line in server.stdout if "http://" in line).strip()
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"),
                                             args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1400, "height": 1000})
            page.set_default_timeout(300_000)
            page.goto(address)
            page.wait_for_selector("body[data-photo]")
            diary.add("spectrabox open mybox", 1, typed("spectrabox open mybox"),
                      time.perf_counter() - start)
            _mark(page, seen, rng, diary)
            _picture(page, out, "marked")
            _read(page, diary)
            _picture(page, out, "report")
            browser.close()
        finally:
            server.terminate()


def _mark(page: Any, seen: dict[str, tuple[float, float]], rng: np.random.Generator,
          diary: Diary) -> None:
    start = time.perf_counter()
    page.click("text=Box corners")
    chosen = 0
    for name in CORNERS:
        if page.input_value("#corner") != name:
            page.select_option("#corner", name)
            chosen += 1
        x, y = np.array(seen[name]) + rng.normal(0, CLICK_PX, 2)
        page.mouse.click(*_on_screen(page, float(x), float(y)))
        page.wait_for_timeout(50)
    page.click("#save")
    page.wait_for_selector("#said:text('marked')")
    page.wait_for_selector("#marks >> text=box corners")
    diary.add(f"{len(CORNERS)} corners of box and block clicked ({chosen} names chosen), saved",
              len(CORNERS) + chosen + 2, len(CORNERS) * AIM_S
              + (chosen + 2) * (THINK_S + POINT_S + CLICK_S), time.perf_counter() - start)


def _on_screen(page: Any, x: float, y: float) -> tuple[float, float]:
    box = page.locator("#canvas").bounding_box()
    width, height = PHOTO_PX
    scale = min(box["width"] / width, box["height"] / height)
    left, top = (box["width"] - width * scale) / 2, (box["height"] - height * scale) / 2
    return box["x"] + left + (x + 0.5) * scale, box["y"] + top + (y + 0.5) * scale


def _read(page: Any, diary: Diary) -> None:
    start = time.perf_counter()
    assert page.is_enabled("#run"), page.inner_text("#problems")
    page.click("#run")
    page.wait_for_selector("#progress:text-matches('verdict|ended with')")
    said = page.inner_text("#progress")
    diary.add(f"Run: {said}", 1, THINK_S + POINT_S + CLICK_S, time.perf_counter() - start)
    assert "verdict" in said, page.inner_text("#log")
    report = page.frame_locator("#report-frame")
    report.locator(".verdict .word").wait_for()
    print("  " + report.locator(".verdict > p").inner_text())


def _picture(page: Any, out: Path | None, name: str) -> None:
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=out / f"{name}.png", full_page=True)


def _score(session: Path) -> None:
    numbers = json.loads((session / "report.json").read_text(encoding="utf-8"))
    paints = {"white": "white_wall", "green": "green_wall", "red": "red_wall", "cube": "cube"}
    for material in numbers["materials"]:
        summary = material["summary"]
        nm, truth = paint(paints[material["name"]])
        wanted = np.interp(summary["nm"], nm, truth)
        error = float(np.sqrt(np.mean((np.array(summary["mean"]) - wanted) ** 2)))
        inside = np.mean((wanted >= summary["lower"]) & (wanted <= summary["upper"]))
        print(f"{material['name']:<8} rms error {error:.3f}, {100 * inside:.0f} % of wavelengths "
              f"inside the band of mean width {material['band_width']:.3f}")


def _run(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "spectrabox", *words], check=True,
                   stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    main()
