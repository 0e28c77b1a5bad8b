"""Sessions over months: a planted drift is found, and nothing else is claimed."""
import dataclasses
import json
import resource
import shutil
import sqlite3
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from flat_example import picture, write_flat
from test_error_laws import image
from typer.testing import CliRunner

from spectrabox.capture.photo.image_files import write_exr
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.measure.chart_quantities import BRIGHTNESS, chart_quantities, relative_exposure
from spectrabox.measure.comparison import (
    Quantity,
    SessionQuantities,
    control_chart,
    lasting_shifts,
    shift_sentence,
    surface_pairs,
)
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import PatchSamples, SpectrumSummary
from spectrabox.session.cli import app
from spectrabox.session.commands.finished import _text as report_text
from spectrabox.session.compare.quantities import find_sessions

GRID = visible_grid(10.0)


def a_session(name="s", camera="A 1", light="lamp", quantities=None, spectra=None):
    return SessionQuantities(Path(name), name, camera, light, "2026-01-01", quantities or {},
                             spectra or {})


def months(rng, count, drift=None, at=7):
    """Chart brightness and colour balance of a lab whose light and shutter repeat to 1.2 %."""
    sessions = []
    for number in range(count):
        common = rng.normal(0, 0.012)
        bands = common + rng.normal(0, 0.002, 3)
        if drift is not None and number == at:
            bands = bands + np.log(drift)
        found = {BRIGHTNESS: Quantity(float(bands.mean()), 0.0005, 0.015)}
        found |= {f"band {k + 1} against the others": Quantity(float(value - bands.mean()), 0.0005,
                                                               0.005)
                  for k, value in enumerate(bands)}
        sessions.append(a_session(f"s{number}", quantities=found))
    return sessions


def out_of(sessions):
    return {(one.session, one.quantity) for one in control_chart(sessions) if one.out}


def test_nothing_is_claimed_of_a_lab_that_is_as_ever():
    rng = np.random.default_rng(1)
    labs = [months(rng, 12) for _ in range(300)]
    alarms = sum(bool(out_of(lab)) or bool(lasting_shifts(lab)) for lab in labs)
    # 12 sessions with 4 quantities each: 1 in 370 of normal values, fewer where spread is stated
    assert alarms <= 12


@pytest.mark.parametrize(("drift", "wanted"), [
    ((1.0, 1.0, 1.03), {"band 3 against the others"}),
    ((1.03, 1.0, 1.0), {"band 1 against the others"}),
    ((0.92, 0.92, 0.92), {BRIGHTNESS}),
])
def test_a_drift_is_found_and_nothing_else_is_claimed(drift, wanted):
    rng = np.random.default_rng(2)
    found = [out_of(months(rng, 12, drift)) for _ in range(100)]
    hits = [{name for session, name in one if session == 7} for one in found]
    assert np.mean([wanted <= one for one in hits]) >= 0.95
    elsewhere = sum(bool({session for session, _ in one} - {7}) for one in found)
    assert elsewhere <= 5
    others = sum(bool(one - wanted) for one in hits)
    assert others <= 5


@pytest.mark.parametrize("last", [3, 5])
def test_a_lamp_that_stays_five_percent_weaker_is_found(last):
    """Within what one session scatters, not within what the mean of several does."""
    rng = np.random.default_rng(5)
    found = []
    for _ in range(100):
        sessions = months(rng, 12 - last) + [
            moved(one, np.log(0.95)) for one in months(rng, last)]
        found.append(lasting_shifts(sessions))
    shifts = [one for lab in found for one in lab if one.quantity == BRIGHTNESS]
    # 98 and 92 of 100 by this rule alone, of 400 labs: three standard errors of 100 labs less
    assert len(shifts) >= {5: 93, 3: 83}[last]
    assert sum(len(lab) for lab in found) - len(shifts) <= 3        # nothing else is claimed
    sizes = np.array([one.size for one in shifts])
    # that the shift is the largest of all splits biases it a little: found where chance adds to it
    assert abs(np.median(sizes) - np.log(0.95)) < 0.008
    assert np.median([one.first for one in shifts]) == 12 - last


def moved(session, off):
    """The same session with its chart brighter by a logarithm."""
    one = session.quantities[BRIGHTNESS]
    quantities = session.quantities | {BRIGHTNESS: Quantity(one.value + off, one.standard_error,
                                                            one.spread)}
    return a_session(session.name, quantities=quantities)


def test_one_odd_session_is_no_lasting_shift():
    rng = np.random.default_rng(6)
    for at in range(12):
        sessions = months(rng, 12, (0.85, 0.85, 0.85), at)
        # at either end two sessions make a part: one that is far off is half of it
        if 2 <= at < 10:
            assert lasting_shifts(sessions) == []


