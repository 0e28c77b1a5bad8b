"""White over a photo of flat samples: its errors against draws of everything that is unknown.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.calibrate import light_field
from spectrabox.calibrate.chart_equations import FIELD_SD, PatchError, field_terms
from spectrabox.calibrate.light_field import FLAT_SHARE, light_at_regions
from spectrabox.measure.pictures import picture_maps
from spectrabox.measure.pictures.pixel_errors import PixelErrors, White
from spectrabox.measure.regions import white as module
from spectrabox.measure.regions.flat_signals import flat_signals
from spectrabox.measure.regions.white import (
    FlatErrors,
    FlatPhoto,
    condition_on_known,
)
from spectrabox.radiometry.chart import plane_centres
from spectrabox.radiometry.error_model import (
    LIGHT_FIELD,
    REPEATABILITY,
    ROUNDED_EXPOSURES,
    SAMPLE_PLANE,
)
from spectrabox.radiometry.gloss import gloss_states
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.calibration import (
    Calibration,
    ChartWhite,
    SensitivityFit,
)
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind, RegionSamples
from spectrabox.radiometry.records.spectra import Outcome, Quantity, Spectrum

SIGMAS, DRAWS = 3.9, 40_000
LEVEL, GLARE = np.array([0.6, 0.8, 0.5]), np.array([0.004, 0.006, 0.003])
SURFACES = np.array([[0.3, 0.5, 0.2], [0.9, 0.88, 0.86]])
FIELD = np.array([-0.1, 0.05])
REPEATS, PLANE = 0.015, 0.01


def photo(signal, exposure_s, name):
    """A photo of one signal, at an exposure that is on no camera's dial."""
    signal = np.broadcast_to(np.float32(signal), (4, 5, 3))
    return LinearImage(signal, np.full(signal.shape, 1e-6, np.float32),
                       np.zeros(signal.shape, bool), 1.0, exposure_s, 100.0, 8.0, PhotoKind.RAW,
                       "camera", name, "")


CHART, OBJECT = photo(0.2, 0.0100, "chart.dng"), photo(0.05, 0.0213, "box.dng")
EXPOSURE = 2.13
ERRORS = FlatErrors(REPEATS, 0.01, PatchError(0.01, 0.02), plane=PLANE,
                    surfaces={"cloth": "satin"})


def unknowns():
    """Covariance (8, 8) of log level, glare and field, all of them correlated."""
    mixed = np.random.default_rng(61).standard_normal((8, 30)) / np.sqrt(30)
    size = np.r_[np.full(3, 0.01), 0.1 * GLARE, np.full(2, 0.02)]
    return size[:, None] * (mixed @ mixed.T) * size


def samples():
    mean = EXPOSURE * LEVEL * np.exp(FIELD)[:, None] * SURFACES + GLARE / 4
    noise = np.array([np.diag((0.001 * one) ** 2) for one in mean])
    return RegionSamples(("cloth", "card"), mean, noise, np.full(2, 100), np.zeros((2, 3)),
                         np.zeros((2, 25, 2)))


def flat_photo():
    """A photo of a cloth and a card, the chart in another."""
    return FlatPhoto("photo", samples(), OBJECT, CHART, False, None, None, None, None)


@pytest.fixture
def seen(monkeypatch):
    """White at the regions of a photo."""
    elsewhere = LEVEL, GLARE, FIELD, unknowns()
    monkeypatch.setattr(module, "_light_at", lambda *_: elsewhere)
    return lambda: module.white_by_chart(flat_photo(), ERRORS)


def signals_of(white, correction):
    """Signals (T, R, K) where the unknowns are off by (T, Z), by the formula of the photo."""
    level, glare, field, causes = np.split(correction, [3, 6, 8], axis=1)
    brightness = np.exp(level[:, None] + field[..., None] + causes.sum(axis=1)[:, None, None])
    lit = white.exposure * LEVEL * np.exp(FIELD)[:, None] * brightness
    return (white.samples.mean - white.glare - glare[:, None]) / lit


