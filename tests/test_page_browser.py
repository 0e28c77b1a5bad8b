"""The page in a real browser: mark a region, undo, run, stop, read the report, shoot a series."""
import tomllib
from fractions import Fraction

import numpy as np
import pytest
from flat_example import PAINTS, picture, rect_of, write_flat
from served_page import (
    MAX_WAIT_MS,
    TOKEN,
    asked,
    drag,
    on_screen,
    opened_in,
    served,
    served_by,
    wait_for,
    wait_ready,
)

from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.session.commands.session import _folder_to_open
from spectrabox.session.page.start_page import StartPage


def undone(page, path, times):
    """Undo by the keyboard, each time once the last is written."""
    for _ in range(times):
        text = path.read_text(encoding="utf-8")
        page.wait_for_selector("#undo:not([disabled])")
        page.keyboard.press("Control+z")
        wait_for(lambda text=text: path.read_text(encoding="utf-8") != text)


@pytest.fixture
def opened(browser):
    with opened_in(browser) as open_address:
        yield open_address


def regions_of(folder):
    return tomllib.loads((folder / "session.toml").read_text(encoding="utf-8"))["regions"]


def test_from_a_photo_to_four_spectra_in_a_report(tmp_path, opened):
    """Eight actions: open, four rectangles of which two are named, Report."""
    photo = tmp_path / "IMG_4711.dng"
    write_photo(photo, picture(), Fraction(1, 60), np.random.default_rng(3))
    session = _folder_to_open((photo,))
    with served(session) as (address, _):
        page = opened(address)                                      # 1
        wait_ready(page)
        assert page.inner_text("#verdict") == "Chart GOOD" and page.is_disabled("#run")
        for number, name in enumerate(PAINTS):
            drag(page, *rect_of(name))                              # 2, 4, 6, 7
            page.wait_for_selector(f"#marks li:nth-child({number + 1}) .spark")
            if number < 2:
                page.keyboard.type(name)                            # 3, 5
                page.keyboard.press("Enter")
                page.wait_for_selector(f'#marks input[data-name="{name}"]')
        page.wait_for_selector("#marks li:nth-child(4) .swatch")
        shown = page.locator("#marks .mark .lab").all_inner_texts()
        assert page.locator("#all-plot svg").is_visible()
        page.wait_for_selector("body[data-result=true]")    # the verdict comes before the report
        before, conditions = page.inner_text("#verdict"), page.locator("#chips button").count()
        assert before.split()[0] in ("PASS", "WARN") and conditions > 3
        page.click("#run")                                          # 8
        page.wait_for_selector("#report:not([hidden])")
        report = page.frame_locator("#report-frame")
        report.locator("h1").first.wait_for()
        page.wait_for_selector("#progress:has-text('up to date')")
        assert page.inner_text("#verdict") == before
        assert list(regions_of(session)) == ["white_wall", "green_wall", "sample 1", "sample 2"]
        cards = " ".join(report.locator("body").inner_text().split())
        for colour in shown:        # the numbers of the page are the report's
            assert colour in cards, colour
        page.keyboard.press("Escape")
        page.wait_for_selector("#report", state="hidden")
        page.click("#progress")
        assert "to do" not in page.inner_text("#stages")
        for name, holds in (("marked.csv", b"white_wall mean"), ("marked.spdx", b"<IESTM2714")):
            status, text = asked(f"{address}/api/export?file={name}")
            assert status == 200 and holds in text

    with served(session) as (address, reopened):      # the verdict stands there again
        reported = reopened.state()["reported"]
    assert reported["status"].upper() in ("PASS", "WARN") and len(reported["says"]) > 20


def test_regions_are_drawn_moved_sized_renamed_and_removed(calibrated_flat, opened):
    session = calibrated_flat
    before = (session / "session.toml").read_text(encoding="utf-8")
    with served(session) as (address, _):
        page = opened(address)
        assert page.url == address + "/page" and page.reload().ok
        page.wait_for_selector("body[data-photo]")
        drag(page, 40, 240, 80, 280)
        page.wait_for_selector('#marks input[data-name="sample 1"]')
        assert regions_of(session)["sample 1"]["rect"] == pytest.approx([40, 240, 80, 280], abs=1)
        drag(page, 60, 260, 70, 270)        # it is selected: inside moves it
        wait_for(lambda: regions_of(session)["sample 1"]["rect"] == pytest.approx(
            [50, 250, 90, 290], abs=1.5))
        drag(page, *regions_of(session)["sample 1"]["rect"][2:], 110, 300)      # a corner sizes it
        wait_for(lambda: regions_of(session)["sample 1"]["rect"] == pytest.approx(
            [50, 250, 110, 300], abs=1.5))
        page.fill('#marks input[data-name="sample 1"]', "table")
        page.keyboard.press("Enter")
        page.wait_for_selector('#marks input[data-name="table"]')
        page.focus("#canvas")
        page.keyboard.press("Shift+ArrowLeft")
        wait_for(lambda: regions_of(session)["table"]["rect"][0] == pytest.approx(40, abs=1.5))
        page.keyboard.press("Delete")
        wait_for(lambda: "table" not in regions_of(session))
        undone(page, session / "session.toml", 6)
        assert (session / "session.toml").read_text(encoding="utf-8") == before
        # with the keyboard alone: a point in the middle of the view, moved by the arrow keys
        page.wait_for_selector('#marks input[data-name="sample 1"]', state="detached")
        page.focus("#canvas")
        for key in ("Escape", "Enter", "Shift+ArrowLeft", "Shift+ArrowUp", "ArrowUp", "Enter"):
            page.keyboard.press(key)
        page.wait_for_selector('#marks input[data-name="sample 1"]')
        x0, y0, x1, y1 = regions_of(session)["sample 1"]["rect"]
        assert (x1 - x0, y1 - y0) == pytest.approx((10, 11), abs=0.11)
        shown = page.get_attribute("#canvas", "data-view")
        drag(page, 100, 100, 140, 140, "middle")        # the middle button moves the photo
        wait_for(lambda: page.get_attribute("#canvas", "data-view") != shown)
        assert len(regions_of(session)) == len(PAINTS) + 1


