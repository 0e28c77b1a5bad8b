"""The report in a real browser: spectra beside the photo, cards that open, and how long it is."""
import json
import re

import pytest
from report_example import example_session

from spectrabox.session.report.page import write_report

WIDE = {"width": 1400, "height": 900}
MAX_PX, MAX_SHEETS = 3500, 4        # of a report of eight regions
CAPTIONS = """[...document.querySelectorAll("figcaption")].filter((one) =>
    one.getBoundingClientRect().height > 2.2 * parseFloat(getComputedStyle(one).lineHeight))
    .map((one) => one.textContent)"""
UNFOLD = "document.querySelectorAll('details').forEach((one) => { one.open = true; })"


@pytest.fixture(scope="module")
def painting(finished_painting):
    """The report of eight regions and a white card."""
    return finished_painting / "report.html"


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    return write_report(example_session(tmp_path_factory.mktemp("box")))


@pytest.fixture
def page(browser):
    with browser.new_page(viewport=WIDE) as page:
        yield page


def test_eight_regions_fit_a_page_of_a_few_screens_and_four_sheets(page, painting, tmp_path):
    pypdf = pytest.importorskip("pypdf", reason="reads the printed report: pip install pypdf")
    page.goto(painting.as_uri())
    assert page.locator(".card:not(.given)").count() == 8
    assert page.evaluate("document.documentElement.scrollHeight") <= MAX_PX
    page.pdf(path=tmp_path / "report.pdf", prefer_css_page_size=True, format="A4")
    sheets = pypdf.PdfReader(tmp_path / "report.pdf").pages
    assert len(sheets) <= MAX_SHEETS
    # what is folded on the cards is read on paper, and so is how to read it
    printed = re.sub(r"\s", "", "".join(sheet.extract_text() for sheet in sheets))
    assert printed.count("whythebandisthiswide:") == printed.count("onetothiscamera;") == 8
    assert printed.count("Metamerismiswhatwouldremain") == 1


@pytest.mark.parametrize("report", ["painting", "box"])
def test_the_first_screen_answers_and_what_it_rests_on_folds_out(page, report, request):
    page.set_viewport_size({"width": 1400, "height": 900})
    page.goto(request.getfixturevalue(report).as_uri())
    for part in ("#verdict", "#photos svg.plot", "svg.spectra", ".card .colour"):
        box = page.locator(part).first.bounding_box()
        assert box["y"] + min(box["height"], 400) <= 900, part
    table = page.locator("#conditions table")
    assert table.is_hidden()
    page.click("nav a[href='#conditions']")
    table.wait_for()
    assert table.locator("tbody tr").count() > 3


@pytest.mark.parametrize("report", ["painting", "box"])
def test_captions_have_at_most_two_lines(page, report, request):
    page.goto(request.getfixturevalue(report).as_uri())
    page.evaluate(UNFOLD)
    assert page.locator("figcaption").count() > 8
    assert page.evaluate(CAPTIONS) == []


@pytest.mark.parametrize("report, name", [("painting", "wall"), ("box", "red paint")])
def test_a_part_of_the_photo_opens_its_card(page, report, name, request):
    page.goto(request.getfixturevalue(report).as_uri())
    card = page.locator(".card", has=page.get_by_role("link", name=name, exact=True))
    assert card.locator("details[open]").count() == 0
    mark = page.locator(f"#photos a.mark[aria-label='{name}']").first
    for _ in range(2):      # shut again by hand, it opens once more
        mark.press("Enter")
        card.locator("details.on-card[open]").wait_for()
        assert card.locator(".words").is_visible()
        card.locator("summary").first.click()
        assert card.locator("details[open]").count() == 0


def test_a_line_shows_its_band_and_its_values_and_opens_its_card(page, painting):
    page.goto(painting.as_uri())
    numbers = json.loads(page.locator("#spectrabox-results").text_content())["regions"]
    plot, said = page.locator("svg.spectra"), page.locator(".all-spectra output")
    assert plot.locator(".curve").count() == len(numbers) and not shown_bands(plot)
    plot.focus()
    for _ in numbers:
        page.keyboard.press("ArrowDown")
        name, nm, mean, lower, upper = re.match(
            r"(.*) at (\d+)\snm: ([\d.]+)(?: \(([\d.]+) to ([\d.]+)\)|, as given)",
            said.text_content()).groups()
        region = next(each for each in numbers if each["name"] == name)
        if region["known"]:
            assert lower is None and not shown_bands(plot)
            continue
        assert shown_bands(plot) == 1
        at = region["summary"]["nm"].index(float(nm))
        for words, curve in ((mean, "mean"), (lower, "lower"), (upper, "upper")):
            assert float(words) == pytest.approx(region["summary"][curve][at], abs=6e-4)
    page.keyboard.press("ArrowUp")
    chosen = said.text_content().split(" at ")[0]
    page.keyboard.press("Enter")
    page.locator("details.on-card[open]").wait_for()
    assert page.locator(".card:has(details[open]) h2").text_content().strip().startswith(chosen)
    page.mouse.move(5, 5)
    plot.blur()
    assert shown_bands(plot) == 1       # of the open card


def shown_bands(plot):
    """How many bands are to be seen."""
    return sum(band.is_visible() for band in plot.locator(".band").all())
