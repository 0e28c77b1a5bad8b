from fractions import Fraction

import numpy as np
import pytest

from spectrabox.capture.photo.metadata import photo_metadata
from spectrabox.capture.photo.raw import read_raw
from spectrabox.fixtures.dng import BAYER_TILES, write_dng


def random_mosaic(height=40, width=60):
    return np.random.default_rng(1).integers(500, 16000, (height, width)).astype(np.uint16)


@pytest.mark.parametrize("pattern", BAYER_TILES)
def test_libraw_reads_back_every_pixel_and_the_pattern(tmp_path, pattern):
    mosaic = random_mosaic()
    write_dng(tmp_path / "photo.dng", mosaic, pattern=pattern)
    frame = read_raw(tmp_path / "photo.dng")
    np.testing.assert_array_equal(frame.mosaic, mosaic)
    assert tuple(frame.cfa.ravel()) == BAYER_TILES[pattern]


def test_metadata_come_back_as_exact_numbers(tmp_path):
    write_dng(tmp_path / "photo.dng", random_mosaic(), exposure_s=Fraction(1, 125), f_number=5.6,
              iso=200, make="Maker", model="Body 1", serial="A77")
    metadata = photo_metadata(tmp_path / "photo.dng")
    assert (metadata.exposure_s, metadata.f_number, metadata.iso) == (Fraction(1, 125),
                                                                      Fraction(28, 5), 200.0)
    assert metadata.camera == "Maker Body 1 A77"


@pytest.mark.parametrize("mosaic",
                         [np.zeros((4, 4)), np.zeros((5, 4), np.uint16), np.zeros((4, 4, 1),
                                                                                  np.uint16)])
def test_a_mosaic_that_no_bayer_sensor_gives_is_refused(tmp_path, mosaic):
    with pytest.raises(ValueError, match=r"uint16 of even size"):
        write_dng(tmp_path / "photo.dng", mosaic)


def test_an_unknown_pattern_is_refused_by_name(tmp_path):
    with pytest.raises(ValueError, match="'RGBW' is not one of RGGB"):
        write_dng(tmp_path / "photo.dng", random_mosaic(), pattern="RGBW")
