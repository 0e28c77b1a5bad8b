import os
import re
import resource
import time

import numpy as np
import OpenImageIO as oiio
import pytest

from spectrabox.capture.develop.developed import divide_by_flat
from spectrabox.capture.photo.image_files import read_encoded_file, read_linear_file
from spectrabox.capture.photo.image_rows import png_rows
from spectrabox.capture.photo.image_writers import write_exr, write_png
from spectrabox.capture.photo.linear import linear_image, open_photo, signal_alone
from spectrabox.capture.photo.noise import photon_transfer, variance_of
from spectrabox.capture.photo.preview import signal_rgb8, whites
from spectrabox.capture.photo.raw import read_raw
from spectrabox.fixtures.chart_scene import mosaic
from spectrabox.fixtures.dng import BAYER_TILES, write_dng
from spectrabox.radiometry.errors import CheckError, EnvironmentProblem, InputError
from spectrabox.radiometry.files import read_text
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind

BLACK = np.array([512, 510, 514, 516])
WHITE = 16383


def constant_patches():
    """Signals (128, 192, 3) of 4 x 6 patches of 32 pixels, and the patches (4, 6, 3)."""
    patches = np.random.default_rng(4).uniform(0.01, 0.9, (4, 6, 3))
    return np.repeat(np.repeat(patches, 32, axis=0), 32, axis=1), patches


