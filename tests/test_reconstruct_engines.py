"""Whole inversions of a small Cornell box with known spectra, by every engine; and what is
refused.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spectrabox.fixtures.cornell_box import MATERIALS, cornell_box_xml
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.interreflection import band_products, exponents_up_to
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.reconstruct import transport_engine
from spectrabox.reconstruct import view as view_module
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.scene.surfaces import block_regions
from spectrabox.reconstruct.settings import ENGINES
from spectrabox.reconstruct.tracer import transport as tracing
from spectrabox.reconstruct.tracer.transport import shaded_images, trace_transport
from spectrabox.reconstruct.transport_engine import (
    FEW_SPP,
    FIRST_SPP,
    MORE_SPP,
    require_lit,
    trace_view,
    unit_scene,
)
from spectrabox.reconstruct.view import check_views

from tests.cornell_problem import (
    GRID,
    TRUTH,
    WIDTH,
    camera,
    photo_of,
    plain_settings,
    scene,
    specs,
    view_of,
)
from tests.session_runs import silent

pytestmark = pytest.mark.usefixtures("mitsuba")

SPECTRA = np.array([TRUTH[name] for name in MATERIALS])
BOUNCES = 3


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    return scene(tmp_path_factory.mktemp("box"), max_depth=BOUNCES + 1)


@pytest.fixture(scope="module")
def photo(box):
    view = view_of(box)
    exponents = exponents_up_to(3, BOUNCES)
    signals = band_products(exponents, SPECTRA, view.response)
    image, = shaded_images(unit_scene(view, BOUNCES), exponents, signals, spp=1024, seed=71)
    return photo_of(image)


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(transport_engine, "MAX_SPP", 128)
    monkeypatch.setattr(transport_engine, "IMAGE_SPP", 256)


def true_signals(found):
    response = (camera().sensitivity.curves * (1 + (GRID.nm - 400) / 300) * GRID.weights_nm)
    return SPECTRA @ (response / response.sum(axis=1, keepdims=True)).T, found


def test_the_transport_engine_finds_the_band_signals(box, photo, quick):
    fit = reconstruct(view_of(box, photo), plain_settings(7), silent)
    wanted, _ = true_signals(fit)
    # Photo and transport are each good to about 1 % per surface at this size, the small red and
    # green signals to 3 %.
    np.testing.assert_allclose(fit.signal, wanted, rtol=0.05, atol=0.01)
    assert fit.outcome is Outcome.ILL_POSED and "light transport" in fit.engine
    assert fit.known == (False, False, False) and np.isfinite(fit.signal_covariance).all()
    assert fit.spectra.min() >= 0 and fit.spectra.max() <= 1


@pytest.mark.parametrize("error", [0.3, 0.01])
def test_tracing_ends_where_its_noise_falls_below_the_photo_s(box, photo, error, monkeypatch):
    monkeypatch.setattr(view_module, "PHOTO_ERROR", error)
    monkeypatch.setattr(view_module, "PHOTO_FLOOR", 0.0)
    view = view_of(box, replace(photo, variance=np.full_like(photo.variance, 1e-30)))
    region, group = block_regions(view.surface, view.used)
    traced = trace_view(view, unit_scene(view, BOUNCES), region, group, 5, silent)
    of_photo = error**2 / np.bincount(region[region >= 0])
    # Half of the regions are below; four passes know each variance to two fifths, and their median
    # much better.
    assert np.median(traced.relative_variance / of_photo) < 1.3
    assert (traced.spp < 2 * transport_engine.FIRST_SPP) == (error == 0.3)


def test_a_known_material_gives_the_scale(box, photo, quick):
    dimmed = replace(photo, signal=photo.signal * np.float32(0.4),
                     variance=photo.variance * np.float32(0.16))
    fit = reconstruct(view_of(box, dimmed, scale=None, materials=specs(known=("white",))),
                      plain_settings(7), silent)
    # Each of seven white surfaces, some of a dozen pixels, is good to 2 to 4 %; they count alike.
    assert fit.light_scale.value == pytest.approx(0.4, rel=0.06)
    assert fit.known == (True, False, False) and np.isnan(fit.coefficients[0]).all()


def test_direct_light_alone_explains_interreflection_as_brightness(box, photo, quick):
    wanted, _ = true_signals(None)
    fit = reconstruct(view_of(box, photo), plain_settings(7, engine="single-bounce"), silent)
    # The walls light each other: without that the fit must make them brighter by far more than the
    # noise of 1 %.
    assert np.all(fit.signal.mean(axis=1) > 1.05 * wanted.mean(axis=1))


def test_the_gradient_engine_finds_the_same_signals(box, photo):
    settings = plain_settings(7, steps=80, spp=8, engine="gradient")
    fit = reconstruct(view_of(box, photo), settings, silent)
    wanted, _ = true_signals(fit)
    # Eighty steps of eight paths, half the default: still within a tenth.
    np.testing.assert_allclose(fit.signal, wanted, rtol=0.12, atol=0.03)
    assert fit.loss_history[-5:].mean() < 0.2 * fit.loss_history[0]


def test_an_unknown_engine_is_named(box, photo):
    with pytest.raises(InputError, match="no engine 'magic'; use one of auto, transport, gradient, "
                       "single-bounce"):
        reconstruct(view_of(box, photo), plain_settings(9, engine="magic"), silent)
    assert set(ENGINES) == {"transport", "gradient", "single-bounce", "auto"}


def test_a_scene_without_any_scale_is_refused(box, photo):
    with pytest.raises(InputError, match="the light scale is unknown: give one material its known "
                       "spectrum"):
        check_views([view_of(box, photo, scale=None)])


def test_a_light_without_power_in_a_band_is_refused(box, photo):
    with pytest.raises(InputError, match="the light gives the camera's band B nothing"):
        check_views([view_of(box, photo, light=np.where(GRID.nm > 620, 1.0, 0.0))])


def test_pixels_that_are_no_numbers_are_refused(box, photo):
    signal = photo.signal.copy()
    signal[3, 4, 1] = np.nan
    with pytest.raises(InputError, match=r"box\.exr: 1 pixels hold no number"):
        check_views([view_of(box, replace(photo, signal=signal))])


def test_pixels_far_below_zero_are_refused(box, photo):
    with pytest.raises(InputError, match="further below zero than noise explains; the black level"):
        below = replace(photo, signal=photo.signal - np.float32(photo.signal.max()))
        check_views([view_of(box, below)])


def test_a_material_that_is_not_seen_is_refused(box, photo):
    dark = photo_of(photo.signal.astype(float), saturated=np.ones(photo.signal.shape, dtype=bool))
    with pytest.raises(InputError, match=r"material 'white' fills .* pixels of the rendered view, "
                                         r"0 of them usable"):
        check_views([view_of(box, dark)])


def test_a_material_that_no_light_reaches_is_refused(tmp_path, photo, quick):
    text = cornell_box_xml(WIDTH, 2).replace('<matrix value="0.23 0 0 0  0 0 -0.19 0.99  0 0.19 0 '
                                             '0.01  0 0 0 1"/>', '<scale value="0.2"/><rotate '
                                             'y="1" angle="90"/><translate x="0.9"/>')
    hidden = scene(tmp_path, text)
    with pytest.raises(InputError, match="no light reaches material 'red'"):
        reconstruct(view_of(hidden), plain_settings(7), silent)
    with pytest.raises(InputError, match="no light reaches material 'red'"):
        require_lit([view_of(hidden)], plain_settings(7))


def test_light_that_few_paths_miss_is_looked_for_by_all_of_the_first_trace(box, photo, monkeypatch):
    shot, followed = view_of(box, photo), []

    def traced(*arguments, **settings):
        trace = trace_transport(*arguments, **settings)
        followed.append(settings["spp"])
        few = settings["spp"] == FEW_SPP and dim
        return replace(trace, passes=0 * trace.passes) if few else trace

    monkeypatch.setattr(tracing, "trace_transport", traced)
    dim = False
    needed, _ = require_lit([shot], plain_settings(7))
    # a second trace and a longer one are timed; together they are shorter than the first of a fit
    timed = [FEW_SPP, FEW_SPP, MORE_SPP]
    assert followed == timed and sum(timed) < FIRST_SPP / 2
    dim = True
    bytes_needed, _ = require_lit([shot], plain_settings(7))
    assert bytes_needed == needed > 0
    assert followed == [*timed, *timed, FIRST_SPP]


def test_the_few_paths_are_among_those_of_the_first_trace(box, photo):
    shot = view_of(box, photo)
    region, _ = block_regions(shot.surface, shot.used)
    unit = unit_scene(shot, BOUNCES)
    few, first = (trace_transport(unit, region, spp=spp, seed=7) for spp in (FEW_SPP, FIRST_SPP))
    # What reaches a region on one of the few paths is among the sums of all: all are positive.
    assert (first.passes[few.passes > 0] > 0).all()
    assert np.count_nonzero(few.passes) < np.count_nonzero(first.passes)
