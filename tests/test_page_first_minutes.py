"""What a photographer meets first: a question, a white card, regions to mend, a verdict."""
import tomllib
from fractions import Fraction

import numpy as np
import pytest
from flat_example import picture, rect_of, write_flat
from served_page import drag, opened_in, served, wait_ready

from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.session.commands.session import _folder_to_open

# whatever is said while the verdict on what is marked is still being worked out
UNSETTLED = """() => { window.unsettled = []; window.said = 0;
  const verdict = document.querySelector("#verdict");
  const look = () => { const { className, textContent } = verdict;
    if (verdict.hidden || !["pass", "warn", "fail"].includes(className)) return;
    if (textContent.startsWith("Chart")) return;
    window.said += 1;
    if (document.body.dataset.result !== "true") window.unsettled.push(textContent); };
  new MutationObserver(look).observe(verdict, { childList: true, subtree: true, attributes: true });
}"""
CUT_OFF = """() => {
  const one = document.querySelector("#verdict");
  return one.scrollWidth > one.clientWidth + 1 || one.scrollHeight > one.clientHeight + 1; }"""


def session_of(folder):
    return tomllib.loads((folder / "session.toml").read_text(encoding="utf-8"))


@pytest.fixture
def opened(browser):
    with opened_in(browser) as open_address:
        yield open_address


def test_the_finish_is_asked_once_and_then_for_a_card_with_its_error(calibrated_flat, opened):
    with served(calibrated_flat) as (address, _):
        page = opened(address)
        wait_ready(page)
        page.wait_for_selector("[data-chip=gloss]:has-text('assumed')")
        assert page.locator("#ask [data-finish]").count() == 4
        page.click("#ask [data-finish=matt]")
        page.click("#ask [data-card=yes]")
        assert session_of(calibrated_flat)["session"]["surface"] == "matt"
        page.wait_for_selector("[data-chip=gloss]:has-text('stated')")
        drag(page, *rect_of("white_wall"))
        page.wait_for_selector("#card-known")
        page.fill("#card-known", "0.87")
        page.fill("#card-error", "0.02")
        page.press("#card-error", "Enter")
        page.wait_for_selector("#card-known", state="hidden")
        assert session_of(calibrated_flat)["regions"]["white card"]["known"].endswith(
            "0.87 +- 0.02.csv")
        page.wait_for_selector("#ask", state="hidden")
        page.reload()
        wait_ready(page)
        assert page.is_hidden("#ask")


def test_who_does_not_know_the_finish_is_not_asked_again(calibrated_flat, opened):
    with served(calibrated_flat) as (address, live):
        page = opened(address)
        page.click("#ask [data-finish=unknown]")
        page.click("#ask [data-card=no]")
        page.wait_for_selector("#ask", state="hidden")
        assert session_of(calibrated_flat)["session"]["surface"] == "unknown"
        wait_ready(page)
        page.wait_for_selector("[data-chip=gloss]:has-text('assumed')")
        assert live.state()["problems"] == []


def test_a_region_across_an_edge_is_mended_by_a_button(calibrated_flat, opened):
    x0, y0, x1, y1 = rect_of("green_wall")
    across = [x0, y0, x1 + 40, y1]          # 26 pixels of the table at its right
    with served(calibrated_flat) as (address, _):
        page = opened(address)
        wait_ready(page)
        page.click("[data-mode=region]")
        drag(page, *across)
        page.click('[aria-label="Fix sample 1"]')
        page.wait_for_selector('[aria-label="Fix sample 1"]', state="detached")
        page.wait_for_selector("#marks li[data-name='sample 1'] .lab:not(.bad):has-text('.')")
        left, top, right, bottom = session_of(calibrated_flat)["regions"]["sample 1"]["rect"]
        # of the paint, which ends 14 pixels beyond the inner rectangle
        assert left >= across[0] - 2 and right <= x1 + 15
        assert right - left > 0.7 * (x1 - x0) and bottom - top > 0.7 * (y1 - y0)


