"""Errors that a session adds or hands on: exact small cases and draws.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from small_captures import (
    image,
    measured_chart,
    records_of,
    scene_capture,
    scene_view,
)
from test_posterior_laws import SMOOTH, mixture_of

from spectrabox.calibrate.held_out_patches import PatchesWithout
from spectrabox.calibrate.prior.curve_posterior import PhotoState
from spectrabox.calibrate.trust import certain_glare
from spectrabox.measure import rules
from spectrabox.measure.held_out_spectra import patches_without
from spectrabox.measure.pictures import illumination, photo_white, surface_textures
from spectrabox.measure.pictures.pixel_flags import SEEN
from spectrabox.measure.pictures.pixel_spectra import PictureLayout
from spectrabox.measure.pictures.texture_files import write_textures
from spectrabox.measure.regions.white import PhotoWhite
from spectrabox.measure.shoot.options import Repeatability, StrayLight
from spectrabox.measure.steps import inversion
from spectrabox.measure.surfaces.surface_spectra import score
from spectrabox.radiometry.error_model import REPEATABILITY, ROUNDED_EXPOSURES, SCENE_LEVEL
from spectrabox.radiometry.findings import Severity
from spectrabox.radiometry.records.calibration import ChartWhite, LightScale
from spectrabox.reconstruct.rendering.renderer import read_spectral_picture
from spectrabox.sampling.prior.mixture import PRIOR_GRID

SIGMAS = 3.9
CURVES = np.exp(-0.5 * ((PRIOR_GRID.nm - np.array([[600.0], [540.0], [460.0]])) / 35) ** 2)


# ---- light scales and stray light of several photos ----------------------------------------------

def test_glare_as_stated_and_as_the_chart_shows_are_independent():
    shown = np.array([0.0, 0.004, 0.0225])
    records = records_of(calibrate=SimpleNamespace(glare=shown))
    capture = scene_capture(stray_light=StrayLight(glare=0.003))
    found = inversion.glare_error(capture, records)
    np.testing.assert_allclose(found**2, 0.003**2 + shown**2)


def test_a_photo_without_a_chart_takes_that_under_its_own_light():
    views = (scene_view(chart="chart.dng"), scene_view("same"), scene_view("other", lamp="other"),
             scene_view("own", chart="own.dng", lamp="own"))
    capture = scene_capture(*views)
    first, _, _, own = views
    assert [inversion.view_of_chart(capture, view) for view in views] == [first, first, None, own]


@pytest.mark.parametrize("photo, causes", [
    ("chart.dng", ()), ("box.dng", (REPEATABILITY,))])
def test_light_and_shutter_repeat_from_photo_to_photo_alone(photo, causes):
    """A photo of chart and box in one has nothing to repeat."""
    calibrated = SimpleNamespace(light_scale=LightScale(5.0, 0.1, None, "chart photo"))
    shown = image(exposure_s=1 / 50)        # as cameras round it: the chart's is 1/60
    records = records_of(chart={"": measured_chart(thumbnail=image())})
    view = scene_view(photo=photo, chart="chart.dng")
    stated = Repeatability(light=0.012, shutter=0.016, scene_level=0.03)    # 0.02 together
    capture = scene_capture(view, repeatability=stated)
    found = inversion.scale_of_view(capture, view, shown, calibrated, records)
    errors = found.common_errors
    # where lamp and chart stood is as uncertain in one photo, and nothing measured it
    assert errors[SCENE_LEVEL] == 0.03
    assert [cause for cause in errors if cause == REPEATABILITY] == list(causes)
    assert all(errors[cause] == pytest.approx(0.02) for cause in causes)
    assert ROUNDED_EXPOSURES in errors
    # a material whose known spectrum says how bright the light is
    from_material = scene_capture(view, scale_from_chart=False)
    assert inversion.scale_of_view(from_material, view, shown, calibrated, records) is None


def test_glare_of_the_chart_is_told_where_it_is_beyond_chance_relative_to_the_picture():
    """Bands 2 and 3 are three errors from 0 and more; the picture's mean is what glare goes by."""
    glare = np.array([0.002, -0.004, 0.009])
    state = PhotoState(1.0, 0.01, np.ones(24), np.ones((24, 3)), ChartWhite(
        np.ones(3), np.zeros(0), glare, 1e-6 * np.eye(6)))
    signal = np.zeros((4, 5, 3))
    signal[0, 0] = 4.0, 8.0, 12.0           # of means 0.2, 0.4, 0.6
    found = certain_glare(SimpleNamespace(photos=[state]), SimpleNamespace(signal=signal))
    np.testing.assert_allclose(found, [0.0, 0.01, 0.015])


