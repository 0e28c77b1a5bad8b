"""Resampling keeps integrals and is Sprague's where CIE 167 asks for it."""
import warnings

import numpy as np
import pytest

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import resampled, sprague

NM = np.arange(380.0, 781.0, 5)
LAMP = 1 + np.sin(NM / 20) / 2 + 3 * np.exp(-(((NM - 546) / 12) ** 2))


def test_sprague_is_colour_sciences():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from colour import SpragueInterpolator
    at = np.linspace(380, 780, 801)
    # The same polynomial in another order of operations: round-off of values near 4.
    np.testing.assert_allclose(sprague(NM, LAMP, at), SpragueInterpolator(NM, LAMP)(at), atol=1e-12)


@pytest.mark.parametrize("degree", range(5))
def test_sprague_reproduces_polynomials(degree):
    values = ((NM - 580) / 100) ** degree
    # Exact up to the fourth degree; the standard's rule for points beyond the ends is so for lines
    # only.
    at = np.linspace(380, 780, 333) if degree < 2 else np.linspace(395, 765, 333)
    np.testing.assert_allclose(sprague(NM, values, at), ((at - 580) / 100) ** degree, atol=1e-11)


def test_samples_are_kept_where_the_grids_meet():
    fine, rule = resampled(NM, LAMP, np.arange(400.0, 701.0), "lamp")
    assert "Sprague" in rule
    np.testing.assert_allclose(fine[::5], LAMP[(NM >= 400) & (NM <= 700)], rtol=1e-12)  # round-off


@pytest.mark.parametrize("step", [10.0, 20.0, 25.0])
def test_a_coarser_grid_keeps_the_integral(step):
    target = np.arange(400.0, 700.1, step)
    coarse, rule = resampled(NM, LAMP, target, "lamp")
    fine_nm = np.linspace(400 - step / 2, 700 + step / 2, 200_001)
    truth = np.trapezoid(sprague(NM, LAMP, fine_nm), fine_nm)
    assert "mean over each" in rule
    # Gauss-Legendre is exact for the quintic; the check itself is a trapezoid of 200 001 points:
    # 1e-9.
    assert coarse.sum() * step == pytest.approx(truth, rel=1e-8)


@pytest.mark.parametrize("step", [10.0, 20.0, 25.0])
def test_a_straight_line_keeps_its_mean_in_steps_that_are_cut_at_the_ends(step):
    line = 2 + (NM - 400) / 100
    found, _ = resampled(NM, line, np.arange(380.0, 780.1, step), "line")
    centres = np.arange(380.0, 780.1, step)
    low, high = np.maximum(centres - step / 2, 380), np.minimum(centres + step / 2, 780)
    # Sprague is exact for lines, Gauss-Legendre too: round-off.
    np.testing.assert_allclose(found, 2 + ((low + high) / 2 - 400) / 100, rtol=1e-12)


def test_there_and_back_changes_a_smooth_spectrum_little():
    smooth = 1 + 0.5 * np.sin(NM / 60)
    fine, _ = resampled(NM, smooth, np.arange(380.0, 781.0), "x")
    back, _ = resampled(np.arange(380.0, 781.0), fine, NM, "x")
    # A mean over 5 nm differs from the value by f'' h^2 / 24 = 1.5e-4; the ends are cut and differ
    # by f' h / 4.
    np.testing.assert_allclose(back[1:-1], smooth[1:-1], atol=2e-4)


def test_uneven_samples_do_not_overshoot():
    nm = np.array([400.0, 410, 415, 430, 500, 520, 700])
    values, rule = resampled(nm, np.array([0, 0, 1, 1, 0, 0, 1.0]), np.arange(400.0, 701.0, 1), "x")
    assert "cubic" in rule and values.min() >= -1e-12 and values.max() <= 1 + 1e-12


@pytest.mark.parametrize("target, message", [
    (np.arange(370.0, 701.0), "lamp covers 380-780 nm; 370-700 nm is asked for"),
    (np.array([400.0, 410, 425]), "even steps"), (np.array([500.0]), "even steps")])
def test_nothing_is_extrapolated(target, message):
    with pytest.raises(InputError, match=message):
        resampled(NM, LAMP, target, "lamp")
