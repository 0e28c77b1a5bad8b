"""Photos stand upright wherever a person reads pixels, at all eight orientations of EXIF."""
import json
from fractions import Fraction

import numpy as np
import OpenImageIO as oiio
import pytest
from flat_example import picture, rect_of
from PIL import Image, ImageOps
from served_page import asked, served, wait_for
from typer.testing import CliRunner

import spectrabox
from spectrabox.capture.photo.image_writers import write_png
from spectrabox.capture.photo.linear import open_photo
from spectrabox.capture.photo.preview import photo_orientation, turned, turned_array
from spectrabox.fixtures.dng import write_dng
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.fixtures.paints import NM, paint
from spectrabox.radiometry.chart import AFTER_2014
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.session.cli import app
from spectrabox.session.commands.session import _folder_to_open
from spectrabox.session.config.session_file import read_session
from spectrabox.session.flat.new_session import MARK, _digest, new_session, tables_without_regions
from spectrabox.session.kept_stages import load_finished

ORIENTATIONS = range(1, 9)
AS_THE_SENSOR_SAW = {6: 8, 8: 6}        # what undoes a turn; the other six undo themselves
UPRIGHT = picture()


def photo_of(path, orientation):
    """A photo of the flat sample by a camera that was held otherwise."""
    seen = turned_array(UPRIGHT, AS_THE_SENSOR_SAW.get(orientation, orientation))
    write_photo(path, seen, Fraction(1, 60), np.random.default_rng(3), orientation=orientation)
    return path


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_a_picture_is_turned_as_another_program_turns_it(tmp_path, orientation):
    mosaic = np.random.default_rng(1).integers(600, 9000, (40, 60)).astype(np.uint16)
    write_dng(tmp_path / "a.dng", mosaic, orientation=orientation)
    assert photo_orientation(tmp_path / "a.dng") == orientation
    image = open_photo(tmp_path / "a.dng")
    shown = turned(image, orientation)
    picture = Image.fromarray(np.arange(600, dtype=np.int32).reshape(20, 30))
    picture.getexif()[274] = orientation
    moved = np.asarray(ImageOps.exif_transpose(picture))
    for name in ("signal", "variance", "saturated"):
        before, after = getattr(image, name), getattr(shown, name)
        np.testing.assert_array_equal(after, before.reshape(600, 3)[moved])
    jpeg = Image.fromarray(np.zeros((20, 30, 3), np.uint8))
    jpeg.getexif()[274] = orientation
    jpeg.save(tmp_path / "a.jpg", exif=jpeg.getexif())
    assert photo_orientation(tmp_path / "a.jpg") == orientation


def test_a_picture_that_states_no_orientation_is_left_as_it_is(tmp_path):
    write_png(tmp_path / "a.png", np.zeros((4, 6, 3), np.uint8))
    assert photo_orientation(tmp_path / "a.png") == 1


def test_the_corners_of_a_chart_are_those_of_the_upright_picture(tmp_path):
    upright, *others = (spectrabox.find_chart(photo_of(tmp_path / f"{number}.dng", number))
                        for number in ORIENTATIONS)
    for found in others:
        # noise differs; a corner is known to a tenth of a pixel
        np.testing.assert_allclose(found.corners, upright.corners, atol=1)
        assert found.verdict == "good"
    said = json.loads(CliRunner().invoke(app, ["chart", str(tmp_path / "6.dng"), "--json"]).stdout)
    np.testing.assert_allclose(said["corners_px"], upright.corners, atol=1)


