"""Photos of the page are those of the files, pixel by pixel."""
import json
import os
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from served_page import wait_for

from spectrabox.capture.photo import stored_images
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.measure.photo_quality import BRIGHT, brightest_signal, exposure_stops
from spectrabox.radiometry.errors import InputError
from spectrabox.session.page import photo_views, shooting
from spectrabox.session.page.photo_views import PhotoFile, PhotoViews

from tests.test_error_laws import image


@pytest.fixture
def path(tmp_path, monkeypatch):
    """A file whose photo is as many pixels of its length; two pixels of the sensor make one."""
    def opened(file, not_linear):
        level = 1e-3 * file.stat().st_size
        seen = image(level + np.arange(24.0).reshape(4, 6, 1) * np.ones(3))
        object.__setattr__(seen, "sensor_step", 2.0)
        return seen
    monkeypatch.setattr(stored_images, "is_image_file", lambda file: True)
    monkeypatch.setattr(photo_views, "open_any", opened)
    (tmp_path / "box.dng").write_bytes(b"1234")
    return tmp_path / "box.dng"


@pytest.mark.parametrize("x, y, pixel", [(0, 0, 0), (1.4, 0, 0), (1.6, 0, 1), (-0.4, 3.4, 6),
                                         (11.4, 7.4, 23)])
def test_a_pixel_of_the_sensor_reads_the_pixel_that_it_is_part_of(path, x, y, pixel):
    found = PhotoViews().value(PhotoFile(path), x, y)
    assert found["signal"] == pytest.approx([pixel + 0.004] * 3)


@pytest.mark.parametrize("x, y", [(-0.6, 0), (11.6, 0), (0, 7.6)])
def test_there_is_nothing_beyond_the_last_pixel(path, x, y):
    with pytest.raises(InputError, match="outside the photo of 12 x 8 pixels"):
        PhotoViews().value(PhotoFile(path), x, y)


def test_what_is_left_of_a_rectangle_holds_no_pixel_that_is_clipped_in_any_band(path, monkeypatch):
    def opened(file, not_linear):
        seen = image(np.full((80, 80, 3), 0.5))
        saturated = np.zeros((80, 80, 3), bool)
        saturated[::7, 50::7, 0] = True
        return replace(seen, saturated=saturated)
    monkeypatch.setattr(photo_views, "open_any", opened)
    left, top, right, bottom = PhotoViews().unclipped(PhotoFile(path), [10, 5, 75, 70])
    # cells are of three pixels
    assert left == pytest.approx(10, abs=3) and 46 <= right < 50
    assert top == pytest.approx(5, abs=3) and bottom == pytest.approx(70, abs=3)


def test_a_file_that_was_replaced_is_shown_as_it_is_now(path):
    shown = PhotoViews()
    assert shown.value(PhotoFile(path), 0, 0)["signal"][0] == pytest.approx(0.004)
    path.write_bytes(b"123456")
    os.utime(path, ns=(1, 1))
    assert shown.value(PhotoFile(path), 0, 0)["signal"][0] == pytest.approx(0.006)


@pytest.mark.parametrize("level", [0.02, 0.5, 0.9])
def test_exposed_by_the_stops_that_are_said_the_brightest_parts_are_as_bright_as_wanted(level):
    signal = level * np.linspace(0.1, 1, 40_000).reshape(200, 200, 1) * np.array([0.5, 1.0, 0.3])
    stops = exposure_stops(image(signal))
    again = image(signal * 2**stops)
    assert max(brightest_signal(again)) == pytest.approx(BRIGHT, rel=1e-5)    # single precision
    assert exposure_stops(again) == pytest.approx(0, abs=1e-5)


@pytest.fixture
def watch(tmp_path, monkeypatch):
    monkeypatch.setattr(shooting, "GIVE_UP_S", 0.6)
    watching = shooting.Shooting(tmp_path)
    watching.start()
    yield watching
    watching.end()


def test_a_file_is_judged_again_whenever_it_has_changed(tmp_path, watch):
    write_photo(tmp_path / "whole", np.full((60, 90, 3), 0.7), Fraction(1, 60),
                np.random.default_rng(1))
    whole = (tmp_path / "whole").read_bytes()
    with (tmp_path / "a.dng").open("wb") as file:   # a copy that pauses for longer than we wait
        file.write(whole[:len(whole) // 2])
        file.flush()
        [shot] = wait_for(lambda: watch.state()["shots"])
        assert shot["verdict"] == "RE-SHOOT" and "a.dng" in shot["reasons"][0]
        file.write(whole[len(whole) // 2:])
    wait_for(lambda: [shot["verdict"] for shot in watch.state()["shots"]] == ["GOOD"])
    (tmp_path / "a.dng").write_bytes(b"no photo at all")
    os.utime(tmp_path / "a.dng", ns=(1, 1))         # as a copy that keeps the time of its file
    wait_for(lambda: [shot["verdict"] for shot in watch.state()["shots"]] == ["RE-SHOOT"])


def test_one_file_that_nobody_can_name_or_open_is_one_line_of_the_page(tmp_path, watch,
                                                                       monkeypatch):
    def judged(image, chart):
        raise RuntimeError("a library's own error")
    (tmp_path / os.fsdecode(b"caf\xe9.dng")).write_bytes(b"no photo")
    (tmp_path / os.fsdecode(b"\xe9.tif")).touch()               # comes and goes
    wait_for(lambda: watch.state()["arriving"] == ["\\udce9.tif"])
    (tmp_path / os.fsdecode(b"\xe9.tif")).unlink()
    [shot] = wait_for(lambda: watch.state()["shots"])
    assert "not UTF-8" in shot["reasons"][0] and watch.path(shot["file"]).is_file()
    monkeypatch.setattr("spectrabox.measure.photo_quality.judge_photo", judged)
    write_photo(tmp_path / "b.dng", np.full((60, 90, 3), 0.7), Fraction(1, 60),
                np.random.default_rng(1))
    wait_for(lambda: len(watch.state()["shots"]) == 2)
    fault = watch.state()["shots"][0]
    assert fault["verdict"] == "FAULT" and shot["verdict"] == "RE-SHOOT"
    assert "not of the photo: unexpected RuntimeError: a library's own error" in fault["reasons"][0]
    assert not watch.state()["arriving"] and json.dumps(watch.state(), ensure_ascii=False).encode()