# ---- patches left out ----------------------------------------------------------------------------

def without(glare, factor=1.0):
    """Two patches as fits without them see them: curves, glare, and how both err."""
    rng, response = np.random.default_rng(81), CURVES * factor
    truth = np.linspace([0.2, 0.6], [0.5, 0.3], PRIOR_GRID.nm.size).T
    size = 3 * PRIOR_GRID.nm.size + 3
    root = rng.standard_normal((2, size, 4)) * np.r_[np.full(size - 3, 2e-3 * factor),
                                                     np.full(3, 0.05 * factor)][:, None]
    noise = (0.02 * factor) ** 2 * np.eye(3) * np.ones((2, 1, 1))
    offset = glare * np.ones((2, 3))
    return PatchesWithout(np.eye(PRIOR_GRID.nm.size), np.ones(PRIOR_GRID.nm.size),
                          np.repeat(response[None], 2, axis=0), offset,
                          root @ root.transpose(0, 2, 1), truth @ response.T + offset, noise,
                          np.zeros((2, 3), bool)), truth


def test_glare_and_the_unit_of_a_signal_change_nothing_of_a_patch_left_out():
    known = mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, 61)), [SMOOTH])
    found = [patches_without(patches, PRIOR_GRID, truth, np.zeros(2, bool), known)
             for patches, truth in (without(0.0), without(3.0), without(0.0, 50.0))]
    for other in found[1:]:
        for name in ("mean", "lower", "upper"):
            # round-off
            np.testing.assert_allclose(getattr(other, name), getattr(found[0], name), atol=1e-7)
    assert np.ptp(found[0].mean) > 0.1


def test_a_patch_is_seen_by_the_fit_without_it_and_not_by_those_without_others():
    """Two fits whose curves lean to the red and to the blue: each patch alone, and both at once."""
    known = mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, 61)), [SMOOTH])
    nm, plain = PRIOR_GRID.nm, without(0.0)[0]
    truth = 0.15 + 0.6 / (1 + np.exp(-(nm - np.array([[540.0], [600.0]])) / 10))
    response = CURVES * (1 + np.array([[[0.5]], [[-0.5]]]) * (nm - 550) / 150)
    noise = np.repeat(1e-4 * np.eye(3)[None], 2, axis=0)
    both = dataclasses.replace(plain, coefficients=response, noise=noise,
                               covariance=1e-6 * plain.covariance,
                               signal=np.einsum("ikp,ip->ik", response, truth))
    found = patches_without(both, PRIOR_GRID, truth, np.zeros(2, bool), known).mean
    for index in (0, 1):
        part = slice(index, index + 1)
        alone = dataclasses.replace(both, **{
            name: getattr(both, name)[part]
            for name in ("coefficients", "offset", "covariance", "signal", "noise", "clipped")})
        mean = patches_without(alone, PRIOR_GRID, truth[part], np.zeros(1, bool), known).mean[0]
        # bands of another lean tell of wavelengths 4 nm off: of an edge a tenth of a reflectance
        np.testing.assert_allclose(found[index], mean, atol=0.03)


def test_bands_that_repeat_others_judge_a_patch_as_those_do_of_less_noise():
    known = mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, 61)), [SMOOTH])
    plain, truth = without(0.0)
    plain = dataclasses.replace(plain, covariance=0 * plain.covariance)
    fivefold = PatchesWithout(
        plain.basis, plain.power, np.tile(plain.coefficients, (1, 5, 1)),
        np.tile(plain.offset, (1, 5)), np.zeros((2, 15 * 62, 15 * 62)),
        np.tile(plain.signal, (1, 5)), np.kron(5 * np.eye(5), plain.noise),
        np.zeros((2, 15), bool))
    found = [patches_without(patches, PRIOR_GRID, truth, np.zeros(2, bool), known)
             for patches in (plain, fivefold)]
    # signals are estimated by least squares: round-off
    np.testing.assert_allclose(found[1].mean, found[0].mean, atol=1e-6)
    np.testing.assert_allclose(found[1].upper, found[0].upper, atol=1e-6)


