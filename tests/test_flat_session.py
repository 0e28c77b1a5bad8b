"""Sessions of flat samples: one photo with a chart in it, to spectra of its regions."""
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from flat_example import (
    CHART,
    HEAD,
    PAINTS,
    SIZE,
    light_over,
    picture,
    rect_of,
    regions_toml,
    write_flat,
)

from spectrabox.fixtures.flat_sample import lamplight, vignetting, write_photo
from spectrabox.fixtures.paints import NM, paint
from spectrabox.measure.opened_photos import OpenPhotos
from spectrabox.measure.results.result_of_records import result_of
from spectrabox.measure.steps.signals import find_signals
from spectrabox.measure.steps.work import Work
from spectrabox.radiometry.chart import AFTER_2014
from spectrabox.radiometry.error_model import CAUSES
from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.radiometry.findings import Severity
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.config.session_file import read_session

from tests.session_runs import call, run

pytestmark = pytest.mark.usefixtures("light_as_stated", "no_advice")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def flat_and_records(_finished_flat, tmp_path_factory):
    """A finished session of this file's tests, and what a run of it keeps."""
    folder = shutil.copytree(_finished_flat, tmp_path_factory.mktemp("flat") / "session")
    return folder, run(folder)


@pytest.fixture
def flat_session(flat_and_records, tmp_path):
    """A finished session of its own."""
    return shutil.copytree(flat_and_records[0], tmp_path / "session")


def true_signals(signals):
    return np.array([signals.response @ np.interp(signals.grid.nm, NM, paint(name)[1])
                     for name in signals.names])


def errors_of(signals):
    return np.sqrt(np.sum([np.diagonal(covariance, axis1=1, axis2=2)
                           for covariance in signals.errors.values()], axis=0))


def test_signals_are_those_of_the_paints_wherever_the_light_falls_off(flat_and_records):
    signals = flat_and_records[1].records.signals
    off = (signals.signal - true_signals(signals)) / errors_of(signals)
    # 12 signals, those of one region nearly one: 4 sigma would be a chance of 1 in 1000
    assert np.abs(off).max() < 4
    light = light_over()
    on = {name: light[int(y0):int(y1), int(x0):int(x1)].mean()
          for name, (x0, y0, x1, y1) in ((name, rect_of(name)) for name in PAINTS)}
    assert max(on.values()) / min(on.values()) > 1.15   # the regions are lit differently
    # uncorrected, the darkest would be off by more than this
    assert np.abs(signals.signal / true_signals(signals) - 1).max() < 0.04


def light_errors(finished):
    return {name: error for name, (_, error) in finished.records.flat_signals.light[""].items()}


def test_the_light_is_known_worse_away_from_the_chart(flat_and_records):
    error = light_errors(flat_and_records[1])
    assert error["white_wall"] < error["green_wall"]
    assert error["red_wall"] < error["cube"]


def test_a_known_region_narrows_the_light_on_its_neighbours(flat_session, flat_and_records):
    (flat_session / "session.toml").write_text(
        HEAD + regions_toml(known=("green_wall",)), encoding="utf-8")
    finished = run(flat_session)
    assert finished.states["calibrate"] == "kept" and finished.states["signals"] == "run"
    before = light_errors(flat_and_records[1])
    assert light_errors(finished)["cube"] < 0.8 * before["cube"]
    signals = finished.records.signals
    off = (signals.signal - true_signals(signals)) / errors_of(signals)
    assert np.abs(off).max() < 4


def test_running_again_keeps_everything_and_a_new_region_keeps_the_calibration(flat_session):
    assert set(run(flat_session).states.values()) == {"kept"}
    (flat_session / "session.toml").write_text(
        HEAD + regions_toml(names=("white_wall", "cube")), encoding="utf-8")
    states = run(flat_session).states
    assert states == {"chart": "kept", "photo": "run", "calibrate": "kept", "signals": "run",
                      "sample": "run"}


def test_errors_of_a_signal_add_up_and_are_covariances(flat_and_records):
    signals = flat_and_records[1].records.signals
    assert signals.errors.keys() <= CAUSES.keys()
    for covariances in signals.errors.values():
        for covariance in covariances:
            np.testing.assert_allclose(covariance, covariance.T, atol=1e-15)
            # round-off of sums of signals near 1
            assert np.linalg.eigvalsh(covariance).min() > -1e-12


