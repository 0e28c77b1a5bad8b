"""Eight tasks on the page, from outside, each in at most the clicks that the how-to states."""
import contextlib
import re
import shutil
import tomllib
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from flat_example import CHART, LAMPS, SIZE, picture, rect_of, write_flat
from served_page import drag, on_screen, opened_in, served, wait_ready
from session_box import marks

from spectrabox.fixtures import lamp
from spectrabox.fixtures.flat_sample import chart_corners, lamplight, write_photo
from spectrabox.fixtures.paints import NM
from spectrabox.session.commands.session import _folder_to_open
from spectrabox.session.config.template import TEMPLATES
from spectrabox.session.problems import check_session

GEL = 0.1 + 0.7 / (1 + np.exp((NM - 570) / 12))     # transmittance: keeps red away
HOW_TO = Path(__file__).resolve().parent.parent / "docs/how-to/page.md"
ROW = re.compile(r"^\| ([^|]+) \| [^|]+ \| (\d+) \|$", re.MULTILINE)
STATED = {task: int(clicks) for task, clicks in ROW.findall(HOW_TO.read_text(encoding="utf-8"))}
# presses of a person: choosing a file opens the system's own window, and counts as one
COUNT = """() => {
  if (window.presses === undefined) addEventListener("pointerdown", () => { presses += 1; }, true);
  window.presses = 0;
}"""


@pytest.fixture
def opened(browser):
    with opened_in(browser, viewport={"width": 1400, "height": 900}) as open_address:
        yield open_address


@pytest.fixture
def opened_empty(browser):
    with opened_in(browser, photo=False) as open_address:
        yield open_address


@contextlib.contextmanager
def within(page, task, tried):
    """Do a task, and hold that no more presses are needed than are stated."""
    files = []
    page.evaluate(COUNT)
    yield files
    assert page.evaluate("presses") + len(files) <= STATED[task], task
    tried.add(task)


def give(page, files, field, path):
    """Choose a file."""
    page.set_input_files(field, path)
    files.append(path)


def session_of(folder):
    return tomllib.loads((folder / "session.toml").read_text(encoding="utf-8"))


def test_eight_tasks_take_no_more_clicks_than_the_how_to_says(tmp_path, opened):
    rng = np.random.default_rng(3)
    photo, gel, moved = (tmp_path / name for name in ("IMG_1.dng", "gel.dng", "moved.dng"))
    first, second = (lamplight(SIZE, [(x, *LAMPS[0][1:])]) for x in (0.1, 0.9))
    write_photo(photo, picture(light=first / first.max()), Fraction(1, 60), rng)
    write_photo(gel, picture(light=first / first.max(), power=lamp.radiance(NM) * GEL),
                Fraction(1, 30), rng)
    write_photo(moved, picture(light=second / second.max()), Fraction(1, 60), rng)
    session, tried = _folder_to_open((photo,)), set()
    with served(session) as (address, _):
        page = opened(address)
        with within(page, "Open a photo", tried):
            wait_ready(page)
        with within(page, "Mark three colours", tried):
            for number, name in enumerate(("green_wall", "red_wall", "cube"), start=1):
                drag(page, *rect_of(name))
                page.wait_for_selector(f"#marks li:nth-child({number}) .spark")
        with within(page, "Compare two", tried):
            for name in ("sample 1", "sample 2"):
                page.check(f'[aria-label="Compare {name}"]')
            page.wait_for_selector("#comparison:has-text('sample 1 | sample 2')")
        with within(page, "Use a white card", tried):
            page.click("#tools >> text=White card")
            drag(page, *rect_of("white_wall"))
            page.wait_for_selector("#card-known")
            page.keyboard.type("0.87")
            page.keyboard.press("Enter")
            page.wait_for_selector("#said:has-text('tells how bright the light is')")
        assert session_of(session)["regions"]["white card"]["known"].endswith("0.87.csv")
        # a number without the reading that it is from: stated, not measured
        page.click("#chips .stated[data-chip='light on the sample']")
        page.wait_for_selector("#panel:has-text('stated and not measured')")
        page.keyboard.press("Escape")
        with within(page, "Add a photo through a gel", tried) as files:
            page.click("text=+ Photo")
            give(page, files, "#further", gel)
            page.click("#further-add")
            page.wait_for_selector("#photos >> text=gel")
        assert session_of(session)["views"]["gel"]["filter"] == "unknown"
        with within(page, "Add a photo with the lamp moved", tried) as files:
            page.click("text=+ Photo")
            page.select_option("#further-how", "moved")     # a native list: one press
            files.append("list")
            give(page, files, "#further", moved)
            page.click("#further-add")
            page.wait_for_selector("#photos >> text=moved")
        assert session_of(session)["views"]["moved"]["lamp"] == "moved"
        wait_ready(page)
        page.wait_for_selector("#marks li:nth-child(1) .spark")
        with within(page, "Name a colour, and save its spectrum", tried):
            page.click('[aria-label="Name of sample 1"]')
            page.keyboard.type("wall")
            page.keyboard.press("Enter")
            page.wait_for_selector('#marks input[data-name="wall"]')
            page.click("#bar >> text=Export")
            with page.expect_download() as download:
                page.click("text=marked.csv")
            assert "wall mean" in Path(download.value.path()).read_text(encoding="utf-8")
        with within(page, "Read the report", tried):
            page.click("#bar >> text='Report'")
            page.wait_for_selector("#report:not([hidden])")
            page.frame_locator("#report-frame").locator("h1").first.wait_for()
    assert tried == set(STATED) and len(tried) == 8


