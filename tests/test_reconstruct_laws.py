"""Laws of inversions: what errors weigh, what a fit leaves, and how far paths and pixels reach.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from test_reconstruct_fit import COUNT, GROUP, case, fit_spectra, model

from spectrabox.radiometry.grid import basis_matrix, visible_grid
from spectrabox.reconstruct import transport_engine
from spectrabox.reconstruct.agreement import (
    FIELD_TERMS,
    covariance_from_few,
    edge_shift,
    within_to_block,
)
from spectrabox.reconstruct.fit.transport_fit import TracedView, band_signals, greville_abscissae
from spectrabox.reconstruct.fit.view_terms import Nuisances, ViewTerms, compress
from spectrabox.reconstruct.gradient_engine import WINDOW, stalled
from spectrabox.reconstruct.inverse_rendering import joint_record
from spectrabox.reconstruct.misfit import worst_part
from spectrabox.reconstruct.pixel_light import LightNodes
from spectrabox.reconstruct.rendering.renderer import load_scene, render, start_mitsuba
from spectrabox.reconstruct.replay import _gains, _photographed
from spectrabox.reconstruct.scene.light_position import _solve, whitening
from spectrabox.reconstruct.scene.scene_file import read_profile, relative_radiance
from spectrabox.reconstruct.scene.surfaces import hits_of, region_means
from spectrabox.reconstruct.tracer import transport as tracing
from spectrabox.reconstruct.tracer.transport import TracedTransport

from tests.cornell_problem import photo_of

SIGMAS = stats.norm.isf(0.5e-4)
EVEN = (np.eye(3) + 1) / 2


@pytest.mark.parametrize("freedom", [1, 2, 4, 12])
def test_errors_from_few_surfaces_hold_the_next_one_95_times_in_a_hundred(freedom):
    """One band; what is stated is one deviation more, and is drawn as the others are."""
    rng = np.random.default_rng(1)
    stated, following, *seen = 0.02 * rng.standard_normal((2 + freedom, 6000))
    covariance = [covariance_from_few(np.array([[own @ own]]), freedom, abs(one))[0, 0]
                  for own, one in zip(np.array(seen).T, stated, strict=True)]
    inside = np.abs(following) < stats.norm.ppf(0.975) * np.sqrt(covariance)
    # Student's interval is exact for normal deviations
    assert abs(inside.mean() - 0.95) < SIGMAS * np.sqrt(0.95 * 0.05 / inside.size)


@pytest.mark.parametrize("freedom", [2, 4, 12])
def test_errors_that_are_even_are_estimated_without_bias(freedom):
    rng, root = np.random.default_rng(15), np.linalg.cholesky(0.02**2 * EVEN)
    seen = rng.standard_normal((3000, freedom, 3)) @ root.T
    covariance = np.mean([covariance_from_few(own.T @ own, freedom, 0.02) for own in seen], axis=0)
    # 3000 sets of two deviations know a variance to 1.8 %
    np.testing.assert_allclose(covariance / np.trace(covariance), EVEN / 3, atol=0.01)


@pytest.mark.parametrize("freedom", [2, 4, 12])
def test_a_matrix_from_few_deviations_is_drawn_to_the_even_one_by_k_plus_1_over_nu_plus_k(freedom):
    """As the docstring has it: by all of its weight at nu = 1."""
    scatter = freedom * 1e-4 * np.diag([4.0, 1.0, 1.0])
    covariance = covariance_from_few(scatter, freedom, 1e-9)
    drawn = 4 / (freedom + 3)
    expected = (1 - drawn) * np.diag([4.0, 1.0, 1.0]) + drawn * 2 * EVEN
    np.testing.assert_allclose(covariance / np.trace(covariance), expected / 6, atol=1e-9)


def test_one_deviation_tells_the_size_of_errors_and_nothing_of_their_colour():
    for seen in ([0.02, -0.01, 0.0], [0.02, 0.02, 0.02], [0.0, 0.0, 0.03]):
        covariance = covariance_from_few(np.outer(seen, seen), 1, 1e-9)
        np.testing.assert_allclose(covariance / np.trace(covariance), EVEN / 3, atol=1e-12)


def test_many_deviations_tell_their_own_covariance():
    rng = np.random.default_rng(2)
    truth = np.array([[4.0, 1.0, 0.0], [1.0, 1.0, -0.3], [0.0, -0.3, 0.25]]) * 1e-4
    seen = rng.multivariate_normal(np.zeros(3), truth, 20_000)
    covariance = covariance_from_few(seen.T @ seen, len(seen), 0.01)
    # 20 000 deviations know a variance to 1 %
    np.testing.assert_allclose(covariance, truth, atol=0.04 * truth[0, 0])
    np.testing.assert_allclose(np.diag(covariance), np.diag(truth), rtol=0.04)


@pytest.mark.parametrize("regions, surfaces", [(600, 6), (90, 3)])
def test_all_blocks_of_a_surface_weigh_as_much_as_the_terms_of_its_field(regions, surfaces):
    """Sums of inverse variances: of blocks taken for independent, and of the field's terms."""
    within = 0.02
    of_block = within * within_to_block(regions, surfaces)
    blocks = regions / surfaces
    assert blocks / of_block**2 == pytest.approx(FIELD_TERMS / within**2)


