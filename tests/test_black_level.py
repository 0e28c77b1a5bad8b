import numpy as np
import pytest

from spectrabox.capture.develop.dark import mean_dark, subtract_dark
from spectrabox.capture.photo.linear import open_photo
from spectrabox.capture.photo.raw import read_raw
from spectrabox.fixtures.chart_scene import mosaic
from spectrabox.fixtures.dng import write_dng
from spectrabox.radiometry.errors import InputError

WHITE = 16383
BLACK = np.array([2070.3, 2074.6, 2077.2, 2072.9])
AREA = (24, 40, 280, 424)      # top, left, bottom, right of the visible pixels in (280, 428)


def scene(darkest=0.004):
    """Signal (256, 384, 3) of patches from nearly black to bright."""
    levels = np.geomspace(darkest, 0.8, 24).reshape(4, 6, 1)
    return np.repeat(np.repeat(levels, 64, axis=0), 64, axis=1) * np.array([0.7, 1.0, 0.5])


def counts(signal, black=BLACK, electrons=4e4, read_noise_dn=4.0, seed=3):
    return mosaic(signal, "RGGB", black, WHITE, electrons, read_noise_dn,
                  np.random.default_rng(seed))


def in_margins(visible, margins):
    """The whole mosaic (280, 428): these visible pixels in these margins, light at their edge."""
    whole = margins.copy()
    whole[AREA[0]:AREA[2], AREA[1]:AREA[3]] = visible
    whole[AREA[0] - 2:AREA[0]] = 9000
    whole[:, AREA[1] - 2:AREA[1]] = 9000
    return whole


def dark_margins(black=BLACK):
    return counts(np.zeros((280, 428, 3)), black)


@pytest.mark.parametrize("stated", [0, 2070])
def test_black_is_read_from_margins_that_no_tag_names(tmp_path, stated):
    write_dng(tmp_path / "photo.dng", in_margins(counts(scene()), dark_margins()),
              black=(stated,) * 4, white=WHITE, active_area=AREA)
    # 4260 samples of 4 DN noise at each position: 0.06 DN, within 4 sigma
    np.testing.assert_allclose(read_raw(tmp_path / "photo.dng").black_level.ravel(), BLACK,
                               atol=0.25)


@pytest.mark.parametrize("margins", [np.full((280, 428), 9000), np.full((280, 428), 40),
                                     np.zeros((280, 428))], ids=["lit", "other", "padded"])
def test_margins_that_are_not_dark_say_nothing(tmp_path, margins):
    write_dng(tmp_path / "photo.dng", in_margins(counts(scene()), margins.astype(np.uint16)),
              black=BLACK, white=WHITE, active_area=AREA)
    np.testing.assert_allclose(read_raw(tmp_path / "photo.dng").black_level.ravel(), BLACK,
                               atol=0.01)


@pytest.mark.parametrize("darkest", [0.004, 0.1])
@pytest.mark.parametrize("electrons, read_noise_dn", [(4e4, 4.0), (1500.0, 25.0)])
def test_a_black_of_zero_far_below_the_darkest_pixels_is_refused(tmp_path, darkest, electrons,
                                                                 read_noise_dn):
    write_dng(tmp_path / "photo.dng", counts(scene(darkest), BLACK, electrons, read_noise_dn),
              black=(0,) * 4, white=WHITE)
    with pytest.raises(InputError, match=r"photo.dng: black lies at 0 DN .* the darkest pixels "
                                         r"read \d+ of 16383 DN.*dark frame.*newer LibRaw"):
        open_photo(tmp_path / "photo.dng")


@pytest.mark.parametrize("darkest", [0.004, 0.1, 0.4])
@pytest.mark.parametrize("electrons, read_noise_dn", [(4e4, 4.0), (1500.0, 25.0)])
def test_a_camera_whose_black_is_zero_may_photograph_bright_scenes(tmp_path, darkest, electrons,
                                                                   read_noise_dn):
    write_dng(tmp_path / "photo.dng", counts(scene(darkest), np.zeros(4), electrons,
                                             read_noise_dn), black=(0,) * 4, white=WHITE)
    assert open_photo(tmp_path / "photo.dng").signal.mean() > 0


def test_a_dark_frame_stands_in_for_a_black_level_that_is_not_known(tmp_path):
    for name, signal, seed in (("photo", scene(), 3), ("off", np.zeros((256, 384, 3)), 4)):
        write_dng(tmp_path / f"{name}.dng", counts(signal, seed=seed), black=(0,) * 4, white=WHITE)
    photo, dark = (read_raw(tmp_path / f"{name}.dng") for name in ("photo", "off"))
    signal = subtract_dark(photo, mean_dark([dark])).signal
    # against white above black, not above 0: one scale for all bands and samples
    expected = scene()[::2, ::2] * (WHITE - BLACK.mean()) / WHITE
    np.testing.assert_allclose(signal.mean(axis=(0, 1)), expected.mean(axis=(0, 1)), rtol=2e-3)