# ---- light of several colours over a picture -----------------------------------------------------

def test_a_signal_is_brought_to_another_light_exactly_where_spectra_are_as_expected():
    """Reflectances that differ by three curves, which three bands tell: what a pixel reads under a
    mixture of two lights becomes what it would read under the typical one.
    """
    rng, nm = np.random.default_rng(82), PRIOR_GRID.nm
    shapes = np.array([1 + 0 * nm, (nm - 550) / 150])
    three = np.array([np.ones(61), np.sin(nm / 70), np.cos(nm / 50)])
    mean = 0.4 + 0.1 * np.sin(nm / 90)
    light = illumination.Illumination(
        np.zeros((1, 2)), shapes, shapes[:, None] * CURVES, np.array([[1.0, 0.8], [1.0, -0.7]]),
        np.zeros(1, int))
    kind = rng.integers(2, size=40)
    # colours near the typical ones, of any strength: what is left is of second order
    away = np.column_stack([np.zeros(40), rng.uniform(-0.1, 0.1, 40)])
    maps = rng.uniform(0.5, 2, (40, 1)) * (light.typical[kind] + away)
    spectra = mean + 0.3 * rng.standard_normal((40, 3)) @ three

    def relative(weights):
        response = np.einsum("nq,qkp->nkp", weights, light.shapes)
        return np.einsum("nkp,np->nk", response, spectra) / response.sum(axis=2)
    own, wanted = relative(maps), relative(light.typical[kind])
    found = illumination.adapted_signals(own, light, maps, kind, (mean, three.T @ three))
    # signals taken to err by 1 % of white, of which reflectances differ by 30 %
    assert np.abs(found - wanted).max() < 0.1 * np.abs(own - wanted).max()
    assert np.abs(own - wanted).max() > 0.005


# ---- known surfaces of a picture -----------------------------------------------------------------

def surfaces_of(noise, texture, seed):
    """Twelve surfaces of one known material, of 400 nodes each, whose light is uneven."""
    rng = np.random.default_rng(seed)
    number = np.repeat(np.arange(12), 400)
    clean = 0.2 * CURVES.sum(axis=1) * np.ones((4800, 1))
    measured = clean * np.exp(texture * rng.standard_normal((4800, 1))) \
        + noise * clean * rng.standard_normal((4800, 3))
    names = {f"wall {index}": "paint" for index in range(12)}
    view = SimpleNamespace(
        sensitivities=CURVES, grid=SimpleNamespace(weights_nm=np.ones(61)), light_scale=None,
        scene_file=SimpleNamespace(surfaces=names), surface_materials=["paint"] * 12,
        scene_materials=[SimpleNamespace(name="paint", reflectance=np.full(61, 0.2))])
    scene = SimpleNamespace(
        view=view, nodes=SimpleNamespace(keys=[number]), relative_variance=np.zeros(4800),
        node_signals=(measured, (noise * clean) ** 2),
        compared=np.ones(4800, bool),
        disagreement=np.hypot(0.01, 0.01),
        joint=SimpleNamespace(views=[SimpleNamespace(
            light_scale=LightScale(1.0, 0.1, None, "photo"), findings=())]))
    return photo_white.compare_reference_surfaces(scene, np.ones((4800, 61)),
                                                         np.ones(4800, bool))


@pytest.mark.parametrize("texture", [0.0, 0.06])
def test_noise_of_pixels_is_no_disagreement_of_photo_and_light(texture):
    plain, noisy = surfaces_of(0.0, texture, 83), surfaces_of(0.1, texture, 83)
    # 4800 nodes know a variance of 0.1 squared to 2 %; what is below 0 counts as 0
    np.testing.assert_allclose(np.diag(noisy[1] - plain[1]), 0,
                               atol=SIGMAS * 0.02 * 0.1**2 + 2e-4 * (texture == 0))
    assert noisy[0].value == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("shape", [(6, 9), (12, 5)])
