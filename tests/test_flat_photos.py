"""Flat samples in several photos: other lights and filters, other exposures, one after another."""
import json
import shutil
import tomllib
from fractions import Fraction

import numpy as np
import OpenImageIO as oiio
import pytest
from flat_example import CHART, HEAD, PAINTS, picture, rect_of, regions_toml, write_flat
from test_photo_orientation import photo_bytes_with
from typer.testing import CliRunner

import spectrabox
from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.capture.photo.preview import encode_srgb8
from spectrabox.fixtures import lamp
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.fixtures.paints import NM, paint
from spectrabox.measure import texts
from spectrabox.measure.captured import TYPED_ERROR, error_of_known
from spectrabox.measure.steps.photos import uneven_regions
from spectrabox.radiometry.error_model import ROUNDED_EXPOSURES
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records.photos import RegionSamples
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.given_spectra import as_known
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum, table_text
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.flat.new_session import (
    known_file,
    new_session,
    tables_without_regions,
    write_picture,
)
from spectrabox.session.store.locks import only_writer

from tests.session_runs import run

pytestmark = pytest.mark.usefixtures("light_as_stated", "no_advice")

C2_NM_K = 1.438777e7        # second radiation constant
FILTER = 1 / (1 + np.exp((NM - 570) / 12))      # transmission of a glass that keeps red away
SECOND = {"warm": NM**-5.0 / np.expm1(C2_NM_K / NM / 2856),
          "glass": lamp.radiance(NM) * FILTER}


def errors_of(signals):
    """Standard errors (R, J)."""
    return np.sqrt(np.sum([np.diagonal(covariance, axis1=1, axis2=2)
                           for covariance in signals.errors.values()], axis=0))


def true_signals(signals):
    return np.array([signals.response @ np.interp(signals.grid.nm, NM, paint(name)[1])
                     for name in signals.names])


def second_photo(folder, name, light):
    """Write a second photo under another light, and what session.toml says of it."""
    write_photo(folder / "photos" / f"{name}.dng", picture(power=SECOND[name]), Fraction(1, 30),
                np.random.default_rng(11))
    (folder / "spectra" / f"{name}.csv").write_text(table_text(
        NM, {"value": SECOND[name]}, quantity=Quantity.RELATIVE, source=name), encoding="utf-8")
    return f'[views.{name}]\nphoto = "photos/{name}.dng"\nlight = "{light}"\n'


@pytest.fixture(scope="module")
def one_photo(_finished_flat):
    return run(_finished_flat)


def errors_and_cover(finished):
    """RMSE and the share inside the band, of every paint."""
    found = []
    for name in PAINTS:
        summary = finished.records.spectra[name]
        truth = np.interp(summary.grid.nm, NM, paint(name)[1])
        found.append([np.sqrt(np.mean((summary.mean - truth)**2)),
                      np.mean((summary.lower <= truth) & (truth <= summary.upper)),
                      np.mean(summary.upper - summary.lower)])
    return np.array(found)


@pytest.mark.parametrize("name, light", [("warm", "spectra/warm.csv"),
                                         ("glass", "spectra/glass.csv")])
def test_a_second_light_or_filter_adds_bands_and_narrows_the_spectra(tmp_path, one_photo, name,
                                                                     light):
    folder = write_flat(tmp_path / "session")
    text = (folder / "session.toml").read_text(encoding="utf-8")
    (folder / "session.toml").write_text(text + second_photo(folder, name, light),
                                         encoding="utf-8")
    finished = run(folder)
    signals = finished.records.signals
    assert signals.signal.shape == (len(PAINTS), 6)
    assert signals.bands[:1] == ("photo: R",) and signals.bands[3:4] == (f"{name}: R",)
    off = (signals.signal - true_signals(signals)) / errors_of(signals)
    # 24 signals of which those of one region and photo are nearly one: 4 sigma
    assert np.abs(off).max() < 4
    one, both = errors_and_cover(one_photo), errors_and_cover(finished)
    assert (both[:, 2] < one[:, 2]).all()               # width of every band
    assert both[:, 0].mean() < one[:, 0].mean()         # RMSE
    known = np.array([name != "cube" for name in PAINTS])
    assert both[known, 1].min() > 0.95
    # The cube's blue rises again towards 700 nm, which few paints of the prior do.
    assert both[~known, 1].min() > 0.75