def test_a_photo_is_shifted_to_the_right_and_down_by_as_much_as_its_edges():
    rng = np.random.default_rng(3)
    coarse = rng.uniform(0.2, 1.0, (12, 15))
    still = np.kron(coarse, np.ones((6, 6)))[..., None] * np.ones(3)
    moved = np.roll(still, (-2, 5), axis=(0, 1))        # two up, five to the right
    (right, down), _ = edge_shift(moved, still)
    # a parabola through the peak of edges one pixel wide
    assert right == pytest.approx(5, abs=0.3) and down == pytest.approx(-2, abs=0.3)


def unevenly_weighed():
    rng = np.random.default_rng(4)
    rows, measured, weight, _ = case(seed=5, noise=0.02)
    return rows, measured, weight[:1] * rng.uniform(0.1, 3.0, (len(rows), 1))


def test_equations_of_pixels_that_weigh_unlike_are_those_of_least_squares():
    rows, measured, weight = unevenly_weighed()
    weight = np.broadcast_to(weight[0] * (weight[:, :1] / weight[0, 0]), measured.shape)
    system = compress(rows, measured, weight, GROUP)
    truth = np.random.default_rng(6).uniform(0.2, 0.8, (2, COUNT))
    signals = model().signals(truth)
    ours = np.sum((system.root * (system.rows @ signals - system.target))**2)
    plain = np.sum(weight * (rows @ signals - measured)**2)
    # round-off of sums of some thousand numbers
    assert ours == pytest.approx(plain, rel=1e-9)


@pytest.mark.parametrize("scale", [None, 1.0])
def test_where_a_fit_ends_nothing_pulls_what_has_no_prior_but_its_own(scale):
    """Gains of surfaces: photo and prior pull them alike; spectra are pulled by their prior."""
    rows, measured, weight, _ = case(seed=7, noise=0.02)
    measured = measured * np.where(GROUP == 0, 1.04, 0.97)[:, None]
    known = model({0: np.full(model().basis.shape[0], 0.5)} if scale is None else None)
    fit = fit_spectra(compress(rows, measured, weight, GROUP), known, scale=scale,
                      surface_error=0.02, brightness_error=0.03)
    spectra = fit.coefficients.size
    size = np.sqrt(np.diag(fit.information))
    # in standard errors of each nuisance by itself: the descent ends at 1e-7 of the cost
    assert np.abs(fit.pull[spectra:] / size[spectra:]).max() < 0.05
    gains = np.log([fit.views[0].gains[surface] for surface in (0, 1)])
    assert np.abs(gains).max() > 0.01      # the test can tell: the gains were needed
    held = fit.information[spectra:, spectra:]
    assert np.abs(held[:6, :6] @ gains.ravel() / size[spectra:spectra + 6]).max() > 1