def test_fingers_move_and_zoom_the_photo_and_mark_where_they_stay(browser, calibrated_flat):
    session = calibrated_flat
    with served(session) as (address, _), opened_in(
            browser, viewport={"width": 400, "height": 800}, has_touch=True,
            is_mobile=True) as open_address:
        page = open_address(address)
        wait_ready(page)
        devtools = page.context.new_cdp_session(page)

        def touch(kind, *places):
            devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [
                {"x": x, "y": y, "id": number} for number, (x, y) in enumerate(places)]})

        def stroke(first, last):
            # found before the finger is down: one that stays where it is draws
            middle = [(a + b) / 2 for a, b in zip(first, last, strict=True)]
            start, *further = [on_screen(page, *place) for place in (first, middle, last)]
            touch("touchStart", start)
            for place in further:
                touch("touchMove", place)
            touch("touchEnd")

        def still():
            """The view once it has come to rest."""
            seen = ""
            while seen != (seen := page.get_attribute("#canvas", "data-view")):
                page.wait_for_timeout(400)
            return seen

        whole = still()
        touch("touchStart", on_screen(page, 60, 260))        # held: a square is marked
        page.wait_for_timeout(700)
        touch("touchEnd")
        page.wait_for_selector('#marks input[data-name="sample 1"]', state="attached")
        x0, y0, x1, y1 = regions_of(session)["sample 1"]["rect"]
        assert ((x0 + x1) / 2, (y0 + y1) / 2) == pytest.approx((60, 260), abs=2)
        assert x1 - x0 == pytest.approx(y1 - y0, abs=0.2) and x1 - x0 > 12
        # neither its spectrum below nor the verdict above takes room from the photo, also while
        # the finish is asked for
        page.wait_for_selector("#looked-at.filled")
        page.wait_for_selector("body[data-result=true]")
        assert page.is_visible("#ask") and still() == whole
        page.click('[data-mode="region"]')
        stroke((140, 250), (180, 290))                       # with the tool one finger draws
        page.wait_for_selector('#marks input[data-name="sample 2"]', state="attached")
        assert regions_of(session)["sample 2"]["rect"] == pytest.approx([140, 250, 180, 290],
                                                                       abs=3)
        page.click('[data-mode="look"]')
        stroke((300, 200), (260, 180))                       # without it moves the photo
        assert still() != whole
        page.keyboard.press("f")
        assert still() == whole
        near, far = (on_screen(page, 200, 150), on_screen(page, 240, 150)), (
            on_screen(page, 120, 150), on_screen(page, 320, 150))
        touch("touchStart", near[0])
        touch("touchStart", *near)
        touch("touchMove", *far)
        touch("touchEnd")
        assert float(still().split()[2]) > 1.5 * float(whole.split()[2])
        assert len(regions_of(session)) == len(PAINTS) + 2
        page.click("#handle")                                # the sheet comes up
        assert page.locator("#marks input").first.is_visible()
        assert page.evaluate("document.documentElement.scrollWidth") <= 400


def test_pointing_shows_a_spectrum_and_a_run_can_be_stopped(tmp_path, opened):
    with served(write_flat(tmp_path / "s")) as (address, _):
        page = opened(address)
        page.click("#run")          # it waits for the calibration
        page.wait_for_selector("#stop:not([hidden])")
        page.click("#stop")
        page.wait_for_selector("#progress:has-text('stopped')")
        page.click("#progress")
        assert "What was finished is kept" in page.inner_text("#panel")
        page.click("#run")
        page.wait_for_selector("#report:not([hidden])")
        page.click("#run")                              # back to the photo
        page.wait_for_selector("#report", state="hidden")
        page.mouse.move(*on_screen(page, 415, 70))
        page.wait_for_selector("#looked-plot svg")
        page.wait_for_selector("#looked-words:has-text('Width of the band from')")
        red, green, blue = bytes.fromhex(page.get_attribute("body", "data-looked")[1:])
        assert green > red and green > blue         # the green paint
        page.click("[data-mode=compare]")
        page.mouse.click(*on_screen(page, 415, 70))     # a marked colour
        page.mouse.click(*on_screen(page, 30, 300))     # and a point of the table
        page.wait_for_selector("#comparison:has-text('tells these colours apart')")
        said = page.inner_text("#comparison")
        assert "green_wall" in said and "point 2" in said
        assert page.locator("#comparison .pair").count() == 5
        page.click('[data-mode="look"]')                # two rows that are ticked do the same
        page.wait_for_selector("#compare", state="hidden")
        for name in ("green_wall", "cube"):
            page.check(f'[aria-label="Compare {name}"]')
        page.wait_for_selector("#comparison:has-text('green_wall | cube')")