def test_chart_and_samples_in_two_photos_differ_by_light_and_shutter(tmp_path):
    folder = write_flat(tmp_path / "session")
    gain = write_photo(folder / "photos" / "chart.dng", picture(paints={}), Fraction(1, 60),
                       np.random.default_rng(4))
    write_photo(folder / "photos" / "sample.dng", picture(chart=None),
                Fraction(1, 120), np.random.default_rng(5), brightest=None, gain=gain)
    (folder / "session.toml").write_text(HEAD.replace(
        "[light]", 'chart = "photos/chart.dng"\n[light]') + regions_toml(), encoding="utf-8")
    signals = run(folder).records.signals
    off = (signals.signal - true_signals(signals)) / errors_of(signals)
    assert np.abs(off).max() < 4
    repeat = np.sqrt(np.diagonal(signals.errors["light and shutter repeat"], axis1=1, axis2=2))
    # 1.2 % of the light and 0.9 % of the shutter
    np.testing.assert_allclose(repeat / signals.signal, np.hypot(0.012, 0.009), rtol=0.02)


def test_a_flat_field_under_the_same_light_leaves_it_even(flat_session):
    card = np.full((*light_over().shape, 3), 0.9) * light_over()[..., None]
    write_photo(flat_session / "photos" / "flat.dng", card, Fraction(1, 60),
                np.random.default_rng(6), electrons=4e5)
    (flat_session / "session.toml").write_text(HEAD.replace(
        "[light]", 'flat = "photos/flat.dng"\n[light]') + regions_toml(), encoding="utf-8")
    finished = run(flat_session)
    level, error = np.transpose([*finished.records.flat_signals.light[""].values()])
    np.testing.assert_allclose(level, 1, atol=0.02)     # twice what a card is taken to leave
    assert error.max() < np.hypot(0.012, 0.03)      # the card tells the field, not the plane
    signals = finished.records.signals
    off = (signals.signal - true_signals(signals)) / errors_of(signals)
    assert np.abs(off).max() < 4


def spoilt(folder, name):
    """Change one thing of a session for the worse."""
    photo, rng = folder / "photos" / "sample.dng", np.random.default_rng(7)
    text = (folder / "session.toml").read_text(encoding="utf-8")
    if name == "no chart":
        write_photo(photo, picture(chart=None), Fraction(1, 60), rng)
    elif name == "mirrored":
        write_photo(photo, picture()[:, ::-1], Fraction(1, 60), rng)
    elif name == "cut off":
        write_photo(photo, picture(chart=(-0.1, *CHART[1:])), Fraction(1, 60), rng)
    elif name == "clipped region":
        light = light_over()
        x0, y0, x1, y1 = rect_of("white_wall")
        light[y0:y1, x0:x1] *= 3
        write_photo(photo, picture(light=light), Fraction(1, 60), rng, brightest=1.6)
    elif name == "outside":
        text = text.replace(str(rect_of("cube")), "[400, 100, 500, 200]")
    elif name == "JPEG":
        (folder / "photos" / "sample.jpg").write_bytes(b"\xff\xd8\xff\xe0 no picture")
        text = text.replace("sample.dng", "sample.jpg")
    (folder / "session.toml").write_text(text, encoding="utf-8")


@pytest.mark.parametrize("fault, sentence", [
    ("no chart", "no ColorChecker was found in photo sample.dng"),
    ("mirrored", "shows the chart mirrored"),
    ("cut off", "no ColorChecker was found"),
    ("clipped region", "region 'white_wall' is saturated in"),
    ("outside", "region 'cube' leaves the photo of 480 x 320 pixels"),
    ("JPEG", "sample.jpg")])
