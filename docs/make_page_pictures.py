"""Pictures of the page for README and how-to, taken of the demo's painting in a real browser.

    python docs/make_page_pictures.py

Needs Playwright and a Chromium (`make test` installs the former). Writes `docs/images/page.jpg` and
`docs/images/page-phone.jpg` in place of those that are there.
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
WAIT_MS = 120_000


def take(page: Any, address: str, selected: str) -> None:
    """The page once verdict and all spectra stand there, with one mark selected."""
    page.set_default_timeout(WAIT_MS)
    page.goto(address)
    page.wait_for_selector("body[data-result=true]")
    page.wait_for_selector("#marks li:last-child .spark", state="attached")
    page.evaluate("name => document.querySelector(`#marks li[data-name='${name}'] .mark`).click()",
                  selected)
    page.wait_for_selector("#looked-plot svg")
    page.evaluate("document.querySelector('#inspector').scrollTo(0, 0)")
    page.wait_for_timeout(800)


def main() -> None:
    """Make the demo, open it, and take both pictures."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser",
                                                 "google-chrome"))), None)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        session = Path(folder) / "painting"
        subprocess.run([*COMMAND, "demo", str(session), "--flat"], check=True, cwd=ROOT,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        opened = subprocess.Popen([*COMMAND, "open", str(session), "--no-browser"], cwd=ROOT,
                                  stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            assert opened.stdout is not None
            address = opened.stdout.readline().split()[-1]
            chromium = driver.chromium.launch(executable_path=found,
                                              args=["--no-sandbox", "--disable-gpu"])
            table = chromium.new_page(viewport={"width": 1400, "height": 900},
                                      device_scale_factor=SCALE)
            take(table, address, SELECTED)
            table.screenshot(path=IMAGES / "page.jpg", quality=QUALITY)
            phone = chromium.new_page(viewport={"width": 390, "height": 844}, has_touch=True,
                                      is_mobile=True, device_scale_factor=SCALE)
            take(phone, address, SELECTED)
            phone.click("#handle")
            phone.wait_for_timeout(800)
            phone.screenshot(path=IMAGES / "page-phone.jpg", quality=QUALITY)
            chromium.close()
        finally:
            opened.terminate()
            opened.wait()


if __name__ == "__main__":
    main()
