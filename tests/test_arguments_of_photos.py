"""What the functions that take photos refuse in a sentence: shapes, ranges, kinds of arguments."""
import json
from fractions import Fraction

import numpy as np
import pytest
from flat_example import picture
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.radiometry.errors import InputError
from spectrabox.session.cli import app

REGION = {"wall": (10, 10, 40, 40)}
CORNERS = [(0, 0), (60, 0), (60, 40)]


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    path = tmp_path_factory.mktemp("photo") / "photo.dng"
    write_photo(path, picture(), Fraction(1, 60), np.random.default_rng(3))
    return path


@pytest.mark.parametrize("stated, says", [
    ({"corners": CORNERS}, r"corners= is four points .* in pixels of the photo; \[\(0, 0\)"),
    ({"corners": [*CORNERS, (0, np.nan)]}, "corners= is four points"),
    ({"regions": [(10, 10, 40, 40)]}, "regions= is a mapping, from names .*; list was given"),
    ({"regions": {"wall": (10, np.nan, 40, 40)}}, "region 'wall' is .* was given"),
    ({"regions": {"wall": "10,10,40,40"}}, "region 'wall' is .* was given"),
    ({"regions": {"wall": [(10, 10), (40, 40)]}}, "region 'wall' is .* three corners"),
    ({"also": "x.dng"}, "also= is a mapping, .*; str was given"),
    ({"families": "paint"}, r"families= is a mapping, such as .*paint.*; str was given"),
    ({"draws": 3}, "draws.* 1000"), ({"level": 95}, r"level.* 0\.999")])
def test_flat_refuses_in_a_sentence(photo, stated, says):
    with pytest.raises(InputError, match=says):
        sb.flat(photo, **{"regions": REGION, **stated})


def test_photos_and_charts_are_refused_in_a_sentence(photo, tmp_path):
    with pytest.raises(InputError, match="corners= is four points"):
        sb.find_chart(photo, corners=CORNERS)
    for function in (sb.open_photo, lambda none: sb.fit_camera(none, light="D65")):
        with pytest.raises(InputError, match=r"no photo was given|either photos"):
            function([])
    for turn in (0, 9):
        with pytest.raises(InputError, match=f"orientation={turn} is none of EXIF's, 1 to 8"):
            sb.open_photo(photo, orientation=turn)
    missing = tmp_path / "nothere.dng"
    for function in (sb.open_photo, sb.find_chart, lambda path: sb.flat(path, REGION),
                     lambda path: sb.fit_camera(path, light="D65")):
        with pytest.raises(InputError, match=r"photo .*nothere.dng does not exist"):
            function(missing)


@pytest.mark.parametrize("words", [
    ("flat", "PHOTO", "--region", "a=nan,650,350,900"), ("flat", "PHOTO", "--corners",
                                                         "0,0,60,0,60,40,0,inf"),
    ("flat", "PHOTO", "--region", "a=1e400,650,350,900")])
def test_a_number_that_is_none_is_no_pixel(photo, tmp_path, words):
    done = CliRunner().invoke(app, [str(photo) if word == "PHOTO" else word for word in words]
                              + ["--session", str(tmp_path / "made"), "--json"])
    assert done.exit_code == 3
    assert "numbers in pixels of the photo are needed" in json.loads(done.stdout)["error"]
    assert not (tmp_path / "made").exists()


def test_a_camera_raw_that_is_missing_is_not_called_damaged(tmp_path):
    done = CliRunner().invoke(app, ["camera", "fit", "--chart", str(tmp_path / "nothere.dng"),
                                    "--light", "D65", "--out", str(tmp_path / "c.csv"), "--json"])
    assert done.exit_code == 3
    assert "nothere.dng does not exist" in json.loads(done.stdout)["error"]
