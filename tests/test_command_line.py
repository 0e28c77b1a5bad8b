import json
import os
import re
import struct
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import spectrabox
from spectrabox.fixtures.demos.demo_session import PAINTS
from spectrabox.fixtures.dng import write_dng
from spectrabox.fixtures.paints import paint
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.session.terminal.command_help import SUBJECTS, USUAL
from spectrabox.session.terminal.command_line import reported_errors

from tests.session_runs import call, edit

ROOT = Path(__file__).resolve().parent.parent



def repaint(path, paint):
    """Replace the sensor values (H, W) of a DNG in its place, leaving camera, exposure and black
    level.
    """
    content = bytearray(path.read_bytes())
    directory = struct.unpack("<L", content[4:8])[0]
    count = struct.unpack("<H", content[directory:directory + 2])[0]
    tags = {struct.unpack("<H", content[at:at + 2])[0]: struct.unpack("<L",
                                                                      content[at + 8:at + 12])[0]
            for at in range(directory + 2, directory + 2 + 12 * count, 12)}
    width, height, start = tags[256] & 0xFFFFFFFF, tags[257], tags[273]
    mosaic = np.frombuffer(bytes(content[start:start + 2 * width * height]), "<u2").reshape(height,
                                                                                            width)
    painted = np.clip(paint(mosaic.astype(float)), 0, 15871).astype("<u2")
    content[start:start + painted.nbytes] = painted.tobytes()
    path.write_bytes(bytes(content))


def remove_photo(folder): (folder / "photos" / "box.dng").unlink()
def empty_photo(folder): (folder / "photos" / "box.dng").write_bytes(b"")
def unknown_key(folder): edit(folder, "draws =", "drawss =")
def no_material(folder): edit(folder, 'bsdf = "cube"', 'bsdf = "cubes"')
def broken_scene(folder): edit(folder, "</scene>", "", "scene/box.xml")
def broken_toml(folder): edit(folder, "[photos]", "[photos")


def truncated_photo(folder):
    path = folder / "photos" / "box.dng"
    path.write_bytes(path.read_bytes()[:20000])


def no_chart(folder):
    noise = np.random.default_rng(1).normal(0, 20, (208, 312))
    repaint(folder / "photos" / "chart.dng", lambda mosaic: 4000 + noise)


def bright_object(folder):
    repaint(folder / "photos" / "box.dng", lambda mosaic: np.where(np.arange(312) < 200, 15871,
                                                                   mosaic))


def clipped_chart(folder):
    repaint(folder / "photos" / "chart.dng", lambda mosaic: 600 + 4 * (mosaic - 600))


def other_size(folder):
    noise = np.random.default_rng(1).normal(0, 20, (208, 208))
    write_dng(folder / "photos" / "box.dng", (4000 + noise).astype(np.uint16), white=15871,
              exposure_s=Fraction(1, 100), f_number=8.0, iso=100)
    edit(folder, 'flat = "photos/flat.dng"', "")


def short_light(folder):
    path = folder / "spectra" / "light.csv"
    kept = [line for line in path.read_text(encoding="utf-8").splitlines()
            if not re.match(r"\d+", line) or int(float(line.split(",")[0])) >= 420]
    path.write_text("\n".join(kept), encoding="utf-8")


def extra_surface(folder):
    edit(folder, "</scene>", '<bsdf type="diffuse" id="brass"/><shape type="sphere" id="knob"><ref '
         'id="brass"/></shape>' "</scene>", "scene/box.xml")


def results_is_a_file(folder): (folder / "results").write_text("in the way")


BAD_INPUT = [
    (remove_photo, 3, r"box\.dng (is missing|does not exist)"),
    (empty_photo, 3, r"box\.dng.*empty"),
    (truncated_photo, 3, r"box\.dng"),
    (no_chart, 4, r"no ColorChecker.*corners_px"),
    (clipped_chart, 4, r"chart\.dng.*saturated.*white"),
    (bright_object, 4, r"box\.dng: 6\d% of the photo is saturated; halve the exposure"),
    (unknown_key, 3, r"unknown key 'drawss' in \[sampling\]; did you mean 'draws'"),
    (no_material, 3, r"'cube' names the BSDF 'cubes', which box\.xml lacks; it has"),
    (extra_surface, 3, r"BSDF 'brass' of knob has no material; add \[materials\.brass\]"),
    (broken_scene, 3, r"box\.xml is not well-formed XML"),
    (broken_toml, 3, r"session\.toml is not valid TOML"),
    (other_size, 3, "box.dng is 208 x 208 pixels, but box.xml expects 312 x 208"),
    (short_light, 3, r"covers 420-\d+ nm; 400-700 nm is needed"),
]


@pytest.mark.parametrize("spoil, code, sentence", BAD_INPUT,
                         ids=lambda value: getattr(value, "__name__", ""))
