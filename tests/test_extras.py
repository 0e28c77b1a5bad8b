"""What is extra takes nothing away: where advice, comparison, edition or a picture fails, the
answer stands, the fault is named wherever the answer is shown, and the exit code is that of the
answer.
"""
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from flat_example import rect_of
from inline_workers import inline_workers
from session_runs import call

import spectrabox as sb
from spectrabox.measure import texts
from spectrabox.measure.advice.flat_actions import FlatPhotos, with_lamp_moved, with_level
from spectrabox.measure.advice.forecast import Unknown, outlook_after
from spectrabox.measure.extras import attempt
from spectrabox.measure.regions.flat_signals import flat_signals
from spectrabox.measure.regions.white import white_at_regions
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.session.batch.overview import batch_facts, batch_text, program_of_batch, write_page
from spectrabox.session.batch.tasks import Task, kept_outcomes, run_batch

from benchmarks.bench_extras import Tally, answers_of, drawn_case

WHY = "planted: zero-size array"
# functions without which an extra cannot be made, and what the extra is called; all of a group fail
# at once, so that an extra of which another is a part is in another group
OF_A_REPORT = {"pictures": {
    "spectrabox.session.report.cards.Markup": "picture of spectra that look alike",
    "spectrabox.session.report.figures.field_whiskers": "picture of the light on regions",
    "spectrabox.session.report.figures._corners": "picture of the photo",
    "spectrabox.session.report.figures._colour_bar": "picture of the light over the photo",
    "spectrabox.session.report.spectra._over_wavelengths": "picture of the spectrum",
    "spectrabox.session.report.figures.fixed": "picture of the error budget",
    "spectrabox.session.report.figures.css_colour": "picture of the irradiance over the chart"},
    "advice and a section": {
        "spectrabox.measure.advice.advise.advice_on_capture": "advice",
        "spectrabox.measure.surfaces.colour_comparison.metamer_pair":
            "comparison of spectra that look alike",
        "spectrabox.session.report.page.swatch_pairs": "section on the chart"},
    "report": {"spectrabox.session.report.page.render_report": "full report"}}


def fails(*_, **__):
    raise ValueError(WHY)


@pytest.fixture(scope="module")
def measured(_finished_flat, tmp_path_factory):
    """A session of flat samples that was run, and its answer."""
    folder = shutil.copytree(_finished_flat, tmp_path_factory.mktemp("extras") / "flat")
    outcome = call("run", folder, "--json", "--quiet")
    facts = json.loads(outcome.stdout)
    assert facts["failed_extras"] == [] and facts["advice"]["overall"]
    return folder, facts


@pytest.fixture
def session(measured, tmp_path):
    """The same, to be changed; its report is not up to date, so that all is made again."""
    folder, facts = measured
    own = shutil.copytree(folder, tmp_path / "flat")
    shutil.rmtree(own / "results" / "report")
    return own, facts


def same_answer(facts, expected):
    """Whether everything but the extras is as it was."""
    extras = {"advice", "failed_extras", "report", "spectra", "stages", "seconds"}
    facts, expected = ({name: value for name, value in each.items() if name not in extras}
                       for each in (facts, expected))
    said = facts.pop("findings")
    assert [one for one in said if one["code"] != "extra.failed"] == expected.pop("findings")
    assert facts == expected


@pytest.mark.parametrize("group", OF_A_REPORT)
def test_extras_that_fail_are_named_and_the_answer_stands(session, monkeypatch, group):
    folder, expected = session
    with monkeypatch.context() as planted:
        for needed in OF_A_REPORT[group]:
            planted.setattr(needed, fails)
        outcome = call("run", folder, "--json", "--quiet")
        again = call("run", folder)
        debugged = call("report", folder, "--debug", "--json")
    facts = json.loads(outcome.stdout)
    assert outcome.exit_code == again.exit_code == debugged.exit_code == 0
    same_answer(facts, expected)
    reported = json.loads((folder / "report.json").read_text("utf-8"))["failed_extras"]
    for extra in OF_A_REPORT[group].values():
        named = {"extra": extra, "error": f"ValueError: {WHY}"}
        for listed in (facts["failed_extras"], json.loads(debugged.stdout)["failed_extras"],
                       reported):
            assert named in listed, (extra, listed)
        note = f"note: No {extra}: ValueError: {WHY}."
        assert note in outcome.stderr and note in again.stdout and note not in again.stderr
    assert "--debug" in again.stdout and "Traceback" not in again.stderr
    assert "in fails" in debugged.stderr and "Traceback" in debugged.stderr
    assert WHY in (folder / "report.html").read_text(encoding="utf-8")
    assert (folder / "spectra.csv").is_file()
    # once it works it is there again, without a stage that is run
    mended = json.loads(call("run", folder, "--json", "--quiet").stdout)
    assert mended["failed_extras"] == [] and mended["advice"] == expected["advice"]
    assert {stage["state"] for stage in mended["stages"]} == {"kept"}