def test_what_later_stages_add_is_taken_as_exact():
    rng, names = np.random.default_rng(8), 1
    operator = rng.uniform(0, 1, (3, 3))
    rows = rng.standard_normal((12, 5))
    added_later = np.array([False] * 3 + [True, False])     # a gain, and a light's
    fit = SimpleNamespace(coefficients=rng.uniform(0.2, 0.8, (names, 3)),
                          information=rows.T @ rows, pull=np.zeros(5), added_later=added_later)
    _, covariances = band_signals(fit, operator, names)
    held = np.linalg.inv((rows.T @ rows)[np.ix_(~added_later, ~added_later)])[:3, :3]
    np.testing.assert_allclose(covariances[0], operator @ held @ operator.T, rtol=1e-6)


def test_an_error_that_all_bands_share_costs_once():
    """A surface that is 3 % brighter in all bands: one deviation, not three."""
    rows, clean, weight, _ = case()
    terms = ViewTerms(compress(rows, clean, weight, GROUP), model(),
                      Nuisances(scale=1.0, surface_error=1e-3, brightness_error=0.03))
    brighter = np.r_[np.full(3, 0.03), np.zeros(len(terms.prior) - 3)]
    assert brighter @ terms.prior @ brighter == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize("coefficients", [5, 8, 13])
def test_a_spline_whose_coefficients_are_its_abscissae_is_a_straight_line(coefficients):
    """Greville's: sum of abscissa times basis function is the wavelength itself."""
    nm = np.linspace(400, 700, 61)
    line = basis_matrix(nm, coefficients) @ greville_abscissae(coefficients)
    np.testing.assert_allclose(line, (nm - 400) / 300, atol=1e-12)


@pytest.mark.parametrize("noisier", [2.0, 5.0])
def test_paths_are_traced_until_their_noise_is_that_of_the_photo(monkeypatch, noisier):
    """Variance falls as 1 / paths: paths that err by twice as much are four times too few."""
    region = np.arange(6).reshape(2, 3).repeat(2, axis=0).repeat(2, axis=1)
    measured, variance = np.full((4, 6, 3), 0.5), np.full((4, 6, 3), 1e-4)
    view = SimpleNamespace(measured=measured, variance=variance)
    photo = 1e-4 / 0.5**2 / 4                   # relative, of a region of four pixels
    asked = []
    monkeypatch.setattr(tracing, "trace_transport",
                        lambda unit, region, *, spp, **_: asked.append(spp) or first)
    monkeypatch.setattr(transport_engine, "unlit_material", lambda *_: None)
    monkeypatch.setattr(tracing, "joined", lambda first, second: None)
    first = SimpleNamespace(spp=16, exponents=None,
                            relative_variance=np.full(6, noisier**2 * photo))
    transport_engine.trace_view(view, None, region, None, 0, lambda *_: None)
    assert asked[1] + 16 == pytest.approx(noisier**2 * 16, abs=1)


def test_a_loss_that_does_not_fall_is_said_to_have_stalled_as_often_as_one_sigma_says():
    rng = np.random.default_rng(9)
    stops = [stalled(list(row)) for row in rng.standard_normal((3000, 2 * WINDOW))]
    expected = stats.t.cdf(1, 2 * WINDOW - 2)
    assert abs(np.mean(stops) - expected) < SIGMAS * np.sqrt(expected * (1 - expected) / len(stops))


@pytest.mark.parametrize("passes", [2, 3, 8])
def test_the_variance_of_a_rendering_is_that_of_the_mean_of_its_passes(monkeypatch, passes):
    rng = np.random.default_rng(10)
    monkeypatch.setitem(sys.modules, "mitsuba", SimpleNamespace(
        render=lambda scene, spp, seed: 1 + 0.1 * rng.standard_normal((100, 200, 1))))
    image, variance = render(None, 16, 0, passes)
    # 20 000 pixels know the variance of their own scatter to 1 %, and to 1.4 % of two passes
    assert variance.mean() == pytest.approx(0.1**2 / passes, rel=0.06)
    assert image.var() == pytest.approx(0.1**2 / passes, rel=0.06)


