"""axe-core on the page that ``open`` serves, in every state that an operator meets, light and dark.
"""
import pytest
from flat_example import write_flat
from served_page import TOKEN, served, served_by
from test_report_screens import CONTRASTS
from typer.testing import CliRunner

from spectrabox.session.cli import app
from spectrabox.session.page.start_page import StartPage

MAX_WAIT_MS = 600_000        # a test waits for a state, and the machine may be busy
SCHEMES = ("light", "dark")


@pytest.fixture(scope="module")
def axe():
    return pytest.importorskip("axe_playwright_python.sync_playwright",
                               reason="axe-core: pip install axe-playwright-python").Axe()


@pytest.fixture
def judged(browser, axe):
    """A function that opens an address and gives the page, and another that asks axe-core."""
    context = browser.new_context(viewport={"width": 1400, "height": 1000})
    context.set_default_timeout(MAX_WAIT_MS)
    page = context.new_page()

    def open_page(address, photo=True, shown="#photos li"):
        page.goto(f"{address}/?token={TOKEN}")
        page.wait_for_selector("body[data-photo]" if photo else shown)
        return page

    def nothing_serious(part=None):
        """In all of the page or in a part of it; in the dark, colours alone are others."""
        for scheme in SCHEMES:
            page.emulate_media(color_scheme=scheme)
            page.wait_for_timeout(100)
            found = axe.run(page, part, {"resultTypes": ["violations"]} | (
                {"runOnly": ["color-contrast"]} if scheme == "dark" else {})).response
            # it did look
            assert len(found["passes"]) > (10 if part is None and scheme == "light" else 0)
            serious = {each["id"]: [node["html"][:200] for node in each["nodes"][:3]]
                       for each in found["violations"]
                       if each["impact"] in ("serious", "critical", "moderate")}
            assert serious == {}, scheme
            faint = [each for each in page.evaluate(CONTRASTS) if each[0] < 4.5]
            assert faint == [], scheme
    yield open_page, nothing_serious
    context.close()


def test_axe_finds_nothing_in_an_empty_session(tmp_path, judged):
    open_page, nothing_serious = judged
    assert CliRunner().invoke(app, ["new", str(tmp_path / "s"), "--template", "flat"]
                              ).exit_code == 0
    with served(tmp_path / "s") as (address, _):
        page = open_page(address, photo=False)
        assert "missing" in page.inner_text("#photos")
        assert page.locator("#drop").is_visible()
        nothing_serious()


def test_axe_finds_nothing_while_marking_running_and_reading(tmp_path, judged, calibrated_flat):
    open_page, nothing_serious = judged
    coming = tmp_path / "coming"
    coming.mkdir()
    with served(calibrated_flat, coming) as (address, _):
        page = open_page(address)
        page.click("#marks li:nth-child(1) .sw")
        page.wait_for_selector("#marks li.selected .spark")
        page.wait_for_selector("#marks li.selected .statements")
        page.wait_for_selector("body[data-result=true]")
        nothing_serious()
        for mode in ("region", "polygon", "white", "chart"):
            page.click(f'[data-mode="{mode}"]')
            page.focus("#canvas")
            page.keyboard.press("Enter")            # a point is set, and can be cleared
            page.wait_for_selector("#clear:not([hidden])")
            nothing_serious()
        page.click('[data-mode="compare"]')
        for number in (1, 2):
            page.click(f"#marks li:nth-child({number}) .sw")
        page.wait_for_selector("#comparison table")
        nothing_serious()
        for opens in ("#name", "#verdict", "#export", "#add-photo", "#keys", "[data-chip=lamp]",
                      "[data-chip=gloss]", "[data-chip=plane]", "[data-chip=measured]"):
            page.click(opens)
            page.wait_for_selector("#panel:popover-open")
            nothing_serious("#panel")
        page.click("#run")
        page.wait_for_selector("#stop:not([hidden])")
        page.click("#progress")
        page.click("#log-box summary")
        nothing_serious()
        page.wait_for_selector("#report:not([hidden])")
        page.frame_locator("#report-frame").locator("h1").first.wait_for()
        nothing_serious()
        page.click("#run")
        (coming / "broken.dng").write_bytes(b"no photo")
        page.wait_for_selector("#watched >> text=broken.dng")
        nothing_serious()


def test_axe_finds_nothing_where_sessions_are_listed(tmp_path, judged):
    open_page, nothing_serious = judged
    write_flat(tmp_path / "s")
    with served_by(StartPage(tmp_path)) as address:
        open_page(address, photo=False, shown="#sessions li")
        nothing_serious()


def test_axe_finds_nothing_on_a_telephone(judged, calibrated_flat):
    open_page, nothing_serious = judged
    with served(calibrated_flat) as (address, _):
        page = open_page(address)
        page.set_viewport_size({"width": 400, "height": 800})
        nothing_serious()
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