@pytest.mark.parametrize("needed, extra", [
    ("spectrabox.capture.photo.preview.signal_rgb8", "picture 'preview'"),
    ("spectrabox.measure.steps.photos.chart_overlay", "picture 'overlay'")])
def test_a_picture_that_a_stage_cannot_draw_is_a_note(measured, tmp_path, monkeypatch, needed,
                                                      extra):
    folder, expected = measured
    own = tmp_path / "flat"
    shutil.copytree(folder, own, ignore=shutil.ignore_patterns("results", "report.*"))
    monkeypatch.setattr(needed, fails)
    outcome = call("run", own, "--json", "--quiet")
    facts = json.loads(outcome.stdout)
    assert outcome.exit_code == 0
    same_answer(facts | {"warnings": []}, expected | {"warnings": []})
    assert any(one.startswith(f"No {extra}: ValueError: {WHY}.") for one in facts["warnings"])


def test_a_scene_stands_without_the_pictures_that_compare_it(_finished, tmp_path, monkeypatch):
    folder = shutil.copytree(_finished, tmp_path / "box")
    monkeypatch.setattr("spectrabox.session.store.surface_files.comparison_rgb8", fails)
    monkeypatch.setattr("spectrabox.session.report.maps._panels", fails)
    facts = json.loads(call("run", folder, "--json", "--quiet").stdout)
    named = {one["extra"] for one in facts["failed_extras"]}
    assert {"comparison of photo and rendering", "picture of photo and rendering",
            "picture of the residuals"} <= named
    assert (folder / "materials.xml").is_file() and facts["materials"]


def test_a_chart_is_judged_without_its_edition(measured, monkeypatch):
    folder, _ = measured
    photo = folder / "photos" / "sample.dng"
    good = json.loads(call("chart", photo, "--json").stdout)
    monkeypatch.setattr("spectrabox.measure.chart_patches.calibrate_chart", fails)
    outcome = call("chart", photo, "--json")
    facts = json.loads(outcome.stdout)
    assert outcome.exit_code == 0 and facts["edition"]["edition"] is None
    assert facts["failed_extras"] == [{"extra": "edition of the chart",
                                       "error": f"ValueError: {WHY}"}]
    changed = {"edition", "failed_extras"}
    assert {key: facts[key] for key in facts if key not in changed} == {
        key: good[key] for key in good if key not in changed}
    assert "note: No edition of the chart" in call("chart", photo).stdout
    found = sb.find_chart(sb.open_photo(photo)).edition
    assert found.edition is None and WHY in found.failed.values["traceback"]


def test_a_batch_names_what_failed_and_tries_it_again(measured, tmp_path, monkeypatch):
    folder, expected = measured
    own = shutil.copytree(folder, tmp_path / "flat").resolve()
    tasks = [Task(own, tmp_path / "out", "cpu", False, program_of_batch())]
    with monkeypatch.context() as planted:
        planted.setattr("spectrabox.session.batch.tasks.picture_data_uri", fails)
        (outcome,) = run_batch(tasks, inline_workers()[1])
    why = f"No picture of the photo: ValueError: {WHY}."
    assert (outcome.state, outcome.verdict, outcome.failed_extras) == (
        "done", expected["verdict"], (why,))
    page = write_page(tmp_path / "out", [outcome], 1)
    assert why in page.read_text(encoding="utf-8") and why in batch_text([outcome], 0, page)
    assert batch_facts([outcome], 0, page, 1)["sessions"][0]["failed_extras"] == [why]
    assert not kept_outcomes(tasks)
    (mended,) = run_batch(tasks, inline_workers()[1])
    assert not mended.failed_extras and [*kept_outcomes(tasks)] == [own]