def test_bad_input_gets_one_sentence_and_its_exit_code(finished, spoil, code, sentence):
    """What does not hang on the fault is kept, of a session that was run before it."""
    spoil(finished)
    checked = call("check", finished)
    assert checked.exit_code == code, checked.output
    assert re.search(sentence, checked.output), checked.output
    ran = call("run", finished, "--device", "cpu")
    assert ran.exit_code == code, ran.output
    assert re.search(sentence, ran.output), ran.output
    assert "Traceback" not in ran.output
    assert not (finished / "report.html").exists()


def test_check_lists_everything_at_once(captured):
    remove_photo(captured)
    no_chart(captured)
    short_light(captured)
    no_material(captured)
    facts = json.loads(call("check", captured, "--json").stdout)
    assert not facts["ready"] and len(facts["problems"]) >= 4, facts["problems"]
    assert facts["error"].splitlines() == facts["problems"] and facts["exit_code"] == 3


def test_check_names_every_missing_file_once_beside_other_faults(captured):
    gone = ("photos/box.dng", "photos/flat.dng", "spectra/light.csv", "spectra/truth_green.csv",
            "scene/box.xml")
    for name in gone:
        (captured / name).unlink()
    no_chart(captured)
    problems = json.loads(call("check", captured, "--json").stdout)["problems"]
    for name in gone:
        assert sum(name.split("/")[1] in problem and "missing" in problem
                   for problem in problems) == 1, problems
    assert len(problems) == len(set(problems))


def test_check_of_a_good_session_is_ready(captured):
    outcome = call("check", captured, "--json")
    facts = json.loads(outcome.stdout)
    assert outcome.exit_code == 0 and facts["ready"] and facts["problems"] == []
    # nothing has been traced yet: it says what that will take
    assert facts["memory"]["tracing_bytes"] > 1e6
    kept = {path.name for path in (captured / "results").iterdir()}
    assert {"chart", "photo"} <= kept and "reconstruct" not in kept     # decoded once, for the run


def test_results_that_cannot_be_written_are_said(captured):
    results_is_a_file(captured)
    outcome = call("run", captured)
    assert outcome.exit_code == 7
    assert "cannot be written" in outcome.output
    assert (captured / "results").read_text() == "in the way"


def test_a_finished_run_answers_with_its_numbers(finished):
    outcome = call("run", finished, "--json", "--device", "cpu")
    assert outcome.exit_code == 0, outcome.output
    facts = json.loads(outcome.stdout)
    assert Path(facts["report"]).is_file() and Path(facts["spectra"]).is_file()
    assert {stage["name"] for stage in facts["stages"]} == {"chart", "photo", "calibrate",
                                                            "reconstruct", "sample"}
    assert {material["name"] for material in facts["materials"]} == {"white", "green", "red",
                                                                     "cube"}
    table = read_table(Path(facts["spectra"]))
    column = dict(zip(table.names, np.transpose(table.values) if len(table.values) == len(table.nm)
                      else table.values, strict=True))
    for material in facts["materials"]:
        name = material["name"]
        truth = np.interp(table.nm, *paint(PAINTS[name]))
        held = (truth >= column[f"{name} lower 0.95"]) & (truth <= column[f"{name} upper 0.95"])
        # the score's quantiles are those of the draws, the file's between wavelengths of 5 nm
        assert material["coverage_95"] == pytest.approx(held.mean(), abs=0.02)
        rms = np.sqrt(np.mean((column[f"{name} mean"] - truth) ** 2))
        assert material["rmse_mean"] == pytest.approx(rms, abs=2e-3) and rms < 0.1
        assert material["rmse_inverse_rendering"] < 0.3
    # Forty pixels wide and thirty steps: within 5 %, where the full demo is within 1 %.
    assert facts["median_surface_error"] < 0.05


def test_the_report_can_be_rebuilt_from_stored_results(finished):
    outcome = call("report", finished)
    assert outcome.exit_code == 0, outcome.output
    text = (finished / "report.html").read_text(encoding="utf-8")
    assert "spectrabox-results" in text and "http://" not in text.replace("http://www.w3.org", "")
    header = (finished / "spectra.csv").read_text(encoding="utf-8").splitlines()
    assert header[0].startswith("wavelength_nm,") and "green mean" in header[0]


def test_recovered_materials_load_in_mitsuba_and_pictures_are_numbers(finished):
    import OpenImageIO as oiio

    from spectrabox.reconstruct.rendering.renderer import load_scene, start_mitsuba
    assert call("report", finished).exit_code == 0
    mi = start_mitsuba("cpu")
    scene_text = (finished / "materials.xml").read_text(encoding="utf-8")
    parameters = mi.traverse(load_scene(scene_text))
    rows = [line.split(",") for line in (finished
                                         / "spectra.csv").read_text(encoding="utf-8").splitlines()]
    column = rows[0].index("green mean")
    written = np.array([float(row[column]) for row in rows[1:]])
    # Mitsuba keeps single precision.
    np.testing.assert_allclose(np.array(parameters["green.reflectance.values"]), written, rtol=1e-6)
    picture = oiio.ImageInput.open(str(finished / "comparison.exr"))
    names = picture.spec().channelnames
    picture.close()
    assert {"photo.R", "rendering.G", "residual.B"} <= set(names)