def test_bad_input_is_one_sentence(flat_session, fault, sentence):
    spoilt(flat_session, fault)
    with pytest.raises(SpectraboxError, match=sentence) as raised:
        run(flat_session)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("change, sentence", [
    (("[regions.cube]", "[scene]\nfile = \"a.xml\"\n[regions.cube]"),
     r"\[regions\] and \[scene\] stand together"),
    (("[regions.cube]", "[reconstruct]\nwidth = 40\n[regions.cube]"),
     r"\[reconstruct\] belongs to a scene"),
    (("[regions.cube]", "[stray_light]\nambient = 0.01\n[regions.cube]"),
     r"stray_light\.ambient belongs to a scene"),
    (("[regions.cube]", "[repeatability]\nlamp_position = 0.01\n[regions.cube]"),
     r"repeatability\.lamp_position belongs to a scene"),
    (("[regions.cube]", "[regions.other]\n[regions.cube]"), "regions.other needs either rect"),
    (("[regions.cube]", "[regions.other]\nrect = [1, 2, 1, 9]\n[regions.cube]"),
     "two opposite corners"),
    (("[regions.cube]", "[regions.cube]\nphoto = \"warm\""), "the session's photos are photo"),
    (("[sampling]", "[sampling]\nthrough = \"transport\""), "follows light through a scene"),
    (("[sampling]", "[sensitivity]\nmethod = \"paper\"\n[sampling]"), "use \"prior\"")])
