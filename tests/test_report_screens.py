"""The report on a phone and in the dark, in a real browser."""

import pytest
from report_example import example_session

from spectrabox.session.report.page import write_report

# contrast of every text against what lies behind it (WCAG 2, 1.4.3)
CONTRASTS = """() => {
  const channel = (c) => (c /= 255) <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  const numbers = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => 0.2126 * channel(r) + 0.7152 * channel(g) + 0.0722 * channel(b);
  const behind = (node) => { for (let n = node; n; n = n.parentElement) {
    const c = numbers(getComputedStyle(n).backgroundColor);
    if (c.length < 4 || c[3] > 0.5) return c; }
    return [255, 255, 255]; };
  return [...document.querySelectorAll("p, td, th, h1, h2, h3, a, figcaption, summary, code, li")]
    .filter((n) => !n.closest("svg") && n.innerText.trim()).map((n) => {
      const [a, b] = [light(numbers(getComputedStyle(n).color)), light(behind(n))];
      return [(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05),
              n.tagName + " " + n.innerText.slice(0, 40)]; });
}"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return write_report(example_session(tmp_path_factory.mktemp("report"),
                                        materials=("white", "red", "green")))


def test_on_a_phone_nothing_is_cut_off_and_no_column_is_a_letter_wide(browser, report):
    with browser.new_page(viewport={"width": 400, "height": 800}) as page:
        page.goto(report.as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
        widths = page.eval_on_selector_all(
            "#problems td:last-child", "cells => cells.map(cell => cell.clientWidth)")
        assert len(widths) > 0 and min(widths) > 250


def test_on_a_phone_the_words_of_photo_and_spectra_can_be_read(browser, report):
    with browser.new_page(viewport={"width": 390, "height": 844}) as page:
        page.goto(report.as_uri())
        heights = page.eval_on_selector_all(
            "#photos svg text", "all => all.map((one) => one.getBoundingClientRect().height)")
        # a line of text of 8 pixels; they were 5 to 7 high
        assert heights and min(heights) > 9
        # what to do stands before what it costs and brings
        cells = page.eval_on_selector_all(
            "#next tr:nth-child(1) td", "all => all.map((one) => one.getBoundingClientRect().top)")
        assert cells == sorted(cells)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_can_be_read_in_light_and_dark(browser, report, scheme):
    with browser.new_page(color_scheme=scheme) as page:
        page.goto(report.as_uri())
        dark = page.evaluate("getComputedStyle(document.documentElement).backgroundColor")
        assert (dark != "rgb(255, 255, 255)") == (scheme == "dark")
        contrasts = page.evaluate(CONTRASTS)
        assert len(contrasts) > 50
        assert min(contrasts)[0] >= 4.5, min(contrasts)