def test_where_no_chart_is_found_four_corners_are_there_to_be_dragged(tmp_path, opened):
    photo = tmp_path / "grey.dng"
    write_photo(photo, picture(chart=None), Fraction(1, 60), np.random.default_rng(3))
    with served(_folder_to_open((photo,))) as (address, _):
        page = opened(address)
        page.wait_for_selector("#hint:has-text('Drag the four corners onto the chart')")
        assert page.get_attribute('[data-mode="chart"]', "aria-pressed") == "true"
        drag(page, 120, 80, 40, 40)
        page.click("text=Use these corners")
        page.wait_for_selector("#said:has-text('chart')")       # there is none: it is refused
        assert "chart" not in session_of(tmp_path / "grey-flat")


def test_corners_of_the_chart_are_dragged_onto_it(calibrated_flat, opened):
    session = calibrated_flat
    wanted = chart_corners(*CHART) * SIZE[1]
    with served(session) as (address, _):
        page = opened(address)
        wait_ready(page)
        page.click('[data-mode="chart"]')
        for (x, y), (u, v) in zip(((120, 80), (360, 80), (360, 240), (120, 240)), wanted,
                                  strict=True):
            drag(page, x, y, u, v)
        page.click("text=Use these corners")
        page.wait_for_selector("#marks >> text=chart corners")
    found = session_of(session)["chart"]["corners_px"]
    np.testing.assert_allclose(found, wanted, atol=2)       # a screen pixel is half of one


def test_a_session_that_waits_for_its_photo_takes_it(tmp_path, opened_empty):
    session = write_flat(tmp_path / "s")
    photo = session / "photos" / "sample.dng"
    taken = photo.rename(tmp_path / "IMG_7.dng")
    with served(session) as (address, _):
        page = opened_empty(address)
        page.wait_for_selector("#drop:has-text('sample.dng')")
        page.set_input_files("#wanted-file", taken)
        page.wait_for_selector("body[data-photo]")
        assert photo.read_bytes() == taken.read_bytes()


def test_corners_of_a_box_are_clicked_by_their_names(captured, opened):
    shutil.copy(TEMPLATES / "box.toml", captured / "session.toml")
    seen = marks(np.random.default_rng(1))
    with served(captured) as (address, _):
        page = opened(address)
        page.click("#tools >> text=Box")
        for name, at in seen.items():
            page.select_option("#corner", name)
            page.mouse.click(*on_screen(page, *at))
        page.click("#save")
        page.wait_for_selector("#marks >> text=8 box corners")
    camera = session_of(captured)["scene"]["box"]["camera"]
    assert camera.keys() == {"fov_deg", "corners_px"} and camera["corners_px"].keys() == seen.keys()
    for name, at in seen.items():
        np.testing.assert_allclose(camera["corners_px"][name], at, atol=1)
    assert not check_session(captured).problems