def test_keys_that_do_not_go_together_are_named(tmp_path, change, sentence):
    (tmp_path / "session.toml").write_text((HEAD + regions_toml()).replace(*change),
                                           encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        read_session(tmp_path)


FLAT = """
import sys
sys.argv = ["spectrabox", *sys.argv[1:]]
from spectrabox.session.cli import main
try:
    main()
except SystemExit as left:
    print("LEFT", left.code, file=sys.stderr)
print("MODULES", *sys.modules)
"""


def spectrabox(*words):
    ran = subprocess.run([sys.executable, "-c", FLAT, *map(str, words)], capture_output=True,
                         text=True, check=False, cwd=ROOT)
    *said, modules = ran.stdout.splitlines()
    return said, modules.split()[1:], ran.stderr


def test_one_command_goes_from_a_photo_to_its_report(tmp_path):
    source = write_flat(tmp_path / "source")
    photo = tmp_path / "my painting.dng"
    shutil.copy(source / "photos" / "sample.dng", photo)
    words = ["flat", photo, "--light", source / "spectra" / "light.csv",
             "--reference", AFTER_2014, "--json"]
    words += [f"--region={name}={','.join(map(str, rect_of(name)))}" for name in ("cube",
                                                                              "red_wall")]
    words += ["--truth", f"cube={source / 'spectra' / 'cube.csv'}"]
    said, modules, _ = spectrabox(*words)
    facts = json.loads(said[-1])
    assert {"report", "verdict", "regions", "light", "warnings", "seconds"} <= facts.keys()
    assert (tmp_path / "my painting-flat" / "report.html").is_file()
    cube = facts["regions"][0]
    count = len(cube["wavelengths_nm"])
    assert all(len(cube[name]) == count for name in ("mean", "standard_deviation", "lower", "upper",
                                                     "bound_lower", "bound_upper"))
    assert len(cube["signal"]) == len(cube["lab_d65"]) == 3
    assert cube["rmse_mean"] < 0.08 and cube["coverage_95"] > 0.7
    assert not {name.split(".")[0] for name in modules} & {"mitsuba", "drjit"}


def test_a_failed_command_leaves_nothing_and_an_edited_session_alone(tmp_path):
    source = write_flat(tmp_path / "source")
    photo = tmp_path / "a.dng"
    shutil.copy(source / "photos" / "sample.dng", photo)
    light = ["--light", source / "spectra" / "light.csv"]
    error = call("flat", photo, *light, "--region", "out=400,100,500,200").stderr
    assert "leaves the photo of 480 x 320 pixels" in error
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.dng", "source"]
    shutil.copytree(source, tmp_path / "a-flat")
    error = call("flat", photo, *light, "--region", "cube=1,2,30,40").stderr
    assert "was edited since" in error


def test_a_warmer_lamp_over_the_samples_is_seen_on_a_white_card(flat_session):
    light = np.repeat(light_over()[..., None], 3, axis=2)
    x0, _, x1, _ = rect_of("white_wall")
    light[:, x0 - 20:x1 + 20, 2] *= 0.85
    write_photo(flat_session / "photos" / "sample.dng", picture(light=np.ones(light.shape[:2]))
                * light, Fraction(1, 60), np.random.default_rng(8))
    (flat_session / "session.toml").write_text(
        HEAD + regions_toml(known=("white_wall",)), encoding="utf-8")
    assert left_out(run(flat_session)) == {"flat.known-other-colour": "white_wall"}


def left_out(finished):
    """Known regions that tell nothing of the light, by the code of what is wrong with each; the
    verdict is WARN, and all other regions have the spectra of a sample without them.
    """
    capture, verdict = finished.capture, result_of(finished.capture, finished.records).verdict
    alone = replace(capture, regions={
        name: region for name, region in capture.regions.items() if region.known is None})
    without = find_signals(alone, finished.records, Work(OpenPhotos(alone), lambda *_: None))
    signals = finished.records.signals
    for name in alone.regions:
        np.testing.assert_allclose(
            signals.signal[signals.names.index(name)],
            without.signals.signal[without.signals.names.index(name)], rtol=1e-12)
        assert finished.records.spectra[name].mean.any()
    assert verdict.word == "warn"
    return {one.code: one.subject for one in verdict.problems}


def with_card(folder, name, factor, error=None):
    """Say that a region is of known spectrum, off by a factor from what it is, with a relative
    standard error if any.
    """
    value = factor * paint(name)[1]
    columns = {"value": value} if error is None else {"value": value,
                                                      "standard_error": error * value}
    text = table_text(NM, columns, quantity=Quantity.REFLECTANCE, source="a card")
    (folder / "spectra" / f"{name}.csv").write_text(text, encoding="utf-8")
    (folder / "session.toml").write_text(HEAD + regions_toml(known=(name,)), encoding="utf-8")


def problems(verdict):
    return {one.code: one for one in verdict.problems}


def test_a_card_stated_far_from_its_level_is_left_out_and_all_others_are_measured(flat_session):
    with_card(flat_session, "white_wall", 0.5)
    finished = run(flat_session)
    assert left_out(finished) == {"flat.known-other-level": "white_wall"}
    values = problems(result_of(finished.capture, finished.records).verdict)[
        "flat.known-other-level"].values
    # half of what it is; its light is known to some per cent beside the chart
    assert values["read"] / values["stated"] == pytest.approx(2, rel=0.1)


def test_a_patch_of_the_chart_is_no_white_card(flat_session):
    left, top, width = CHART
    white = [round(SIZE[1] * value) for value in (
        left + 0.02 * width, top + 0.53 * width, left + 0.08 * width, top + 0.58 * width)]
    card = f'[regions.card]\nrect = {white}\nknown = "spectra/white_wall.csv"\n'
    (flat_session / "session.toml").write_text(HEAD + regions_toml() + card, encoding="utf-8")
    assert left_out(run(flat_session)) == {"flat.known-on-chart": "card"}


def test_a_card_that_is_overexposed_is_left_out_and_all_others_are_measured(flat_session):
    light = light_over()
    x0, y0, x1, y1 = rect_of("white_wall")
    light[y0:y1, x0:x1] *= 3
    write_photo(flat_session / "photos" / "sample.dng", picture(light=light), Fraction(1, 60),
                np.random.default_rng(7), brightest=1.6)
    (flat_session / "session.toml").write_text(HEAD + regions_toml(known=("white_wall",)),
                                               encoding="utf-8")
    assert left_out(run(flat_session)) == {"flat.known-clipped": "white_wall"}


@pytest.mark.parametrize("error, standing", [(None, "measured"), (0.005, "measured"),
                                             (0.03, "stated")])
def test_a_card_measures_the_light_as_well_as_its_reflectance_is_known(flat_session, error,
                                                                       standing):
    with_card(flat_session, "white_wall", 1.0, error)
    finished = run(flat_session)
    verdict = result_of(finished.capture, finished.records)
    light = next(one for one in verdict.conditions if one.code == "condition.light")
    assert light.values["standing"] == standing and light.values["names"] == ["white_wall"]
    # what was typed is named: it may be another card's, and changes a white by two of L*
    assert light.values["named"] == (standing == "stated")
    by_card = {None: 0.005, 0.005: 0.0071, 0.03: 0.03}[error]
    assert finished.capture.known_errors["white_wall"] == pytest.approx(by_card, rel=0.02)
    # the card's own error bounds what it tells of the light upon it
    level_error = light_errors(finished)["white_wall"]
    assert level_error < 1.1 * np.hypot(by_card, 0.013)


def test_a_card_stated_off_its_level_is_doubted(flat_session):
    with_card(flat_session, "white_wall", 1.17)     # the light is known to about 4 % there
    finished = run(flat_session)
    found = result_of(finished.capture, finished.records)
    verdict = found.verdict
    assert verdict.severity is Severity.WARN
    assert problems(verdict)["flat.known-level"].subject == "white_wall"
    photo = replace(found.photos[0], level_misfits={"bright": 3.5, "dark": -4.5})
    verdict = replace(found, photos=(photo,)).verdict
    doubted = problems(verdict)["flat.known-level"]
    assert doubted.subject == "dark" and doubted.values["value"] == 4.5
    assert doubted.values["surfaces"] == ["bright", "dark"]


def test_a_region_of_several_paints_and_a_truth_of_another_are_warnings(flat_session):
    text = (flat_session / "session.toml").read_text(encoding="utf-8")
    x0, y0, x1, y1 = rect_of("cube")
    other = rect_of("red_wall")
    finished = run(flat_session)
    right = result_of(finished.capture, finished.records).verdict
    assert {one.code for one in right.passed} >= {"flat.scatter", "truth.possible"}
    both = [min(x0, other[0]), min(y0, other[1]), max(x1, other[2]), max(y1, other[3])]
    text += f"[regions.both]\nrect = {both}\n"
    (flat_session / "spectra" / "other.csv").write_text(table_text(
        NM, {"value": 1 - paint("cube")[1]}, quantity=Quantity.REFLECTANCE, source=""),
        encoding="utf-8")
    text = text.replace('"spectra/cube.csv"', '"spectra/other.csv"')
    (flat_session / "session.toml").write_text(text, encoding="utf-8")
    finished = run(flat_session)
    verdict = result_of(finished.capture, finished.records).verdict
    assert verdict.severity is Severity.WARN
    assert problems(verdict)["flat.scatter"].subject == "both"
    assert problems(verdict)["truth.of-another"].subject == "cube"


def test_a_true_card_far_from_the_chart_in_uneven_light_is_believed(flat_session):
    light = lamplight((320, 480), [(0.0, 0.1, 0.5, 1.0)]) * vignetting((320, 480), 0.8)
    x0, y0, x1, y1 = rect_of("green_wall")
    assert light[y0:y1, x0:x1].mean() < 0.6 * light[:y1, :x1].max()
    write_photo(flat_session / "photos" / "sample.dng", picture(light=light / light.max()),
                Fraction(1, 60), np.random.default_rng(10))
    with_card(flat_session, "green_wall", 1.0)
    misfits = run(flat_session).records.flat_signals.level_misfits[""]
    assert np.abs(misfits["green_wall"]) < 3


def test_a_shadow_across_the_chart_is_said(flat_session):
    light = light_over()
    left, top = CHART[:2]
    patch = CHART[2] / 6 * light.shape[1]
    y, x = int(top * light.shape[1]), int(left * light.shape[1])
    light[y:y + int(patch), x:x + int(2 * patch)] *= 0.8        # dark skin and light skin
    write_photo(flat_session / "photos" / "sample.dng", picture(light=light), Fraction(1, 60),
                np.random.default_rng(9))
    off, = [one for one in run(flat_session).records.calibrate.findings
            if one.severity is Severity.WARN]
    # named, since no other cause leaves two patches beside each other dark alone
    assert off.code == "calibration.cause" and off.values["causes"] == ["shadow-edge"]
    darker = {row["patch"]: row["brighter"]
              for row in off.values["doubts"]["patches.unlike-reference"]["patches"]}
    assert darker["light skin"] < -0.1 and darker["dark skin"] < -0.1