def test_a_lasting_shift_is_said_with_its_first_session_and_its_error():
    values = [0.0, 0.004, -0.004, 0.002, -0.002, -0.06, -0.055, -0.063, -0.06]
    sessions = [a_session(f"s{k}", quantities={BRIGHTNESS: Quantity(value, 0.0, 0.01)})
                for k, value in enumerate(values)]
    other = [a_session(f"o{k}", camera="B 1", quantities={BRIGHTNESS: Quantity(1.0, 0.0, 0.01)})
             for k in range(9)]
    mixed = [one for pair in zip(other, sessions, strict=True) for one in pair]
    [shift] = lasting_shifts(mixed)
    assert mixed[shift.first].name == "s5" and mixed[shift.last_before].name == "s4"
    assert shift.size == pytest.approx(np.mean(values[5:]) - np.mean(values[:5]))
    assert (shift.before, shift.after) == (5, 4)
    # the largest difference of two successive ones makes the scatter larger than stated
    scatter = np.sqrt(np.mean(np.diff(values) ** 2) / 2)
    assert shift.standard_error == pytest.approx(scatter * np.sqrt(1 / 5 + 1 / 4))
    assert shift_sentence(shift, "s5") == ("from s5 on, brightness of the chart differs by -5.9% ± "
                                        "1.0% from before (5 sessions before, 4 after)")
    assert lasting_shifts(sessions[:5]) == []           # too few to tell


def test_two_sessions_are_told_apart_only_beyond_what_both_repeat():
    def pair(apart):
        return [a_session(name, quantities={BRIGHTNESS: Quantity(value, 0.0, 0.015)})
                for name, value in (("a", 0.0), ("b", apart))]
    limit = 3 * np.sqrt(2) * 0.015
    assert not out_of(pair(0.98 * limit))
    assert len(out_of(pair(1.02 * limit))) == 2


def test_another_camera_or_light_is_not_compared():
    value = {BRIGHTNESS: Quantity(0.0, 0.0, 0.01)}
    other = {BRIGHTNESS: Quantity(9.0, 0.0, 0.01)}
    assert control_chart([a_session(quantities=value),
                          a_session(camera="B", quantities=other)]) == []
    assert control_chart([a_session(quantities=value),
                          a_session(light="sun", quantities=other)]) == []


def a_summary(mean, deviation):
    curve = np.full(GRID.nm.size, mean)
    error = np.full(GRID.nm.size, deviation)
    return SpectrumSummary(GRID, curve, error, curve - 2 * error, curve + 2 * error, curve, curve,
                           0.95, "test", 550.0)