@pytest.mark.usefixtures("no_advice")
def test_page_regions_and_report_are_of_the_upright_picture(tmp_path):
    """Also of a further photo that states another orientation: a camera that looks down does."""
    photo, other = (photo_of(tmp_path / f"{name}.dng", 6) for name in ("a", "b"))
    (tmp_path / "b.dng").write_bytes(photo_bytes_with(other, 8))
    folder = _folder_to_open((photo, other))
    assert read_session(folder).photos.orientation == 6
    x0, y0, x1, y1 = rect_of("green_wall")
    with served(folder) as (address, page):
        wait_for(lambda: page.state()["live"]["ready"], 120)
        assert asked(f"{address}/api/size?role=photo")[1]["size"] == [480, 320]
        pointed = asked(f"{address}/api/spectrum?role=photo&x0={x0}&y0={y0}&x1={x1}&y1={y1}")[1]
    red, green, blue = bytes.fromhex(pointed["hex"][1:])
    assert green > red and green > blue
    region = f"green_wall={x0},{y0},{x1},{y1}"
    session = tmp_path / "s"
    words = ["--region", region, "--reference", AFTER_2014, "--session", str(session), "--quiet"]
    assert CliRunner().invoke(app, ["flat", str(photo), *words]).exit_code == 0
    mean = load_finished(read_session(session)).records.spectra["green_wall"].mean
    truth = np.interp(FINE_GRID.nm, NM, paint("green_wall")[1])
    # as of a photo that was not turned (0.02); the grey table beside it is 0.08 away
    assert np.sqrt(np.mean((mean - truth) ** 2)) < 0.04
    with Image.open(session / "results" / "photo" / "preview.png") as preview:
        assert preview.width > preview.height
    assert CliRunner().invoke(app, ["colour", str(session), "--family", "paint"]).exit_code == 0
    tiff = oiio.ImageBuf(str(session / "colour" / "photo.tif"))
    red, green, blue = tiff.getpixel((x0 + x1) // 4, (y0 + y1) // 4)    # of half the size
    assert tiff.spec().width == 240 and green > red and green > blue


def test_a_developed_photo_stays_in_the_sensors_frame_and_states_how_to_turn_it(tmp_path):
    photo, out = photo_of(tmp_path / "a.dng", 6), tmp_path / "a.exr"
    assert CliRunner().invoke(app, ["develop", str(photo), "--out", str(out)]).exit_code == 0
    np.testing.assert_array_equal(open_photo(out).signal, open_photo(photo).signal)
    assert photo_orientation(out) == 6


def photo_bytes_with(path, orientation):
    """The same file, stating another orientation (tag 274, SHORT, one value)."""
    before = path.read_bytes()
    tag = b"\x12\x01\x03\x00\x01\x00\x00\x00"
    assert before.count(tag) == 1
    at = before.index(tag) + len(tag)
    return before[:at] + bytes([orientation]) + before[at + 1:]


def test_a_command_that_is_given_again_counts_pixels_as_its_session_does(tmp_path):
    """A session of a version that turned no photo is written anew without turning any."""
    photo, folder = photo_of(tmp_path / "a.dng", 8), tmp_path / "s"
    tables = tables_without_regions(photo) | {"regions": {"a": {"rect": [10, 10, 40, 40]}}}
    with new_session(tables, folder):
        assert read_session(folder).photos.orientation == 8
    old = (folder / "session.toml").read_text(encoding="utf-8").replace("orientation = 8\n", "")
    body = old.rpartition(MARK)[0]
    (folder / "session.toml").write_text(f"{body}{MARK}{_digest(body)}\n", encoding="utf-8")
    with new_session(tables, folder):
        assert read_session(folder).photos.orientation == 1


def test_an_old_session_counts_pixels_as_it_did(tmp_path):
    """Without the key nothing is turned, whatever the file states; of a scene nothing ever is."""
    folder = _folder_to_open((photo_of(tmp_path / "a.dng", 8),))
    path = folder / "session.toml"
    text = path.read_text(encoding="utf-8")
    assert "orientation = 8" in text
    path.write_text(text.replace("orientation = 8\n", ""), encoding="utf-8")
    with served(folder) as (address, _):
        assert asked(f"{address}/api/size?role=photo")[1]["size"] == [320, 480]
