"""Laws of pictures of spectra: errors of pixels, areas that pixels stand for, scatter of surfaces.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from sampling_cameras import response, seen
from scipy.sparse import csr_array
from small_captures import photo
from test_posterior_laws import SMOOTH, mixture_of
from test_sampling_uplift import painted

from spectrabox.capture.photo.registration import resampled
from spectrabox.measure.pictures import photo_white as references
from spectrabox.measure.pictures import scene_light
from spectrabox.measure.pictures.crop import Crop
from spectrabox.measure.pictures.illumination import Illumination, adapted_signals, even_light
from spectrabox.measure.pictures.lit_photo import GREY, LitPhoto
from spectrabox.measure.pictures.pixel_errors import PixelErrors, White
from spectrabox.measure.pictures.pixel_flags import CLIPPED, SEEN
from spectrabox.measure.pictures.pixel_spectra import (
    PictureLayout,
    block_spectra,
    spectra_tables,
    survey,
)
from spectrabox.measure.pictures.stacked_photos import shown_bands
from spectrabox.radiometry import error_model
from spectrabox.radiometry.gloss import gloss_states
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.reconstruct.pixel_light import LightNodes
from spectrabox.sampling.prior import local_posteriors
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior, reflectance_moments

GRID = visible_grid()


def errors_of(white, **changes):
    """Errors of which only white, glare and noise count."""
    bands = white.signal.shape[1]
    none = np.zeros((bands, bands))
    parts = dict.fromkeys(("between", "light", "calibrations", "fine_responses", "prior"))
    parts |= {"white": white, "glare": np.zeros(bands), "glare_covariance": none,
              "photo_of_band": np.zeros(bands, int), "relative": none,
              "gloss": gloss_states("matt", ["lamp"] * bands).through(none)}
    return PixelErrors(**parts | changes)


def lit_photo(rng):
    """A photo of all brightnesses whose variance is a constant and a slope by the signal."""
    signal = rng.uniform(0.05, 0.9, (40, 50, 3))
    return photo(signal=signal.astype(np.float32), saturated=np.zeros(signal.shape, bool),
                 variance=(2e-5 + 1e-4 * signal).astype(np.float32))


@pytest.mark.parametrize("glare", [0.0, 0.03])
def test_a_mid_grey_at_a_node_errs_as_pixels_of_it_do(glare):
    """Draws of white there and of the photo's noise; glare adds light, and so noise."""
    rng = np.random.default_rng(1)
    white = White(np.array([[0.9, 0.5, 0.7], [0.2, 0.1, 0.3]]),
                  np.tile(0.01**2 * (np.eye(3) + 1), (2, 1, 1)), np.zeros((2, 3, 3)))
    pixels = LitPhoto(lit_photo(rng), errors_of(white, glare=np.full(3, glare)))
    found = pixels.grey_variance
    for node, signal in enumerate(white.signal):
        logs = rng.multivariate_normal(np.zeros(3), white.log[node], 60_000)
        light = GREY * signal
        noise = np.sqrt(2e-5 + 1e-4 * (light + glare)) * rng.standard_normal(logs.shape)
        relative = (light + noise) / (signal * np.exp(logs)) / GREY
        # 60 000 draws in three bands know a variance to 0.4 %
        assert found[node] == pytest.approx(relative.var(axis=0).mean(), rel=0.03)


def test_what_a_surface_may_mirror_is_taken_off_a_pixel_and_is_one_of_its_errors():
    white = White(np.array([[0.5, 0.8, 0.4]]), np.zeros((1, 3, 3)), np.zeros((1, 3, 3)))
    states = gloss_states("satin", ["lamp"] * 3)
    blocks, errors = [], []
    for gloss in (states.through(np.zeros((3, 3))), states):
        parts = errors_of(
            white, gloss=gloss, light=even_light(response(3)[1], 1), prior=load_prior(),
            between=lambda first, last: csr_array(np.ones((50 * (last - first), 1))))
        blocks.append(LitPhoto(lit_photo(np.random.default_rng(4)), parts).block(0, 2))
        errors.append(parts.at_white(np.full((1, 3), 0.4), white, np.zeros((1, 3)))[0])
    np.testing.assert_allclose(blocks[0].measured - blocks[1].measured, states.mean[0], rtol=1e-6)
    np.testing.assert_allclose(errors[1] - errors[0], states.covariance[0, 0])


