"""Where bands of a picture clip: known answers, each band for itself, in any unit."""
import numpy as np
import pytest

from spectrabox.capture.photo import clipping

STEP = 1 / 4095
SIZE = (400, 600)
READ, GAIN = 2e-6, 1e-4         # variance of a pixel: read + gain x signal


def scene(seed, brightest=1.0):
    """Tiles of 50 pixels of different brightness, with the noise of a sensor."""
    drawn = np.random.default_rng(seed)
    tiles = drawn.uniform(0.05, brightest, (SIZE[0] // 50, SIZE[1] // 50))
    light = np.kron(tiles, np.ones((50, 50)))
    return light + np.sqrt(READ + GAIN * light) * drawn.standard_normal(SIZE)


def digitised(signal):
    return np.round(signal / STEP) * STEP


def rolled(signal, onset=0.6, top=0.7):
    """Highlights pressed together smoothly from a level on."""
    beyond = np.maximum(signal - onset, 0)
    return np.where(signal > onset, onset + (top - onset) * (1 - np.exp(-beyond / (top - onset))),
                    signal)


@pytest.fixture(scope="module")
def picture():
    """Three bands: one that is whole, one cut at .7, one whose highlights are rolled off."""
    whole, cut, soft = (scene(seed) for seed in (1, 2, 3))
    return np.stack([digitised(whole * 0.6), digitised(np.minimum(cut, 0.7)),
                     digitised(rolled(soft))], axis=-1)


@pytest.fixture(scope="module")
def clips(picture):
    return clipping.clip_levels(picture, STEP)


def test_a_cut_a_shoulder_and_neither_are_told_apart(clips):
    whole, cut, soft = clips
    assert whole is None
    assert cut.level == pytest.approx(0.7, abs=STEP) and not cut.soft
    # the variance falls to half where the slope is .7: within a tenth above the onset
    assert soft.soft and 0.58 < soft.level < 0.67


@pytest.mark.parametrize("order", [(2, 0, 1), (1, 2, 0)])
def test_each_band_is_for_itself(picture, clips, order):
    assert clipping.clip_levels(picture[..., list(order)], STEP) == [clips[band] for band in order]


@pytest.mark.parametrize("unit", [0.25, 4096.0])
def test_levels_are_in_the_unit_of_the_signal(picture, clips, unit):
    for found, clip in zip(clipping.clip_levels(unit * picture, unit * STEP), clips, strict=True):
        assert (found is None) == (clip is None)
        if clip is not None:
            assert found.soft == clip.soft
            assert found.level == pytest.approx(unit * clip.level, rel=1e-6)


def test_a_picture_that_is_turned_clips_where_it_did(picture, clips):
    for found, clip in zip(clipping.clip_levels(picture[::-1, ::-1], STEP), clips, strict=True):
        assert (found is None) == (clip is None)
        assert clip is None or found.level == pytest.approx(clip.level, rel=0.05)


def test_bands_of_different_steps_have_each_their_own(picture, clips):
    factors = np.array([1.0, 2.0, 0.5])
    found = clipping.clip_levels(picture * factors, STEP * factors)
    assert [None if clip is None else pytest.approx(clip.level / factor, rel=1e-6)
            for clip, factor in zip(found, factors, strict=True)] == [
                None if clip is None else clip.level for clip in clips]


def test_noise_that_no_step_shows_tells_nothing(picture):
    # a computed picture has plain parts of one value
    plain = np.kron(np.random.default_rng(5).uniform(0.1, 1, (8, 12)), np.ones((50, 50)))
    assert clipping.clip_levels(digitised(np.minimum(plain, 0.7))[..., None], STEP) == [None]
    # the same cut as above, in a file of steps as large as the noise
    coarse = 0.02
    assert clipping.clip_levels(np.round(picture[..., 1:2] / coarse) * coarse, coarse) == [None]


def test_what_was_rolled_off_is_said_by_band_with_its_level(clips):
    (said,) = clipping.rolled_off(clips)
    assert said.code == "file.rolled-off"
    assert said.values == {"bands": ["B"], "levels": [clips[2].level]}
    assert clipping.rolled_off([clips[0], clips[1]]) == ()


def test_dark_noise_is_that_of_the_sensor(picture):
    read, gain = clipping.dark_noise(picture[..., 1], STEP)
    # of 200 tiles in a range of brightness of seven; the file's rounding adds a twelfth of a step
    assert gain == pytest.approx(GAIN, rel=0.1)
    assert read == pytest.approx(READ + STEP**2 / 12, abs=4e-6)


def test_a_few_hot_pixels_above_a_cut_are_none_of_the_scene(picture, clips):
    hot = picture[..., 1].copy()
    hot[7, 11] = hot[100, 301] = 0.99
    (clip,) = clipping.clip_levels(hot[..., None], STEP)
    assert clip == clips[1]