def test_signals_and_their_errors_are_those_of_draws_of_all_that_is_unknown(seen):
    white = seen()
    # glare goes with the light in the whole picture: a quarter of that in the chart photo
    np.testing.assert_allclose(white.glare, GLARE / 4, rtol=1e-6)   # pixels of float32
    assert white.exposure == pytest.approx(EXPOSURE)
    np.testing.assert_allclose(white.signal, SURFACES, rtol=1e-6)
    causes = {REPEATABILITY: REPEATS, ROUNDED_EXPOSURES: 0.0, SAMPLE_PLANE: PLANE}
    assert white.causes == tuple(causes)
    rng = np.random.default_rng(62)
    draws = np.hstack([rng.multivariate_normal(np.zeros(8), unknowns(), DRAWS),
                       rng.standard_normal((DRAWS, len(causes))) * list(causes.values())])
    estimate = signals_of(white, draws)
    for region in (0, 1):
        total = np.sum(list(white.errors(region).values()), axis=0)
        size = np.sqrt(np.diag(total))
        # 40 000 draws know a variance to 0.7 %; 2 % of curvature
        np.testing.assert_allclose(np.cov(estimate[:, region], rowvar=False) / np.outer(size, size),
                                   total / np.outer(size, size), atol=0.04)
        both = np.outer(white.signal[region], white.signal[region])
        for cause, relative in causes.items():
            np.testing.assert_allclose(white.errors(region)[cause], relative**2 * both,
                                       rtol=0.02, atol=1e-12)


@pytest.mark.parametrize("brighter", [1.0, 2.0, 8.0])
def test_what_bands_differ_by_does_not_hang_on_how_bright_the_light_is(brighter):
    # errors of 0.7 that all bands share but for a hundredth, unlike from band to band
    common, own = 0.5 * np.ones((3, 3)), np.diag([0.5, 1.0, 3.0]) * 1e-5
    assert module._colour_misfit(brighter * np.ones(3), common + own)[0] == 0
    # the level is between the bands, 1.04 by those that are known best
    off, band = module._colour_misfit(brighter * np.array([1.1, 1.0, 0.9]), common + own)
    assert band == 2 and off == pytest.approx(-0.14, abs=0.005)


@pytest.mark.parametrize("noisier, stated", [(1, 0.005), (15, 0.005), (1, 0.03)])
def test_a_card_of_known_spectrum_tells_of_white_what_conditioning_on_it_tells(
        seen, noisier, stated):
    """Draws of the unknowns, their regression on what the card would read: the exact answer of a
    Gaussian, to second order.
    """
    white, target = seen(), 1.012 * SURFACES[1]
    white = dataclasses.replace(white, samples=dataclasses.replace(
        white.samples, covariance_of_mean=noisier**2 * white.samples.covariance_of_mean))
    model = np.diag((0.003 * target) ** 2) + stated**2 * np.outer(target, target)
    estimate = condition_on_known(white, {"card": target}, {"card": model})
    rng = np.random.default_rng(63)
    draws = np.hstack([rng.multivariate_normal(np.zeros(8), unknowns(), DRAWS),
                       rng.standard_normal((DRAWS, 3)) * [REPEATS, 0.0, PLANE]])
    noise = white.noise(1) + model
    read = signals_of(white, draws)
    off = read[:, 1] + rng.multivariate_normal(np.zeros(3), noise, DRAWS)
    centred = off - off.mean(axis=0)
    slope = np.linalg.lstsq(centred, draws - draws.mean(axis=0), rcond=None)[0]
    mean = (target - SURFACES[1]) @ slope
    rest = draws - draws.mean(axis=0) - centred @ slope
    size = np.sqrt(np.diag(white.covariance)) + 1e-12
    # 1.2 % off is about a standard error; the regression knows its slopes to 0.5 % of that
    np.testing.assert_allclose(estimate.mean / size, mean / size, atol=0.04)
    np.testing.assert_allclose(np.sqrt(np.diag(estimate.covariance)) / size,
                               rest.std(axis=0) / size, atol=0.03)
    assert np.sqrt(estimate.covariance[8, 8]) < (0.99 if noisier > 1 or stated > 0.01
                                                 else 0.9) * REPEATS


def test_the_map_of_the_light_shows_what_a_known_card_said(monkeypatch):
    """Where the card lies the map has the card's small error, further away the chart's."""
    def smooth(_, __, points):
        at = np.array([np.mean(one, axis=0) for one in points])
        apart = np.linalg.norm(at[:, None] - at[None], axis=-1)
        covariance = np.zeros((6 + len(at),) * 2)
        covariance[6:, 6:] = 0.08**2 * np.exp(-((apart / 3)**2))
        return LEVEL, 0 * GLARE, np.zeros(len(at)), covariance
    monkeypatch.setattr(module, "_light_at", smooth)
    monkeypatch.setattr(module.interreflection, "relative_response", lambda *_: np.eye(3))
    signal = EXPOSURE * LEVEL * SURFACES
    regions = RegionSamples(("cloth", "card"), signal, np.zeros((2, 3, 3)), np.full(2, 100),
                            np.zeros((2, 3)), np.array([np.full((25, 2), 3.0), np.zeros((25, 2))]))
    shown = dataclasses.replace(flat_photo(), samples=regions)
    known = {"card": SURFACES[1]}
    errors = dataclasses.replace(ERRORS, known={"card": 0.005})
    white = module.white_at_regions(shown, known, errors)
    _, error = module.light_map(shown, known, errors)
    assert error[0, 0] == pytest.approx(white.field_error[1], rel=0.3)
    assert error[0, 0] < 0.5 * error[-1, -1]
    _, by_chart = module.light_map(shown, {}, ERRORS)
    assert by_chart.min() > 0.079