def noiseless_dn(signal, pattern, black):
    counts = np.empty(signal.shape[:2])
    for position, band in enumerate(BAYER_TILES[pattern]):
        tile = (slice(position // 2, None, 2), slice(position % 2, None, 2))
        counts[tile] = black[position] + signal[(*tile, band)] * (WHITE - black[position])
    return np.rint(counts).astype(np.uint16)


def flat_image(signal, **changes):
    fields = {"sensor_step": 2.0, "exposure_s": 0.01, "iso": 100.0, "f_number": 8.0,
              "kind": PhotoKind.RAW,
              "camera": "Body", "source": "photo.dng", "sha256": "",
              "saturated": np.zeros(signal.shape, bool)}
    return LinearImage(signal=signal.astype(np.float32),
                       variance=np.full(signal.shape, 1e-6, np.float32), **(fields | changes))


# ---- raw to linear -------------------------------------------------------------------------------

@pytest.mark.parametrize("pattern", BAYER_TILES)
def test_patch_means_survive_the_camera_file(tmp_path, pattern):
    signal, patches = constant_patches()
    write_dng(tmp_path / "photo.dng", noiseless_dn(signal, pattern, BLACK), pattern=pattern,
              black=BLACK)
    image = open_photo(tmp_path / "photo.dng")
    means = image.signal.reshape(4, 16, 6, 16, 3).mean(axis=(1, 3), dtype=float)
    # Rounding to whole DN is wrong by half a DN at most; single precision adds 1e-6.
    np.testing.assert_allclose(means, patches, atol=0.5 / (WHITE - BLACK.max()) + 1e-6)
    assert (image.sensor_step, image.exposure_s, image.kind) == (2.0, 1 / 125, PhotoKind.RAW)


def test_fractional_black_levels_leave_no_offset(tmp_path):
    black = np.array([511.75, 510.5, 514.0, 516.25])
    counts = mosaic(np.zeros((256, 256, 3)), "RGGB", black, WHITE, 1e4, 4.0,
                    np.random.default_rng(5))
    write_dng(tmp_path / "photo.dng", counts, black=black)
    image = open_photo(tmp_path / "photo.dng")
    assert image.signal.min() < 0
    # The mean of 128 x 128 samples of 4 DN read noise, within 4 sigma.
    assert np.abs(image.signal.mean(axis=(0, 1))).max() < 4 * 4.0 / 128 / (WHITE - 511)


def test_linear_signal_is_proportional_to_the_light(tmp_path):
    signal, _ = constant_patches()
    images = []
    for scale in (0.25, 0.75):
        write_dng(tmp_path / "photo.dng", noiseless_dn(scale * signal, "GRBG", BLACK),
                  pattern="GRBG", black=BLACK)
        images.append(open_photo(tmp_path / "photo.dng").signal)
    # Half a DN of rounding in either photo, the darker one's threefold.
    np.testing.assert_allclose(images[1], 3 * images[0], atol=4 * 0.5 / (WHITE - BLACK.max()))


def test_a_pixel_is_saturated_where_any_sample_of_its_tile_is(tmp_path):
    counts = np.full((64, 64), 4000, np.uint16)
    counts[10, 21] = WHITE  # a green sample of tile (5, 10)
    write_dng(tmp_path / "photo.dng", counts)
    saturated = open_photo(tmp_path / "photo.dng").saturated
    assert np.argwhere(saturated).tolist() == [[5, 10, 1]]


def test_large_photos_stay_in_single_precision(tmp_path):
    write_dng(tmp_path / "photo.dng", np.full((64, 64), 4000, np.uint16))
    image = linear_image(read_raw(tmp_path / "photo.dng"))
    assert (image.signal.dtype, image.variance.dtype,
            image.saturated.dtype) == (np.float32, np.float32, bool)


# ---- noise ---------------------------------------------------------------------------------------

@pytest.mark.parametrize("electrons, read_noise", [(5000, 0.004), (40000, 0.001)])
def test_gain_and_read_noise_are_found_in_a_photo_with_texture(electrons, read_noise):
    rng = np.random.default_rng(6)
    scene = np.repeat(np.linspace(0.0, 0.8, 600)[None, :, None], 480,
                      axis=0) * np.array([1.0, 0.8, 0.5])
    scene[100:200] *= rng.uniform(0.5, 1.0, (100, 600, 1))  # a fifth of the picture is not flat
    scene[300:] *= np.exp(np.linspace(0, -1, 180))[:, None, None]
    photo = (rng.poisson(scene * electrons) / electrons
             + rng.normal(scale=read_noise, size=scene.shape))
    read, gain = photon_transfer(photo.astype(np.float32), photo > 0.98, quantum=1 / 16383)
    # Stated accuracy of the method: 10 %.
    np.testing.assert_allclose(gain, 1 / electrons, rtol=0.1)
    np.testing.assert_allclose(read, read_noise**2, rtol=0.1)


def lit_box(rng, gain, read_electrons, black_share, level=0.0):
    """Signal (H, W, 1) of a lit box of which a share is black, 15000 DN of 14 bits being full and
    black at a level in DN.
    """
    height, width = 416, 624
    y, x = np.mgrid[:height, :width]
    scene = (0.25 + 0.5 * x / width) * np.where((x // 90 + y // 70) % 2, 1, 0.55)
    side = int(np.sqrt(black_share * height * width))
    scene[-side:, :side] = 0.0
    electrons = (rng.poisson(0.8 * 15000 * scene / gain)
                 + read_electrons * rng.standard_normal(scene.shape))
    return (np.round(gain * electrons + level + 600) - 600)[..., None] / 15000


@pytest.mark.parametrize("gain", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("black_share", [0.005, 0.01, 0.05, 0.3])
def test_the_read_noise_of_a_small_black_part_is_that_of_the_camera(gain, black_share):
    signal = lit_box(np.random.default_rng(8), gain, 4.0, black_share)
    noise = photon_transfer(signal.astype(np.float32), signal > 0.98, quantum=1 / 15000)
    read = np.hypot(4.0 * gain, 1 / np.sqrt(12)) / 15000
    # Five flat tiles of 115 degrees of freedom each tell a standard deviation to 3 % (1 sigma).
    np.testing.assert_allclose(np.sqrt(noise[0]), read, rtol=0.15)
    # Edges and rounding add to the gain, never take from it.
    np.testing.assert_allclose(noise[1], gain / 15000, rtol=0.05)
    # The check of reconstruct/view_checks: less than 0.1 % of pixels further below 0 than 6 sigma.
    assert np.mean(signal < -6 * np.sqrt(variance_of(signal, *noise))) < 1e-3


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("gain", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("above", [-0.5, 0.0, 0.7, 2.0])
def test_the_read_noise_of_a_camera_that_cuts_off_at_black_is_that_of_the_camera(gain, above,
                                                                               samples):
    # The level of the black part is above the cut by so many read noises: 2 to 84 % are cut off.
    rng, read = np.random.default_rng(9), 4.0 * gain
    signal = np.mean([np.maximum(lit_box(rng, gain, 4.0, 0.05, above * read), 0)
                      for _ in range(samples)], axis=0)
    noise = photon_transfer(signal.astype(np.float32), signal > 0.98,
                            quantum=1 / 15000 / np.sqrt(samples), samples=samples)
    # at the level of the black part, whose electrons are read noise alone
    stated = np.sqrt(noise[0] + noise[1] * max(above * read, 0) / 15000)
    expected = np.sqrt((read**2 + 1 / 12) / samples) / 15000
    # 50 tiles tell a standard deviation to 1 % (1 sigma), the cut share of each another 2; steps of
    # 1.25 read noises at the smallest gain cost the rest. Uncorrected it is 0.33 to 0.59 at 0.
    np.testing.assert_allclose(stated, expected, rtol=0.12)


def test_a_photo_at_black_throughout_has_no_noise_to_state():
    signal = np.full((400, 400, 3), 0.0, np.float32)
    signal[:20, :20] = 0.5
    with pytest.raises(InputError, match="100% cut off at black cannot be measured"):
        photon_transfer(signal, np.zeros(signal.shape, bool), quantum=1e-4)


def test_noise_is_never_less_than_the_rounding_of_the_file():
    noise = photon_transfer(np.full((64, 64, 3), 0.5, np.float32), np.zeros((64, 64, 3), bool),
                            quantum=1e-4)
    # Exact up to round-off.
    np.testing.assert_allclose(variance_of(np.full((1, 1, 3), 0.5), *noise), 1e-8 / 12, rtol=1e-6)


@pytest.mark.parametrize("size", [(10, 10), (3, 4)])
def test_noise_of_a_photo_without_flat_parts_is_not_invented(size):
    with pytest.raises(InputError, match=f"noise of a photo of {size[1]} x {size[0]} pixels with 0%"
                                         " saturated and 100% cut off at black cannot be measured"):
        photon_transfer(np.zeros((*size, 3), np.float32), np.zeros((*size, 3), bool), quantum=1e-4)


# ---- image files ---------------------------------------------------------------------------------

def noisy(shape=(40, 60, 3)):
    return np.random.default_rng(7).uniform(0.1, 0.9, shape).astype(np.float32)


def write(path, pixels, names, kind, **attributes):
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    spec.channelnames = names
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec) and file.write_image(pixels) and file.close()


def test_exr_pixels_and_exposure_come_back_exactly(tmp_path):
    pixels = noisy()
    write_exr(tmp_path / "photo.exr", pixels, ("R", "G", "B"), exposure_s=0.125)
    image = open_photo(tmp_path / "photo.exr")
    np.testing.assert_array_equal(image.signal, pixels)
    assert (image.exposure_s, image.iso, image.sensor_step,
            image.kind) == (0.125, None, 1.0, PhotoKind.LINEAR_FILE)


def test_named_bands_come_in_rgb_order_and_alpha_is_dropped(tmp_path):
    pixels = noisy((40, 60, 4))
    write_exr(tmp_path / "photo.exr", pixels, ("A", "B", "G", "R"))
    np.testing.assert_array_equal(read_linear_file(tmp_path / "photo.exr").signal,
                                  pixels[..., [3, 2, 1]])


def test_further_bands_keep_the_order_of_the_file(tmp_path):
    pixels = noisy((40, 60, 5))
    write_exr(tmp_path / "photo.exr", pixels, tuple(f"band{number}" for number in range(5)))
    np.testing.assert_array_equal(read_linear_file(tmp_path / "photo.exr").signal, pixels)


def test_sixteen_bit_tiff_is_a_fraction_of_full_scale(tmp_path):
    pixels = noisy()
    write(tmp_path / "photo.tif", np.rint(pixels * 65535).astype(np.uint16), ("R", "G", "B"),
          oiio.UINT16)
    # Half a step of 16 bits, and single precision.
    np.testing.assert_allclose(open_photo(tmp_path / "photo.tif").signal, pixels, atol=0.5 / 65535
                               + 1e-7)


def test_bands_are_not_multiplied_by_a_tiff_s_alpha(tmp_path):
    pixels = np.concatenate([noisy(), np.full((40, 60, 1), 0.25, np.float32)], axis=2)
    write(tmp_path / "photo.tif", np.rint(pixels * 65535).astype(np.uint16), ("R", "G", "B", "A"),
          oiio.UINT16, oiio__UnassociatedAlpha=1)
    # Half a step of 16 bits, and single precision.
    np.testing.assert_allclose(open_photo(tmp_path / "photo.tif").signal, pixels[..., :3],
                               atol=0.5 / 65535 + 1e-7)


@pytest.mark.parametrize("name, kind, pixel", [
                             ("photo.tif", oiio.INT16, np.int16),
                             ("photo.tif", oiio.UINT32, np.uint32),
                             ("photo.exr", oiio.UINT32, np.uint32)])
def test_integers_of_unknown_full_scale_are_refused(tmp_path, name, kind, pixel):
    write(tmp_path / name, (noisy() * 4000).astype(pixel), ("R", "G", "B"), kind)
    with pytest.raises(InputError,
                       match="whose full scale nobody states; export it as a linear EXR"):
        open_photo(tmp_path / name)


def test_an_exr_of_another_name_is_known_by_its_content(tmp_path):
    write_exr(tmp_path / "photo.exr", noisy(), ("R", "G", "B"))
    (tmp_path / "photo.exr").rename(tmp_path / "photo")
    assert open_photo(tmp_path / "photo").kind is PhotoKind.LINEAR_FILE


@pytest.mark.parametrize("name, kind, attributes, message", [
                             ("photo.png", oiio.UINT8, {}, "photo.png is a PNG, processed"),
                             ("photo.png", oiio.UINT16, {}, "photo.png is a PNG, processed"),
                             ("photo.jpg", oiio.UINT8, {}, "photo.jpg is a JPEG, processed"),
                             ("photo.tif", oiio.UINT8, {}, "photo.tif is an 8-bit TIFF, processed"),
                             ("photo.tif", oiio.UINT16, {"oiio__ColorSpace": "sRGB"},
                              "photo.tif is a TIFF tagged sRGB, processed"),
                             ])
def test_files_that_are_not_linear_are_refused(tmp_path, name, kind, attributes, message):
    write(tmp_path / name, noisy(), ("R", "G", "B"), kind, **attributes)
    with pytest.raises(InputError,
                       match=f"{message}.*not proportional to light; give the camera's raw file"):
        open_photo(tmp_path / name)


@pytest.mark.parametrize("name", ["photo.dng", "photo.nef", "photo"])
def test_a_jpeg_handed_in_as_raw_is_known_by_its_content(tmp_path, name):
    write(tmp_path / "photo.jpg", noisy(), ("R", "G", "B"), oiio.UINT8)
    (tmp_path / "photo.jpg").rename(tmp_path / name)
    with pytest.raises(InputError, match=f"{name} is a JPEG, processed.*not proportional to "
                       "light"):
        open_photo(tmp_path / name)


def test_pixels_that_are_no_numbers_are_counted_and_refused(tmp_path):
    pixels = noisy()
    pixels[3, 4, :2] = np.nan, np.inf
    write_exr(tmp_path / "photo.exr", pixels, ("R", "G", "B"))
    with pytest.raises(InputError, match="has 2 of 7200 values that are NaN or infinite"):
        open_photo(tmp_path / "photo.exr")


@pytest.mark.parametrize("value", [1e36, -1e20, 3.4e38])
def test_pixels_too_large_for_a_variance_are_refused(tmp_path, value):
    pixels = noisy()
    pixels[3, 4, 1] = value
    write_exr(tmp_path / "photo.exr", pixels, ("R", "G", "B"))
    with pytest.raises(InputError, match=r"holds values up to .*; scale it so that white is near"):
        open_photo(tmp_path / "photo.exr")


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e-9, 1e30])
def test_a_developed_photo_states_variances_that_can_be(tmp_path, value):
    names = [f"{kind}{band}" for kind in ("", "variance.", "saturated.") for band in "RGB"]
    pixels = np.concatenate([noisy(), np.full((40, 60, 3), 1e-6), np.zeros((40, 60, 3))], axis=2)
    write_exr(tmp_path / "photo.exr", pixels, names)
    assert np.all(open_photo(tmp_path / "photo.exr").variance == np.float32(1e-6))
    pixels[5, 6, 4] = value
    write_exr(tmp_path / "photo.exr", pixels, names)
    with pytest.raises(InputError, match="variance that is negative, NaN or too large at 1 of"):
        open_photo(tmp_path / "photo.exr")


def test_two_bands_are_too_few(tmp_path):
    write_exr(tmp_path / "photo.exr", noisy((40, 60, 2)), ("Y", "X"))
    with pytest.raises(InputError, match=r"has 2 band\(s\).* at least 3 are needed"):
        open_photo(tmp_path / "photo.exr")


@pytest.mark.parametrize("name, content, message", [
    ("photo.exr", b"nothing", "photo.exr is no readable image"),
    ("photo.dng", b"", r"photo.dng is empty"),
    ("photo.tif", None, "photo .*photo.tif does not exist"),
])
def test_files_that_cannot_be_opened_are_named(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message):
        open_photo(tmp_path / name)


def test_gigabytes_that_are_no_picture_are_refused_by_their_first_bytes(tmp_path):
    for name in ("disk.tif", "disk.exr"):
        (tmp_path / name).touch()
        os.truncate(tmp_path / name, 3 << 30)       # zeros that take no room
        started = time.process_time()
        with pytest.raises(InputError, match="no readable image"):
            open_photo(tmp_path / name)
        with pytest.raises(InputError, match="zero bytes"):
            read_text(tmp_path / name)
        # to their end it would be minutes
        assert time.process_time() - started < 2


def test_an_exr_cut_short_is_refused(tmp_path):
    write_exr(tmp_path / "photo.exr", noisy(), ("R", "G", "B"))
    (tmp_path / "photo.exr").write_bytes((tmp_path / "photo.exr").read_bytes()[:-500])
    with pytest.raises(InputError, match=r"photo.exr cannot be read to its end"):
        open_photo(tmp_path / "photo.exr")


@pytest.mark.parametrize("pattern", BAYER_TILES)
def test_the_signal_alone_is_that_of_the_linear_image(tmp_path, pattern):
    path = tmp_path / "photo.dng"
    signal, _ = constant_patches()
    dn = mosaic(signal, pattern, BLACK, WHITE, 20_000, 2.0, np.random.default_rng(2))
    write_dng(path, dn, pattern=pattern, black=BLACK)
    frame = read_raw(path)
    np.testing.assert_array_equal(signal_alone(frame), linear_image(frame).signal)


def test_a_part_is_shown_as_in_the_whole_photo():
    signal = np.random.default_rng(3).gamma(2.0, 0.1, (60, 80, 3)).astype(np.float32)
    whole = signal_rgb8(signal)
    part = signal_rgb8(signal[10:30, 20:50], white=whites(signal))
    np.testing.assert_array_equal(part, whole[10:30, 20:50])
    reduced = signal_rgb8(signal, 4)
    means = signal.reshape(15, 4, 20, 4, 3).mean(axis=(1, 3))
    # sums in another order: round-off may take a value over the edge to the next code
    assert np.abs(reduced.astype(int) - signal_rgb8(means, white=whites(signal))).max() <= 1


def test_the_preview_comes_back_from_png_as_encoded(tmp_path):
    image = flat_image(noisy((80, 120, 3)))
    write_png(tmp_path / "preview.png", signal_rgb8(image.signal))
    decoded = read_encoded_file(tmp_path / "preview.png").signal
    shown = np.clip(image.signal / np.percentile(image.signal, 99.5, axis=(0, 1)), 0, 1)
    # Half a code value of 8 bits and 0.03 of the table, where the sRGB curve is steepest (2.4 /
    # 1.055).
    np.testing.assert_allclose(decoded, shown, atol=0.53 / 255 * 2.4 / 1.055)


# ---- flat field ----------------------------------------------------------------------------------

def vignette(height=90, width=120):
    y, x = np.mgrid[-1:1:height * 1j, -1:1:width * 1j]
    return np.exp(-0.4 * x**2 - 0.3 * y**2 + 0.1 * x)[..., None] * np.array([0.8, 0.6, 0.4])


def test_a_shaded_scene_is_evened_out():
    scene = np.random.default_rng(8).uniform(0.1, 0.9, (90, 120, 3))
    noise = np.random.default_rng(9).normal(scale=0.005, size=scene.shape)
    shaded, card = flat_image(scene * vignette()), flat_image(vignette() + noise, source="card.dng")
    ratio = divide_by_flat(shaded, card).signal / (scene * vignette().max(axis=(0, 1)))
    # 15 terms fitted to 10800 pixels of 0.5 % to 3 % noise: 0.1 % on average, a few times that in
    # the corners.
    np.testing.assert_allclose(ratio, 1, atol=0.01)


def test_a_flat_with_holes_is_refused():
    card = vignette()
    card[30:45, 40:60] *= 0.5
    with pytest.raises(CheckError,
                       match=r"\d+ of 576 parts differ from a smooth card, by up to \d+%"):
        divide_by_flat(flat_image(vignette()), flat_image(card))


def test_the_relative_error_is_unchanged_by_the_flat():
    image = flat_image(vignette())
    evened = divide_by_flat(image, image)
    # Single precision, a few operations.
    np.testing.assert_allclose(evened.variance / evened.signal**2, image.variance / image.signal**2,
                               rtol=1e-5)


@pytest.mark.parametrize("flat, error, message", [
                             (flat_image(vignette(80)), InputError,
                              "photograph the white card at the same size"),
                             (flat_image(vignette(), camera="Other"), InputError,
                              "taken with Other and photo photo.dng with Body"),
                             (flat_image(vignette(), saturated=np.ones((90, 120, 3), bool)),
                              CheckError, "is saturated in 100% of its area"),
                             (flat_image(0.01 * vignette()), CheckError, "at least 0.02 is needed"),
                             ])
def test_an_unfit_flat_field_is_refused(flat, error, message):
    with pytest.raises(error, match=message):
        divide_by_flat(flat_image(vignette()), flat)


@pytest.mark.parametrize("channels", ["RGB", "BGR", "GBR"])
def test_the_noise_of_an_image_file_does_not_hang_on_the_order_of_its_channels(tmp_path, channels):
    rng = np.random.default_rng(4)
    flat = np.linspace(0.2, 0.8, 6).repeat(16)[:, None, None] * np.array([1.0, 0.8, 0.6])
    photo = flat + np.sqrt(5e-5 * flat) * rng.standard_normal((96, 128, 3))
    write_exr(tmp_path / "photo.exr", 0.01 * photo[..., ["RGB".index(name) for name in channels]],
              channels)
    read = read_linear_file(tmp_path / "photo.exr")
    np.testing.assert_allclose(read.signal, 0.01 * photo, rtol=1e-6)
    ratio = read.variance.mean(axis=(0, 1)) / (1e-4 * 5e-5 * flat.mean(axis=(0, 1)))
    assert np.all(np.abs(ratio - 1) < 0.15), ratio


def write_png_by_rows(path, rgb8):
    with png_rows(path, *rgb8.shape) as write:
        write(0, rgb8)


def write_exr_of_8_bits(path, rgb8):
    write_exr(path, rgb8.astype(np.float32), "RGB")


@pytest.mark.parametrize(("write", "name"), [
    (write_png, "a.png"), (write_png_by_rows, "a.png"), (write_exr_of_8_bits, "a.exr")])
def test_a_picture_that_a_full_disk_cuts_short_is_no_result(tmp_path, write, name):
    pixels = np.random.default_rng(1).integers(0, 255, (100, 100, 3)).astype(np.uint8)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, before[1]))
    try:
        with pytest.raises(EnvironmentProblem, match=rf"{re.escape(name)} cannot be written"):
            write(tmp_path / name, pixels)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_a_picture_is_not_written_under_a_name_that_is_no_text(tmp_path):
    with pytest.raises(InputError, match="not UTF-8"):
        write_exr(tmp_path / "\udcff.exr", np.ones((4, 4, 3)), ("R", "G", "B"))