def test_surfaces_of_one_name_agree_within_both_errors_whatever_the_light():
    sessions = [a_session("a", light="A", spectra={"red": a_summary(0.3, 0.02)}),
                a_session("b", light="D65", spectra={"red": a_summary(0.34, 0.02),
                                                     "blue": a_summary(0.1, 0.01)}),
                a_session("c", light="D65", spectra={"red": a_summary(0.42, 0.02)})]
    pairs = {(one.first, one.second): one for one in surface_pairs(sessions)}
    assert set(pairs) == {(0, 1), (0, 2), (1, 2)}
    assert not pairs[0, 1].disagree and pairs[0, 2].disagree and pairs[1, 2].disagree
    assert pairs[0, 2].rms == pytest.approx(0.12)
    # L* 61.7 and 70.9, weighed by 1.24 (Sharma et al. 2005, Eq. 15)
    assert pairs[0, 2].delta_e00 == pytest.approx(7.46, abs=0.05)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Six sessions of one camera; in the fifth the lamp has lost a tenth in its last band."""
    root = tmp_path_factory.mktemp("lab")
    first = write_flat(root / "a-0")
    light = picture((400, 600))
    gain = write_photo(first / "photos" / "sample.dng", light, Fraction(1, 60),
                       np.random.default_rng(0))
    text = (first / "session.toml").read_text(encoding="utf-8")
    (first / "session.toml").write_text(text, encoding="utf-8")
    for number in range(1, 6):
        folder = shutil.copytree(first, root / "more" / f"a-{number}") if number > 3 else \
            shutil.copytree(first, root / f"a-{number}")
        seen = light * np.array([1, 1, 0.9]) if number == 4 else light
        write_photo(folder / "photos" / "sample.dng", seen, Fraction(1, 60),
                    np.random.default_rng(number), brightest=None, gain=gain)
    for folder in find_sessions(root):
        said = CliRunner().invoke(app, ["run", str(folder), "--only", "chart"])
        assert (folder / "results" / "chart").is_dir(), said.output
    return root


def test_the_command_names_the_session_and_the_band(lab):
    folders = [str(folder) for folder in find_sessions(lab)]
    said = CliRunner().invoke(app, ["compare", *folders, "--json"])
    assert said.exit_code == 0, said.output
    facts = json.loads(said.output)
    assert len(facts["sessions"]) == 6 and facts["sessions"][0]["camera"]
    assert {Path(one["folder"]).name for one in facts["out"]} == {"a-4"}
    assert "band 3 against the others" in {one["quantity"] for one in facts["out"]}
    text = CliRunner().invoke(app, ["compare", *folders]).output
    assert "a-4: band 3 against the others is -" in text
    quiet = [folder for folder in folders if not folder.endswith("a-4")]
    assert "camera, light and chart are as before" in CliRunner().invoke(app, ["compare",
                                                                               *quiet]).output


def test_cameras_are_compared_by_make_model_and_serial_number():
    same, other = a_session(camera="Make A 1"), a_session(camera="Make A 2")
    quiet = SimpleNamespace(out=False)
    text = report_text([same, same, other], [quiet], [], [])
    assert "different cameras (make, model, serial number): Make A 1; Make A 2" in text
    assert "camera, light and chart are as before" not in text


def test_the_catalogue_is_made_anew_from_the_folders(lab, tmp_path):
    out = tmp_path / "lab.sqlite"
    (lab / "empty").mkdir(exist_ok=True)
    (lab / "empty" / "session.toml").write_text("", encoding="utf-8")
    for _ in range(2):
        said = CliRunner().invoke(app, ["catalogue", str(lab), "-o", str(out), "--json"])
        assert said.exit_code == 0, said.output
        assert "empty is left out" in json.loads(said.output)["skipped"][0]
        with sqlite3.connect(out) as file:
            sessions = file.execute("SELECT folder FROM sessions ORDER BY folder").fetchall()
            bad = file.execute("SELECT DISTINCT folder FROM quantities WHERE out = 1").fetchall()
        file.close()
        assert [one for one, in sessions] == ["a-0", "a-1", "a-2", "a-3", "more/a-4", "more/a-5"]
        assert bad == [("more/a-4",)]


def test_a_full_disk_under_the_catalogue_is_one_sentence(lab, tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))    # no file grows beyond
    try:
        said = CliRunner().invoke(app, ["catalogue", str(lab), "-o", str(tmp_path / "a.sqlite")])
        with pytest.raises(EnvironmentProblem, match=r"a\.exr cannot be written"):
            write_exr(tmp_path / "a.exr", np.random.default_rng(1).random((40, 40, 3)), "RGB")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert said.exit_code == 7 and "cannot be written (File too large)" in said.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("words", "said"), [
    (["compare", "{lab}/a-0"], "one session cannot be compared"),
    (["compare", "{lab}/a-0", "{lab}/empty-one"], "is missing"),
    (["catalogue", "{lab}/nowhere"], "is no folder"),
    (["catalogue", "{lab}", "-o", "x.csv"], "ends in .sqlite"),
])
def test_what_cannot_be_compared_is_said(lab, words, said):
    result = CliRunner().invoke(app, [word.format(lab=lab) for word in words])
    assert result.exit_code != 0 and said in result.output


def test_links_are_not_followed_to_sessions_elsewhere(tmp_path):
    (tmp_path / "out" / "s").mkdir(parents=True)
    (tmp_path / "out" / "s" / "session.toml").write_text("", encoding="utf-8")
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "link").symlink_to(tmp_path / "out")
    assert find_sessions(tmp_path / "lab") == []
    with pytest.raises(InputError):
        find_sessions(tmp_path / "nowhere")


@pytest.mark.parametrize("seconds, iso, f_number", [(0.1, 100.0, 8.0), (0.025, 100.0, 4.0),
                                                    (0.05, 200.0, 8.0), (0.2, 200.0, 16.0)])
def test_settings_that_let_in_as_much_light_count_as_one_exposure(seconds, iso, f_number):
    photo = dataclasses.replace(image(np.ones((1, 1, 3))), exposure_s=seconds, iso=iso,
                                f_number=f_number)
    assert relative_exposure(photo) == pytest.approx(0.1 / 64)


def test_one_normal_value_in_hundreds_is_out_where_nothing_is_known_of_the_spread():
    rng = np.random.default_rng(6)
    out = [len(out_of([a_session(str(number), quantities={"x": Quantity(value, 0.0, 0.0)})
                       for number, value in enumerate(rng.normal(2, 0.03, 500))]))
           for _ in range(10)]
    # 3 deviations: 0.27 %, and a little more, as 500 values know the median deviation to 5 %
    assert 0.0012 < np.sum(out) / 5000 < 0.0065


def test_brightness_and_balance_of_a_chart_err_as_those_of_repeated_photos():
    rng, truth = np.random.default_rng(7), np.linspace(0.1, 0.9, 24)[:, None] * [1.0, 0.8, 0.5]
    sigma = 0.03 * truth
    found, stated = [], []
    for _ in range(400):
        samples = PatchSamples(truth + sigma * rng.standard_normal(truth.shape),
                               np.einsum("ik,kl->ikl", sigma**2, np.eye(3)), np.full(24, 100),
                               np.zeros((24, 3)), np.zeros((24, 3)))
        quantities = chart_quantities(samples, image(np.ones((1, 1, 3))), 0.01)
        found.append([one.value for one in quantities.values()])
        stated.append([one.standard_error for one in quantities.values()])
    # 400 photos know a deviation to 3.5 %; a band errs a little less beside the mean of all three
    ratio = np.mean(stated, axis=0) / np.std(found, axis=0)
    assert ratio[0] == pytest.approx(1, abs=0.14)
    np.testing.assert_allclose(ratio[1:], np.sqrt(1.5), rtol=0.15)