def test_white_that_errs_with_the_glare_makes_pixels_err_more():
    """White taken for too bright and glare for too strong: each makes a signal too small."""
    rng, signal = np.random.default_rng(2), np.array([0.4, 0.6])
    root = 0.01 * rng.standard_normal((4, 4)) + 0.01 * np.eye(4)
    whole = root @ root.T           # of log white, and of the glare's signal
    white = White(np.array([[0.5, 0.8]]), whole[None, :2, :2], whole[None, :2, 2:])
    found = errors_of(white, glare_covariance=whole[2:, 2:]).at_white(
        signal[None], white, np.zeros((1, 2)))[0]
    drawn = rng.multivariate_normal(np.zeros(4), whole, 60_000)
    seen = (signal * white.signal[0] + 0.05 - (0.05 + drawn[:, 2:])) / (
        white.signal[0] * np.exp(drawn[:, :2]))
    size = np.sqrt(np.diag(found))
    # 60 000 draws know a variance to 0.6 %; errors of 2 % are straight to as much
    np.testing.assert_allclose(np.cov(seen.T) / np.outer(size, size),
                               found / np.outer(size, size), atol=0.05)


def test_a_material_is_what_its_surface_reflects_and_not_what_most_pixels_show(monkeypatch):
    """Two halves of a wall, the far one in a third as many pixels, each of thrice the area; and
    another wall beside it.
    """
    levels = np.repeat([0.2, 0.8, 0.6], [6, 2, 4])
    spectra = levels[:, None] * np.ones(PRIOR_GRID.nm.size)
    monkeypatch.setattr(LitPhoto, "block",
                        lambda *_, **__: SimpleNamespace(seen=np.ones(levels.size, bool)))
    monkeypatch.setattr(LitPhoto, "direct", lambda *_, **__: (spectra, None, None))
    chart, dark = photo(), np.zeros((1, 3, 3))
    nodes = SimpleNamespace(weights=lambda row, column: csr_array(np.ones((levels.size, 1))))
    scene = SimpleNamespace(view=SimpleNamespace(photo=chart, grid=GRID),
                            nodes=nodes)
    pixels = LitPhoto(chart, errors_of(White(np.ones((1, 3)), dark, dark)))
    found = scene_light.mean_spectra(
        scene, pixels, np.repeat([2, 5], [8, 4]), np.zeros(levels.size, int),
        np.arange(levels.size), np.repeat([1.0, 3.0, 2.0], [6, 2, 4]))
    assert found.keys() == {2, 5}
    np.testing.assert_allclose(found[2], 0.5, rtol=1e-12)
    np.testing.assert_allclose(found[5], 0.6, rtol=1e-12)


@pytest.mark.parametrize("walls", [1, 3])
@pytest.mark.parametrize("spread", [0.0, 0.02, 0.05])
def test_scatter_of_a_known_surface_is_that_beyond_its_noise(monkeypatch, spread, walls):
    rng, bands, nodes = np.random.default_rng(3), 3, 4000
    noise, traced_noise = 0.03, 0.01
    light, sensed = np.ones((nodes, GRID.nm.size)), np.ones((bands, GRID.nm.size))
    predicted = 0.5 * (sensed * GRID.weights_nm).sum(axis=1)
    measured = predicted * np.exp(spread * rng.standard_normal((nodes, bands))
                                  + traced_noise * rng.standard_normal((nodes, 1))
                                  + noise * rng.standard_normal((nodes, bands)))
    material = SimpleNamespace(name="white", reflectance=np.full(GRID.nm.size, 0.5))
    view = SimpleNamespace(sensitivities=sensed, grid=GRID, scene_materials=(material,),
                           surface_materials=("white",) * walls,
                           light_scale=LightScale(1, 0, None, ""),
                           scene_file=SimpleNamespace(surfaces=dict.fromkeys(
                               map(str, range(walls)), "white")))
    scene = SimpleNamespace(
        view=view, node_signals=(measured, (noise * measured)**2), compared=np.ones(nodes, bool),
        nodes=SimpleNamespace(
            keys=np.array([np.arange(nodes) % walls, *np.zeros((2, nodes), int)])),
        relative_variance=np.full(nodes, traced_noise**2),
        disagreement=0.0,
        joint=SimpleNamespace(views=[SimpleNamespace(light_scale=LightScale(1, 0, None, ""),
                                                     findings=())]))
    monkeypatch.setattr(references, "surface_covariance", lambda *_: np.zeros((bands, bands)))
    _, found = references.compare_reference_surfaces(scene, light, np.ones(nodes, bool))
    # 4000 nodes know a variance of 3 % squared to 2.2 %: 2e-5
    np.testing.assert_allclose(np.diag(found), spread**2, atol=3.9 * 2.2e-2 * (
        noise**2 + traced_noise**2 + spread**2))



