import os
import struct
from types import SimpleNamespace

import numpy as np
import pytest
import rawpy

from spectrabox.capture.photo.linear import open_photo
from spectrabox.capture.photo.raw import _require_known_sensor, read_raw
from spectrabox.fixtures.dng import BAYER_TILES, BITS, CAMERA_FROM_XYZ, PATTERNS, write_dng
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.photos import PhotoKind

MOSAIC = np.random.default_rng(2).integers(500, 16000, (48, 66)).astype(np.uint16)


@pytest.fixture
def photo(tmp_path):
    write_dng(tmp_path / "photo.dng", MOSAIC)
    return tmp_path / "photo.dng"


@pytest.mark.parametrize("black", [(512, 510, 514, 516), (511.75, 510.5, 514.0, 516.25)])
@pytest.mark.parametrize("pattern", BAYER_TILES)
def test_black_levels_stay_at_their_position_with_their_fraction(tmp_path, pattern, black):
    write_dng(tmp_path / "photo.dng", MOSAIC, pattern=pattern, black=black)
    np.testing.assert_array_equal(read_raw(tmp_path / "photo.dng").black_level.ravel(), black)


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("pattern", PATTERNS)
def test_every_sample_of_every_bit_depth_and_pattern_comes_back(tmp_path, pattern, bits):
    mosaic = MOSAIC >> (16 - bits)
    write_dng(tmp_path / "photo.dng", mosaic, pattern=pattern, bits=bits, white=2**bits - 1,
              black=(60, 60, 60, 60))
    frame = read_raw(tmp_path / "photo.dng")
    np.testing.assert_array_equal(frame.mosaic, mosaic)
    assert tuple(frame.cfa.ravel()) == (PATTERNS[pattern] or (0,))
    assert (frame.white_level, set(frame.black_level.ravel())) == (2**bits - 1, {60.0})


@pytest.mark.parametrize("top", [2, 3])
@pytest.mark.parametrize("left", [4, 5])
@pytest.mark.parametrize("below", [False, True])
def test_odd_margins_mix_up_neither_colours_nor_black_levels(tmp_path, top, left, below):
    black = np.array([[600.0, 601.5], [602.0, 603.0]])
    write_dng(tmp_path / "photo.dng", MOSAIC, black=black.ravel(), active_area=(top, left, 46, 62),
              below_thumbnail=below)
    frame = read_raw(tmp_path / "photo.dng")
    skipped = [int(np.flatnonzero((frame.mosaic[0, 0] == MOSAIC).ravel())[0]) // 66 - top,
               int(np.flatnonzero((frame.mosaic[0, 0] == MOSAIC).ravel())[0]) % 66 - left]
    y, x = np.add.outer(skipped, [0, 1]) % 2
    np.testing.assert_array_equal(frame.black_level, black[np.ix_(y, x)])
    np.testing.assert_array_equal(frame.cfa, np.array([[0, 1], [1, 2]])[np.ix_(y, x)])


@pytest.mark.parametrize("below", [False, True])
def test_black_levels_come_from_masked_pixels_where_the_file_names_them(tmp_path, below):
    rng, true = np.random.default_rng(5), np.array([[600.3, 604.6], [607.2, 602.9]])
    mosaic = rng.integers(2000, 9000, (96, 128)).astype(np.uint16)
    mosaic[:, :40] = np.rint(np.tile(true, (48, 20)) + rng.normal(scale=4.0, size=(96, 40)))
    mosaic[7, 9] = 9000  # a hot pixel
    write_dng(tmp_path / "photo.dng", mosaic, black=(610,) * 4, active_area=(0, 44, 96, 128),
              masked_areas=(0, 0, 96, 40), below_thumbnail=below)
    # 960 samples of 4 DN noise at each position: 0.13 DN, within 4 sigma.
    np.testing.assert_allclose(read_raw(tmp_path / "photo.dng").black_level, true,
                               atol=4 * 4 / np.sqrt(960))