def test_the_library_returns_the_answer_without_its_advice(measured, monkeypatch):
    folder, _ = measured
    result = None
    monkeypatch.setattr("spectrabox.measure.advice.advise.advice_on_capture", fails)
    result = sb.flat(folder / "photos" / "sample.dng", {"cube": rect_of("cube")}, progress=False)
    assert result["cube"].mean.shape and result.facts()["regions"]
    assert result.advice == result["cube"].advice == ()
    (failed,) = result.failed_extras
    assert (failed.subject, failed.values["error"]) == ("advice", f"ValueError: {WHY}")
    assert "in fails" in failed.values["traceback"] and texts.says(failed) in result.text()
    assert result["cube"].failed_extras[0].values["error"] == failed.values["error"]
    for known in (result, result["cube"]):      # who asks for advice alone is told why
        with pytest.raises(ValueError, match=WHY):
            sb.advise(known)


def test_an_interrupt_is_no_failure():
    class FromTheRenderer(RuntimeError):
        """As Dr.Jit wraps it."""

    def interrupted():
        raise KeyboardInterrupt

    def wrapped():
        try:
            interrupted()
        except KeyboardInterrupt as stop:
            raise FromTheRenderer("tracing failed") from stop

    for stopped in (interrupted, wrapped):
        with pytest.raises(KeyboardInterrupt):
            attempt("advice", stopped, None)
    with pytest.raises(SystemExit):
        attempt("advice", lambda: exit(3), None)


@pytest.mark.parametrize("error, said", [
    (InputError("a band sees nothing; leave it out"), "a band sees nothing; leave it out"),
    (MemoryError(), "memory ran out"), (RecursionError(), "RecursionError"),
    (ZeroDivisionError("two\nlines"), "ZeroDivisionError: two lines")])
def test_errors_are_said_in_a_line(error, said):
    def failing():
        raise error

    value, failed = attempt("advice", failing, 7)
    assert value == 7 and failed.values["error"] == said
    assert attempt("advice", lambda: 5, None) == (5, None)


@pytest.mark.parametrize("seed", (7, 12))
def test_every_extra_of_captures_that_nobody_planned_works(seed):
    """Two sets of regions on each of a few calibrations; more by benchmarks/bench_extras.py."""
    tally = Tally()
    for words, answer in answers_of(drawn_case(seed), 1):
        tally.answer(words, answer)
    assert not tally.failed


def test_signals_that_nobody_planned_get_advice():
    tally = Tally()
    for seed in range(20):
        tally.signal(seed)
    assert tally.answers > 10 and not tally.failed


def test_a_light_that_is_dark_at_some_wavelengths_gets_advice(measured, tmp_path):
    """As a meter reads a dim lamp: a forecast under another lamp divided by it."""
    folder, _ = measured
    table = read_table(folder / "spectra" / "light.csv")
    light = np.where(table.values[0] < 0.03 * table.values[0].max(), 0, table.values[0])
    result = sb.flat(folder / "photos" / "sample.dng", {"cube": rect_of("cube")},
                     light=(table.nm, light), progress=False)
    assert {"gel", "second-lamp"} & {one.action for one in result.advice}
    assert not result.failed_extras


@pytest.fixture(scope="module")
def cube(measured):
    """What a result asks for advice with."""
    result = sb.flat(measured[0] / "photos" / "sample.dng", {"cube": rect_of("cube")},
                     progress=False)
    return result.found.advise.args


def test_a_black_surface_gets_advice(cube):
    """The level of the light changes nothing of it."""
    capture, records = cube
    signals = records.signals
    black = replace(signals, signal=-1e-4 * np.ones_like(signals.signal))
    states = records.spectra["cube"].states
    unknown = Unknown(load_prior(), 0.95, black, np.full(PRIOR_GRID.nm.size, 0.01), states.mean,
                      np.ones(2), np.ones(2), 550.0)
    assert with_level(unknown) is unknown
    after = with_lamp_moved(FlatPhotos(capture, records), "cube")
    assert np.isfinite(outlook_after(with_level(unknown), after)).all()


def test_a_region_that_no_photo_shows_in_any_band_is_refused_by_name(cube):
    sample = FlatPhotos(*cube)
    (photo,) = sample.photos
    white = white_at_regions(photo, {}, sample.errors)
    clipped = replace(white, samples=replace(white.samples, clipped=np.ones((1, 3), bool)))
    with pytest.raises(sb.CheckError, match="no band of any photo tells anything of region 'cube'"):
        flat_signals([photo], [clipped], {"cube": ()}, {}, sample.bands, sample.errors)