def test_spectra_are_expected_behind_signals_as_draws_of_the_prior_have_them():
    """Regression of what another light shows on a signal that is known to 1 % of white."""
    prior = mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, 61)), [0.1**2 * SMOOTH])
    response = seen(np.ones(61)).relative_response
    tinted = response * np.linspace(0.7, 1.3, 61)
    light = Illumination(np.ones((1, 2)), np.ones((2, 1)), np.array([response, tinted]),
                         np.array([[0.8, 0.2]]), np.zeros(1, int))
    mean, covariance = reflectance_moments(prior)
    rng = np.random.default_rng(4)
    drawn = rng.multivariate_normal(mean, covariance, 40_000)
    signals = drawn @ light.responses[0].T + 0.01 * rng.standard_normal((40_000, 3))
    shown = np.einsum("qkp,np->nqk", light.shapes, drawn).reshape(40_000, 6)
    centre, middle = light.responses[0] @ mean, light.shapes @ mean
    slopes = np.linalg.lstsq(signals - centre, shown - middle.ravel(), rcond=None)[0]
    # a standard deviation away from the mean of each band
    some = centre + np.diag(np.sqrt(np.diag(np.cov(signals.T))))
    under = middle + ((some - centre) @ slopes).reshape(3, 2, 3)
    white, typical = light.shapes.sum(axis=2), light.typical[0]
    for own, maps in enumerate(np.eye(2)):
        expected = some - under[:, own] / white[own] + (typical @ under) / (typical @ white)
        found = adapted_signals(some, light, np.tile(maps, (3, 1)), None,
                                (mean, covariance))
        # 40 000 draws know a slope to 0.5 % or better
        np.testing.assert_allclose(found, expected, atol=0.01 * np.abs(some - centre).max())


def test_what_is_uncertain_of_the_light_on_a_node_adds_up_as_variances(monkeypatch):
    """Noise of tracing, light that is misplaced where it changes, and light from elsewhere."""
    nodes = LightNodes(np.zeros((12, 16), int), 4)
    _, row, column = nodes.keys
    light = (1 + 0.01 * column)[:, None] * np.ones(GRID.nm.size)    # rises by 1 % a node
    bands, traced_noise, ambient = 3, 0.004, 0.003
    to_signals = np.ones((bands, GRID.nm.size, 61)) / (61 * GRID.nm.size)
    for module, name, value in (
            (references, "compare_reference_surfaces",
             (LightScale(1.0, 0.0, None, ""), np.zeros((bands, bands)))),
            (scene_light, "_calibration_under", None), (scene_light, "crop_photo", None),
            (error_model, "scale_covariances", {"one": np.zeros((bands, bands))})):
        monkeypatch.setattr(module, name, lambda *_, value=value, **__: value)
    crop = SimpleNamespace(rows=slice(0, 12), columns=slice(0, 16))
    scene = SimpleNamespace(
        crop=crop, to_signals=to_signals, calibration=None, prior=None,
        edges=np.zeros((12, 16), bool), veil=np.zeros(bands), ambient=ambient,
        surface=None,
        view=SimpleNamespace(photo=photo(), grid=GRID,
                             sensitivities=np.ones((bands, GRID.nm.size))),
        nodes=nodes, relative_variance=np.full(row.size, traced_noise**2),
        lamp=np.zeros(row.size, bool),
        joint=SimpleNamespace(views=[None]))
    white = scene_light.light_photo(scene, light)[0].errors.white
    slope = 0.01 / nodes.cell
    inner = (column > 0) & (column < column.max())
    uneven = scene_light.MISPLACED_PX * slope / light[:, 0]
    brightest = np.percentile(light[:, 0], scene_light.BRIGHTEST_PERCENTILE) / light[:, 0]
    expected = traced_noise**2 + uneven**2 + (ambient * brightest)**2
    np.testing.assert_allclose(white.log[inner], expected[inner, None, None]
                               * np.ones((bands, bands)), rtol=1e-6)