def test_full_colour_pixels_are_no_mosaic_but_a_photo(tmp_path):
    pixels = np.random.default_rng(6).integers(600, 16000, (64, 96, 3)).astype(np.uint16)
    write_dng(tmp_path / "photo.dng", pixels, black=(600, 601, 602))
    with pytest.raises(InputError, match=r"photo.dng holds full-colour pixels"):
        read_raw(tmp_path / "photo.dng")
    image = open_photo(tmp_path / "photo.dng")
    # Single precision.
    np.testing.assert_allclose(image.signal, (pixels - [600, 601, 602.0])
                               / (16383 - np.array([600, 601, 602])), atol=1e-6)
    assert (image.kind, image.sensor_step) == (PhotoKind.LINEAR_FILE, 1.0)


def test_a_linear_dng_is_saturated_at_98_per_cent_of_its_white_level(tmp_path):
    pixels = np.random.default_rng(6).integers(600, 15500, (64, 96, 3)).astype(np.uint16)
    pixels[0, 0], pixels[0, 1] = (16383, 16057, 16053), (600, 16055, 16056)
    write_dng(tmp_path / "photo.dng", pixels, black=(600, 601, 602))
    saturated = open_photo(tmp_path / "photo.dng").saturated
    # 0.98 of 16383 is 16055.3
    assert saturated[0, :2].tolist() == [[True, True, False], [False, False, True]]
    assert saturated.sum() == 3


def test_what_libraw_complains_of_and_reads_on_is_an_error(photo, monkeypatch, capfd):
    read = rawpy.imread

    def complaining(path):
        os.write(2, b"photo.dng: data corrupted at 512\n")
        return read(path)
    monkeypatch.setattr(rawpy, "imread", complaining)
    with pytest.raises(InputError, match=r"fewer pixels than it promises \(photo.dng: data corr"):
        read_raw(photo)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("black", [(64.5,) * 3, (64.25, 65.0, 63.75)])
def test_fractions_of_black_levels_of_a_linear_dng_are_kept(tmp_path, black):
    pixels = np.random.default_rng(3).integers(70, 900, (60, 80, 3)).astype(np.uint16)
    write_dng(tmp_path / "linear.dng", pixels, black=black, white=1023, bits=10)
    image = open_photo(tmp_path / "linear.dng")
    # Single precision; half a DN would be 5e-4.
    np.testing.assert_allclose(image.signal, (pixels - np.array(black)) / (1023 - np.array(black)),
                               atol=1e-6)


@pytest.mark.parametrize("tag, values", [(256, "<L"), (257, "<L")])
def test_a_size_that_its_strips_contradict_is_refused(photo, tag, values):
    whole = bytearray(photo.read_bytes())
    entry = whole.index(struct.pack("<HHL", tag, 4, 1)) + 8
    whole[entry:entry + 4] = struct.pack(values, 32)
    photo.write_bytes(whole)
    with pytest.raises(InputError,
                       match=r"states a size of \d+ bytes and holds 6336; it is damaged"):
        read_raw(photo)


def test_black_levels_of_other_columns_than_there_are_are_refused_not_ignored(photo):
    # The numbers of the white balance (50728, three fractions) become BlackLevelDeltaH (50715).
    content = photo.read_bytes()
    renamed = content.replace(struct.pack("<HH", 50728, 5), struct.pack("<HH", 50715, 5), 1)
    assert renamed != content
    photo.write_bytes(renamed)
    with pytest.raises(InputError, match="black levels of 3 columns"):
        read_raw(photo)


@pytest.mark.parametrize("light, known", [(21, True), (23, True), (17, False), (0, False)])
def test_a_dng_states_its_own_colour_matrix_under_daylight(tmp_path, light, known):
    write_dng(tmp_path / "photo.dng", MOSAIC, matrix_light=light, below_thumbnail=True)
    frame = read_raw(tmp_path / "photo.dng")
    assert frame.matrix_of_file == known == (frame.camera_from_xyz is not None)
    if known:
        np.testing.assert_allclose(frame.camera_from_xyz.ravel(), CAMERA_FROM_XYZ)