def write_unknown(folder, views):
    """The paints under an unknown lamp, and further photos: warm, or the first lamp again."""
    write_flat(folder)
    second_photo(folder, "warm", "unknown")
    write_photo(folder / "photos" / "again.dng", picture(), Fraction(1, 100),
                np.random.default_rng(12))
    (folder / "session.toml").write_text(
        HEAD.replace("spectra/light.csv", "unknown") + regions_toml() + "".join(
            f'[views.{name}]\nphoto = "photos/{name}.dng"\n{light}\n'
            for name, light in views.items()), encoding="utf-8")
    return folder


OWN, SAME = 'light = "unknown"', 'same_light_as = "photo"'


@pytest.mark.parametrize("views, bands", [
    ({"warm": OWN}, 6), ({"again": SAME}, 3), ({"again": OWN}, 3)])
def test_two_lamps_of_one_word_are_two_and_one_lamp_in_two_photos_is_one(tmp_path, views, bands):
    finished = run(write_unknown(tmp_path / "session", views)).records
    signals, found = finished.signals, finished.calibrate.findings
    assert signals.signal.shape == (len(PAINTS), bands)
    assert len(finished.calibrate.whites) == 2
    # only what is not stated has to be said
    same = [one.values["names"] for one in found if one.code == "light.same-in-photos"]
    assert bool(same) == (views == {"again": OWN})
    off = (signals.signal - true_signals(signals)) / errors_of(signals)
    assert np.abs(off).max() < 4    # as above


def test_another_lamp_is_not_taken_for_the_first_because_somebody_says_so(tmp_path):
    with pytest.raises(CheckError, match="its chart shows a light that differs by"):
        run(write_unknown(tmp_path / "session", {"warm": SAME}))


def test_regions_are_measured_in_the_photos_that_show_them(tmp_path):
    folder = write_flat(tmp_path / "session")
    text = HEAD + second_photo(folder, "warm", "spectra/warm.csv") + "".join(
        f"[regions.{name}]\nrect = {rect_of(name)}\nphoto = {shown}\n" for name, shown
        in (("cube", '"photo"'), ("red_wall", '"warm"'), ("green_wall", '["photo", "warm"]')))
    (folder / "session.toml").write_text(text, encoding="utf-8")
    signals = run(folder).records.signals
    assert np.isfinite(signals.signal).tolist() == [[True] * 3 + [False] * 3,
                                                    [False] * 3 + [True] * 3, [True] * 6]


def two_photos(folder, *, stated=(Fraction(1, 60), Fraction(1, 125)),
               true=(Fraction(1, 64), Fraction(1, 128)), write=write_photo):
    """A chart photo and a photo of the samples whose stated times are rounded."""
    write_flat(folder)
    shutter = float(true[1] / true[0]) / float(stated[1] / stated[0])
    gain = write(folder / "photos" / "chart.dng", picture(paints={}), stated[0],
                 np.random.default_rng(4))
    write(folder / "photos" / "sample.dng", picture(chart=None), stated[1],
          np.random.default_rng(5), brightest=None, gain=gain * shutter)
    (folder / "session.toml").write_text(HEAD.replace(
        "[light]", 'chart = "photos/chart.dng"\n[light]') + regions_toml(), encoding="utf-8")
    return folder


def test_rounded_exposure_times_are_brought_together_with_their_error(tmp_path):
    signals = run(two_photos(tmp_path / "session")).records.signals
    off = (signals.signal - true_signals(signals)) / errors_of(signals)
    assert np.abs(off).max() < 4
    # the stated ratio is off by 64/60 x 125/128: as much as the error that is said of it
    rounded = signals.errors[ROUNDED_EXPOSURES]
    share = np.sqrt(np.diagonal(rounded, axis1=1, axis2=2)) / signals.signal
    np.testing.assert_allclose(share, 1 - 60 * 128 / (64 * 125), rtol=0.1)
    assert np.abs(signals.signal / true_signals(signals) - 1).max() > 0.03


def test_photos_that_state_no_exposure_are_refused_in_one_sentence(tmp_path):
    folder = two_photos(tmp_path / "session")
    samples = picture(chart=None) / picture().max()
    write_exr(folder / "photos" / "sample.exr", samples, "RGB")
    text = (folder / "session.toml").read_text(encoding="utf-8")
    (folder / "session.toml").write_text(text.replace("sample.dng", "sample.exr"),
                                         encoding="utf-8")
    with pytest.raises(InputError, match="do not both state how long they were exposed") as raised:
        run(folder)
    assert "\n" not in str(raised.value) and "sample.exr" in str(raised.value)