def test_all_that_flat_knows_is_stated_on_the_page(tmp_path, opened):
    """Name, light, picture, a further photo through a filter, a truth; Undo takes each back."""
    session = write_flat(tmp_path / "s")
    path = session / "session.toml"
    before = path.read_text(encoding="utf-8")
    write_photo(tmp_path / "filtered.dng", 0.5 * picture(), Fraction(1, 30),
                np.random.default_rng(4))
    with served(session) as (address, _):
        page = opened(address)
        for opens, field, value in (("#name", "#session-name", "Red chair"),
                                    ("[data-chip=lamp]", "#session-light", "halogen")):
            page.click(opens)
            page.fill(field, value)
            page.keyboard.press("Enter")
            page.wait_for_selector(field, state="hidden")
        page.click("#export")
        page.check("#session-picture")
        page.click("#add-photo")
        page.select_option("#further-how", "moved")
        assert page.is_hidden("#further-filter")
        page.select_option("#further-how", "filter")
        page.set_input_files("#further", tmp_path / "filtered.dng")
        page.click("#further-add")
        page.wait_for_selector("#photos >> text=filtered")
        page.click("#marks li:nth-child(2) .sw")
        page.set_input_files("#marks li.selected [data-key='truth file']",
                             session / "spectra" / "red_wall.csv")
        page.wait_for_selector("text=compared with spectra/red_wall-2.csv")
        written = tomllib.loads(path.read_text(encoding="utf-8"))
        assert written["session"]["name"] == page.inner_text("#name") == "Red chair"
        assert written["light"]["spectrum"] == "halogen" and written["picture"] == {}
        assert written["views"] == {"filtered": {
            "photo": "photos/filtered.dng", "same_light_as": "photo", "filter": "unknown"}}
        assert written["regions"]["green_wall"]["truth"] == "spectra/red_wall-2.csv"
        page.click("[data-chip=lamp]")
        page.fill("#session-light", "moonshine")
        page.keyboard.press("Enter")
        page.wait_for_selector("#said:has-text('moonshine')")
        assert "moonshine" not in path.read_text(encoding="utf-8")
        page.focus("#canvas")
        undone(page, path, 5)
        assert path.read_text(encoding="utf-8") == before


def test_a_photo_that_is_dropped_opens_its_session(tmp_path, browser):
    photo, home = tmp_path / "IMG 1.dng", tmp_path / "home"
    home.mkdir()
    write_photo(photo, picture(), Fraction(1, 60), np.random.default_rng(3))
    context = browser.new_context(viewport={"width": 400, "height": 800})
    context.set_default_timeout(MAX_WAIT_MS)
    page, said = context.new_page(), []
    page.on("pageerror", lambda error: said.append(str(error)))
    with served_by(StartPage(home)) as address:
        page.goto(f"{address}/?token={TOKEN}")
        page.wait_for_selector("#folder:has-text('none in')")
        page.set_input_files("#files", tmp_path / "IMG 1.dng")
        page.wait_for_url("**/s/1/page")
        wait_ready(page)
        assert page.inner_text("#name") == "IMG 1" and page.reload().ok
        wait_ready(page)
        page.goto(f"{address}/page")
        page.click("#sessions >> text=IMG 1-flat")
        page.wait_for_url("**/s/1/page")
        page.wait_for_selector("body[data-photo]")
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
    context.close()
    assert said == []


def test_a_fault_in_the_session_is_said_and_nothing_can_be_run(opened, calibrated_flat):
    session = calibrated_flat
    with served(session) as (address, _):
        page = opened(address)
        page.wait_for_selector("body[data-look^=calibrated]")
        path = session / "session.toml"
        path.write_text(path.read_text(encoding="utf-8") + "[lihgt]\n", encoding="utf-8")
        page.wait_for_selector("#progress:has-text('1 problem')")
        # the photo stays while the fault is mended, and can still be looked at
        assert asked(f"{address}/api/tile?role=photo&halvings=0&column=0&row=0")[0] == 200
        assert page.get_attribute("body", "data-look").startswith("calibrated")
        page.wait_for_selector("#hint:has-text('lihgt')")
        page.click("#progress")
        assert "lihgt" in page.inner_text("#panel")
        assert page.is_disabled("#run")


def test_a_tethered_series_is_judged_as_it_comes_in(tmp_path, opened, calibrated_flat):
    session, coming = calibrated_flat, tmp_path / "coming"
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
