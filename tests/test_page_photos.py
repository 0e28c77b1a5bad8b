"""Photos of the page are those of the files, pixel by pixel."""
import os

import numpy as np
import pytest

from spectrabox.radiometry.errors import InputError
from spectrabox.session.page import photo_views
from spectrabox.session.page.photo_views import PhotoViews
from spectrabox.session.page.shooting import BRIGHT, brightest_signal, exposure_stops

from tests.test_error_laws import image


@pytest.fixture
def path(tmp_path, monkeypatch):
    """A file whose photo is as many pixels of its length; two pixels of the sensor make one."""
    def opened(file, not_linear):
        level = 1e-3 * file.stat().st_size
        seen = image(level + np.arange(24.0).reshape(4, 6, 1) * np.ones(3))
        object.__setattr__(seen, "sensor_step", 2.0)
        return seen
    monkeypatch.setattr(photo_views, "is_image_file", lambda file: True)
    monkeypatch.setattr(photo_views, "open_any", opened)
    (tmp_path / "box.dng").write_bytes(b"1234")
    return tmp_path / "box.dng"


@pytest.mark.parametrize("x, y, pixel", [(0, 0, 0), (1.4, 0, 0), (1.6, 0, 1), (-0.4, 3.4, 6),
                                         (11.4, 7.4, 23)])
def test_a_pixel_of_the_sensor_reads_the_pixel_that_it_is_part_of(path, x, y, pixel):
    found = PhotoViews().value(path, x, y)
    assert found["signal"] == pytest.approx([pixel + 0.004] * 3)


@pytest.mark.parametrize("x, y", [(-0.6, 0), (11.6, 0), (0, 7.6)])
def test_there_is_nothing_beyond_the_last_pixel(path, x, y):
    with pytest.raises(InputError, match="outside the photo of 12 x 8 pixels"):
        PhotoViews().value(path, x, y)


def test_a_file_that_was_replaced_is_shown_as_it_is_now(path):
    shown = PhotoViews()
    assert shown.value(path, 0, 0)["signal"][0] == pytest.approx(0.004)
    path.write_bytes(b"123456")
    os.utime(path, ns=(1, 1))
    assert shown.value(path, 0, 0)["signal"][0] == pytest.approx(0.006)


@pytest.mark.parametrize("level", [0.02, 0.5, 0.9])
def test_exposed_by_the_stops_that_are_said_the_brightest_parts_are_as_bright_as_wanted(level):
    signal = level * np.linspace(0.1, 1, 40_000).reshape(200, 200, 1) * np.array([0.5, 1.0, 0.3])
    stops = exposure_stops(image(signal))
    again = image(signal * 2**stops)
    assert max(brightest_signal(again)) == pytest.approx(BRIGHT, rel=1e-5)    # single precision
    assert exposure_stops(again) == pytest.approx(0, abs=1e-5)
