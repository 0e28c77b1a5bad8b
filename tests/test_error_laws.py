"""Stated errors against the errors made: p-values are uniform, variances unbiased.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from calibrate_cameras import (
    GRID,
    cameras,
    coarse_prior,
    daylight,
    on_grid,
    photo,
    reflectances,
    signals,
)
from scipy import stats

from spectrabox.calibrate.chart_equations import (
    PatchError,
    field_terms,
    noise_of_photos,
    predicted_signal,
    unlit_design,
)
from spectrabox.calibrate.prior.curve_posterior import PhotoState
from spectrabox.calibrate.prior.prior_fit import held_out_signals, posterior_of_curves
from spectrabox.calibrate.spline_fit import band_fits
from spectrabox.calibrate.trust import fit_findings
from spectrabox.capture.chart.patches import VARIANCE_LEFT_BY_CLIPPING, sample_patches
from spectrabox.measure.more_bands.joined_errors import _of_cause
from spectrabox.measure.surfaces.colour_comparison import independent_bands
from spectrabox.radiometry.covariance import common_variance, is_covariance
from spectrabox.radiometry.error_model import DISAGREEMENT
from spectrabox.radiometry.grid import basis_matrix
from spectrabox.radiometry.records.calibration import ChartWhite
from spectrabox.radiometry.records.photos import ChartDetection, LinearImage, PhotoKind
from spectrabox.radiometry.records.scenes import SurfaceAgreement
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.filters import unknown_filter
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum
from spectrabox.reconstruct.agreement import model_covariance, scene_errors, surface_covariance
from spectrabox.reconstruct.misfit import SHAPE_ERROR, surface_tests
from spectrabox.sampling.prior.mixture import PRIOR_GRID

SIGNIFICANCE = 1e-4
SIGMAS = stats.norm.isf(SIGNIFICANCE / 2)


def image(signal, variance=1e-6):
    signal = np.asarray(signal, np.float32)
    return LinearImage(signal, np.full_like(signal, variance), np.zeros(signal.shape, bool), 1.0,
                       0.1, 100.0, 8.0, PhotoKind.RAW, "", "IMG.dng", "")


def p_values(kind, surface, scenes, surface_error):
    masks = [surface == index for index in range(surface.max() + 1)]
    model = np.full((*surface.shape, 3), 0.5)
    return np.ravel([surface_tests(scene, model, masks, surface_error)[2][kind]
                     for scene in scenes])


@pytest.mark.parametrize("surface_error", [0.0, 0.003])
def test_p_values_of_levels_are_uniform_on_scenes_that_fit(surface_error):
    rng = np.random.default_rng(21)
    surface = np.repeat(np.arange(4), 12)[:, None] * np.ones((1, 48), int)
    scenes = [0.5 * np.exp(surface_error * rng.standard_normal((4, 3)))[surface]
              * (1 + 0.05 * rng.standard_normal((48, 48, 3))) for _ in range(70)]
    values = p_values(0, surface, scenes, surface_error)
    assert values.size == 840 and stats.kstest(values, "uniform").pvalue > SIGNIFICANCE


def test_p_values_of_shapes_are_uniform_where_blocks_err_as_stated():
    rng = np.random.default_rng(22)
    row, column = np.mgrid[:48, :48]
    surface = row // 8 * 6 + column // 8            # of four blocks each
    scenes = [0.5 * (1 + SHAPE_ERROR * rng.standard_normal((12, 12, 3)).repeat(4, 0).repeat(4, 1)
                     + 1e-3 * rng.standard_normal((48, 48, 3))) for _ in range(12)]
    values = p_values(1, surface, scenes, 0.01)
    assert values.size == 1296 and stats.kstest(values, "uniform").pvalue > SIGNIFICANCE


def agreement(log_ratios, materials):
    count = len(log_ratios)
    return SurfaceAgreement(tuple(f"{name} / {index}" for index, name in enumerate(materials)),
                            materials, np.full(count, 400), np.exp(log_ratios),
                            np.zeros(log_ratios.shape))


@pytest.mark.parametrize("known", [frozenset(), frozenset(f"paint {i}" for i in range(600))])
def test_scatter_between_surfaces_is_estimated_without_bias(known):
    rng, brightness, colour = np.random.default_rng(25), 0.02, 0.01
    truth = brightness**2 + colour**2 * np.eye(3)
    offsets = rng.multivariate_normal(np.zeros(3), truth, 1200)
    if not known:       # a fit takes up what the surfaces of a material have in common
        offsets += np.repeat(rng.normal(0, 0.1, (600, 3)), 2, axis=0)
    seen = agreement(offsets, tuple(f"paint {index // 2}" for index in range(1200)))
    # 600 degrees of freedom know a variance to 6 %
    np.testing.assert_allclose(surface_covariance(seen, known, 0.0), truth,
                               atol=0.25 * truth[0, 0])
    np.testing.assert_allclose(np.diag(surface_covariance(seen, known, 0.0)), np.diag(truth),
                               rtol=0.25)
    errors = scene_errors(seen, known, 0)
    assert errors.brightness == pytest.approx(np.hypot(brightness, colour / np.sqrt(3)), rel=0.12)
    assert errors.colour == pytest.approx(colour, rel=0.09)     # twice the degrees of freedom


@pytest.mark.parametrize("method, understated", [("paper", 1.0), ("nonnegative", 3.0)])
def test_covariance_of_splines_is_that_of_their_errors(method, understated):
    rng, bands, sigma = np.random.default_rng(26), 60, 1e-6
    rows = reflectances() * daylight() / GRID.nm.size
    coefficients = np.pad(rng.uniform(0.5, 1, (bands, 8)), ((0, 0), (1, 1)))
    signal = rows @ basis_matrix(GRID.nm, 10) @ coefficients.T
    signal = signal + sigma * rng.standard_normal(signal.shape)
    used = np.ones(signal.shape, bool)
    _, fit = band_fits(method, rows, signal, np.full(signal.shape, sigma / understated), GRID, 10,
                       used)
    found, covariance = fit(used)
    design = rows @ basis_matrix(GRID.nm, 10)[:, 1:-1]
    exact = np.diag(np.linalg.inv(design.T @ design)) * sigma**2
    assert np.all(found[:, 1:-1] > 0)
    # 16 degrees of freedom each: the mean of 60 variances is known to 4.6 %
    share = np.diagonal(covariance[:, 1:-1, 1:-1], axis1=1, axis2=2) / exact
    np.testing.assert_allclose(share.mean(axis=0), 1, atol=0.18)


@pytest.mark.parametrize("pixels, tolerance", [(8, 0.04), (60, 0.01)])
def test_covariance_of_a_patch_is_that_of_its_mean(pixels, tolerance):
    rng = np.random.default_rng(27)
    side = 24 * (pixels + 4) if pixels < 16 else 640
    truth = 1e-4 * np.array([[1.0, 0.5, 0.0], [0.5, 2.0, -0.4], [0.0, -0.4, 1.5]])
    noise = rng.multivariate_normal(np.zeros(3), truth, (side, side))
    corner = 2 + (pixels + 4) * np.arange(side // (pixels + 4))
    quads = np.array([[[x, y], [x + pixels - 1, y], [x + pixels - 1, y + pixels - 1],
                       [x, y + pixels - 1]] for y in corner for x in corner], float)
    patches = sample_patches(image(0.5 + noise, 1e-6), ChartDetection(quads, 1.0, False, ""))
    scatter = (patches.covariance_of_mean * patches.pixels[:, None, None]).mean(axis=0)
    size = np.sqrt(np.diag(truth))
    # 37 000 pixels know a variance to 0.8 %, 300 000 to 0.3 %
    np.testing.assert_allclose(scatter / np.outer(size, size), truth / np.outer(size, size),
                               atol=tolerance)
    spread = np.mean((patches.mean - 0.5)**2 / np.diagonal(patches.covariance_of_mean, axis1=1,
                                                           axis2=2), axis=0)
    # means of independent patches
    np.testing.assert_allclose(spread, 1, atol=0.1 + SIGMAS * np.sqrt(2 / len(quads)))


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.03, -0.01), (-0.05, 0.05)])
def test_uneven_light_changes_nothing_of_what_counts_as_dust(slope):
    rng, pixels = np.random.default_rng(34), 24
    # no pixel near 3 sigma: noise has hard ends at 1.35 sigma, dust lies far beyond
    noise = 0.004 * rng.uniform(-1, 1, (pixels, pixels, 3))
    dust = np.zeros((pixels, pixels), bool)
    dust[rng.integers(0, pixels, 9), rng.integers(0, pixels, 9)] = True
    noise[dust, 1] -= 0.1
    row, column = np.mgrid[:pixels, :pixels] - (pixels - 1) / 2
    light = 1 + (slope[0] * row + slope[1] * column)[..., None]
    quads = np.array([[[0, 0], [pixels - 1, 0], [pixels - 1, pixels - 1], [0, pixels - 1]]], float)
    patches = sample_patches(image(light + noise, 1e-6), ChartDetection(quads, 1.0, False, ""))
    assert patches.pixels[0] == pixels**2 - dust.sum()
    terms = np.stack([np.ones(row.shape), row, column], axis=-1)[~dust]
    clean = noise[~dust]
    left = clean - terms @ np.linalg.lstsq(terms, clean, rcond=None)[0]
    expected = left.T @ left / (len(left) - 3) / len(left) / VARIANCE_LEFT_BY_CLIPPING
    # signals are kept as 32-bit floats: 1e-7 of them, beside noise of 4e-3
    np.testing.assert_allclose(patches.covariance_of_mean[0], expected, atol=1e-3 * expected.max())


def test_pixels_at_the_clip_point_count_as_saturated_where_they_are_left_out_as_glints():
    rng, pixels = np.random.default_rng(35), 20
    signal = 0.5 + 0.003 * rng.uniform(-1, 1, (pixels, pixels, 3))
    glint = np.zeros((pixels, pixels), bool)
    glint[rng.integers(0, pixels, 17), rng.integers(0, pixels, 17)] = True
    signal[glint, 0] = 1.0
    saturated = np.zeros(signal.shape, bool)
    saturated[glint, 0] = True
    quads = np.array([[[0, 0], [pixels - 1, 0], [pixels - 1, pixels - 1], [0, pixels - 1]]], float)
    patches = sample_patches(dataclasses.replace(image(signal), saturated=saturated),
                             ChartDetection(quads, 1.0, False, ""))
    assert patches.pixels[0] == pixels**2 - glint.sum()
    np.testing.assert_allclose(patches.saturated_fraction[0], [glint.mean(), 0, 0], rtol=1e-12)


def test_errors_of_a_chart_photo_are_correlated_as_its_bands_are():
    rng = np.random.default_rng(28)
    truth = 1e-6 * np.array([[4.0, 3.0, 0.0], [3.0, 4.0, -1.0], [0.0, -1.0, 2.0]])
    light, surfaces = daylight(), reflectances()
    signal = signals(on_grid(cameras(1, 40)[0]), light, surfaces)
    signal /= signal.max()
    scales = rng.uniform(0.5, 2, 24)
    chart = dataclasses.replace(photo(signal, light, surfaces),
                                covariance=scales[:, None, None] * truth)
    errors = np.sqrt(scales)[:, None] * rng.multivariate_normal(np.zeros(3), truth, (2000, 24))
    whitened = np.linalg.solve(np.linalg.cholesky(noise_of_photos([chart], PatchError(0.0))),
                               errors.reshape(2000, -1).T)
    # 2000 draws know a correlation to 2.2 %; 4.9 sigma for the largest of 2600
    np.testing.assert_allclose(whitened @ whitened.T / 2000, np.eye(72), atol=0.16)
    posterior = posterior_of_curves([chart], coarse_prior(), GRID, model_errors=(1e-6,))
    without = held_out_signals([chart], coarse_prior(), GRID, posterior)[2]
    # a model error of 1e-6 beside a noise of 1e-3
    np.testing.assert_allclose(without.noise, chart.covariance, rtol=1e-4, atol=1e-10)


@pytest.mark.parametrize("role, unit, factor", [
    (Quantity.REFLECTANCE, "percent", 100.0), (Quantity.RADIANCE, "mW m-2 sr-1 nm-1", 1000.0)])
def test_a_standard_error_has_the_unit_of_its_spectrum(tmp_path, role, unit, factor):
    head = f"# quantity: {role.name.lower()}\n# unit: "
    columns = "\nwavelength_nm,value,standard_error\n"
    estimates = []
    for name, times in ((role.value, 1.0),
                        (unit, factor)):
        path = tmp_path / f"{times:g}.csv"
        path.write_text(head + name + columns + "".join(
            f"{nm},{times * value},{times * 0.02 * value}\n"
            for nm, value in ((400, 0.25), (500, 0.5), (600, 0.4))), encoding="utf-8")
        estimates.append(read_spectrum(path, role=role))
    one, other = estimates
    np.testing.assert_allclose(other.values, one.values, rtol=1e-12)
    np.testing.assert_allclose(other.standard_error, one.standard_error, rtol=1e-12)
    np.testing.assert_allclose(one.standard_error / one.values, 0.02, rtol=1e-12)


# mu as of Latin-1 and as of Greek
@pytest.mark.parametrize("power, area, factor", [
    ("W", "m-2", 1.0), ("mW", "m-2", 1e-3), ("uW", "cm-2", 1e-6 / 1e-4),
    ("\u00b5W", "cm-2", 1e-6 / 1e-4), ("\u03bcW", "cm-2", 1e-6 / 1e-4)])
@pytest.mark.parametrize("solid_angle", [True, False])
def test_a_unit_of_light_is_watts_over_square_metres(tmp_path, power, area, factor, solid_angle):
    unit = f"{power} {area} {'sr-1 ' if solid_angle else ''}nm-1"
    role = Quantity.RADIANCE if solid_angle else Quantity.IRRADIANCE
    (tmp_path / "light.csv").write_text(
        f"# quantity: {role.name.lower()}\n# unit: {unit}\nwavelength_nm,value\n400,2\n500,3\n"
        "600,4\n", encoding="utf-8")
    spectrum = read_spectrum(tmp_path / "light.csv", role=role)
    np.testing.assert_allclose(spectrum.values, np.array([2, 3, 4]) * factor, rtol=1e-12)


def test_each_bands_own_error_of_a_dark_patch_is_that_of_one_with_a_fifth_of_the_brightest():
    """Real dark paints depart from their published spectra by as much as light ones."""
    signal = np.array([[1.0, 0.5, 2.0]]) * np.geomspace(1, 1e-3, 24)[:, None]
    chart = photo(signal, daylight(), reflectances(), 0.001)
    added = np.diag(noise_of_photos([chart], PatchError(0.02))
                    - noise_of_photos([chart], PatchError(0.0))).reshape(24, 3)
    share = np.maximum(signal / signal.max(axis=0), 0.2)
    np.testing.assert_allclose(np.sqrt(added), 0.02 * share * signal.max(axis=0), rtol=1e-9)


def test_a_material_is_off_by_what_its_surfaces_are_off_by_together_and_apart():
    """Means of n surfaces: their common offset, an n-th of their scatter, and that of their blocks.
    """
    rng = np.random.default_rng(29)
    materials = ("wall",) * 4 + ("cloth",) * 2 + ("card",)
    logs = 0.02 * rng.standard_normal((7, 3))
    spread = np.abs(0.01 * rng.standard_normal((7, 3)))
    pixels = np.array([100, 300, 200, 400, 50, 150, 600])
    seen = SurfaceAgreement(tuple(map(str, range(7))), materials, pixels, np.exp(logs), spread)
    for name in ("wall", "cloth", "card"):
        own = np.array([material == name for material in materials])
        share = pixels[own] / pixels[own].sum()
        offset = share @ logs[own]
        blocks = sum(part * np.outer(one, one)
                     for part, one in zip(share, spread[own], strict=True))
        apart = surface_covariance(seen, frozenset({"card"}), 0.01) / own.sum()
        # sums of a few numbers
        np.testing.assert_allclose(model_covariance(seen, name, frozenset({"card"}), 0.01),
                                   apart + blocks + np.outer(offset, offset), rtol=1e-10)
        # a signal that is taken brighter than the rendering absorbs that much of the offset
        taken = np.array([1.02, 0.99, 1.05])
        left = offset - np.log(taken)
        np.testing.assert_allclose(
            model_covariance(seen, name, frozenset({"card"}), 0.01, taken),
            apart + blocks + np.outer(left, left), rtol=1e-10)
    assert not model_covariance(seen, "glass", frozenset(), 0.01).any()


@pytest.mark.parametrize("sigmas, claimed", [(2.0, False), (4.0, True)])
def test_glare_is_claimed_beyond_three_of_its_standard_errors(sigmas, claimed):
    """Of 5 % of the brightest patch: much, where it is certain."""
    glare = np.array([0.05, 0.0, 0.0])
    state = PhotoState(1.0, 0.01, np.ones(24), np.ones((24, 3)), ChartWhite(
        np.ones(3), np.zeros(0), glare, (0.05 / sigmas) ** 2 * np.eye(6)))
    fit = SimpleNamespace(model_error=0.002, chi_square=1.0, families=(), photos=(state,),
                          prior_share=np.zeros((3, GRID.nm.size)))
    glare = [one.values["glare"] for one in fit_findings(fit, GRID)
             if one.code == "calibration.glare"]
    assert glare == ([pytest.approx(0.05)] if claimed else [])


@pytest.mark.parametrize("with_glare, through", [(True, None), (False, None),
                                                 (True, unknown_filter())])
def test_derivatives_of_a_chart_photo_are_those_of_differences(with_glare, through):
    light, rng = daylight(), np.random.default_rng(30)
    chart = photo(np.full((24, 3), 0.3), light, reflectances(), 0.01,
                  field_terms(rng.uniform(size=(24, 2))), with_glare)
    chart = dataclasses.replace(chart, filter=through)
    basis = basis_matrix(GRID.nm, 6)
    modes = chart.modes(basis)
    design, count = unlit_design(chart, basis), (8 if with_glare else 5) + modes.shape[1]
    at = np.r_[rng.uniform(0.5, 1, 18), 0.2, 0.1 * rng.standard_normal(count)]

    def signal(state):
        return predicted_signal(chart, design, state[:18].reshape(3, 6), state[18], state[19:],
                                modes)
    estimate, step = signal(at)[1], 1e-6
    # central differences: the third derivative times the step squared, and eps over the step
    for index, unit in enumerate(np.eye(at.size)):
        ahead, behind = (signal(at + sign * step * unit)[0] for sign in (1, -1))
        np.testing.assert_allclose(estimate[:, index], (ahead - behind) / (2 * step), rtol=1e-6,
                                   atol=1e-8 * np.abs(ahead).max())


@pytest.mark.parametrize("rank", [4, 12])
def test_bands_that_depend_on_each_other_say_what_a_few_of_them_say(rank):
    rng = np.random.default_rng(4)
    few = np.abs(np.sin(np.outer(np.arange(1, 5), PRIOR_GRID.nm / 90))) + 0.01
    sums = rng.uniform(0.2, 1, (8, 4)) @ few
    many = np.vstack([few, sums if rank == 4 else sums + rng.uniform(0, 1, sums.shape)])
    many = many / many.sum(axis=1, keepdims=True)
    factor = rng.standard_normal((12, 12))
    covariance = 1e-5 * (np.eye(12) + factor @ factor.T)
    signal = many @ (0.3 + 0.2 * np.sin(PRIOR_GRID.nm / 60))
    chosen, gain = independent_bands(many, covariance)
    assert len(chosen) == rank and np.all(np.diff(chosen) > 0)
    # the information on reflectances, and what was measured of it, are those of all bands
    left = gain @ covariance @ gain.T
    for of_all, of_few in ((many.T @ np.linalg.solve(covariance, many),
                            many[chosen].T @ np.linalg.solve(left, many[chosen])),
                           (many.T @ np.linalg.solve(covariance, signal),
                            many[chosen].T @ np.linalg.solve(left, gain @ signal))):
        # round-off of two solutions with a condition of 1e4
        np.testing.assert_allclose(of_few, of_all, atol=1e-9 * np.abs(of_all).max())


@pytest.mark.parametrize("same_lamp", [True, False])
def test_what_photos_disagree_by_together_is_a_covariance_whatever_the_bands_have_in_common(
        same_lamp):
    rng, photos = np.random.default_rng(12), [SimpleNamespace(same_lamp=same_lamp)] * 2
    blocks, signal = [slice(3, 6), slice(6, 9)], rng.uniform(0.05, 0.9, 9)
    for _ in range(50):
        bands = rng.standard_normal((3, 4)) * rng.uniform(0.1, 1, (3, 1)) * signal[:3, None]
        own = 0.001 * bands @ bands.T
        assert is_covariance(_of_cause(DISAGREEMENT, own, signal, blocks, photos)
                             + np.pad(own, (0, 6)))


def test_of_bands_alike_the_common_part_is_what_they_have_in_common():
    """One factor of variance c over K independent parts of variance a: all of c, and a / K."""
    covariance = 0.3 + np.diag([0.2] * 4)
    assert common_variance(covariance, np.ones(4)) == pytest.approx(0.3 + 0.2 / 4)
