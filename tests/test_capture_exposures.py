"""Dark frames, brackets, bands and the clip point: from several photos to one linear image."""
import dataclasses

import numpy as np
import pytest

from spectrabox.capture.develop.bracket import merge_exposures, variance_line
from spectrabox.capture.develop.dark import DarkFrame, common_variance, mean_dark, subtract_dark
from spectrabox.capture.develop.developed import develop_photos, stack_bands, strongest_channel
from spectrabox.capture.photo.linear import linear_image, tile_step
from spectrabox.fixtures.dng import X_TRANS, write_dng
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind, RawFrame

from benchmarks.mosaic_file import read_mosaic

BLACK, WHITE, ELECTRONS, READ_DN = 512.0, 16383.0, 20000.0, 4.0
RGGB = np.array([[0, 1], [1, 2]])


def scene(height=160, width=240):
    """A shaded scene with texture; bright parts reach 1 at the exposure of 1."""
    rng = np.random.default_rng(11)
    shade = np.linspace(0.02, 1.0, width)[None] * np.linspace(0.4, 1.0, height)[:, None]
    return shade * np.kron(rng.uniform(0.6, 1.0, (height // 20, width // 20)), np.ones((20, 20)))


def frame(light, seed=1, cfa=RGGB, clip=WHITE, offset=0.0, **changes):
    """A mosaic of one grey scene (H, W), with shot and read noise."""
    rng = np.random.default_rng(seed)
    counts = (BLACK + offset + rng.poisson(np.maximum(light, 0) * ELECTRONS) * (WHITE - BLACK)
              / ELECTRONS)
    counts = np.minimum(counts + rng.normal(scale=READ_DN, size=light.shape), clip)
    fields = {"exposure_s": 0.01, "iso": 100.0, "f_number": 8.0, "camera": "Body 1",
              "file": "photo.dng", "sha256": ""}
    return RawFrame(mosaic=np.clip(np.rint(counts), 0, 65535).astype(np.uint16), cfa=cfa,
                    black_level=np.full(cfa.shape, BLACK), white_level=WHITE, **(fields | changes))


def exposed(seconds, seed, light=None, **changes):
    light = scene() if light is None else light
    return linear_image(frame(light * seconds, seed, exposure_s=seconds, file=f"{seconds:g} s.dng",
                              **changes))


# ---- tiles ---------------------------------------------------------------------------------------

@pytest.mark.parametrize("cfa, step",
                         [(RGGB, 2), (np.reshape(X_TRANS, (6, 6)), 3), (np.zeros((1, 1), int), 1),
                          (np.zeros((2, 2), int), 1), (np.tile(RGGB, (2, 2)), 2)])
def test_a_pixel_is_the_smallest_block_with_every_colour(cfa, step):
    assert tile_step(cfa) == step


@pytest.mark.parametrize("shift", [(0, 0), (3, 0), (0, 3), (3, 3)])
def test_x_trans_blocks_average_two_five_and_two_samples(shift):
    cfa = np.roll(np.reshape(X_TRANS, (6, 6)), shift, axis=(0, 1))
    rng = np.random.default_rng(1)
    mosaic = rng.integers(600, 16000, (60, 96)).astype(np.uint16)
    raw = dataclasses.replace(frame(np.zeros((60, 96)), cfa=cfa), mosaic=mosaic)
    image = linear_image(raw, (np.full(3, 1e-6), np.zeros(3)))
    colours = np.tile(cfa, (10, 16))
    for band, samples in enumerate((2, 5, 2)):
        mask = colours == band
        total = np.where(mask, (mosaic - BLACK) / (WHITE - BLACK),
                         0).reshape(20, 3, 32, 3).sum(axis=(1, 3))
        # Single precision over five terms.
        np.testing.assert_allclose(image.signal[..., band], total / samples, atol=1e-6)


def test_a_tile_that_lacks_a_colour_is_refused():
    with pytest.raises(InputError, match=r"lacks one of the colours"):
        tile_step(np.array([[0, 2], [2, 0]]))


def test_a_black_level_above_the_picture_is_refused():
    with pytest.raises(InputError,
                       match=r"darkest hundredth of the picture lies .* below its black level"):
        linear_image(dataclasses.replace(frame(0.2 * scene()), black_level=np.full((2, 2), 3000.0)))


# ---- clip point ----------------------------------------------------------------------------------

def test_the_clip_point_comes_from_the_histogram_where_the_white_level_is_too_high():
    raw = frame(1.3 * scene(), clip=13000)
    image = linear_image(raw)
    tiles = raw.mosaic.reshape(80, 2, 120, 2)
    clipped = np.stack([tiles[:, 0, :, 0], np.maximum(tiles[:, 0, :, 1], tiles[:, 1, :, 0]),
                        tiles[:, 1, :, 1]], axis=-1) >= 13000
    assert clipped.sum() > 500 and image.saturated[clipped].all()


def test_a_bright_plain_surface_is_not_taken_for_clipping():
    light = np.full((160, 240), 0.1)
    light[40:120, 60:180] = 0.7
    assert not linear_image(frame(light)).saturated.any()


# ---- dark frames ---------------------------------------------------------------------------------

def test_a_dark_frame_takes_away_glow_and_hot_pixels():
    glow = np.linspace(0, 0.02, 240) * np.ones((160, 1))
    hot = np.zeros((160, 240))
    hot[50, 60] = hot[51, 61] = 0.3
    truth = 0.4 * scene()
    dark = mean_dark([frame(glow + hot, seed, file=f"dark {seed}") for seed in range(8)])
    assert np.argwhere(dark.hot).tolist() == [[50, 60], [51, 61]]
    image = subtract_dark(frame(truth + glow + hot, 20), dark)
    error = image.signal[..., 0] - truth[::2, ::2]
    # The stated variance of each pixel, hot ones being filled from neighbours: mean over 9600
    # pixels within 4 sigma.
    assert abs(error.mean()) < 4 * np.sqrt(image.variance[..., 0].mean() / error.size)
    assert abs(error[25, 30]) < 0.05


@pytest.mark.parametrize("darks", [1, 4])
def test_the_stated_variance_is_the_scatter_of_photos_and_dark_frames(darks):
    light = np.tile(np.linspace(0.001, 0.004, 160), (160, 1))  # as dark as its read noise
    images = []
    for first in range(0, 120, 20):
        dark = mean_dark([frame(np.zeros(light.shape), first + k,
                                file=f"{k}") for k in range(darks)])
        images.append(subtract_dark(frame(light, first + 10), dark))
    scatter = np.var([image.signal for image in images], axis=0, ddof=1).mean()
    # 5 x 6400 x 3 squares tell a variance to 0.5 % (1 sigma), the line of noise from one small
    # photo to 2 %.
    assert np.mean([image.variance for image in images]) == pytest.approx(scatter, rel=0.06)


@pytest.mark.parametrize("cfa", [RGGB, np.reshape(X_TRANS, (6, 6)), np.zeros((1, 1), int)])
def test_photos_have_the_noise_of_their_dark_frame_in_common(cfa):
    photos = [frame(np.full((120, 120), 0.2), seed, cfa=cfa) for seed in (1, 2)]
    errors = []
    for seed in range(10, 16):
        dark = mean_dark([frame(np.zeros((120, 120)), seed, cfa=cfa)])
        errors.append([subtract_dark(photo, dark).signal for photo in photos])
    shared = np.mean(np.var(errors, axis=0, ddof=1), axis=(0, 1, 2))
    # At least 5 x 1600 squares a band: 1.6 % (1 sigma); one dark frame tells its own variance to
    # 1.5 %.
    np.testing.assert_allclose(common_variance(photos[0], dark), shared, rtol=0.1)


def test_more_photos_do_not_average_away_the_noise_of_one_dark_frame(tmp_path):
    def write(name, light, seed):
        write_dng(tmp_path / name, frame(light, seed).mosaic, black=(BLACK,) * 4, white=int(WHITE))
        return tmp_path / name

    light = np.full((160, 160), 0.001)  # as dark as its read noise
    images = []
    for repeat in range(5):
        photos = [write(f"photo{repeat}{k}.dng", light, 10 * repeat + k) for k in range(4)]
        images.append(develop_photos(photos,
                                     [write(f"dark{repeat}.dng", 0 * light, 10 * repeat + 9)],
                                     None)[0])
    scatter = np.var([image.signal for image in images], axis=0, ddof=1).mean()
    # 4 x 6400 x 3 squares: 0.5 % (1 sigma); the noise of each photo is measured in 100 tiles, to 3
    # %.
    assert np.mean([image.variance for image in images]) == pytest.approx(scatter, rel=0.08)


@pytest.mark.parametrize("read_dn", [0.6, 1.0, 1.5, 6.0])
def test_one_dark_frame_tells_its_noise_however_coarse_its_steps(read_dn):
    noise = np.rint(np.random.default_rng(4).normal(BLACK, read_dn, (120, 160)))
    noise[20, 30] = 5000  # a hot pixel is no noise
    dark = mean_dark([dataclasses.replace(frame(np.zeros((120, 160))),
                                          mosaic=noise.astype(np.uint16))])
    # Rounding adds 1/12; neighbours in 19 000 differences share pixels: 1.3 % (1 sigma).
    assert dark.variance.mean() == pytest.approx(read_dn**2 + 1 / 12, rel=0.06)


def test_hot_pixels_are_filled_without_cutting_off_digits():
    mosaic = np.random.default_rng(2).integers(600, 640, (80, 480)).astype(np.uint16)
    hot = np.zeros(mosaic.shape, bool)
    hot[::2, 4:476:8] = True  # red ones, whose red neighbours stand two columns away
    dark = DarkFrame(np.full(mosaic.shape, BLACK, np.float32), np.zeros(mosaic.shape, np.float32),
                     hot, 0.01, 100.0, "Body 1", "dark.dng")
    raw = dataclasses.replace(frame(np.zeros(mosaic.shape)), mosaic=mosaic)
    red = (subtract_dark(raw, dark, (np.zeros(3), np.zeros(3))).signal[..., 0]
           * (WHITE - BLACK) + BLACK)
    beside = (mosaic[::2, 2:474:8].astype(float) + mosaic[::2, 6:478:8]) / 2
    # Rounding to whole DN errs by 0.35 DN (1 sigma) at 2360 places; cutting off would take 0.25 DN
    # from each.
    assert abs(np.mean(red[:, 2:238:4] - beside)) < 4 * 0.35 / np.sqrt(beside.size)


@pytest.mark.parametrize("changes, error, message", [
    ({"camera": "Body 2"}, InputError, "was taken with Body 2 and photo photo.dng with Body 1"),
    ({"exposure_s": 0.5}, InputError, "was exposed for 0.5 s and photo photo.dng for 0.01 s"),
    ({"iso": 800.0}, InputError, "at ISO 800 and photo photo.dng at ISO 100"),
    ({"offset": 9000.0}, CheckError, "is brighter .* than photo photo.dng"),
])
def test_an_unfit_dark_frame_is_refused(changes, error, message):
    dark = mean_dark([frame(np.zeros((160, 240)), 1, file="dark.dng", **changes)])
    with pytest.raises(error, match=f"dark frame dark.dng .*{message}"):
        subtract_dark(frame(0.3 * scene()), dark)


def test_a_dark_frame_of_another_size_or_with_light_is_refused():
    with pytest.raises(InputError, match="is 100 x 80 pixels and photo"):
        subtract_dark(frame(scene()), mean_dark([frame(np.zeros((80, 100)))]))
    light = np.zeros((160, 240))
    light[:40, :40] = 0.2
    with pytest.raises(CheckError, match="it is not dark"):
        mean_dark([frame(light)])
    with pytest.raises(InputError, match="no dark frame was given"):
        mean_dark([])


# ---- brackets ------------------------------------------------------------------------------------

def test_a_bracket_agrees_with_the_truth_within_its_variance():
    truth = scene()[::2, ::2]
    noise = ((READ_DN**2 + 1 / 12) / (WHITE - BLACK) ** 2 * np.array([1, 0.5, 1]),
             np.array([1, 0.5, 1]) / ELECTRONS)
    merged, pairs = merge_exposures(
        [linear_image(frame(scene() * seconds, seed, exposure_s=seconds), noise)
         for seed, seconds in enumerate((0.25, 1.0, 4.0), 1)])
    error = merged.signal[..., 0] - 0.25 * truth
    assert [pair.code for pair in pairs] == 2 * ["bracket.ratio"] and not merged.saturated.any()
    # Mean of 9600 squared errors in sigma: 1 within 4 standard deviations.
    assert np.mean(error**2 / merged.variance[..., 0]) == pytest.approx(
        1, abs=4 * np.sqrt(2 / error.size))
    alone = exposed(0.25, 1)
    assert merged.variance.mean() < 0.5 * alone.variance.mean()


def test_a_bracket_goes_by_the_exposures_measured_not_by_those_stated():
    short, long = exposed(0.25, 2), exposed(1.0, 3)
    rounded = dataclasses.replace(long, exposure_s=1 / 1.024)      # 1/125 s stated of 1/128 s
    merged, _ = merge_exposures([short, rounded])
    # shot noise of 9600 pixels of some thousand electrons: 0.02 %
    assert merged.signal.mean() / short.signal.mean() == pytest.approx(1, abs=0.002)


def test_dark_parts_are_not_pulled_down_by_their_own_noise():
    light = np.full((160, 240), 0.01)
    light[:, :120] = 0.8
    merged, _ = merge_exposures([exposed(seconds, seed, light)
                                 for seed, seconds in enumerate((0.5, 1.0), 1)])
    dark = merged.signal[:, 62:, 0]
    # Mean of 4640 pixels within 4 sigma of their stated noise, and the ratio of exposures to 0.1 %.
    bound = 4 * np.sqrt(merged.variance[:, 62:, 0].mean() / dark.size) + 0.001 * 0.005
    assert abs(dark.mean() - 0.005) < bound


def test_saturated_in_every_exposure_stays_saturated():
    light = np.where(scene() > 0.6, 40.0, scene())
    merged, _ = merge_exposures([exposed(seconds, seed, light)
                                 for seed, seconds in enumerate((0.25, 0.5), 1)])
    inside = (light[::2, ::2] > 1) & (light[1::2, 1::2] > 1)
    assert merged.saturated[inside].all() and not merged.saturated[
        ~inside & (light[1::2, 1::2] < 1)].all()


@pytest.mark.parametrize("changes, message", [
                             ({"camera": "Body 2"}, "differ in camera"),
                             ({"iso": 400.0}, "differ in ISO"),
                             ({"f_number": 4.0}, "differ in f-number"),
                             ({"exposure_s": None}, "does not state its exposure time"),
                             ])
def test_a_bracket_of_different_settings_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        merge_exposures([exposed(0.25, 1), dataclasses.replace(exposed(0.5, 2), **changes)])


def test_exposures_that_disagree_stop_the_run():
    wrong = dataclasses.replace(exposed(0.5, 2), exposure_s=1.0)
    with pytest.raises(CheckError,
                       match=r"differ by a factor of 2\.\d+ in signal and 4\.000 in time"):
        merge_exposures([exposed(0.25, 1), wrong])


# A ratio of exposures may be off by 5 %, and change by 3 % from dark to bright.
@pytest.mark.parametrize("bend, message", [
    (0.2, r"changes by -3\.\d% from dark to bright"),
    (0.25, r"differ by a factor of 2\.1\d+ in signal and 2\.250 in time"), (0.15, None)])
def test_a_sensor_that_is_not_linear_stops_the_run(bend, message):
    bent = [dataclasses.replace(image, signal=image.signal * (1 - bend * image.signal))
            for image in (exposed(0.4, 1), exposed(0.9, 2))]
    if message is None:
        pair, = merge_exposures(bent)[1]
        assert -0.03 < pair.values["curvature"] < -0.02
    else:
        with pytest.raises(CheckError, match=message):
            merge_exposures(bent)


def test_the_line_of_the_variance_comes_back():
    noise = np.array([2e-6, 1e-6, 3e-6]), np.array([5e-5, 2.5e-5, 6e-5])
    read, gain = variance_line(linear_image(frame(0.7 * scene()), noise))
    # Single precision of the stored variance over some thousand pixels.
    np.testing.assert_allclose(gain, noise[1], rtol=1e-3)
    np.testing.assert_allclose(read, noise[0], rtol=0.05)


def test_saturated_pixels_do_not_bend_the_line_of_the_variance():
    signal = np.tile(np.linspace(0.01, 1.0, 300)[:, None, None], (1, 40, 3)).astype(np.float32)
    saturated = signal > 0.9
    # as the mean of six photos of one exposure has it
    variance = np.where(saturated, 6, 1) * (1e-7 + 5e-5 * signal)
    read, gain = variance_line(grey(signal, variance=variance.astype(np.float32),
                                    saturated=saturated))
    # Single precision of the variance.
    np.testing.assert_allclose(gain, 5e-5, rtol=1e-4)
    np.testing.assert_allclose(read, 1e-7, rtol=1e-2)


# ---- bands ---------------------------------------------------------------------------------------

def grey(signal, **changes):
    signal = np.asarray(signal, np.float32)
    fields = {"variance": np.full_like(signal, 1e-6), "saturated": signal > 0.98,
              "sensor_step": 2.0, "exposure_s": 0.1, "iso": None, "f_number": None,
              "kind": PhotoKind.RAW, "camera": "Body", "source": "a.dng", "sha256": ""}
    return LinearImage(signal=signal, **(fields | changes))


def test_bands_are_the_strongest_channels_in_order():
    rng = np.random.default_rng(5)
    photos = [grey(rng.uniform(0.2, 0.4, (8, 9, 3)) * np.roll([1.0, 0.2, 0.1], band))
              for band in (0, 2, 1, 1)]
    image = stack_bands(photos, ["650", "450", "500", "550"])
    assert [strongest_channel(photo) for photo in photos] == [0, 2, 1, 1]
    for index, channel in enumerate((0, 2, 1, 1)):
        np.testing.assert_array_equal(image.signal[..., index], photos[index].signal[..., channel])
    assert image.signal.shape == (8, 9, 4) and image.exposure_s == 0.1


def test_bands_are_brought_to_the_wanted_exposure():
    image = stack_bands([grey(np.full((8, 9, 3), 0.2))], ["red"], channels=[0], exposures_s=[0.3])
    # Single precision.
    np.testing.assert_allclose(image.signal, 0.6, rtol=1e-6)
    np.testing.assert_allclose(image.variance, 9e-6, rtol=1e-6)


def test_stacked_bands_state_the_exposure_they_were_brought_to():
    photos = [grey(np.full((8, 9, 3), 0.2), exposure_s=seconds) for seconds in (0.1, 0.2)]
    image = stack_bands(photos, ["red", "blue"], channels=[0, 0], exposures_s=[0.05, 0.05])
    assert image.exposure_s == 0.05
    # Single precision.
    np.testing.assert_allclose(image.signal, np.broadcast_to([0.1, 0.05], (8, 9, 2)), rtol=1e-6)


@pytest.mark.parametrize("changes, message", [
    ({"exposure_s": None}, "band blue: photo b.dng states no exposure time"),
    ({"iso": 400.0}, "band blue: photo b.dng was taken at ISO 400 and f/unknown, a.dng at ISO 100"),
    ({"f_number": 4.0}, "photo b.dng was taken at ISO 100 and f/4"),
])
def test_bands_whose_exposures_cannot_be_compared_are_refused(changes, message):
    photos = [grey(np.zeros((8, 9, 3)), iso=100.0),
              grey(np.zeros((8, 9, 3)), **({"iso": 100.0, "source": "b.dng"} | changes))]
    with pytest.raises(InputError, match=message):
        stack_bands(photos, ["red", "blue"], exposures_s=[0.1, 0.1])


def test_bands_of_different_photos_are_refused():
    with pytest.raises(InputError,
                       match=r"band blue: photo b.dng differs from a.dng in size or camera"):
        stack_bands([grey(np.zeros((8, 9, 3))), grey(np.zeros((8, 8, 3)), source="b.dng")],
                    ["red", "blue"])
    with pytest.raises(InputError, match="1 photos and 2 band names"):
        stack_bands([grey(np.zeros((8, 9, 3)))], ["red", "blue"])


# ---- mosaics without words -----------------------------------------------------------------------

def test_the_mosaic_of_an_industrial_camera_is_read_as_stored(tmp_path):
    import OpenImageIO as oiio
    values = np.random.default_rng(1).integers(0, 255, (20, 30, 1)).astype(np.uint8)
    file = oiio.ImageOutput.create(str(tmp_path / "frame.tif"))
    assert file.open(str(tmp_path / "frame.tif"), oiio.ImageSpec(30, 20, 1, oiio.UINT8))
    assert file.write_image(values) and file.close()
    raw = read_mosaic(tmp_path / "frame.tif", "GBRG", white_level=255, exposure_s=0.025,
                      camera="Flea3")
    np.testing.assert_array_equal(raw.mosaic, values[..., 0])
    assert raw.cfa.tolist() == [[1, 2], [0, 1]] and (raw.exposure_s, raw.camera) == (0.025, "Flea3")
    with pytest.raises(InputError, match="pattern 'RGBW' is not the four letters"):
        read_mosaic(tmp_path / "frame.tif", "RGBW", white_level=255)
