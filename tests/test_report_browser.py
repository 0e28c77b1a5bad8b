"""Both reports in a real browser: they fetch nothing, complain of nothing, are read by keyboard,
print whole, and axe-core finds nothing serious in them.
"""
import re
import shutil
import unicodedata

import pytest
from report_example import example_session

from spectrabox.session.report.page import write_report

WIDTHS = (1300, 420)        # of a desk and of a telephone, where tables scroll
HOSTILE = "<script>alert(1)</script>"


@pytest.fixture(scope="module", params=["scene", "flat"])
def report(request, browser, _finished_flat, tmp_path_factory):
    """The report of a session with a scene, and of one without."""
    if request.param == "flat":
        return _finished_flat / "report.html"
    return write_report(example_session(tmp_path_factory.mktemp("scene"),
                                        materials=("white", HOSTILE, "green")))


@pytest.fixture
def opened(browser, report):
    """A function that opens the report; at the end nothing may have been asked for or complained
    of, by what the browser itself saw.
    """
    context, said, asked = browser.new_context(), [], []
    page = context.new_page()
    session = context.new_cdp_session(page)
    session.send("Network.enable")
    session.on("Network.requestWillBeSent", lambda sent: asked.append(sent["request"]["url"]))
    session.on("Network.webSocketCreated", lambda made: asked.append(made["url"]))
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda line: said.append(line.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("dialog", lambda dialog: said.append(dialog.message) or dialog.dismiss())

    def open_report(width=WIDTHS[0]):
        page.set_viewport_size({"width": width, "height": 900})
        page.goto(report.as_uri())
        return page
    yield open_report
    page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
    page.wait_for_load_state("networkidle")
    context.close()
    assert said == []
    assert asked and {url for url in asked if not url.startswith("data:")} == {report.as_uri()}


UNFOLD = "document.querySelectorAll('details').forEach((one) => { one.open = true; })"


def test_what_the_pointer_rests_on_is_read_out(opened):
    page = opened()
    page.evaluate(UNFOLD)
    plots = page.locator(".plot-box:has(script.readout)")
    assert plots.count() == int(page.locator("html").get_attribute("data-readouts")) > 2
    for plot in plots.all():
        plot.locator("svg").hover()
        assert re.match(r"\S.* \d+( \S+)?: .*\d", plot.locator("output").text_content())


WHAT_HAS_FOCUS = """() => {
  const focused = document.activeElement;
  if (focused === document.body) return null;
  const style = getComputedStyle(focused), box = focused.closest(".plot-box");
  const all = [...document.querySelectorAll("svg, summary, a, .scroll")];
  return {kind: focused.tagName.toLowerCase(), at: all.indexOf(focused),
          outlined: style.outlineStyle !== "none" && parseFloat(style.outlineWidth) > 0,
          name: focused.getAttribute("aria-label")
            || (focused.labels?.[0] ?? focused).textContent.trim(),
          readout: box !== null && box.querySelector("script.readout") !== null};
}"""


def focused_one_after_the_other(page):
    """What Tab reaches, with the read-outs as arrows and End change them."""
    reached, said = [], []
    for _ in range(500):
        page.keyboard.press("Tab")
        has_focus = page.evaluate(WHAT_HAS_FOCUS)
        if has_focus is None or has_focus in reached:
            break
        reached.append(has_focus)
        if has_focus["readout"]:
            for key in ("Home", "ArrowRight", "Shift+ArrowRight", "End", "ArrowLeft"):
                page.keyboard.press(key)
                said.append(page.evaluate("document.activeElement.closest('.plot-box')"
                                          ".querySelector('output').textContent"))
    return reached, said


def test_plots_are_read_out_and_tables_opened_by_keyboard_alone(opened):
    page = opened()
    page.evaluate(UNFOLD)
    reached, said = focused_one_after_the_other(page)
    plots = page.locator(".plot-box:has(script.readout)").count()
    assert sum(one["readout"] for one in reached) == plots
    assert all(one["outlined"] and one["name"] for one in reached), reached
    for home, right, far, end, left in zip(*[iter(said)] * 5, strict=True):
        assert all(re.match(r"\S.* \d+( \S+)?: .*\d", each) for each in (home, right, far, end,
                                                                        left))
        at = [int(re.search(r" (\d+)(?: \S+)?: ", each)[1]) for each in (home, right, far, end,
                                                                       left)]
        assert at[1] == at[0] + 1 and at[2] == at[1] + 10 and at[4] == at[3] - 1 > at[2]
    closed = page.locator("details").count()
    assert closed == sum(one["kind"] == "summary" for one in reached) > 2
    page.locator("summary").first.focus()
    page.keyboard.press("Enter")
    assert page.locator("details[open]").count() == closed - 1


def test_every_patch_of_the_chart_is_drawn_with_its_band_and_its_reference(opened):
    page = opened()
    page.evaluate(UNFOLD)
    # of the example of a scene no patch was left out
    patches = 24 if page.locator("#patches").count() else 0
    for part in (".band", ".mean", ".truth"):
        assert page.locator(f".patch svg {part}").count() == patches
    # as printed: six in a row
    places = page.eval_on_selector_all(".patch", "all => all.map(one => Math.round(one.offsetTop))")
    assert len(set(places)) == patches / 6 and places == sorted(places)


def test_a_table_that_is_wider_than_the_screen_is_scrolled_by_keyboard(opened):
    page = opened(WIDTHS[1])
    page.evaluate(UNFOLD)
    wide = page.evaluate("[...document.querySelectorAll('.scroll')].filter((box) =>"
                         " !box.closest('details:not([open])')"
                         " && box.scrollWidth > box.clientWidth + 1).length")
    reached, _ = focused_one_after_the_other(page)
    assert sum(one["kind"] == "div" for one in reached) >= wide > 0
    box = page.locator(".scroll").first
    box.focus()
    page.keyboard.press("ArrowRight")
    for _ in range(100):        # it glides there; the page's policy lets no one wait inside it
        if page.evaluate("document.querySelector('.scroll').scrollLeft") > 0:
            break
        page.wait_for_timeout(50)
    assert page.evaluate("document.querySelector('.scroll').scrollLeft") > 0
    # nothing else is wider than the screen
    assert page.evaluate("document.documentElement.scrollWidth") <= WIDTHS[1]


def squeezed(text):
    """Letters and digits alone: a PDF has other spaces and breaks of lines, and ligatures."""
    return re.sub(r"\W", "", unicodedata.normalize("NFKC", text))


def test_the_report_prints_whole(opened, tmp_path):
    pypdf = pytest.importorskip("pypdf", reason="reads the printed report: pip install pypdf")
    page = opened()
    page.pdf(path=tmp_path / "report.pdf", prefer_css_page_size=True, format="A4")
    sheets = pypdf.PdfReader(tmp_path / "report.pdf").pages
    printed = squeezed("".join(sheet.extract_text() for sheet in sheets))
    wanted = page.evaluate("""[...document.querySelectorAll(
        "h1, h2, h3, summary, p, li, figcaption, td, th, svg text")].filter(
        (one) => !one.closest("nav, details:not(#conditions)")).map((one) => one.textContent)""")
    assert len(wanted) > 100
    missing = [text for text in wanted if squeezed(text) not in printed]
    assert missing == []
    assert page.locator("details[open]").count() == 0       # closed again on the screen


def test_nothing_is_cut_off_on_paper(opened):
    page = opened(A4_WIDTH_PX)
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    cut = page.evaluate("""[...document.body.querySelectorAll("*")].filter((one) => {
        const box = one.getBoundingClientRect();
        const drawing = one.closest("text") && one.closest("svg").getBoundingClientRect();
        return box.width > 0 && (box.right > document.documentElement.clientWidth + 1
          || (drawing && (box.right > drawing.right + 1 || box.left < drawing.left - 1))
          || (getComputedStyle(one).overflowX !== "visible"
              && one.scrollWidth > one.clientWidth + 1));
        }).map((one) => one.outerHTML.slice(0, 200))""")
    assert cut == []


A4_WIDTH_PX = round((210 - 2 * 14) / 25.4 * 96)     # inside the margins of report.css


def test_axe_finds_nothing_serious(opened):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright",
                              reason="axe-core: pip install axe-playwright-python")
    page = opened(WIDTHS[1])    # where there is more to find: tables scroll
    page.evaluate(UNFOLD)
    found = axe.Axe().run(page, options={"resultTypes": ["violations"]}).response
    assert len(found["passes"]) > 15        # it did look; of these, one element each is named
    serious = {each["id"]: [node["html"][:200] for node in each["nodes"][:3]]
               for each in found["violations"] if each["impact"] in ("serious", "critical")}
    assert serious == {}


def test_without_chromium_the_reason_is_said(monkeypatch, request):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    fixture = request.getfixturevalue("request").node.session._fixturemanager \
        .getfixturedefs("browser", request.node)[-1]
    with pytest.raises(pytest.skip.Exception, match=r"no Chromium .*apt install chromium"):
        next(fixture.func())