def test_a_report_without_results_says_what_to_run(captured):
    outcome = call("report", captured)
    assert outcome.exit_code == 3 and "run 'spectrabox run' first" in outcome.output


def test_status_tells_how_far_a_session_has_come(captured, finished):
    assert "missing" in call("status", captured).output
    edit(finished, "draws = 1000", "draws = 1300")
    facts = json.loads(call("status", finished, "--json").stdout)
    stale = [stage for stage in facts["stages"] if stage["state"] == "stale"]
    assert [stage["name"] for stage in stale] == ["sample"]
    assert stale[0]["reasons"] == ["settings: sampling changed"]


def test_a_new_session_is_a_commented_template_and_overwrites_nothing(tmp_path):
    folder = tmp_path / "new session"
    assert call("new", folder).exit_code == 0
    assert {path.name for path in folder.iterdir()} == {"photos", "spectra", "scene",
                                                        "session.toml", "session.schema.json"}
    again = call("new", folder)
    assert again.exit_code == 3 and "exists already" in again.output


def test_wrong_usage_exits_with_2(captured):
    assert call("run").exit_code == 2
    assert call("run", captured, "--device", "toaster").exit_code == 2
    assert call("fly").exit_code == 2


def test_an_error_in_json_is_one_object(tmp_path):
    outcome = call("run", tmp_path, "--json")
    assert outcome.exit_code == 3
    assert json.loads(outcome.stdout)["exit_code"] == 3


def test_debug_shows_the_traceback_and_nothing_else_does(tmp_path):
    command = [sys.executable, "-m", "spectrabox", "run", str(tmp_path)]
    plain = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert plain.returncode == 3 and "Traceback" not in plain.stderr
    assert "session.toml is missing" in plain.stderr
    debug = subprocess.run([*command, "--debug"], cwd=ROOT, capture_output=True, text=True,
                           check=False)
    assert "Traceback" in debug.stderr


def test_the_doctor_finds_this_machine_ready():
    outcome = call("doctor", "--json", "--device", "cpu")
    facts = json.loads(outcome.stdout)
    assert outcome.exit_code == 0 and facts["ready"] and facts[
        "variant"] == "llvm_ad_spectral", facts
    assert facts["llvm"]["version"] >= 15


def test_an_interrupt_that_another_error_wraps_is_still_an_interrupt(capsys):
    def trace():
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise RuntimeError("the loop could not be traced") from interrupt

    with pytest.raises(SystemExit) as left, reported_errors(as_json=False, debug=False):
        trace()
    assert left.value.code == 130
    assert "interrupted: finished stages are kept" in capsys.readouterr().err


def test_the_version_is_printed():
    assert call("--version").stdout == f"spectrabox {spectrabox.__version__}\n"


@pytest.mark.parametrize("group", [[], ["camera"], ["geometry"], ["meter"], ["spectrum"]])
def test_help_cuts_no_sentence(group):
    help_text = call(*group, "--help").stdout
    assert "..." not in help_text.replace("[ARGS]...", "")


def test_every_command_has_a_subject():
    help_text = call("help", "all").stdout
    assert all(f"\n{subject}:\n" in help_text for subject in SUBJECTS)
    assert "\nCommands:\n" not in help_text


def test_help_lists_ten_commands_and_says_how_to_see_all_and_each():
    help_text = call("--help").stdout
    listed = re.findall(r"^  (\w+)  ", help_text.partition("\nCommands:\n")[2], re.MULTILINE)
    assert listed == list(USUAL) and len(listed) == 10
    assert "help all" in help_text and call("help").stdout == help_text
    assert call("help", "camera", "fit").stdout == call("camera", "fit", "--help").stdout


def test_without_arguments_eight_lines_say_what_to_type():
    said = call()
    assert said.exit_code == 2 and len(said.stdout.splitlines()) == 8
    commands = re.findall(r"^  spectrabox (\w+)", said.stdout, re.MULTILINE)
    assert commands == ["open", "flat", "new", "sample", "demo", "help"]
    assert max(map(len, said.stdout.splitlines())) <= 80


def test_a_shell_completes_commands():
    environment = os.environ | {"_SPECTRABOX_COMPLETE": "complete_bash", "COMP_CWORD": "1",
                                "COMP_WORDS": "spectrabox st"}
    done = subprocess.run([sys.executable, "-m", "spectrabox"], env=environment, cwd=ROOT,
                          capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["status"], done
