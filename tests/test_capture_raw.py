from types import SimpleNamespace

import numpy as np
import pytest
import rawpy

from capture.raw import _require_bayer, read_raw
from fixtures.dng import BAYER_TILES, write_dng
from radiometry.errors import InputError

MOSAIC = np.random.default_rng(2).integers(500, 16000, (48, 64)).astype(np.uint16)


@pytest.fixture
def photo(tmp_path):
    write_dng(tmp_path / "photo.dng", MOSAIC)
    return tmp_path / "photo.dng"


@pytest.mark.parametrize("black", [(512, 510, 514, 516), (511.75, 510.5, 514.0, 516.25)])
@pytest.mark.parametrize("pattern", BAYER_TILES)
def test_black_levels_stay_at_their_position_with_their_fraction(tmp_path, pattern, black):
    write_dng(tmp_path / "photo.dng", MOSAIC, pattern=pattern, black=black)
    np.testing.assert_array_equal(read_raw(tmp_path / "photo.dng").black_level.ravel(), black)


def test_exposure_and_camera_are_those_of_the_file(photo):
    frame = read_raw(photo)
    assert (frame.exposure_s, frame.iso, frame.f_number, frame.white_level) == (1 / 125, 100.0, 8.0, 16383.0)
    assert frame.camera == "Spectrabox Synthetic SN0001"


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_the_mosaic_stays_in_sensor_orientation(tmp_path, orientation):
    write_dng(tmp_path / "photo.dng", MOSAIC, orientation=orientation)
    np.testing.assert_array_equal(read_raw(tmp_path / "photo.dng").mosaic, MOSAIC)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"photo .*gone.dng does not exist"):
        read_raw(tmp_path / "gone.dng")


@pytest.mark.parametrize("kept_bytes", [8, 300, 2000, -1])
def test_a_file_cut_short_is_refused_quietly(photo, capfd, kept_bytes):
    photo.write_bytes(photo.read_bytes()[:kept_bytes])
    with pytest.raises(InputError, match=r"raw photo photo.dng cannot be read to its end .* cut short or damaged"):
        read_raw(photo)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("content, message", [
    (b"", r"raw photo photo.dng is empty \(0 bytes\)"),
    (b"not a photo " * 100, r"photo photo.dng is no camera raw that LibRaw [0-9.]+ knows"),
])
def test_a_file_that_is_no_raw_is_refused(photo, content, message):
    photo.write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_raw(photo)


@pytest.mark.parametrize("sensor, found", [
    ((rawpy.RawType.Stack, None, 3, b"RGBG"), "full-colour pixels"),
    ((rawpy.RawType.Flat, None, 1, b"GGGG"), "no colour filter pattern"),
    ((rawpy.RawType.Flat, np.zeros((6, 6)), 3, b"RGBG"), "a 6 x 6 pattern of 3 colours"),
    ((rawpy.RawType.Flat, np.zeros((2, 2)), 4, b"GMCY"), r"a 2 x 2 pattern of 4 colours \(GMCY\)"),
])
def test_a_sensor_without_bayer_pattern_is_refused_and_named(tmp_path, sensor, found):
    names = ("raw_type", "raw_pattern", "num_colors", "color_desc")
    with pytest.raises(InputError, match=f"has {found}.* is needed"):
        _require_bayer(SimpleNamespace(**dict(zip(names, sensor, strict=True))), tmp_path / "photo.raf")


def test_white_level_below_black_level_is_refused(tmp_path):
    write_dng(tmp_path / "photo.dng", MOSAIC, white=500)
    with pytest.raises(InputError, match="states a white level of 500 DN, not above its black level of 512 DN"):
        read_raw(tmp_path / "photo.dng")


def test_damaged_headers_end_in_a_sentence(photo):
    whole, rng = photo.read_bytes(), np.random.default_rng(3)
    for _ in range(100):
        damaged = bytearray(whole)
        damaged[rng.integers(0, 700)] = rng.integers(0, 256)
        photo.write_bytes(damaged)
        try:
            read_raw(photo)
        except InputError as error:
            assert "photo.dng" in str(error)
