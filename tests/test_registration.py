"""Photos from one tripod that moved by some pixels: found, undone, or refused."""
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from spectrabox.capture.photo.registration import (
    find_edges,
    own_motion_px,
    register,
    registered,
)
from spectrabox.measure.opened_photos import require_one_camera
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind

SIZE, STEP, BLUR = (240, 360), 2.0, 3.0
# edges lie at any part of a pixel
CHART = [(20.2 + 40.3 * column, 20.9 + 40.7 * row, 50.6 + 40.3 * column, 51.7 + 40.7 * row)
         for row in range(4) for column in range(6)]
SAMPLES = [(290.3, 20.1, 340.4, 80.8), (289.2, 120, 341.1, 200.7), (400.9, 40.4, 460.3, 160.2),
           (500.5, 41.3, 600, 200.6), (400.1, 240.7, 600.8, 420.4)]
REFLECTED = np.random.default_rng(3).uniform(0.05, 0.9, (len(CHART) + len(SAMPLES), 3))
RED_FILTER, BLUE_LAMP = (1, 0.1, 0.02), (0.03, 0.3, 1)
MIDDLE = np.array(SIZE[::-1]) * STEP / 2 - 0.5
REGIONS = {"tall": [(405, 45), (455, 45), (455, 155), (405, 155)],
           "wide": [(420, 260), (580, 260), (580, 400), (420, 400)]}


def patches_px(shift=(0, 0)):
    return np.array([[(x0, y0), (x1, y0), (x1, y1), (x0, y1)] for x0, y0, x1, y1 in CHART]) \
        + np.array(shift)


def photo(seed, *, shift=(0.0, 0.0), turn_deg=0.0, light=(1, 1, 1), moved=(0, 0), fall=0.3):
    """A chart and five samples as the colour sites of a sensor see them, each beside the other."""
    height, width = SIZE
    y, x = np.mgrid[:height, :width] * STEP + (STEP - 1) / 2
    turn, signal = np.radians(turn_deg), np.zeros((*SIZE, 3))

    def inside(x, y, box):
        across, along = (np.clip(0.5 + np.minimum(at - ends[0], ends[1] - at) / BLUR, 0, 1)
                         for at, ends in ((x, box[::2]), (y, box[1::2])))
        return across * along

    for band, site in enumerate((-0.5, 0.0, 0.5)):
        right, down = x + site - MIDDLE[0] - shift[0], y + site - MIDDLE[1] - shift[1]
        there = (np.cos(turn) * right + np.sin(turn) * down + MIDDLE[0],
                 np.cos(turn) * down - np.sin(turn) * right + MIDDLE[1])
        shown = np.full(SIZE, 0.2)
        for number, box in enumerate([*CHART, *SAMPLES]):
            along = moved if number >= len(CHART) else (0, 0)
            part = inside(there[0] - along[0], there[1] - along[1], box)
            shown = (1 - part) * shown + part * REFLECTED[number, band]
        signal[..., band] = shown * light[band] * (1 - fall * x / x.max())
    variance = 1e-4 * np.maximum(signal, 0.01)
    noisy = signal + np.random.default_rng(seed).standard_normal(signal.shape) * np.sqrt(variance)
    return LinearImage(noisy.astype(np.float32), variance.astype(np.float32),
                       np.zeros(signal.shape, bool), STEP, 0.01, 100.0, 8.0, PhotoKind.RAW, "", "",
                       "")


@pytest.fixture(scope="module")
def first():
    return find_edges(photo(1))


@pytest.mark.parametrize("light, fall", [((1, 1, 1), 0.3), (RED_FILTER, 0.3), (BLUE_LAMP, -0.4)])
@pytest.mark.parametrize("shift, turn_deg", [((7.3, -2.1), 0.0), ((-21.7, 18.4), 0.4)])
def test_a_shift_is_found_under_any_light(first, light, fall, shift, turn_deg):
    other = find_edges(photo(2, shift=shift, turn_deg=turn_deg, light=light, fall=fall))
    found = register(first, other)
    at_middle = found.matrix[:, :2] @ MIDDLE + found.matrix[:, 2] - MIDDLE
    np.testing.assert_allclose(at_middle, shift, atol=0.1)      # pixels, as the documentation says
    np.testing.assert_allclose(np.degrees(np.arctan2(*found.matrix[::-1, 0])), turn_deg, atol=0.02)
    assert registered(first, other, ("a", "b"), REGIONS, None).shift_px == found.shift_px