def write_jpeg(path):
    shown = encode_srgb8(picture() / picture().max())
    file = oiio.ImageOutput.create(str(path))
    file.open(str(path), oiio.ImageSpec(shown.shape[1], shown.shape[0], 3, oiio.UINT8))
    file.write_image(shown)
    file.close()


def write_raw(**changed):
    return lambda path: write_photo(path, picture(**changed), Fraction(1, 60),
                                    np.random.default_rng(7))


@pytest.mark.parametrize("name, write, sentence", [
    ("a.jpg", write_jpeg, "a.jpg is a JPEG"),
    ("a.dng", write_raw(chart=None), "no ColorChecker was found in photo a.dng"),
    ("a.dng", lambda path: path.write_bytes(b"II*\0 cut short"), "a.dng")])
def test_a_photo_that_will_not_do_is_one_sentence_and_leaves_nothing(tmp_path, name, write,
                                                                     sentence):
    write(tmp_path / name)
    outcome = CliRunner().invoke(app, ["flat", str(tmp_path / name), "--region", "a=300,50,340,90"])
    assert outcome.exit_code in (3, 4), outcome.output
    said = outcome.stderr.strip().splitlines()[-1]
    assert sentence in said and "Traceback" not in outcome.stderr
    assert [path.name for path in tmp_path.iterdir()] == [name]


def _spectra(folder):
    (folder / "spectra").mkdir()
    return folder


def test_without_a_region_the_chart_is_looked_for_and_drawn(tmp_path):
    write_raw()(tmp_path / "a.dng")
    outcome = CliRunner().invoke(app, ["flat", str(tmp_path / "a.dng"), "--json"])
    facts = json.loads(outcome.stdout)
    assert facts["verdict"] in ("good", "re-shoot") and len(facts["corners_px"]) == 24
    plain = tmp_path / "plain.png"
    write_picture(open_any(tmp_path / "a.dng"), plain)
    drawn, blank = (oiio.ImageBuf(str(path)).get_pixels() for path in (facts["picture"], plain))
    assert 0.001 < (drawn != blank).any(axis=2).mean() < 0.2
    said = CliRunner().invoke(app, ["flat", str(tmp_path / "a.dng")]).stdout.splitlines()
    assert said[-2].endswith(f"spectrabox open {tmp_path / 'a.dng'}") and "--region" in said[-1]


@pytest.mark.parametrize("chart", [None, (-0.02, *CHART[1:])], ids=["none", "cut by the frame"])
def test_a_photo_without_a_whole_chart_is_told_which_option_to_use(tmp_path, chart):
    write_raw(chart=chart)(tmp_path / "a.dng")
    outcome = CliRunner().invoke(app, ["flat", str(tmp_path / "a.dng")])
    assert outcome.exit_code == 4 and "the whole chart" in outcome.stderr
    assert (chart is not None) or "--corners X,Y" in outcome.stderr
    assert (tmp_path / "a-pixels.png").exists()     # from which corners can be read


def test_photos_of_a_day_have_their_regions_in_a_file_and_a_session_each(tmp_path):
    write_raw()(tmp_path / "a.dng")
    write_raw(seed=2)(tmp_path / "b.dng")
    # a camera that looks down states any orientation, and the regions stay where they are
    (tmp_path / "b.dng").write_bytes(photo_bytes_with(tmp_path / "b.dng", 8))
    write_raw(chart=None)(tmp_path / "none.dng")
    (tmp_path / "regions.toml").write_text("".join(
        f"[regions.{name}]\nrect = {rect_of(name)}\n" + more for name, more in
        (("cube", 'family = "paint"\nsurface = "matt"\n'), ("white_wall", "known = 0.9\n"))),
        encoding="utf-8")
    words = ["flat", *(str(tmp_path / f"{name}.dng") for name in ("a", "none", "b")), "--regions",
             str(tmp_path / "regions.toml"), "--each", "--light", "LED-B3", "--json", "--quiet"]
    outcome = CliRunner().invoke(app, words)
    facts = json.loads(outcome.stdout)["photos"]
    assert outcome.exit_code == 4 and "no ColorChecker" in facts[1]["error"]
    for name in "ab":
        written = tomllib.loads((tmp_path / f"{name}-flat" / "session.toml").read_text())["regions"]
        assert written["cube"] == {"rect": rect_of("cube"), "family": ["paint"], "surface": "matt"}
        assert written["white_wall"]["known"].endswith(".csv")
        assert (tmp_path / f"{name}-flat" / "report.html").exists()