def test_whitened_residuals_of_a_light_are_independent_where_bands_err_together():
    rng = np.random.default_rng(11)
    common, own = np.array([4e-4, 1e-4]), np.array([[1e-4, 2e-4, 3e-4], [1e-5, 1e-4, 2e-5]])
    draws = np.sqrt(common)[:, None] * rng.standard_normal((20_000, 2, 1)) \
        + np.sqrt(own) * rng.standard_normal((20_000, 2, 3))
    white = np.einsum("rkl,trl->trk", whitening(common, own), draws)
    for region in (0, 1):
        # 20 000 draws know a variance to 1 %, a covariance to 0.7 %
        np.testing.assert_allclose(np.cov(white[:, region].T), np.eye(3), atol=0.05)


def test_a_misfit_widens_the_errors_of_a_light_by_its_root():
    """Residuals that are k times as large as stated: errors k times as large."""
    rng = np.random.default_rng(12)
    slopes = rng.standard_normal((3, 40, 2))
    whiten, nothing = np.tile(np.eye(2), (40, 1, 1)), np.zeros((40, 2, 0))
    residual = 5 * rng.standard_normal((40, 2))
    (_, one, misfit), (_, three, _) = (_solve(k * residual, slopes, whiten, nothing)
                                       for k in (1, 3))
    np.testing.assert_allclose(three, 9 * one, rtol=1e-9)
    plain = np.linalg.inv(np.einsum("irk,jrk->ij", *2 * (np.concatenate(
        [slopes, np.ones((1, 40, 2))]),)))
    np.testing.assert_allclose(one, misfit * plain, rtol=1e-6)


SQUARE = """<scene version="3.0.0"><integrator type="path"/>
<sensor type="perspective"><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0,0,{away}" target="0,0,0" up="0,1,0"/></transform>
</sensor><shape type="rectangle" id="square"><transform name="to_world">
<rotate y="1" angle="{turned}"/></transform></shape></scene>"""


@pytest.mark.parametrize("turned", [0, 50])
def test_pixels_that_show_a_surface_cover_its_area_from_near_and_far(turned):
    """Pixels at the frame's corners see a little less of a solid angle each: cos^3."""
    start_mitsuba("cpu")
    row, column = (grid.ravel() for grid in np.mgrid[:64, :64])
    areas = [hits_of(load_scene(SQUARE.format(away=away, turned=turned)), (64, 64), row,
                     column)[1].sum() for away in (6.0, 9.0)]
    # cos^3 within 13 degrees of the middle, near, and 8, far: 2 %; and the rim's pixels
    assert areas[0] / areas[1] == pytest.approx(1, abs=0.06)


@pytest.mark.parametrize("cell", [1, 4])
def test_light_that_rises_evenly_is_off_by_its_slope_where_pixels_are_misplaced(cell):
    nodes = LightNodes(np.zeros((24, 40), int), cell)
    _, row, column = nodes.keys
    slope = np.array([0.003, -0.004])           # down and across, per pixel
    light = 1 + cell * (slope[0] * row + slope[1] * column)
    estimate = nodes.unevenness(light, 2.0) * light
    inner = (row > 0) & (row < row.max()) & (column > 0) & (column < column.max())
    np.testing.assert_allclose(estimate[inner], 2.0 * 0.005, rtol=1e-9)


def test_a_lamp_that_is_brightest_aside_is_one_straight_ahead(tmp_path):
    (tmp_path / "wings.csv").write_text("angle_deg,radiance\n0,40\n30,60\n60,20\n")
    table = read_profile(tmp_path / "wings.csv")
    angles = np.array([0, 15, 30, 45, 60, 80])
    estimate = relative_radiance(table, np.cos(np.radians(angles)))
    # straight lines between the angles, the last value up to 90 degrees; round-off of cosines
    np.testing.assert_allclose(estimate, [1, 1.25, 1.5, 1, 0.5, 0.5], atol=1e-9)


