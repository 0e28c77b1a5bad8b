"""A picture of spectra: every pixel of a flat sample, under light that falls off."""
import shutil
from fractions import Fraction

import numpy as np
import OpenImageIO as oiio
import pytest
from flat_example import HEAD, light_over, picture, write_spectra
from sampling_cameras import surface
from small_captures import work

from spectrabox.capture.photo import regions
from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.fixtures.paints import NM
from spectrabox.measure.pictures import pixel_spectra
from spectrabox.measure.steps.pictures import lit_photo
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.config.session_file import read_session
from spectrabox.session.outputs.run_outputs import write_outputs
from spectrabox.session.terminal.progress_display import with_time_left

from tests.session_runs import run

LEFT, TOP, CELL, CELLS = 276, 30, 12, 14        # of a mosaic of surfaces, in pixels of the photo
CLIPPED = (3, 5)                                # row and column of the cell that is too bright
END = CELL * CELLS
GROUND = "[regions.ground]\nrect = [300, 250, 340, 290]\n"
WHOLE = f"rect = [{LEFT - 0.5}, {TOP - 0.5}, {LEFT + END - 0.5}, {TOP + END - 0.5}]\n"
SMALL = f"rect = [{LEFT - 0.5}, {TOP - 0.5}, {LEFT + 15.5}, {TOP + 7.5}]\n"
QUARTER = f"rect = [{LEFT - 0.5}, {TOP - 0.5}, {LEFT + END / 2 - 0.5}, {TOP + END / 2 - 0.5}]\n"
# the pixel (1, 2) of the picture
DOT = f"[regions.dot]\nrect = [{LEFT + 1.6}, {TOP + 3.6}, {LEFT + 3.4}, {TOP + 5.4}]\n" \
    'surface = "matt"\n'
SIGMAS_95 = 1.96
GEL = (0.05 + 0.85 * np.exp(-((NM - 450) / 35)**2) + 0.8 * np.exp(-((NM - 610) / 42)**2))
MOVED = (3, -4)                                 # rows and columns of the photo
VIEWS = {name: f'[views.{name}]\nphoto = "photos/{name}.dng"\n{light}\n' for name, light in (
    ("again", 'same_light_as = "photo"'), ("gel", 'filter = "spectra/gel.csv"'),
    ("moved", 'filter = "spectra/gel.csv"'))}


def surfaces():
    return np.array([[surface(NM, CELLS * row + column) for column in range(CELLS)]
                     for row in range(CELLS)])


def light_of_mosaic(power, clipped):
    """Light (H, W, 3) that reaches the sensor from chart and surfaces, one of which is too bright.
    """
    shown = surfaces()
    shown[clipped] = 4.0
    mosaic = np.repeat(np.repeat(shown @ (camera_sensitivities() * power).T, CELL, axis=0), CELL,
                       axis=1)
    seen = picture(paints={}, power=power)
    part = slice(TOP, TOP + END), slice(LEFT, LEFT + END)
    seen[part] = mosaic * light_over()[part][..., None]
    return seen


def write_session(folder):
    write_spectra(folder / "spectra")
    (folder / "spectra" / "gel.csv").write_text(table_text(
        NM, {"value": GEL}, quantity=Quantity.RELATIVE, source="a gel"), encoding="utf-8")
    (folder / "photos").mkdir()
    first = light_of_mosaic(lamp.radiance(NM), CLIPPED)
    through = light_of_mosaic(lamp.radiance(NM) * GEL, (7, 2))
    for seed, (name, seen, seconds) in enumerate((
            ("sample", first, 60), ("again", first, 100), ("gel", through, 60),
            ("moved", np.roll(through, MOVED, (0, 1)), 60)), start=3):
        write_photo(folder / "photos" / f"{name}.dng", seen, Fraction(1, seconds),
                    np.random.default_rng(seed))
    write_toml(folder, WHOLE)
    return folder


def write_toml(folder, part, more=""):
    # the simulated samples lie in the chart's plane and mirror nothing
    (folder / "session.toml").write_text(
        f"{HEAD}[repeatability]\nplane = 0\n[picture]\nlight = \"A\"\nsurface = \"matt\"\n"
        f"{part}{GROUND}{more}", encoding="utf-8")


def stored(folder, name):
    file = oiio.ImageInput.open(str(folder / "results" / "picture" / name))
    pixels, channels = np.asarray(file.read_image("float")), list(file.spec().channelnames)
    first = 3 if len(channels) > 3 and channels[0] == "R" else 0    # colours for viewers
    return pixels[..., first:], channels[first:]


@pytest.fixture(scope="module")
def _finished_picture(tmp_path_factory):
    folder = write_session(tmp_path_factory.mktemp("picture") / "session")
    return folder, run(folder)


