"""A picture of spectra: every pixel of a flat sample, under light that falls off."""
import shutil
from fractions import Fraction

import numpy as np
import OpenImageIO as oiio
import pytest
from flat_example import HEAD, light_over, picture, write_spectra
from sampling_cameras import surface

from spectrabox.capture.photo import regions
from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.fixtures.paints import NM
from spectrabox.measure.pictures import pixel_spectra
from spectrabox.radiometry.errors import InputError
from spectrabox.session.config.session_file import read_session
from spectrabox.session.outputs.write_outputs import write_outputs
from spectrabox.session.terminal.progress_display import with_time_left

from tests.session_runs import run

LEFT, TOP, CELL, CELLS = 276, 30, 12, 14        # of a mosaic of surfaces, in pixels of the photo
CLIPPED = (3, 5)                                # row and column of the cell that is too bright
END = CELL * CELLS
GROUND = "[regions.ground]\nrect = [300, 250, 340, 290]\n"
WHOLE = f"rect = [{LEFT - 0.5}, {TOP - 0.5}, {LEFT + END - 0.5}, {TOP + END - 0.5}]\n"
SMALL = f"rect = [{LEFT - 0.5}, {TOP - 0.5}, {LEFT + 15.5}, {TOP + 7.5}]\n"
QUARTER = f"rect = [{LEFT - 0.5}, {TOP - 0.5}, {LEFT + END / 2 - 0.5}, {TOP + END / 2 - 0.5}]\n"
SIGMAS_95 = 1.96


def surfaces():
    return np.array([[surface(NM, CELLS * row + column) for column in range(CELLS)]
                     for row in range(CELLS)])


def write_session(folder):
    write_spectra(folder / "spectra")
    (folder / "photos").mkdir()
    light, responses = light_over(), camera_sensitivities() * lamp.radiance(NM)
    shown = surfaces()
    shown[CLIPPED] = 4.0
    mosaic = np.repeat(np.repeat(shown @ responses.T, CELL, axis=0), CELL, axis=1)
    seen = picture(paints={})
    part = slice(TOP, TOP + END), slice(LEFT, LEFT + END)
    seen[part] = mosaic * light[part][..., None]
    write_photo(folder / "photos" / "sample.dng", seen, Fraction(1, 60), np.random.default_rng(3))
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


def test_the_bands_of_pixels_hold_their_surfaces(_finished_picture):
    folder, _ = _finished_picture
    mean, spread = (stored(folder, f"{name}.exr") for name in ("mean", "standard_deviation"))
    assert mean[1][:2] == ["T.400,000000nm", "T.410,000000nm"]
    assert spread[1][:2] == ["T.400,000000nm", "T.420,000000nm"]
    truth = np.array([[np.interp(np.arange(400, 701, 20), NM, each) for each in row]
                      for row in surfaces()])
    side = CELL // 2        # the photo is developed at half its size
    truth = truth.repeat(side, axis=0).repeat(side, axis=1)
    held = np.abs(truth - mean[0][..., ::2]) <= SIGMAS_95 * spread[0]
    seen = np.isfinite(mean[0][..., 0])
    # one light for all of them, and 195 surfaces: 3 sigma of the share are 4 %
    assert 0.93 <= held[seen].mean() <= 0.98


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


def test_a_pixel_is_what_a_region_of_one_pixel_gives_however_many_rows_are_read(session,
                                                                                monkeypatch):
    monkeypatch.setattr(regions, "MIN_PIXELS", 1)
    x, y = LEFT + 2, TOP + 4        # the pixel (1, 2) of the picture
    dot = f"[regions.dot]\nrect = [{x - 0.4}, {y - 0.4}, {x + 1.4}, {y + 1.4}]\n"
    write_toml(session, SMALL, dot)
    finished = run(session)
    assert finished.states["calibrate"] == "kept" and finished.states["picture"] == "run"
    once = {name: stored(session, name)[0] for name in finished.records.picture.files}
    summary = finished.records.sample.spectra["dot"].summary
    # means of 1000 draws: 4 sigma are 0.13 of their spread; rounding of half floats adds to it
    nm = np.arange(400, 701, 10)
    mean, width = (np.interp(nm, summary.grid.nm, values)
                   for values in (summary.mean, summary.standard_deviation))
    assert np.abs(once["mean.exr"][2, 1] - mean).max() < 0.15 * width.max()
    assert np.abs((once["mean.exr"][2, 1] - mean) / width).max() < 0.2
    # 1000 draws tell a spread to 2 %, in the tails of a skewed one to 5 %
    np.testing.assert_allclose(once["standard_deviation.exr"][2, 1], width[::2], rtol=0.2)
    monkeypatch.setattr(pixel_spectra, "ROWS_PER_BLOCK", 1)
    monkeypatch.setattr(pixel_spectra, "PIXELS_AT_ONCE", 1)
    shutil.rmtree(session / "results" / "picture")
    run(session)
    for name, values in once.items():
        np.testing.assert_allclose(stored(session, name)[0], values, rtol=1e-3, atol=1e-6)


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
    facts, text, _ = write_outputs(read_session(session), finished, ["spectrabox"], "cpu")
    assert all((session / file).is_file() for file in facts["picture"]["files"])
    assert facts["picture"]["size_px"] == [END // 2, END // 2]
    assert "files in results/picture" in text
    page = (session / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png") >= 9 and "Colour under A" in page


@pytest.mark.parametrize("change, sentence", [
    ("rect = [1, 2, 1, 9]\n", "two opposite corners"),
    ("bands_nm = [390]\n", "lies outside 400 to 700 nm"),
    ("family = \"glass\"\n", "picture.family")])
def test_keys_that_cannot_be_are_named(tmp_path, change, sentence):
    write_toml(tmp_path, change)
    with pytest.raises(InputError, match=sentence):
        read_session(tmp_path)


def test_a_picture_beyond_the_photo_is_one_sentence(session):
    write_toml(session, "rect = [400, 100, 500, 200]\n")
    with pytest.raises(InputError, match=r"picture.rect leaves photo .* of 480 x 320 pixels"):
        run(session)