def test_the_part_of_a_region_that_is_not_clipped_is_marked_by_a_button(tmp_path, opened):
    light, rng, photo = picture(), np.random.default_rng(3), tmp_path / "IMG_1.dng"
    x0, y0, x1, y1 = rect_of("green_wall")
    gain = write_photo(photo, light, Fraction(1, 60), rng)
    light[y0:y1, (x0 + x1) // 2:x1] *= 50.0         # a reflection, on its right half
    write_photo(photo, light, Fraction(1, 60), rng, brightest=None, gain=gain)
    session = _folder_to_open((photo,))
    with served(session) as (address, _):
        page = opened(address)
        wait_ready(page)
        drag(page, x0, y0, x1, y1)
        page.click("#fix-clipped")
        page.wait_for_selector("#marks li[data-name='sample 1'] .spark")
        left, top, right, bottom = session_of(session)["regions"]["sample 1"]["rect"]
        assert left == pytest.approx(x0, abs=3) and right == pytest.approx((x0 + x1) / 2, abs=4)
        assert (top, bottom) == pytest.approx((y0, y1), abs=4)


def test_a_wrong_card_says_so_and_leaves_the_other_spectra(calibrated_flat, opened):
    with served(calibrated_flat) as (address, live):
        page = opened(address)
        wait_ready(page)
        page.wait_for_selector("#marks li[data-name='green_wall'] .spark")
        right = live.live.region("green_wall")
        state = live.state()
        live.marks.apply({"kind": "stated", "name": "white_wall",
                          "stated": {"known": "0.3 +- 0.003"}}, state["digest"])
        row = "#marks li[data-name='white_wall']"
        page.wait_for_selector(f"{row} .lab.bad")
        page.click(f"{row} .sw")
        page.wait_for_selector(f"{row} .statements .bad:has-text('Not used')")
        assert live.live.region("green_wall")["mean"] == right["mean"]
        page.wait_for_selector("#verdict.warn")     # and the verdict says what is wrong
        found = {one["code"]: one["subject"] for one in live.live.state()["result"]["findings"]}
        assert found["flat.known-other-level"] == "white_wall"


def test_no_verdict_is_shown_before_it_is_settled_and_none_is_cut_off(tmp_path, browser):
    with served(write_flat(tmp_path / "s")) as (address, _), opened_in(
            browser, viewport={"width": 390, "height": 844}) as opened:
        page = opened(address)
        page.evaluate(UNSETTLED)
        wait_ready(page)
        page.wait_for_selector("body[data-result=true]")
        for width in (390, 800, 1400):
            page.set_viewport_size({"width": width, "height": 844})
            assert not page.evaluate(CUT_OFF), width
        page.set_viewport_size({"width": 390, "height": 844})
        page.click("#ask [data-finish=glossy]")
        page.wait_for_selector("#verdict.judging")
        page.wait_for_selector("body[data-result=true]")
        page.wait_for_selector("#verdict:is(.pass, .warn, .fail)")
        assert page.evaluate("window.unsettled") == [] and page.evaluate("window.said") > 0


def test_two_colours_are_compared_in_their_own_colours(calibrated_flat, opened):
    with served(calibrated_flat) as (address, live):
        page = opened(address)
        wait_ready(page)
        for name in ("green_wall", "red_wall"):
            page.check(f'[aria-label="Compare {name}"]')
        page.wait_for_selector("#comparison .spectrum")
        strokes = [page.locator("#comparison .spectrum").locator(one).get_attribute("stroke")
                   for one in (".mean", ".other")]
        # in closed form, and not from draws as the marks are: a code value or two
        for name, stroke in zip(("green_wall", "red_wall"), strokes, strict=True):
            mark, line = (np.frombuffer(bytes.fromhex(colour[1:]), np.uint8).astype(int)
                          for colour in (live.live.region(name)["hex"], stroke))
            assert np.abs(mark - line).max() <= 6
        # a lamp that nobody stated is no statement
        assert "stated" not in page.get_attribute("[data-chip=lamp]", "class") or \
            session_of(calibrated_flat)["light"]["spectrum"] != "unknown"
