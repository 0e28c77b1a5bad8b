"""What a report plots and embeds is what the records and the files behind it say."""
import json
import shutil

import numpy as np
import pytest
from report_example import example_session
from typer.testing import CliRunner

from spectrabox.radiometry.files import sha256_of
from spectrabox.session.cli import app
from spectrabox.session.report.page import write_report


@pytest.fixture(scope="module")
def written(_finished_flat, tmp_path_factory):
    """A folder with a report of a scene, and one of a flat sample, both as they were written."""
    scene = tmp_path_factory.mktemp("scene")
    write_report(example_session(scene, materials=("white", "a/b ~ <i>", "green")))
    return {"scene": scene, "flat": shutil.copytree(_finished_flat, scene.parent / "embedded")}


def numbers_of(folder):
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


def edited(folder, name, old, new):
    """A file of the folder with one place changed."""
    path = folder / name
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


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


def test_files_are_compared_with_the_page_in_the_browser(browser, written, tmp_path):
    folder = shutil.copytree(written["flat"], tmp_path / "s")
    photo, toml = folder / "photos" / "sample.dng", folder / "session.toml"

    def sentences(*files):
        with browser.new_page() as page:
            page.goto((folder / "report.html").as_uri())
            page.set_input_files("#check-files", files)
            page.wait_for_selector("#check-says[data-wrong]", state="attached")
            return page.locator("#check-says p").all_text_contents()

    before = sentences(folder / "report.json", photo, toml)
    assert "report.json holds the numbers of this page." in before
    assert "photos/sample.dng is the file that this page was made from." in before
    edited(folder, "report.json", '"name":"', '"name":"x')
    edited(folder, "session.toml", "", "# noted\n")
    after = sentences(folder / "report.json", photo, toml)
    assert "report.json holds other numbers than this page." in after
    assert "session.toml is not as it was when this page was made." in after
    assert "photos/sample.dng is the file that this page was made from." in after


def test_a_note_in_session_toml_makes_the_report_anew(written, tmp_path):
    """Its digest stands in the report, and would no longer be that of the file."""
    folder = shutil.copytree(written["flat"], tmp_path / "s")
    toml = folder / "session.toml"
    toml.write_text(toml.read_text(encoding="utf-8") + "# noted\n", encoding="utf-8")
    embedded = numbers_of(folder)["made_from"]["session"]
    assert embedded != {"session.toml": sha256_of(toml)}
    assert CliRunner().invoke(app, ["run", str(folder), "--quiet"]).exit_code == 0
    assert numbers_of(folder)["made_from"]["session"] == {"session.toml": sha256_of(toml)}