def test_exposure_and_camera_are_those_of_the_file(photo):
    frame = read_raw(photo)
    assert (frame.exposure_s, frame.iso, frame.f_number,
            frame.white_level) == (1 / 125, 100.0, 8.0, 16383.0)
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
    with pytest.raises(
            InputError,
            match=r"raw photo photo.dng cannot be read to its end .* cut short or damaged"):
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


@pytest.mark.parametrize("sensor, named", [
    ((rawpy.RawType.Stack, None, 3, b"RGBG"), "full-colour pixels"),
    ((rawpy.RawType.Flat, None, 3, b"RGBG"), "no colour filter pattern"),
    ((rawpy.RawType.Flat, np.zeros((4, 4)), 3, b"RGBG"), "a 4 x 4 pattern of 3 colours"),
    ((rawpy.RawType.Flat, np.zeros((2, 2)), 4, b"GMCY"), r"a 2 x 2 pattern of 4 colours \(GMCY\)"),
])
def test_an_unknown_sensor_is_refused_and_named(tmp_path, sensor, named):
    names = ("raw_type", "raw_pattern", "num_colors", "color_desc")
    with pytest.raises(InputError, match=f"has {named}.* are known"):
        _require_known_sensor(SimpleNamespace(**dict(zip(names, sensor, strict=True))),
                              SimpleNamespace(is_dng=False), tmp_path / "photo.raf")


@pytest.mark.parametrize("changes, message", [
    ({"black": (512, 1024, 512, 512)}, r"states black levels from 512 to 1024 DN, too far apart"),
    ({"tile": (0, 0, 1, 2)},
     r"states the colour filters \[\[0, 0\], \[1, 2\]\].*neither Bayer nor X-Trans"),
])
def test_a_tile_that_only_damage_makes_is_refused(tmp_path, monkeypatch, changes, message):
    if "tile" in changes:
        monkeypatch.setitem(PATTERNS, "RGGB", changes.pop("tile"))
    write_dng(tmp_path / "photo.dng", MOSAIC, **changes)
    with pytest.raises(InputError, match=message):
        read_raw(tmp_path / "photo.dng")


def test_white_level_below_black_level_is_refused(tmp_path):
    write_dng(tmp_path / "photo.dng", MOSAIC, white=500)
    with pytest.raises(InputError, match="states a white level of 500 DN, not above its black "
                       "level of 512 DN"):
        read_raw(tmp_path / "photo.dng")


@pytest.mark.parametrize("pattern, bits, suffix", [
                             ("RGGB", 16, ".dng"), ("GBRG", 12, ".nef"), ("X-Trans", 14, ".raf"),
                             ("mono", 16, ".dng"), ("BGGR", 10, ".exr"), ("GRBG", 16, ".tif"),
                             ("RGGB", 16, ".jpg"),
                             ])
def test_truncated_flipped_and_mislabelled_files_end_in_a_sentence_or_a_photo(tmp_path, pattern,
                                                                              bits, suffix):
    mosaic = np.tile(MOSAIC, (2, 2)) >> (16 - bits)
    write_dng(tmp_path / "photo.dng", mosaic, pattern=pattern, bits=bits, white=2**bits - 1,
              black=(3,) * 4)
    whole, rng = (tmp_path / "photo.dng").read_bytes(), np.random.default_rng(
        [3, bits, len(pattern)])
    path = tmp_path / f"damaged{suffix}"
    for index in range(60):
        damaged = bytearray(whole[:rng.integers(0, len(whole))] if index % 3 == 0 else whole)
        for _ in range(rng.integers(1, 5)):
            if damaged:
                damaged[rng.integers(0, min(len(damaged), 900))] ^= 1 << int(rng.integers(0, 8))
        path.write_bytes(damaged)
        try:
            image = open_photo(path)
            assert np.isfinite(image.signal).all() and (image.variance > 0).all()
        except InputError as error:
            assert path.name in str(error)