def test_a_card_in_per_cent_is_asked_back_or_understood(tmp_path):
    assert known_file("94%", "card", _spectra(tmp_path)) == known_file("0.94", "card", tmp_path)
    even = read_spectrum(tmp_path / known_file("0.94", "card", tmp_path), role=Quantity.REFLECTANCE)
    assert error_of_known(even) == TYPED_ERROR      # a number is a statement
    assert error_of_known(as_known(0.94, "card")) == TYPED_ERROR
    assert error_of_known(as_known((0.94, 0.02), "card")) == pytest.approx(0.02 / 0.94, rel=0.05)
    typed = tmp_path / known_file("94% +- 2%", "card", tmp_path)
    assert error_of_known(read_spectrum(typed, role=Quantity.REFLECTANCE)) == pytest.approx(
        0.02 / 0.94, rel=0.05)
    write_raw()(tmp_path / "a.dng")
    outcome = CliRunner().invoke(app, ["flat", str(tmp_path / "a.dng"), "--region",
                                       "a=300,50,340,90", "--white-card", "300,10,340,40=94"])
    assert outcome.exit_code == 3 and "outside 0 to 1 (0.94?)" in outcome.stderr


def test_two_commands_do_not_work_in_one_session_at_once(tmp_path):
    write_raw()(tmp_path / "a.dng")
    tables = tables_without_regions(tmp_path / "a.dng")
    tables |= {"regions": {"a": {"rect": [300, 50, 340, 90]}}}
    with new_session(tables, None) as folder, only_writer(folder, "spectrabox run"):
        outcome = CliRunner().invoke(app, ["flat", str(tmp_path / "a.dng"), "--region",
                                           "a=300,50,340,90"])
    assert outcome.exit_code != 0 and not (folder / "report.html").exists()
    assert "'spectrabox run' (process" in outcome.stderr and "works in this session" in \
        outcome.stderr


def test_photos_from_one_tripod_are_one_command_and_each_has_its_own_lamp(tmp_path):
    write_raw()(tmp_path / "_DSC1.dng")
    for name in ("warm", "glass"):
        write_raw(power=SECOND[name])(tmp_path / f"{name}.dng")
    (tmp_path / "glass.csv").write_text(table_text(
        NM, {"value": FILTER}, quantity=Quantity.RELATIVE, source="glass"), encoding="utf-8")
    one, warm, glass = (str(tmp_path / name) for name in ("_DSC1.dng", "warm.dng", "glass.dng"))
    region = "--region=wall=" + ",".join(map(str, rect_of("white_wall")))
    outcome = CliRunner().invoke(app, ["flat", one, warm, "--also", f"{glass}=filter:"
                                       f"{tmp_path / 'glass.csv'}", region, "--json"])
    assert outcome.exit_code == 0, outcome.output
    wall = json.loads(outcome.stdout)["regions"][0]
    assert len(wall["signal"]) == 9
    said = {photo["name"]: photo for photo in json.loads(outcome.stdout)["photos"]}
    assert "light: unknown; bands of its chart's" in said["photo"]["says"]
    assert "light: the lamp of “photo” through spectra/glass.csv" in said["glass"]["says"]
    assert said["warm"]["shift_px"] < 0.5 and said["warm"]["residual_px"] < 1
    assert said["glass"]["left_out_bands"] == []
    folder = tmp_path / "_DSC1-flat"
    views = read_session(folder).all_views
    assert [(view.title, view.lamp_of) for view in views] == [
        ("photo", "photo"), ("warm", "warm"), ("glass", "photo")]
    assert (folder / views[2].filter.file).read_bytes() == (tmp_path / "glass.csv").read_bytes()


@pytest.mark.parametrize("words, sentence", [
    (["{a}", "{a}"], "is given twice"), (["{a}", "--also", "b.dng=orange.csv"], "is needed"),
    (["{a}", "--also", "{a}=same"], "is given twice"),
    (["{a}", "none.dng"], "none.dng is missing")])
def test_photos_that_cannot_go_together_are_one_sentence(tmp_path, words, sentence):
    write_raw()(tmp_path / "a.dng")
    outcome = CliRunner().invoke(app, ["flat", *(word.format(a=tmp_path / "a.dng")
                                                 for word in words), "--region", "a=300,50,340,90"])
    assert outcome.exit_code == 3 and sentence in outcome.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.dng"]