@pytest.fixture
def session(_finished_picture, tmp_path):
    """A finished session of its own."""
    return shutil.copytree(_finished_picture[0], tmp_path / "session")


def off_and_held(folder):
    """What pixels (H, W, Q) with a spectrum are off by, and whether their bands hold the truth."""
    mean, spread = (stored(folder, f"{name}.exr") for name in ("mean", "standard_deviation"))
    assert mean[1][:2] == ["T.400,000000nm", "T.410,000000nm"]
    assert spread[1][:2] == ["T.400,000000nm", "T.420,000000nm"]
    truth = np.array([[np.interp(np.arange(400, 701, 20), NM, each) for each in row]
                      for row in surfaces()])
    side = CELL // 2        # the photo is developed at half its size
    off = mean[0][..., ::2] - truth.repeat(side, axis=0).repeat(side, axis=1)
    return off, np.abs(off) <= SIGMAS_95 * spread[0]


def test_the_bands_of_pixels_hold_their_surfaces(_finished_picture):
    off, held = off_and_held(_finished_picture[0])
    # one light for all of them, and 195 surfaces: 3 sigma of the share are 4 %
    assert 0.93 <= held[np.isfinite(off)].mean() <= 0.98


@pytest.mark.parametrize("view", ["gel", "moved"])
def test_a_photo_through_a_filter_brings_pixels_nearer_to_their_surfaces(_finished_picture, session,
                                                                         view):
    """Also where it was moved, by one and a half pixels: there edges are left to the first photo.
    """
    write_toml(session, WHOLE, VIEWS[view])
    picture = run(session).records.picture
    photos, fewer = picture.findings
    assert "mask.png" not in picture.files      # that says why pixels of scenes have no spectrum
    assert (photos.code, photos.values["bands"]) == ("picture.photos", 6)
    assert fewer.code == "picture.fewer-photos"
    (before, _), (off, held) = off_and_held(_finished_picture[0]), off_and_held(session)
    both = np.isfinite(before + off)
    # by 9 % without a motion: few surfaces, of which the filter says more of some
    assert np.sqrt(np.mean(off[both]**2)) < 0.98 * np.sqrt(np.mean(before[both]**2))
    # as above
    assert 0.93 <= held[np.isfinite(off)].mean() <= 0.98
    row, column = (CELL // 2 * each + CELL // 4 for each in CLIPPED)
    assert np.isfinite(off[row, column]).all()      # by the other photo


def test_clipped_pixels_are_masked_and_shown(_finished_picture):
    folder, finished = _finished_picture
    mean, _ = stored(folder, "mean.exr")
    side = CELL // 2
    row, column = CLIPPED
    clipped = np.zeros(mean.shape[:2], bool)
    clipped[row * side:(row + 1) * side, column * side:(column + 1) * side] = True
    np.testing.assert_array_equal(np.isnan(mean).all(axis=2), clipped)
    for name in ("colour-D65.png", "colour-A.png", "550nm.png", "uncertainty.png",
                 "unfamiliarity.png"):
        shown, _ = stored(folder, name)
        np.testing.assert_array_equal((shown == [1, 0, 1]).all(axis=2), clipped)
    assert finished.records.picture.masked == pytest.approx(1 / CELLS**2)


@pytest.mark.parametrize("more", ["", VIEWS["again"] + VIEWS["gel"]])
def test_a_pixel_is_what_a_region_of_one_pixel_gives_however_many_rows_are_read(session, more,
                                                                                monkeypatch):
    monkeypatch.setattr(regions, "MIN_PIXELS", 1)
    write_toml(session, SMALL, more + DOT)
    text = (session / "session.toml").read_text(encoding="utf-8")
    (session / "session.toml").write_text(text.replace("draws = 1000", "draws = 16000"),
                                          encoding="utf-8")
    finished = run(session)
    assert finished.states["picture"] == "run"
    assert finished.states["calibrate"] == ("run" if more else "kept")
    once = {name: stored(session, name)[0] for name in finished.records.picture.files}
    summary = finished.records.spectra["dot"]
    # means of 16 000 draws: 4 sigma are 0.03 of their spread; rounding of half floats adds to it
    nm = np.arange(400, 701, 10)
    mean, width = (np.interp(nm, summary.grid.nm, values)
                   for values in (summary.mean, summary.standard_deviation))
    assert np.abs(once["mean.exr"][2, 1] - mean).max() < 0.05 * width.max()
    assert np.abs((once["mean.exr"][2, 1] - mean) / width).max() < 0.1
    # 16 000 draws tell a spread to 0.6 %, a skewed one to 3 %; gloss, of which regions draw and
    # pixels take the variance, is the more skewed where the sample is dark: below 430 nm
    found, at = once["standard_deviation.exr"][2, 1], nm[::2] >= 430
    np.testing.assert_allclose(found[at], width[::2][at], rtol=0.05)
    np.testing.assert_allclose(found[~at], width[::2][~at], rtol=0.1)
    monkeypatch.setattr(pixel_spectra, "ROWS_PER_BLOCK", 1)
    monkeypatch.setattr(pixel_spectra, "PIXELS_AT_ONCE", 1)
    shutil.rmtree(session / "results" / "picture")
    run(session)
    for name, values in once.items():
        np.testing.assert_allclose(stored(session, name)[0], values, rtol=1e-3, atol=1e-6)


def test_a_pixel_in_all_bands_errs_as_a_region_of_one_pixel_does(session, monkeypatch):
    """Errors that photos under one lamp have in common are among them."""
    monkeypatch.setattr(regions, "MIN_PIXELS", 1)
    write_toml(session, SMALL, VIEWS["again"] + VIEWS["gel"] + DOT)
    finished = run(session)
    signals = finished.records.signals
    dot = signals.names.index("dot")
    lit = lit_photo(finished.capture, finished.records, work(finished.capture))
    block, pixel = lit.block(0, 8, direct=True), np.array([lit.size[1] * 2 + 1])
    # a region's points are spread over it, where the light is even to 1e-5
    gloss = signals.states[dot]     # a pixel's signal is without its mean
    np.testing.assert_allclose(block.measured[pixel[0]] + gloss.pattern @ gloss.mean,
                               signals.signal[dot], rtol=1e-4)
    covariance = lit.errors.at_white(block.measured[pixel], block.white.rows(pixel),
                                     block.variance[pixel])[0] \
        + lit.errors.by_curves(block.measured[pixel], 0)[0]
    of_region = np.sum([each[dot] for each in signals.errors.values()], axis=0) \
        + gloss.pattern @ gloss.covariance @ gloss.pattern.T
    size = np.sqrt(np.diag(of_region))
    # the share of the light's error in that of white depends on the signal a little
    np.testing.assert_allclose(covariance / np.outer(size, size),
                               of_region / np.outer(size, size), atol=0.02)


def test_a_table_gives_what_pixels_give_one_by_one_and_says_how_long_it_takes(session, monkeypatch):
    made, shares = [], []
    show = with_time_left(lambda stage, share, said: shares.append((share, said))
                          if stage == "picture" else None)
    for points, progress in ((0, show), (1e9, lambda *_: None)):
        monkeypatch.setattr(pixel_spectra, "POINT_IN_PIXELS", points)
        write_toml(session, QUARTER)
        shutil.rmtree(session / "results" / "picture")
        run(session, progress)
        made.append([stored(session, name)[0] for name in (
            "mean.exr", "standard_deviation.exr", "unfamiliarity.png")])
    (mean, spread, unlike), (alone, width, strange) = made
    seen = np.isfinite(width).all(axis=2)
    assert seen.mean() > 0.9
    off = ((mean - alone)[..., ::2] / width)[seen]
    # the noise of one pixel moves its mean by more than this
    assert np.sqrt(np.mean(off**2)) < 0.25
    assert np.median(np.abs(spread / width - 1)[seen]) < 0.05
    # red beyond what the prior explains
    told, said = ((values[..., 0] > values[..., 2])[seen] for values in (unlike, strange))
    assert (told != said).mean() < 0.02
    assert [share for share, _ in shares] == sorted(share for share, _ in shares)
    assert shares[0][0] == 0 and shares[-1][0] == 1
    assert any(said.endswith(" s left") for _, said in shares)


def test_another_region_keeps_the_picture_and_the_report_shows_it(session):
    more = "[regions.other]\nrect = [100, 250, 140, 290]\n"
    write_toml(session, WHOLE, more)
    finished = run(session)
    assert finished.states["picture"] == "kept" and finished.states["signals"] == "run"
    facts, _, text, *_ = write_outputs(read_session(session), finished, ["spectrabox"], "cpu")
    assert all((session / file).is_file() for file in facts["picture"]["files"])
    assert facts["picture"]["size_px"] == [END // 2, END // 2]
    assert "files in results/picture" in text
    page = (session / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png") >= 9 and "Colour under A" in page


@pytest.mark.parametrize("change, sentence", [
    ("rect = [1, 2, 1, 9]\n", "two opposite corners"),
    ("family = \"glass\"\n", "picture.family")])
def test_keys_that_cannot_be_are_named(tmp_path, change, sentence):
    write_toml(tmp_path, change)
    with pytest.raises(InputError, match=sentence):
        read_session(tmp_path)


def test_a_picture_beyond_the_photo_is_one_sentence(session):
    write_toml(session, "rect = [400, 100, 500, 200]\n")
    with pytest.raises(InputError, match=r"picture.rect leaves photo .* of 480 x 320 pixels"):
        run(session)
