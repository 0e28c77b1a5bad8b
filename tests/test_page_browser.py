"""The page in a real browser: mark a region, undo, run, stop, read the report, shoot a series."""
import tomllib

import pytest
from flat_example import rect_of, write_flat
from served_page import TOKEN, served, wait_for

MAX_WAIT_MS = 120_000


@pytest.fixture
def opened(browser):
    """A function that opens an address; at the end nothing may have complained."""
    context = browser.new_context(viewport={"width": 1400, "height": 1000})
    context.set_default_timeout(MAX_WAIT_MS)
    page, said, asked = context.new_page(), [], []
    page.on("console", lambda line: said.append(line.text)
            if line.type in ("error", "warning") and "409" not in line.text
            and "CONNECTION_REFUSED" not in line.text else None)     # the server has ended
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))

    def open_address(address):
        page.goto(f"{address}/?token={TOKEN}")
        page.wait_for_selector("body[data-photo]")
        return page
    yield open_address
    own = page.url.removesuffix("/page")
    context.close()
    assert said == []
    assert not [url for url in asked if not url.startswith((own, "blob:", "data:"))]


def click_at(page, x, y, size=(480, 320)):
    """Click the canvas where a pixel of the photo is shown."""
    box = page.locator("#canvas").bounding_box()
    scale = min(box["width"] / size[0], box["height"] / size[1])
    left, top = (box["width"] - size[0] * scale) / 2, (box["height"] - size[1] * scale) / 2
    page.mouse.click(box["x"] + left + (x + 0.5) * scale, box["y"] + top + (y + 0.5) * scale)


def regions_of(folder):
    return tomllib.loads((folder / "session.toml").read_text(encoding="utf-8"))["regions"]


def test_from_a_marked_region_to_the_report(tmp_path, opened):
    session = write_flat(tmp_path / "s")
    before = (session / "session.toml").read_text(encoding="utf-8")
    with served(session) as (address, _):
        page = opened(address)
        assert page.url == address + "/page" and page.reload().ok
        page.wait_for_selector("body[data-photo]")
        page.click("text=Region")
        page.fill("#mark-name", "second green")
        x0, y0, x1, y1 = rect_of("green_wall")
        click_at(page, x0, y0)
        click_at(page, x1, y1)
        page.wait_for_selector("#marks >> text=second green")
        marked = regions_of(session)["second green"]["rect"]
        assert marked == pytest.approx([x0, y0, x1, y1], abs=1.0)
        page.click("#undo")
        page.wait_for_selector("#marks >> text=second green", state="detached")
        assert (session / "session.toml").read_text(encoding="utf-8") == before
        # with the keyboard alone: a point in the middle of the view, moved by the arrow keys
        page.focus("#canvas")
        page.keyboard.press("Enter")
        page.keyboard.press("Shift+ArrowLeft")
        page.keyboard.press("Shift+ArrowUp")
        page.keyboard.press("ArrowUp")
        page.keyboard.press("Enter")
        page.wait_for_selector("#marks >> text=second green")
        x0, y0, x1, y1 = regions_of(session)["second green"]["rect"]
        assert (x1 - x0, y1 - y0) == pytest.approx((10, 11), abs=0.11)
        page.click("#undo")
        page.wait_for_selector("#marks >> text=second green", state="detached")

        page.hover("#canvas")
        page.wait_for_selector("#values:has-text('%')")
        page.click("#run")
        page.wait_for_selector("#stop:not([disabled])")
        page.click("#stop")
        page.wait_for_selector("#progress:has-text('finished stages are kept')")
        page.click("#run")
        page.wait_for_selector("#progress:has-text('verdict')")
        assert page.inner_text("#progress").split()[1].strip(",") in ("PASS", "WARN")
        report = page.frame_locator("#report-frame")
        report.locator("h1").first.wait_for()
        assert "green_wall" in report.locator("body").inner_text()
        assert "done" in page.inner_text("#stages") and "stale" not in page.inner_text("#stages")


def test_a_fault_in_the_session_is_said_and_nothing_can_be_run(tmp_path, opened):
    session = write_flat(tmp_path / "s")
    with served(session) as (address, _):
        page = opened(address)
        path = session / "session.toml"
        path.write_text(path.read_text(encoding="utf-8") + "[lihgt]\n", encoding="utf-8")
        page.wait_for_selector("#problems >> text=lihgt")
        assert page.is_disabled("#run")


def test_a_tethered_series_is_judged_as_it_comes_in(tmp_path, opened):
    from fractions import Fraction

    import numpy as np
    from flat_example import picture

    from spectrabox.fixtures.flat_sample import write_photo
    session, coming = write_flat(tmp_path / "s"), tmp_path / "coming"
    coming.mkdir()
    light = picture((400, 600))
    for number in range(10):        # every third one far too dark
        write_photo(tmp_path / f"{number}.dng", light, Fraction(1, 60),
                    np.random.default_rng(number), brightest=0.02 if number % 3 == 2 else 0.8)
    with served(session, coming) as (address, served_page):
        page = opened(address)
        for number in range(10):
            whole = (tmp_path / f"{number}.dng").read_bytes()
            with (coming / f"{number}.dng").open("wb") as file:     # as a cable delivers it
                file.write(whole[:len(whole) // 2])
                file.flush()
                if number == 0:
                    page.wait_for_selector("#watched >> text=arriving")
                file.write(whole[len(whole) // 2:])
        wait_for(lambda: len(served_page.shooting.state()["shots"]) == 10)
        shots = {shot["file"]: shot for shot in served_page.shooting.state()["shots"]}
        for number in range(10):
            shot, dark = shots[f"{number}.dng"], number % 3 == 2
            assert shot["verdict"] == ("RE-SHOOT" if dark else "GOOD"), shot
            if dark:
                assert shot["stops"] > 3 and "longer" in shot["reasons"][0]
            else:
                assert shot["chart"]
        page.wait_for_selector("#shots >> text=9.dng")
        assert page.locator("#shots li").count() == 10
        page.click("#shots >> text=4.dng")
        page.wait_for_selector("body[data-photo='shot:4.dng']")
