"""Whether a report still shows its data: by its button in a real browser, and by --check."""
import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
from flat_example import write_flat
from report_example import example_session
from typer.testing import CliRunner

from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages
from spectrabox.session.report import words
from spectrabox.session.report.checked.cells import of, shows, value_at
from spectrabox.session.report.checked.page_check import differences, page_faults
from spectrabox.session.report.page import write_report
from spectrabox.session.run_outputs import rewritten_outputs
from spectrabox.session.store.results import ViewResult

FORMATS = [words.percent, words.signed_percent, words.number, words.fixed, words.exposure,
           lambda value: words.fixed(value, 0), lambda value: words.number(value, 2),
           lambda value: words.percent(value, 0), lambda value: words.fact(float(value))]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with a report of a scene, and one of a flat sample, both as they were written."""
    scene, flat = (tmp_path_factory.mktemp(name) for name in ("scene", "flat"))
    write_report(example_session(scene, materials=("white", "a/b ~ <i>", "green")))
    config = read_session(write_flat(flat / "s"))
    finished = run_stages(config, device="cpu", only=None, force=False, progress=lambda *_: None)
    rewritten_outputs(config, finished, ["spectrabox", "run"], "cpu")
    return {"scene": scene, "flat": config.folder}


@pytest.fixture(params=["scene", "flat"])
def folder(request, written, tmp_path):
    return shutil.copytree(written[request.param], tmp_path / "s")


def numbers_of(folder):
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


def edited(folder, old, new):
    """The page with one place changed."""
    path = folder / "report.html"
    text = path.read_text(encoding="utf-8")
    assert text.count(old) >= 1
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def asked(browser, folder, files=()):
    """What the page says after its button, or a choice of files."""
    with browser.new_page() as page:
        page.goto((folder / "report.html").as_uri())
        if files:
            page.set_input_files("#check-files", files)
        else:
            page.click("#check-page")
        page.wait_for_selector("#check-says[data-wrong]")
        return page.inner_text("#check-says"), [
            item.inner_text() for item in page.locator("#check-says li").all()]


@pytest.mark.parametrize("write", FORMATS)
def test_a_number_shows_itself_and_no_neighbour(write):
    rng = np.random.default_rng(4)
    for value in [*10 ** rng.uniform(-4, 4, 300), 0.5, 1.0, 0.125, 25.0, 1 / 60, 1 / 500]:
        text = write(float(value))
        assert shows(text, float(value)), (text, value)
        if re.search(r"[1-9]", text) and "1/" not in text:
            last = re.search(r"\d(?=\D*$)", text.partition(" ×")[0].partition("e")[0])
            other = str((int(last[0]) + 5) % 10)
            assert not shows(text[:last.start()] + other + text[last.end():], float(value))


def test_signs_units_and_what_is_not_known():
    assert shows("−1.3 %", -0.0131) and not shows("1.3 %", -0.0131)
    assert shows("not measured", None) and not shows("0.0", None)
    assert not shows("not measured", 0.1)
    assert shows("1/60 s", 1 / 60) and not shows("1/60 s", 1 / 62)
    assert shows("1.23 × 10⁻⁵", 1.2341e-5) and not shows("1.23 × 10⁻⁵", 1.2341e-4)
    assert shows("± 0.012", 0.0121) and shows(" red\n paint", "red paint")


def test_a_pointer_leads_back_to_its_number():
    content = {"a/b": [{"~x": 3}]}
    pointer = re.search('data-of="(.*)"', of("a/b", [0, "~x"]))[1]
    assert pointer == "/a~1b/0/~0x" and value_at(content, pointer) == 3
    for nowhere in ("/a~1b/1", "/a~1b/x", "/a~1b/0/~0x/y", "/c"):
        with pytest.raises(KeyError):
            value_at(content, nowhere)


def test_every_number_of_a_table_says_which_of_the_data_it_is(folder):
    page = (folder / "report.html").read_text(encoding="utf-8")
    cells = re.findall(r'<td class="n[^"]*"([^>]*)>(.*?)</td>', page)
    with_digit = [(tag, text) for tag, text in cells if re.search(r"\d", re.sub("<.*?>", "", text))]
    assert len(with_digit) > 300
    assert [each for each in with_digit if "data-of" not in each[0] + each[1]] == []
    assert page_faults(page, numbers_of(folder))[1] == []


def test_what_is_plotted_is_what_the_records_say(written):
    numbers = numbers_of(written["scene"])
    for number, material in enumerate(numbers["materials"], start=1):
        lines = {line["label"]: line for line in
                 numbers["plots"][f"spectrum-{number}"]["axes"][0]["lines"]}
        label, values = ("mean", material["summary"]["mean"]) if material["summary"] else (
            "given spectrum", material["inverse_rendering"]["reflectance"])
        # six significant digits are kept
        np.testing.assert_allclose(lines[label]["y"], values, rtol=5e-6)
        bars = numbers["plots"].get(f"budget-{number}", {"axes": [{"bars": []}]})["axes"][0]["bars"]
        stated = [100 * value for values in material["error_budget"].values() for value in values]
        assert sorted(bar["corners"][2] for bar in bars) == pytest.approx(sorted(stated), rel=5e-6)


def test_an_untouched_report_agrees(browser, folder):
    said, faults = asked(browser, folder)
    assert said.startswith("They agree.") and faults == []
    assert int(re.search(r"(\d+) entries", said)[1]) > 300


def test_a_changed_digit_of_a_table_is_named(browser, folder):
    numbers = numbers_of(folder)
    key = "materials" if "materials" in numbers else "regions"
    name = numbers[key][0]["name"]
    value = numbers[key][0]["scores"]["rmse_mean"]
    shown = f'rmse_mean">{value:.4f}<'
    edited(folder, shown, shown[:-2] + str((int(shown[-2]) + 1) % 10) + "<")
    said, faults = asked(browser, folder)
    assert said.startswith("They do not agree.") and len(faults) == 1
    assert name in faults[0] and "RMSE, mean" in faults[0] and f"/{key}/0/scores" in faults[0]
    found = page_faults((folder / "report.html").read_text(encoding="utf-8"), numbers)[1]
    assert len(found) == 1 and f"/{key}/0/scores/rmse_mean" in found[0]


def first_mean(page):
    """The path that is drawn of the first mean spectrum."""
    number = re.search(r'"(spectrum-1)":.*?"id":"(s\d+)","label":"mean"', page)
    return re.search(rf'<g id="{number[1]}-{number[2]}">\s*<path d="([^"]*)"', page)[1]


@pytest.mark.parametrize("digit, says", [("tens", "mean: "), ("hundredths", "as it was written")])
def test_a_changed_digit_of_a_plot_is_named(browser, folder, digit, says):
    path = first_mean((folder / "report.html").read_text(encoding="utf-8"))
    y = list(re.finditer(r"L -?[\d.]+ (\d+)\.?(\d*)", path))[10]
    old = y[0]
    new = old[:-1] + str((int(old[-1]) + 1) % 10) if digit == "hundredths" else re.sub(
        r" (\d+)(\.\d*)?$", lambda found: f" {int(found[1]) + 10}{found[2] or ''}", old)
    edited(folder, path, path.replace(old, new, 1))
    said, faults = asked(browser, folder)
    assert said.startswith("They do not agree.") and len(faults) == 1
    assert "Reflectance of" in faults[0] and says in faults[0]
    numbers = numbers_of(folder)
    assert len(page_faults((folder / "report.html").read_text(encoding="utf-8"), numbers)[1]) == 1


def test_other_data_in_the_page_are_noticed(browser, folder):
    """Tables, plots and pictures of the page against data that somebody has changed in it."""
    page = (folder / "report.html").read_text(encoding="utf-8")
    start, value = re.search(r'("label":"mean","x":\[[^]]*\],"y":\[)([^,]*)', page).groups()
    edited(folder, start + value, f"{start}{float(value) + 0.1}")
    edited(folder, '"pictures":{"photo":"', '"pictures":{"photo":"0')
    faults = asked(browser, folder)[1]
    assert len(faults) == 2 and "mean: at 400" in faults[0] and "Picture" in faults[1]


def test_a_word_of_the_verdict_is_held_against_the_data(browser, folder):
    page = (folder / "report.html").read_text(encoding="utf-8")
    word = re.search(r'data-of="/verdict/status">(\w+)<', page)[1]
    edited(folder, f'/verdict/status">{word}<', '/verdict/status">FINE<')
    assert "FINE" in asked(browser, folder)[1][0]


def test_files_are_held_against_the_page(browser, written, tmp_path):
    folder = shutil.copytree(written["flat"], tmp_path / "s")
    photo, toml = folder / "photos" / "sample.dng", folder / "session.toml"
    said, faults = asked(browser, folder, [folder / "report.json", photo, toml])
    assert faults == [] and "photos/sample.dng: the file" in said and "report.json" in said
    numbers = numbers_of(folder)
    numbers["regions"][1]["signal"][0] += 1e-9
    (folder / "report.json").write_text(json.dumps(numbers), encoding="utf-8")
    toml.write_text(toml.read_text(encoding="utf-8") + "# noted\n", encoding="utf-8")
    _, faults = asked(browser, folder, [folder / "report.json", photo, toml])
    assert len(faults) == 2 and "/regions/1/signal/0" in faults[0]
    assert faults[1].startswith("session.toml: not as it was")


def checked(folder):
    found = CliRunner().invoke(app, ["report", str(folder), "--check"])
    return found.exit_code, found.stdout


def test_the_command_holds_report_files_and_results_against_each_other(written, tmp_path):
    folder = shutil.copytree(written["flat"], tmp_path / "s")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    code, said = checked(folder)
    assert code == 0 and said.startswith("report and data agree")
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before

    numbers = numbers_of(folder)
    was = numbers["regions"][0]["summary"]["mean"][7]
    for name in ("report.json", "report.html"):     # whoever changes both deceives the page
        path = folder / name
        path.write_text(path.read_text(encoding="utf-8").replace(repr(was), repr(was + 0.001)),
                        encoding="utf-8")
    code, said = checked(folder)
    assert code == 4 and "the stored results give another value" in said
    assert "/regions/0/summary/mean/7" in said

    (folder / "report.json").unlink()
    assert checked(folder)[0] == 3


def test_the_command_names_inputs_that_are_no_longer_those(written, tmp_path):
    folder = shutil.copytree(written["flat"], tmp_path / "s")
    (folder / "spectra" / "light.csv").write_text("nothing", encoding="utf-8")
    code, said = checked(folder)
    assert code == 4 and "spectra/light.csv is not as it was" in said


def test_further_photos_are_checked_too(browser, tmp_path):
    results = example_session(tmp_path)
    view = ViewResult('left/1 ~ "x"', results.bands, results.calibration, results.photo_preview,
                      results.reconstruction)
    write_report(dataclasses.replace(results, views=[view]))
    page, numbers = (tmp_path / "report.html").read_text(encoding="utf-8"), numbers_of(tmp_path)
    assert "pair-2" in numbers["plots"] and f"photo {view.name}" in numbers["pictures"]
    assert 'data-of="/views/0/agreement/0/ratio/0"' in page
    assert page_faults(page, numbers)[1] == []
    assert asked(browser, tmp_path)[0].startswith("They agree.")


def test_differences_are_named_by_pointer():
    mine = {"a": [1, {"b/c": 2}], "d": None}
    assert list(differences(mine, mine)) == []
    assert list(differences(mine, {"a": [1, {"b/c": 3}], "e": 1})) == ["/a/1/b~1c", "/d", "/e"]
    assert list(differences(mine, {"a": [1], "d": None})) == ["/a"]


def test_a_note_in_session_toml_makes_the_report_anew(written, tmp_path):
    """Its digest stands in the report, and would no longer be that of the file."""
    folder = shutil.copytree(written["flat"], tmp_path / "s")
    toml = folder / "session.toml"
    toml.write_text(toml.read_text(encoding="utf-8") + "# noted\n", encoding="utf-8")
    assert checked(folder)[0] == 4
    assert CliRunner().invoke(app, ["run", str(folder), "--quiet"]).exit_code == 0
    assert checked(folder)[0] == 0