@pytest.mark.parametrize("model", [0.0, 0.02])
def test_errors_of_a_pixel_are_those_of_draws_of_white_glare_and_noise(model):
    rng = np.random.default_rng(64)
    # glare that is hardly known, of a photo with little noise: no part hides another
    size = np.repeat([1.0, 12.0], 3)
    covariance = size[:, None] * unknowns()[:6, :6] * size
    white = White(LEVEL[None], covariance[None, :3, :3], covariance[None, :3, 3:])
    veil, noise = np.array([0.002, 0.001, 0.003]), np.array([[4e-6, 6e-6, 5e-6]])
    shared, mirrored = 0.01**2 * np.eye(3), gloss_states("glossy", ["lamp"] * 3)
    errors = PixelErrors(None, white, None, GLARE, covariance[3:, 3:] + np.outer(veil, veil),
                         mirrored, shared + model**2 * np.eye(3), None, None,
                         None, None)
    signal = np.array([[0.15, 0.4, 0.25]])
    draws = rng.multivariate_normal(np.zeros(6), covariance, DRAWS)
    # what is mirrored on the mean is read with the surface, and taken off
    photo_signal = (signal + mirrored.mean) * LEVEL + GLARE
    read = (photo_signal + np.sqrt(noise) * rng.standard_normal((DRAWS, 3))
            + rng.standard_normal((DRAWS, 1)) * veil - GLARE - draws[:, 3:]) \
        / (LEVEL * np.exp(draws[:, :3]))
    read = read * (1 + 0.01 * rng.standard_normal((DRAWS, 3))) \
        * (1 + model * rng.standard_normal((DRAWS, 3))) \
        + mirrored.covariance[0, 0]**0.5 * rng.standard_normal((DRAWS, 1))
    estimate = errors.at_white(signal, white, noise)[0]
    size = np.sqrt(np.diag(estimate))
    # as above
    np.testing.assert_allclose(np.cov(read, rowvar=False) / np.outer(size, size),
                               estimate / np.outer(size, size), atol=0.04)


def test_light_over_a_picture_is_the_mixture_of_every_kind_of_lamp(monkeypatch):
    """Means, and what is inside each kind and between them, weighed by share and evidence."""
    rng = np.random.default_rng(65)
    kinds = []

    def given(*_):
        root = 0.01 * rng.standard_normal((8, 8))
        kinds.append((rng.uniform(-1, 1), 0.02 * rng.standard_normal(8), root @ root.T))
        return kinds[-1]
    monkeypatch.setattr(light_field, "_given_the_chart", given)
    monkeypatch.setattr(light_field, "_of_distance", lambda *_: (None, None))
    monkeypatch.setattr(light_field, "_nearly_even", lambda *_: (None, None))
    plane = rng.uniform(size=(24, 2))
    white = ChartWhite(LEVEL, np.zeros(5), GLARE, 1e-4 * np.eye(11))
    level, _, log_light, covariance = light_at_regions(white, 3 * [plane], 3 * [plane], True)
    shares = np.r_[np.full(len(kinds) - 1, (1 - FLAT_SHARE) / (len(kinds) - 1)), FLAT_SHARE]
    weights = shares * np.exp([evidence for evidence, _, _ in kinds])
    counts = rng.multinomial(200_000, weights / weights.sum())
    draws = np.vstack([rng.multivariate_normal(mean, inside, count)
                       for count, (_, mean, inside) in zip(counts, kinds, strict=True)])
    size = np.sqrt(np.diag(covariance))
    # 200 000 draws know a variance to 0.5 %
    np.testing.assert_allclose(np.cov(draws, rowvar=False) / np.outer(size, size),
                               covariance / np.outer(size, size), atol=0.02)
    np.testing.assert_allclose(level, LEVEL * np.exp(draws[:, :3].mean(axis=0)), rtol=1e-3)
    np.testing.assert_allclose(log_light, draws[:, 6:].mean(axis=0), atol=1e-3)


