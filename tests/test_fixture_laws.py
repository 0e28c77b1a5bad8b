"""Synthetic inputs obey the laws that they are said to."""
import numpy as np
import pytest

from spectrabox.fixtures import flat_sample, lamp
from spectrabox.fixtures.chart_scene import mosaic
from spectrabox.fixtures.demos import demo_photos
from spectrabox.fixtures.demos.demo_scenes import CHART_LIGHT_CM, LIGHT_RADIUS_CM
from spectrabox.fixtures.flat_sample import lamplight


@pytest.mark.parametrize("side, width", [(-1, 19.0), (1, 25.0)])
def test_the_blue_peak_is_half_as_high_at_half_of_its_width(monkeypatch, side, width):
    monkeypatch.setattr(lamp, "PEAK_RADIANCE", 1.0)
    nm = np.array([450.0, 450.0 + side * width / 2])
    phosphor = (0.40 * np.exp(-0.5 * ((nm - 543) / 31) ** 2)
                + 0.47 * np.exp(-0.5 * ((nm - 600) / 45) ** 2)
                + 0.006 * np.exp(-0.5 * ((nm - 480) / 160) ** 2))
    top, flank = lamp.radiance(nm) - phosphor
    assert flank == pytest.approx(top / 2, rel=1e-9)


def test_a_small_lamp_lights_a_plane_by_the_square_of_its_distance_and_the_cosine():
    height, rows, columns = 0.8, 40, 60
    estimate = lamplight((rows, columns), [(0.3, 0.2, height, 1.7)])
    y, x = ((np.arange(count) + 0.5) / columns for count in (rows, columns))
    squared = (x - 0.3) ** 2 + (y[:, None] - 0.2) ** 2 + height**2
    expected = height / np.sqrt(squared) / squared
    # single precision
    np.testing.assert_allclose(estimate / estimate[7, 9], expected / expected[7, 9], rtol=1e-5)
    # light from all sides is the same everywhere
    mixed = lamplight((rows, columns), [(0.3, 0.2, height, 1.7)], ambient=0.25)
    np.testing.assert_allclose(mixed, 0.25 + 0.75 * estimate, rtol=1e-5)


@pytest.mark.parametrize("point", [(0.0, 0.0), (-12.0, 8.0), (14.0, -10.0)])
def test_a_ball_lights_a_plane_as_the_directions_in_which_it_is_seen(point):
    """Irradiance over pi times its radiance: the cosines, summed over the ball's solid angle."""
    to_ball = CHART_LIGHT_CM - np.array([*point, 0.0])
    distance = np.linalg.norm(to_ball)
    axis = to_ball / distance
    side = np.cross(axis, [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    polar = (np.arange(400) + 0.5) / 400 * np.arcsin(LIGHT_RADIUS_CM / distance)
    angle = 2 * np.pi * (np.arange(60) + 0.5) / 60
    directions = (np.cos(polar)[:, None, None] * axis + np.sin(polar)[:, None, None]
                  * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other))
    solid_angle = np.sin(polar)[:, None] * polar[0] * 2 * 2 * np.pi / 60
    expected = np.sum(directions[..., 2] * solid_angle) / np.pi
    # sums over 400 rings
    assert demo_photos.light_factor(np.array(point)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("lens", [demo_photos.vignetting,
                                  lambda size: flat_sample.vignetting(size, 0.85)])
def test_a_lens_dims_the_corners_as_stated_and_not_the_middle(lens):
    """As cos^4 does: the square of 1 / (1 + distance^2 / focal^2)."""
    light = lens((41, 61))
    assert light[20, 30] == 1 and light[0, 0] == light[-1, -1] == pytest.approx(0.85)
    y, x = np.mgrid[-20:21, -30:31]
    bent = light**-0.5 - 1
    np.testing.assert_allclose(bent / bent[0, 0], (x**2 + y**2) / (20**2 + 30**2), atol=1e-12)


@pytest.mark.parametrize("read_noise_dn", [2.0, 9.0])
def test_counts_scatter_by_shot_and_read_noise(read_noise_dn):
    """Poisson: the variance of the electrons is their number; read noise and rounding on top."""
    electrons, white, black = 5000.0, 4095.0, 200.0
    counts = mosaic(np.full((400, 400, 3), 0.4), "RGGB", np.full(4, black), white, electrons,
                    read_noise_dn, np.random.default_rng(2)).astype(float)
    gain = (white - black) / electrons
    expected = gain**2 * 0.4 * electrons + read_noise_dn**2 + 1 / 12
    # 160 000 pixels know a variance to 0.35 %
    assert counts.var() == pytest.approx(expected, rel=0.015)
    assert counts.mean() == pytest.approx(black + 0.4 * (white - black), abs=0.5)


def test_readings_of_the_lamp_err_by_the_same_share_at_every_wavelength():
    rng, truth = np.random.default_rng(3), lamp.radiance()
    readings = np.array([lamp.measured(rng)[1] for _ in range(2000)])
    stated = lamp.measured(rng)[2]
    np.testing.assert_allclose(stated / truth, lamp.READING_NOISE, rtol=1e-12)
    # 2000 readings know a deviation to 1.6 %; 401 wavelengths, 4.9 of those at 1e-4 in all
    np.testing.assert_allclose(readings.std(axis=0) / stated, 1, atol=0.08)
    np.testing.assert_allclose(readings.mean(axis=0), truth, rtol=0.003 * 5 / np.sqrt(2000))