def test_a_photo_that_stayed_is_left_as_it_is(first):
    found = register(first, find_edges(photo(2, light=BLUE_LAMP)), (patches_px(), patches_px()))
    points = np.array([[3.0, 4.0], [300.0, 20.0]])
    assert found.still and found.moved(points) is points
    assert found.chart_px < 0.1 and found.residual_px < 0.5


def test_the_chart_and_parts_of_the_photo_say_what_is_left(first):
    other = find_edges(photo(2, shift=(7.3, -2.1)))
    found = register(first, other, (patches_px(), patches_px((8.3, -2.1))))
    assert found.chart_px == pytest.approx(1, abs=0.1)
    assert found.residual_px < 0.5      # a quarter of a pixel of the edges


@pytest.mark.parametrize("changes, says", [
    ({"shift": (60, 0)}, "is shifted by 60 pixels against a, 8% of its width"),
    ({"moved": (25, 6)}, "region '.*' moved by 2[4-8] pixels against what else")])
def test_what_moved_too_far_or_by_itself_is_refused(first, changes, says):
    other = find_edges(photo(2, **changes))
    corners = patches_px(), patches_px(changes.get("shift", (0, 0)))
    with pytest.raises(CheckError, match=says):
        registered(first, other, ("a", "b"), REGIONS, corners)


def test_a_sample_that_moved_is_named(first):
    def only_wide(seed, distance):
        x0, y0, x1, y1 = map(int, SAMPLES[-1])
        shown = photo(seed)
        part = (slice(y0 // 2 - 6, y1 // 2 + 6), slice(x0 // 2 - 6, x1 // 2 + 6))
        signal = shown.signal.copy()
        signal[part] = 0.2
        signal[y0 // 2:y1 // 2, (x0 + distance) // 2:(x1 + distance) // 2] = 0.7
        return find_edges(LinearImage(**{**vars(shown), "signal": signal}))

    before, after = only_wide(1, 0), only_wide(2, 14)
    moved = own_motion_px(before, after, register(before, after), REGIONS)
    assert moved == {"wide": pytest.approx(14, abs=2)}      # a pixel of the edges is two


def test_photos_without_edges_or_of_other_sizes_are_not_compared(first):
    dark = photo(2, light=(0, 0, 0))
    assert register(first, find_edges(dark)) is None
    half = LinearImage(**{**vars(dark), **{name: getattr(dark, name)[:120] for name in
                                           ("signal", "variance", "saturated")}})
    with pytest.raises(InputError, match="a of 720 x 480 and b of 720 x 240 pixels"):
        registered(first, find_edges(half), ("a", "b"), REGIONS, None)


def test_a_chart_that_moved_is_not_taken_for_the_camera():
    """The samples lie where they lay; the chart, which fills much of the photo, does not."""
    edges = find_edges(photo(3))
    far = np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]])[None]
    with pytest.raises(CheckError, match="the chart moved by 80 pixels against what else"):
        registered(edges, edges, ("first", "other"), REGIONS, (far, far + np.array([80.0, 0.0])))


def test_a_photo_with_nothing_in_common_is_judged_by_its_chart(first):
    """Where edges tell nothing, the chart says whether another photo is from the same tripod."""
    dark = find_edges(photo(2, light=(0, 0, 0)))
    there = patches_px()
    assert registered(first, dark, ("a", "b"), REGIONS, (there, patches_px((2, 1)))) is None
    for far in ((40, 0), (200, 100)):       # by less and by more than what registration undoes
        distance = round(float(np.hypot(*far)))
        with pytest.raises(CheckError, match=rf"in b the chart lies {distance} pixels from where "
                           "it lies in a, and little else is in both"):
            registered(first, dark, ("a", "b"), REGIONS, (there, patches_px(far)))


@pytest.mark.parametrize("cameras, refused", [
    (("Nikon D810 77", "Nikon D850 12"), True), (("Canon EOS R", "Canon EOS R5"), True),
    (("Nikon D810 77", "", "Nikon D810"), False)])      # files without EXIF, or without a serial
def test_photos_of_two_cameras_are_refused(cameras, refused):
    images = [replace(photo(1), camera=camera, source=f"{number}.dng")
              for number, camera in enumerate(cameras)]
    with pytest.raises(InputError, match=rf"0.dng was taken with {cameras[0]} and 1.dng with "
                       rf"{cameras[1]}.*with one camera") if refused else nullcontext():
        require_one_camera(images)