@pytest.mark.parametrize("step", [1.0, 2.0, 4.0])
def test_a_developed_pixel_lies_in_the_middle_of_those_that_it_is_made_of(step):
    crop = Crop(slice(3, 9), slice(2, 7), (0, 0, 1, 1), step)
    whole = np.arange(40.0).reshape(-1, int(step)).mean(axis=1)
    np.testing.assert_allclose(crop.x_px, whole[2:7])
    np.testing.assert_allclose(crop.y_px, whole[3:9])


def test_a_moved_photo_is_interpolated_and_its_noise_is_that_of_draws():
    """A plane of light, moved by 2.6 and -1.4 pixels of the sensor: between four of its own."""
    matrix = np.array([[1, 0, 2.6], [0, 1, -1.4]])
    at = np.arange(3.5, 40, 2)      # of the sensor
    y, x = np.mgrid[:24, :24]
    plane = np.repeat((0.3 + 0.01 * x + 0.004 * y)[..., None], 3, axis=2).astype(np.float32)
    clipped = np.zeros(plane.shape, bool)
    clipped[6, 9] = True
    image = photo(signal=plane, saturated=clipped, variance=np.full_like(plane, 1e-4))
    image = dataclasses.replace(image, sensor_step=2.0)
    shown, off_px = resampled(image, matrix, at, at)
    inside = ~shown.saturated[..., 0]
    columns, rows = np.meshgrid((at + 2.6 + 0.5) / 2 - 0.5, (at - 1.4 + 0.5) / 2 - 0.5)
    # single precision
    np.testing.assert_allclose(shown.signal[inside, 0],
                               (0.3 + 0.01 * columns + 0.004 * rows)[inside], rtol=1e-5)
    # four pixels see the clipped one; none lies beyond the photo
    assert (~inside).sum() == 4
    np.testing.assert_allclose(shown.variance[inside], 1e-4 * (0.2**2 + 0.8**2)**2, rtol=1e-4)
    np.testing.assert_allclose(off_px, 2 * 0.2 * 0.8, rtol=1e-4)
    noisy = dataclasses.replace(image, signal=(0.01 * np.random.default_rng(6).standard_normal(
        (24, 24, 3))).astype(np.float32))
    drawn = resampled(noisy, matrix, at, at)[0].signal
    # 1000 pixels that share noise with their neighbours: 6 % of the variance
    assert drawn.var() == pytest.approx(shown.variance[inside].mean(), rel=3.9 * 0.06)


def test_pixels_take_the_photos_that_show_them_and_are_flagged_where_none_does():
    signal = np.full((2, 3, 4), 0.5, np.float32)
    signal[0, 1, 0] = 0.01          # the glare alone: the first photo says nothing
    clipped = np.zeros(signal.shape, bool)
    clipped[0, 2, 3] = clipped[1, 0, 1] = clipped[1, 0, 2] = True
    stack = photo(signal=signal, variance=signal, saturated=clipped)
    one, both = np.array([0, 0, 0, 0]), np.array([0, 0, 2, 2])
    glare, loud = np.full(4, 0.01), np.zeros(4, bool)
    (sets, index), flags = shown_bands(stack, glare, both, loud)
    assert sets.tolist() == [[True] * 4, [True] * 2 + [False] * 2, [False] * 2 + [True] * 2]
    assert index.tolist() == [[0, 2, 1], [0, 0, 0]]
    assert flags.tolist() == [[SEEN, SEEN, SEEN], [CLIPPED, SEEN, SEEN]]
    assert shown_bands(stack, glare, one, loud) == (None, None)
    silent = np.array([False, False, False, True])
    (sets, index), _ = shown_bands(stack, glare, both, silent)
    assert sets.tolist() == [[True] * 3 + [False], [False, False, True, False]]
    assert index.tolist() == [[0, 1, 0], [0, 0, 0]]