def test_a_band_that_is_saturated_in_one_of_several_photos_says_nothing(seen):
    white = seen()
    curves = np.exp(-0.5 * ((FINE_GRID.nm - np.array([[610], [540], [460]])) / 40)**2)
    fit = SensitivityFit(FINE_GRID, curves, *[None] * 7, "stated", Outcome.CONVERGED)
    light = Spectrum(FINE_GRID, np.ones(FINE_GRID.nm.size), Quantity.RELATIVE, "even")
    photo = dataclasses.replace(flat_photo(), calibration=Calibration(
        fit, light, None, np.zeros((3, 3)), ()))
    clipped = np.array([[True, False, False], [False] * 3])
    bright = dataclasses.replace(white, samples=dataclasses.replace(white.samples,
                                                                    clipped=clipped))
    signals = flat_signals([photo, photo], [white, bright], {"cloth": (), "card": ()}, {},
                           ("red", "green", "blue"), ERRORS)
    np.testing.assert_array_equal(np.isnan(signals.signal), clipped)


def test_a_reduced_map_is_the_mean_of_what_was_seen_of_each_block(monkeypatch):
    monkeypatch.setattr(picture_maps, "REDUCED_PX", 4)
    rng, of_map = np.random.default_rng(65), SimpleNamespace(file="map.png", channels=2,
                                                                values=np.mean)
    values, seen = rng.uniform(size=(9, 12, 2)), rng.uniform(size=(9, 12)) < 0.8
    seen[:3, :3] = np.eye(3, dtype=bool)            # a third of a block: not enough
    reduced = picture_maps.Reduced(9, 12, [of_map])
    for first in (0, 2, 7):                         # rows come in parts of any height
        rows = slice(first, {0: 2, 2: 7, 7: 9}[first])
        reduced.add(first, seen[rows], {"map.png": values[rows]})
    estimate = reduced.mean("map.png")
    assert estimate.shape == (3, 4, 2) and np.all(np.isnan(estimate[0, 0]))
    for row, column in np.argwhere(~np.isnan(estimate[..., 0])):
        block = np.s_[3 * row:3 * row + 3, 3 * column:3 * column + 3]
        # single precision
        np.testing.assert_allclose(estimate[row, column], values[block][seen[block]].mean(axis=0),
                                   rtol=1e-6)


def test_photos_of_one_chart_err_alike_away_from_it_under_any_lamps(monkeypatch):
    """Two lamps, one chart whose patches err: the product of the errors of both signals."""
    rng, error, grey = np.random.default_rng(68), 0.008, 0.4
    plane, away = plane_centres(), np.array([[1.5, 0.3]])
    terms = np.column_stack([np.ones(24), field_terms(plane)])
    spread = np.linalg.inv(terms.T @ terms / error**2 + np.diag(np.r_[0, [FIELD_SD**-2] * 5]))
    curve = np.exp(-0.5 * ((FINE_GRID.nm - 550) / 40)**2)[None]
    fit = SensitivityFit(FINE_GRID, curve, *[None] * 7, "stated", Outcome.CONVERGED)
    image = SimpleNamespace(signal=np.full((1, 1, 1), 0.2))
    photos = [FlatPhoto(name, None, image, image, True, None, None, None, Calibration(
        fit, Spectrum(FINE_GRID, light, Quantity.RELATIVE, name), None, np.zeros((1, 1)), ()),
        lamp=name) for name, light in (("a", FINE_GRID.nm), ("b", 1100 - FINE_GRID.nm))]
    products, stated = [], []
    for _ in range(40):
        known, shown, off = {}, [], error * rng.standard_normal(24)
        for photo in photos:
            lamp, height = rng.uniform([-2, -2], [4, 3]), rng.uniform(4, 8)
            on_chart, on_cloth = (-1.5 * np.log(np.sum((at - lamp)**2, axis=1) + height**2)
                                  for at in (plane, away))
            level, *shape = spread @ terms.T @ (on_chart + off) / error**2
            known[photo.name] = light_at_regions(
                ChartWhite(np.exp([level]), np.array(shape), np.zeros(1),
                           np.pad(spread, (0, 1)) + 1e-12 * np.eye(7)),
                [plane, away], [(plane - 0.5) / 2, (away - 0.5) / 2], False)
            shown.append(dataclasses.replace(photo, samples=RegionSamples(
                ("cloth",), grey * np.exp(on_cloth)[:, None], np.zeros((1, 1, 1)), np.ones(1),
                np.zeros((1, 1)), np.zeros((1, 25, 2)))))
        monkeypatch.setattr(module, "_light_at", lambda photo, *_, known=known: known[photo.name])
        signals = flat_signals(shown, [module.white_by_chart(photo, ERRORS) for photo in shown],
                               {"cloth": ()}, {}, ("green",), ERRORS)
        stated.append(signals.errors[LIGHT_FIELD][0][0, 1])
        products.append(np.prod(signals.signal[0] - grey))
    # 40 know a mean product to 25 %, and how alike lamps stand changes it by half
    assert np.mean(products) == pytest.approx(np.mean(stated), rel=0.7)