def test_the_texture_of_a_wall_seen_face_on_is_the_picture_of_it(tmp_path, monkeypatch, shape):
    """u runs to the right and v upwards, rows of a texture downwards."""
    rows, columns = shape
    row, column = (each.ravel() for each in np.mgrid[:rows, :columns])
    u, v = (column + 0.5) / columns, 1 - (row + 0.5) / rows
    monkeypatch.setattr(surface_textures, "hits_of", lambda *_: (
        np.column_stack([u * columns, v * rows, 0 * u]), np.ones(u.size), np.column_stack([u, v])))
    scene = SimpleNamespace(
        crop=SimpleNamespace(rows=slice(0, rows), columns=slice(0, columns)),
        view=SimpleNamespace(surface_materials=["paint"], known=(), size=(columns, rows),
                             scene_file=SimpleNamespace(surfaces={"wall": "bsdf"})),
        nodes=SimpleNamespace(surface=np.zeros(shape, int)),
        unit=SimpleNamespace(scene=None))
    seen, mean = np.full(rows * columns, SEEN), np.full((rows * columns, 61), 0.5)
    mean[:, 0], mean[:, 1] = row / 16, column / 16
    layout = PictureLayout(5, full=True)
    made = surface_textures.TextureSums(scene, seen.reshape(shape), layout)
    for first in range(0, rows, 2):         # some rows at a time
        part = slice(first * columns, (first + 2) * columns)
        made.add(first, first + 2, seen[part], mean[part], mean[part])
    write_textures(made, layout, tmp_path)
    picture, nm = read_spectral_picture(str(tmp_path / "texture-wall.exr"))
    np.testing.assert_array_equal(nm, PRIOR_GRID.nm)
    np.testing.assert_array_equal(picture, mean.reshape(*shape, 61))    # sixteenths


# ---- white at every pixel of flat samples --------------------------------------------------------

def test_errors_of_white_and_glare_are_those_of_small_changes_of_all_unknowns():
    """Against differences of the logarithm of white and of the glare by each unknown."""
    bands, step = 3, 1e-4
    field = np.array([-0.1, 0.0, 0.05, 0.2])
    size = 2 * bands + field.size + 2
    root = 0.01 * np.random.default_rng(84).standard_normal((size, 2 * size))
    white = PhotoWhite(
        SimpleNamespace(names=tuple("abcd")),
        np.array([0.6, 0.8, 0.5]), field, 1.3, np.full(bands, 0.01), ("shutter", "lamp"),
        np.zeros(size), root @ root.T)

    def at(mean, region):
        moved = dataclasses.replace(white, mean=mean)
        return np.r_[np.log(moved.white[region]), moved.glare + moved.mean[bands:2 * bands]]

    for region in range(field.size):
        slopes = np.array([(at(change, region) - at(-change, region)) / (2 * step)
                           for change in step * np.eye(size)]).T
        # linear: round-off over the step, 1e-12
        np.testing.assert_allclose(white.white_and_glare(region),
                                   slopes @ white.covariance @ slopes.T, rtol=1e-8, atol=1e-14)


# ---- what is counted -----------------------------------------------------------------------------

def test_a_pixel_is_clipped_where_any_band_is():
    saturated = np.zeros((10, 20, 3), bool)
    saturated[0, :10, 1] = saturated[0, 5:15, 2] = True
    photo = dataclasses.replace(image(np.full((10, 20, 3), 0.4)), saturated=saturated)
    assert photo.clipped_share == pytest.approx(15 / 200)
    found = rules.clipped("flat.clipped", SimpleNamespace(photo_of_view={"": photo}))
    assert found.values["value"] == photo.clipped_share and found.severity is Severity.WARN


def test_a_band_is_as_wide_as_it_is_in_the_mean():
    nm = PRIOR_GRID.nm
    summary = SimpleNamespace(grid=PRIOR_GRID, mean=np.full(61, 0.4), lower=np.full(61, 0.3),
                              upper=0.4 + (nm - 400) / 3000, bound_lower=np.zeros(61),
                              bound_upper=np.ones(61))
    samples = SimpleNamespace(grid=PRIOR_GRID, spectra=np.full((3, 61), 0.4))
    assert score(np.full(61, 0.4), None, summary, samples).band_width == pytest.approx(0.15)