@pytest.mark.parametrize("cell", [1, 4, 5])
def test_light_that_rises_evenly_is_found_at_every_pixel_between_nodes(cell):
    nodes = LightNodes(np.zeros((20, 40), int), cell)
    row, column = (place.ravel() for place in np.mgrid[:20, :40])
    light = 2 + 0.1 * row - 0.03 * column
    of_nodes = np.bincount(nodes.region.ravel(), light) / np.bincount(nodes.region.ravel())
    found = nodes.weights(row, column) @ of_nodes
    inner = (row >= cell / 2) & (row < 20 - cell / 2) & (column >= cell / 2) \
        & (column < 40 - cell / 2)
    np.testing.assert_allclose(found[inner], light[inner], rtol=1e-5)   # single precision


def test_a_mid_grey_errs_at_a_pixel_by_the_root_of_its_nodes_variance():
    rng = np.random.default_rng(5)
    white = White(np.array([[0.9, 0.5, 0.7]]), np.tile(0.02**2 * (np.eye(3) + 1), (1, 1, 1)),
                  np.zeros((1, 3, 3)))
    errors = SimpleNamespace(
        white=white, glare=np.zeros(3), responses=np.ones((1, 3, 61)),
        gloss=gloss_states("matt", ["lamp"] * 3),
        between=lambda first, last: csr_array(np.ones(((last - first) * 50, 1))),
        light=SimpleNamespace(maps=np.ones((1, 1)), typical=np.ones((1, 1))), moments=None)
    pixels = LitPhoto(lit_photo(rng), errors)
    block = pixels.block(0, 2)
    np.testing.assert_allclose(block.grey_error**2, pixels.grey_variance[0], rtol=1e-6)


def test_pixels_of_a_lit_photo_of_many_bands_are_those_computed_one_by_one(monkeypatch):
    """White is known to 0.5 % at the left and to 4 % at the right."""
    monkeypatch.setattr(local_posteriors, "MAX_CENTRES", 400)
    monkeypatch.setattr(PixelErrors, "by_curves",
                        lambda self, signals, *_: np.zeros((*signals.shape, signals.shape[1])))
    matrix, (_, signals) = response(6)[1], painted(40 * 30, 6)
    share = np.tile((np.arange(40) + 0.5) / 40, 30)
    weights = csr_array(np.column_stack([1 - share, share]))
    white = White(np.full((2, 6), 0.8), np.array([error**2 * np.eye(6) for error in (0.005, 0.04)]),
                  np.zeros((2, 6, 6)))
    signal = (0.8 * signals).reshape(30, 40, 6).astype(np.float32)
    lit = LitPhoto(photo(signal=signal, saturated=np.zeros(signal.shape, bool),
                         variance=(1e-7 + 1e-5 * signal).astype(np.float32)),
                   errors_of(white, between=lambda first, last: weights[40 * first:40 * last],
                             light=even_light(matrix, 2), prior=load_prior()))
    points, sample, _, _ = survey(lit)
    layout = PictureLayout(5, full=True)
    tables = spectra_tables(lit, layout, points, sample)
    assert tables
    mean, spread, _ = block_spectra(lit, layout, tables, lit.block(14, 16))
    exact_mean, exact_spread, _ = lit.direct(lit.block(14, 16, direct=True))
    off = (mean - exact_mean) / exact_spread
    assert np.sqrt(np.mean(off**2)) < 0.25 and np.median(np.abs(off)) < 0.1
    ratio = spread.mean(axis=1) / exact_spread.mean(axis=1)
    assert abs(np.median(ratio) - 1) < 0.05 and np.mean(np.abs(ratio - 1) > 0.3) < 0.05
