"""Pictures of page and reports for README and how-tos, taken of the demos in a real browser.

    python docs/make_pictures.py

Needs Playwright and a Chromium (`make test` installs both). Writes `docs/images/page.jpg`,
`page-phone.jpg`, `flat.png`, `light.png` and `report.png` in place of those that are there.
"""
from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
COMMAND = (sys.executable, "-m", "spectrabox")
SELECTED = "mountain"   # a region of the painting
SCALE = 0.8             # of the pictures: pixels for one of the page
QUALITY = 85            # of the JPEG
REPORT = {"width": 1400, "height": 1320}    # of a report, from its top
WAIT_MS = 120_000


def take(page: Any, address: str, selected: str, first: bool = False) -> None:
    """The page once verdict and all spectra stand there, with one mark selected."""
    page.set_default_timeout(WAIT_MS)
    page.goto(address)
    page.wait_for_selector("body[data-result=true][data-look^=calibrated]")
    if first:           # asked at the beginning alone; the demo has its card
        page.click("#ask [data-finish=unknown]")
    page.wait_for_selector("#ask", state="hidden")
    page.wait_for_selector("body[data-result=true]")
    page.wait_for_selector("#marks li:last-child .spark", state="attached")
    page.evaluate("name => document.querySelector(`#marks li[data-name='${name}'] .mark`).click()",
                  selected)
    page.wait_for_selector("#looked-plot svg")
    page.evaluate("document.querySelector('#inspector').scrollTo(0, 0)")
    page.wait_for_timeout(800)


def demo(session: Path, *options: str) -> None:
    """A demo's session with its report."""
    subprocess.run([*COMMAND, "demo", str(session), *options], check=True, cwd=ROOT,
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def take_report(chromium: Any, session: Path, image: str) -> None:
    """The top of a session's report."""
    report = chromium.new_page(viewport=REPORT)
    report.goto((session / "report.html").as_uri())
    report.screenshot(path=IMAGES / image)


def take_light(chromium: Any, session: Path, image: str) -> None:
    """The map of the light in a report."""
    report = chromium.new_page(viewport=REPORT, device_scale_factor=1 / SCALE)
    report.goto((session / "report.html").as_uri())
    report.locator("svg:has(title:text('Light over'))").first.screenshot(path=IMAGES / image)


def take_page(chromium: Any, session: Path) -> None:
    """The page of a session, on a screen and on a telephone."""
    opened = subprocess.Popen([*COMMAND, "open", str(session), "--no-browser"], cwd=ROOT,
                              stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert opened.stdout is not None
        address = opened.stdout.readline().split()[-1]
        table = chromium.new_page(viewport={"width": 1400, "height": 900},
                                  device_scale_factor=SCALE)
        take(table, address, SELECTED, first=True)
        table.screenshot(path=IMAGES / "page.jpg", quality=QUALITY)
        phone = chromium.new_page(viewport={"width": 390, "height": 844}, has_touch=True,
                                  is_mobile=True, device_scale_factor=SCALE)
        take(phone, address, SELECTED)
        phone.click("#handle")
        phone.wait_for_timeout(800)
        phone.screenshot(path=IMAGES / "page-phone.jpg", quality=QUALITY)
    finally:
        opened.terminate()
        opened.wait()


def main() -> None:
    """Make both demos, and take all pictures."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser",
                                                 "google-chrome"))), None)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        painting, box = Path(folder) / "painting", Path(folder) / "box"
        demo(painting, "--flat")
        demo(box)
        chromium = driver.chromium.launch(executable_path=found,
                                          args=["--no-sandbox", "--disable-gpu"])
        take_report(chromium, painting, "flat.png")
        take_light(chromium, painting, "light.png")
        take_report(chromium, box, "report.png")
        take_page(chromium, painting)
        chromium.close()


if __name__ == "__main__":
    main()