def test_errors_of_a_model_are_no_smaller_for_a_second_photo_of_it():
    """The same response twice: what scene and photo disagree by is common to both photos."""
    rng, grid = np.random.default_rng(16), visible_grid(5)
    response = rng.uniform(0, 1, (3, grid.nm.size))
    errors = np.array([0.01**2 * (np.eye(3) + 1), 0.02**2 * (np.eye(3) + 1)])
    view = SimpleNamespace(name="one", response=response, grid=grid, bands=("R", "G", "B"),
                           lamp_in_place="")
    record = SimpleNamespace(materials=("a", "b"), known=(False, False), model_covariance=errors,
                             spectra=np.full((2, grid.nm.size), 0.5), signal=np.full((2, 3), 0.5),
                             signal_covariance=np.zeros((2, 3, 3)))
    for times in (1, 2, 3):
        joint = joint_record((view,) * times, (record,) * times, (None,) * times,
                             (None,) * times)
        np.testing.assert_allclose(joint.model_covariance, errors, rtol=1e-12)


def test_surfaces_of_a_replayed_photo_err_as_stated_in_each_band_and_in_all():
    colour, brightness = 0.01, 0.03
    traced = SimpleNamespace(nuisances=Nuisances(surface_error=colour,
                                                 brightness_error=brightness),
                             measured=np.zeros((4000, 3)), group=np.arange(4000))
    estimate = np.log(_gains(traced, np.random.default_rng(17)))
    # 4000 surfaces know a variance to 2.2 %
    np.testing.assert_allclose(np.cov(estimate.T), colour**2 * np.eye(3) + brightness**2,
                               atol=0.09 * brightness**2)


@pytest.mark.parametrize("noise", [0.05, 0.2])
def test_a_part_is_told_beyond_three_errors_of_its_mean(noise):
    """Blocks of sixteen pixels of noise alone: one in 370 lies beyond three errors, by a little."""
    rng, size = np.random.default_rng(18), (160, 160)
    rendered = np.full((*size, 1), 0.5)
    measured = rendered * (1 + noise * rng.standard_normal(rendered.shape))
    part = worst_part(measured, rendered, np.ones(size, bool))
    # the largest of 1600 normal blocks: 3.2 to 4.6 errors, of which three are taken off
    assert 0.1 < abs(part) / (noise / 4) < 1.9


def test_a_replayed_photo_says_the_noise_of_counted_light():
    """A region twice as bright has twice the variance of the same camera: drawn, and stated."""
    region = np.repeat(np.arange(3), 400).reshape(30, 40)
    light, middle, noise = np.array([0.1, 0.2, 0.6]), 0.2, 1e-4
    photo = photo_of(np.full((30, 40, 1), middle), np.full((30, 40, 1), noise))
    view = SimpleNamespace(photo=photo, measured=photo.signal.astype(float),
                           variance=photo.variance.astype(float), with_photo=lambda taken: taken,
                           scene_materials=(SimpleNamespace(name="paint"),),
                           surface_materials=("paint",))
    traced = TracedView(view, TracedTransport(np.array([[1]]), light[None, :, None, None], 1, 0.0),
                        region, np.zeros(3, int), Nuisances(scale=1.0))
    nothing, rng = np.zeros((3, 1)), np.random.default_rng(13)
    taken = [_photographed(traced, {"paint": np.ones(1)}, np.ones((1, 1, 1)), np.zeros(1), 0.0,
                           nothing, rng) for _ in range(600)]
    means = np.array([region_means(one.signal.astype(float), region)[:, 0] for one in taken])
    expected = noise * light / middle
    # 600 photos know a variance to 6 %
    np.testing.assert_allclose(means.var(axis=0) * 400, expected, rtol=0.25)
    stated = np.mean([region_means(one.variance.astype(float), region)[:, 0] for one in taken],
                     axis=0)
    np.testing.assert_allclose(stated, expected, rtol=0.01)


def test_deviations_of_a_trace_are_relative_to_its_signal_whatever_its_brightness():
    rng = np.random.default_rng(14)
    passes = np.array([1.0, 40.0])[:, None, None] * (1 + 0.1 * rng.standard_normal((8, 2, 1, 1)))
    one = TracedTransport(np.ones((1, 1), int), passes, 8, 0.0)
    three = TracedTransport(np.ones((1, 1), int), 3 * passes, 8, 0.0)
    np.testing.assert_allclose(three.relative_variance, one.relative_variance, rtol=1e-12)