def test_photos_that_moved_are_measured_where_they_show_the_regions(tmp_path):
    folder, shift = write_flat(tmp_path / "session"), (20, -8)      # regions are 14 within a paint
    (folder / "spectra" / "glass.csv").write_text(table_text(
        NM, {"value": FILTER}, quantity=Quantity.RELATIVE, source="glass"), encoding="utf-8")
    text = HEAD.replace("spectra/light.csv", "unknown") + regions_toml()
    for name, said in (("warm", 'light = "unknown"'), ("glass", 'filter = "spectra/glass.csv"')):
        write_photo(folder / "photos" / f"{name}.dng",
                    np.roll(picture(power=SECOND[name]), shift, axis=(1, 0)), Fraction(1, 30),
                    np.random.default_rng(13))
        text += f'[views.{name}]\nphoto = "photos/{name}.dng"\n{said}\n'
    (folder / "session.toml").write_text(text, encoding="utf-8")
    records = run(folder).records
    for registration in records.photo.registrations.values():
        np.testing.assert_allclose(registration.matrix[:, 2], shift, atol=0.5)
        assert registration.chart_px < 1 and registration.residual_px < 1
    signals = records.signals
    assert signals.signal.shape == (len(PAINTS), 9)
    off = (signals.signal - true_signals(signals)) / errors_of(signals)
    assert np.abs(off).max() < 4    # as above
    photo, glass = folder / "photos" / "sample.dng", folder / "photos" / "glass.dng"
    regions, filtered = {name: rect_of(name) for name in PAINTS}, {glass: folder / "spectra" /
                                                                   "glass.csv"}
    write_photo(glass, np.roll(picture(power=SECOND["glass"]), 50, axis=1), Fraction(1, 30),
                np.random.default_rng(13))
    with pytest.raises(CheckError, match=r"glass.dng is shifted by .* take all photos from one"):
        spectrabox.flat(photo, regions, filtered=filtered)


@pytest.fixture(scope="module")
def unknown_lamp(tmp_path_factory):
    """A session of one photo under a lamp that nobody knows, and its spectra."""
    folder = write_unknown(tmp_path_factory.mktemp("unknown") / "session", {})
    return folder, run(folder).records.spectra


@pytest.mark.parametrize("said", ["spectra/filter.csv", "unknown"])
def test_a_filter_adds_three_bands_under_a_light_that_nobody_knows(tmp_path, unknown_lamp, said):
    first, one = unknown_lamp
    folder = shutil.copytree(first, tmp_path / "session")
    second_photo(folder, "glass", "unknown")
    (folder / "spectra" / "filter.csv").write_text(table_text(
        NM, {"value": 100 * FILTER}, quantity=Quantity.RELATIVE, source="glass"), encoding="utf-8")
    with (folder / "session.toml").open("a", encoding="utf-8") as text:
        text.write(f'[views.glass]\nphoto = "photos/glass.dng"\nfilter = "{said}"\n')
    records = run(folder).records
    off = (records.signals.signal - true_signals(records.signals)) / errors_of(records.signals)
    # 24 signals of which those of one region are nearly one: 4 sigma
    assert np.abs(off[np.isfinite(off)]).max() < 4
    width, before = (np.mean([spectra[name].upper - spectra[name].lower
                              for name in PAINTS]) for spectra in (records.spectra, one))
    assert width < before
    if said == "unknown":
        return
    with pytest.raises(InputError, match="is the photo without the filter"):
        spectrabox.flat(folder / "photos" / "glass.dng", {"a": rect_of("cube")},
                        filtered={folder / "photos" / "glass.dng": folder / said})


def test_a_region_is_uneven_where_its_pixels_scatter_by_more_than_noise_in_some_band():
    scatter = np.array([[0.01, 0.04, 0.02], [0.01, 0.09, 0.02]])
    samples = RegionSamples(("wall", "leaf"), np.ones((2, 3)), np.zeros((2, 3, 3)),
                            np.full(2, 100), scatter, np.zeros((2, 1, 2)))
    uneven, = uneven_regions(samples, "warm")
    assert (uneven.code, uneven.subject, uneven.values["photo"]) == ("region.uneven", "leaf",
                                                                     "warm")
    assert uneven.values["scatter"] == 0.09 and texts.remedy(uneven)
