"""Several photos of one box in one fit: other lights, exposures, viewpoints and cameras; and what
is refused.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spectrabox.fixtures.cornell_box import MATERIALS, cornell_box_xml
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.interreflection import band_products, exponents_up_to
from spectrabox.radiometry.records.scenes import JointReconstruction, LearntSpectra
from spectrabox.radiometry.records.spectra import Outcome, Quantity, Spectrum
from spectrabox.reconstruct import transport_engine
from spectrabox.reconstruct.fit.transport_fit import spectrum_prior
from spectrabox.reconstruct.inverse_rendering import reconstruct, reconstruct_views
from spectrabox.reconstruct.tracer.transport import shaded_images, trace_transport
from spectrabox.reconstruct.transport_engine import unit_scene
from spectrabox.reconstruct.view import check_views
from spectrabox.session.store.record_files import pack, unpack

from tests.cornell_problem import (
    BANDS,
    GRID,
    SCALE_ONE,
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
NOISE = 0.003
FALLING = 0.1 + np.exp(-((GRID.nm - 400) / 90) ** 2) + 0.6 * np.exp(-((GRID.nm - 570) / 15) ** 2)
SETTINGS = plain_settings(9)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(transport_engine, "MAX_SPP", 128)
    monkeypatch.setattr(transport_engine, "IMAGE_SPP", 128)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("views")


def photographed(view, seed, brightness=1.0, lights=None):
    """The view with the photo that its scene gives with the true spectra, ``brightness`` times as
    bright.
    """
    exponents = exponents_up_to(3, BOUNCES)
    responses = view.responses if lights is not None else view.responses[:1]
    signals = np.vstack([gain * band_products(exponents, SPECTRA, response)
                         for gain, response in zip(lights or (1.0,), responses, strict=True)])
    image, = brightness * shaded_images(unit_scene(view, BOUNCES, lights is not None), exponents,
                                        signals, spp=512, seed=seed)
    rng = np.random.default_rng(seed)
    variance = (NOISE * np.maximum(image, 0.01 * image.max())) ** 2
    return replace(view,
                   photo=photo_of(image + np.sqrt(variance) * rng.standard_normal(image.shape),
                                  variance))


def view(folder, name, light=None, text=None, scale=SCALE_ONE):
    scene_file = scene(folder, text, max_depth=BOUNCES + 1) if text is None else scene(folder, text)
    return replace(view_of(scene_file, light=light, scale=scale), name=name)


@pytest.fixture(scope="module")
def first(folder):
    return photographed(view(folder, "rising"), 71)


def test_one_view_is_what_reconstruct_gives(first):
    alone = reconstruct(first, SETTINGS, silent)
    joint = reconstruct_views([first], SETTINGS, silent)
    # The same sums in another order.
    np.testing.assert_allclose(joint.signal, alone.signal, rtol=1e-9)
    np.testing.assert_allclose(joint.signal_covariance, alone.signal_covariance, rtol=1e-6,
                               atol=1e-15)
    np.testing.assert_array_equal(joint.model_covariance, alone.model_covariance)
    assert joint.bands == tuple(f"rising: {band}" for band in BANDS)


def test_the_bands_of_two_lights_stand_side_by_side(folder, first):
    second = photographed(view(folder, "falling", FALLING), 72)
    joint = reconstruct_views([first, second], SETTINGS, silent)
    assert joint.signal.shape == (3, 6) and joint.view_of_band.tolist() == [0, 0, 0, 1, 1, 1]
    np.testing.assert_allclose(joint.response.sum(axis=1), 1.0, rtol=1e-12)
    wanted = SPECTRA @ joint.response.T
    # Photo and transport are each good to about 1 % per surface, the small red and green signals to
    # 3 %.
    np.testing.assert_allclose(joint.signal, wanted, rtol=0.06, atol=0.012)
    for signal, covariance, truth in zip(joint.signal, joint.signal_covariance, wanted,
                                         strict=True):
        # Six degrees of freedom, 0.1 % level 22.5; twice that, for the errors of surface gains are
        # not in it.
        assert (signal - truth) @ np.linalg.solve(covariance, signal - truth) < 45
    np.testing.assert_array_equal(joint.views[0].spectra, joint.views[1].spectra)
    assert (joint.model_covariance[:, :3, 3:] == 0).all() and joint.model_covariance[0, 3, 3] > 0


def test_another_exposure_needs_no_scale_and_adds_no_band(first):
    brighter = photographed(replace(first, name="long", light_scale=None), 73, brightness=2.5)
    joint = reconstruct_views([first, brighter], SETTINGS, silent)
    assert joint.signal.shape == (3, 3) and len(joint.views) == 2
    scale = joint.views[1].light_scale
    assert "in common" in scale.source and scale.standard_error is not None
    # Seven white surfaces share one scale: well below the 2 % that each block is allowed.
    assert scale.value == pytest.approx(2.5, rel=0.02)
    alone = reconstruct_views([first], SETTINGS, silent)
    variances = [np.einsum("mkk->m", each.signal_covariance).sum() for each in (joint, alone)]
    assert variances[0] < variances[1]


def test_two_viewpoints_of_the_same_box(folder, first):
    text = cornell_box_xml(WIDTH, BOUNCES + 1).replace('origin="0, 0, 3.9" target="0, 0, 0"',
                                                       'origin="0.5, 0.3, 3.6" target="-0.2, -0.1, '
                                                       '0"')
    other = photographed(view(folder, "from the right", text=text), 74)
    joint = reconstruct_views([first, other], SETTINGS, silent)
    assert joint.views[0].surface.shape == joint.views[1].surface.shape
    assert (joint.views[0].surface != joint.views[1].surface).any()
    np.testing.assert_allclose(joint.signal, SPECTRA @ joint.response.T, rtol=0.05, atol=0.01)


def test_another_camera_with_more_bands(folder, first):
    given = camera()
    curves = np.exp(-0.5 * ((GRID.nm - np.array([[430.0], [510.0], [570.0], [640.0]])) / 20) ** 2)
    four = replace(given, sensitivity=replace(given.sensitivity, curves=curves),
                   relative_covariance=np.zeros((4, 4)))
    blank = replace(view(folder, "four"), calibration=four, bands=("a", "b", "c", "d"),
                    photo=photo_of(np.ones((WIDTH, WIDTH, 4))))
    joint = reconstruct_views([first, photographed(blank, 77)], SETTINGS, silent)
    assert joint.bands[3:] == ("four: a", "four: b", "four: c",
                               "four: d") and joint.signal.shape == (3, 7)
    np.testing.assert_allclose(joint.signal, SPECTRA @ joint.response.T, rtol=0.06, atol=0.012)
    arrays = {}
    stored = pack(joint, "joint", arrays)
    again = unpack(JointReconstruction, stored, arrays)
    np.testing.assert_array_equal(again.views[1].signal, joint.views[1].signal)
    np.testing.assert_array_equal(again.signal_covariance, joint.signal_covariance)


def test_a_material_may_hide_in_one_view(folder, first):
    """A camera that looks past the green wall: the other view knows it, and this one uses its
    light.
    """
    text = cornell_box_xml(WIDTH, BOUNCES + 1).replace('target="0, 0, 0"',
                                                       'target="-1.3, 0, 0"').replace(
        'value="39.3077"', 'value="20"')
    aside = photographed_without_green(folder, text)
    joint = reconstruct_views([first, aside], SETTINGS, silent)
    assert np.isfinite(joint.signal).all()
    with pytest.raises(InputError, match="material 'green' fills 0 pixels of the rendered view,"):
        reconstruct_views([aside], SETTINGS, silent)


def photographed_without_green(folder, text):
    """As ``photographed``, which checks that every material is seen: the photo of a wider view's
    scene file.
    """
    wide = view(folder, "aside", text=cornell_box_xml(WIDTH, BOUNCES + 1))
    narrow = replace(wide, scene_file=view(folder, "aside", text=text).scene_file)
    exponents = exponents_up_to(3, BOUNCES)
    image, = shaded_images(unit_scene(narrow, BOUNCES), exponents,
                           band_products(exponents, SPECTRA, narrow.response), spp=256, seed=75)
    return replace(wide, scene_file=narrow.scene_file,
                   photo=photo_of(image, (0.01 * image + 1e-6) ** 2))


def test_two_lamps_of_which_one_is_brighter_than_stated(folder):
    bulb = ('<emitter type="point" id="bulb"><point name="position" value="0.3, 0, 0.8"/>'
            '<spectrum name="intensity" value="0.5"/></emitter></scene>')
    text = cornell_box_xml(WIDTH, BOUNCES + 1).replace("</scene>", bulb)
    two = photographed(replace(view(folder, "two lamps", text=text),
                               light_spectra={"bulb": Spectrum(GRID, 0.3 * FALLING,
                                                               Quantity.RADIANCE, "bulb")}), 76,
                       lights=(1.0, 1.4))
    wanted = SPECTRA @ camera_rows().T
    plain = reconstruct_views([two], SETTINGS, silent)
    gained = reconstruct_views([two], replace(SETTINGS, light_error=0.3), silent)
    corrected = next(one for one in gained.views[0].findings if one.code == "fit.lights-corrected")
    lamp, bulb_gain = corrected.values["factors"].values()
    # The scale of light against paint is told by interreflection alone; the ratio of the lamps by
    # their shading.
    assert bulb_gain / lamp == pytest.approx(1.4, rel=0.05)
    assert np.abs(gained.signal / wanted - 1).mean() < np.abs(plain.signal / wanted - 1).mean()


def camera_rows():
    response = camera().sensitivity.curves * (1 + (GRID.nm - 400) / 300) * GRID.weights_nm
    return response / response.sum(axis=1, keepdims=True)


def test_an_unknown_lamp_is_named(folder, first):
    lamp = {"sun": Spectrum(GRID, FALLING, Quantity.RADIANCE, "sun")}
    with pytest.raises(InputError, match=r"box\.xml has no light 'sun'; it has lamp"):
        check_views([replace(first, light_spectra=lamp)])


def test_lights_without_names_are_told_apart_by_names_that_they_get(folder, first):
    bulb = '<emitter type="point"><point name="position" value="0.3, 0, {}"/></emitter>'
    text = cornell_box_xml(WIDTH, BOUNCES + 1).replace("</scene>", "".join(
        map(bulb.format, ("0.8", "0.1"))) + "</scene>")
    three = view(folder, "three lamps", text=text)
    assert three.scene_file.light_ids == ("lamp", "point", "point_2")
    unit = unit_scene(three, 1, separate_lights=True)
    region = np.zeros(three.surface.shape, dtype=int)
    lit = trace_transport(unit, region, spp=16, seed=1).passes.sum(axis=(0, 1, 3))
    assert lit.shape == (3,) and (lit > 0).all()


def test_a_view_whose_scale_nothing_tells_is_named(folder, first):
    lonely = view(folder, "lonely", scale=None)
    renamed = replace(lonely.scene_file, surfaces=dict.fromkeys(lonely.scene_file.surfaces, "blue"))
    with pytest.raises(InputError, match="the light scale of lonely is unknown"):
        check_views([first, replace(lonely, scene_file=renamed)])


def test_engines_of_one_photo_say_so(first):
    with pytest.raises(InputError, match="the engine 'gradient' takes one photo, and 2 are given"):
        reconstruct_views([first, first], replace(SETTINGS, engine="gradient"), silent)


def test_the_prior_on_spectra_is_an_option(first):
    mean, flat = np.full(GRID.nm.size, 0.4), np.eye(GRID.nm.size) * 1e-4
    learnt = LearntSpectra(GRID.nm, mean, flat)
    basis = first.basis(9)
    of_coefficients, _ = spectrum_prior(replace(SETTINGS, spectrum_prior="learnt", learnt=learnt),
                                        GRID)
    np.testing.assert_allclose(basis @ of_coefficients, mean, rtol=1e-9)
    smooth, free = (spectrum_prior(replace(SETTINGS, spectrum_prior=name), GRID)[1]
                    for name in ("smooth", "none"))
    assert np.trace(smooth) > np.trace(free)
    with pytest.raises(InputError, match="no prior on spectra 'magic'; use one of learnt, smooth, "
                       "none"):
        spectrum_prior(replace(SETTINGS, spectrum_prior="magic"), GRID)
    with pytest.raises(InputError, match="needs the mean and covariance"):
        spectrum_prior(replace(SETTINGS, spectrum_prior="learnt"), GRID)


def test_what_a_material_is_said_to_be_decides_what_the_photo_leaves_open(first):
    names = [material.name for material in first.materials]
    broad = LearntSpectra(GRID.nm, np.full(GRID.nm.size, 0.4), 0.04 * np.eye(GRID.nm.size))
    narrow = LearntSpectra(GRID.nm, TRUTH["red"], 1e-4 * np.eye(GRID.nm.size))
    message = replace(first, materials=tuple(
        replace(material, learnt=narrow if material.name == "red" else None)
        for material in first.materials))
    settings = replace(SETTINGS, spectrum_prior="learnt", learnt=broad)
    free, stated = (np.sqrt(np.mean((reconstruct_views([one], settings, silent).views[0].spectra
                                     - SPECTRA)**2, axis=1)) for one in (first, message))
    red = names.index("red")
    # within the narrow prior, and a fraction of what the broad one leaves open
    assert stated[red] < 0.015 and stated[red] < free[red] / 3
    # others change by no more than interreflection of the red tells
    assert np.abs(np.delete(stated - free, red)).max() < 0.01


def test_what_only_the_prior_says_is_said(first):
    fit = reconstruct_views([first], replace(SETTINGS, coefficients=20), silent).views[0]
    assert fit.findings[0].code == "fit.determined" and fit.findings[0].values["by_prior"]
    assert fit.outcome is Outcome.ILL_POSED


def test_signals_are_kept_apart_where_the_lamp_was_moved(folder, first):
    text = cornell_box_xml(WIDTH, BOUNCES + 1)
    moved = text.replace("0 0 -0.19 0.99  0 0.19 0 0.01", "0.3 0 -0.19 0.99  0 0.19 0 0.01")
    assert moved != text
    second = photographed(view(folder, "moved", text=moved), 74)
    # every surface mirrors as much more under the moved lamp
    shining = replace(second, photo=replace(second.photo, signal=second.photo.signal * np.float32(
        1 + 0.1)))
    joint = reconstruct_views([first, shining], SETTINGS, silent)
    assert joint.signal.shape == (3, 6) and joint.view_of_band.tolist() == [0, 0, 0, 1, 1, 1]
    np.testing.assert_array_equal(joint.response[:3], joint.response[3:])
    alone = [reconstruct_views([one], SETTINGS, silent) for one in (first, shining)]
    for number, one in enumerate(alone):
        bands = slice(3 * number, 3 * number + 3)
        # the second is traced with paths of its own
        np.testing.assert_allclose(joint.signal[:, bands], one.signal, rtol=0.03, atol=0.02)
    assert np.all(joint.signal[0, 3:] > 1.04 * joint.signal[0, :3])
    np.testing.assert_array_equal(joint.signal_covariance[:, :3, 3:], 0)
    # a camera elsewhere is not a lamp elsewhere: two photos under one tell of the same signals
    same = reconstruct_views([first, replace(first, name="again")], SETTINGS, silent)
    assert same.signal.shape == (3, 3)


@pytest.mark.parametrize("unevenness", [0.0, 1.0])
def test_the_pull_of_the_prior_on_spectra_is_no_disagreement_of_photo_and_model(folder, unevenness):
    """Dark colourless surfaces are expected, the photo shows others: its signals are handed on
    without what was expected, and so is what they are off by.
    """
    seen = photographed(view(folder, "rising", scale=None), 81)
    shapes = list(seen.scene_file.surfaces)
    factor = np.ones(seen.surface.shape)
    for shape, log in (("floor", 0.2), ("ceiling", -0.2), ("green_wall", 0.25), ("red_wall", 0.2),
                       ("small_block", -0.1), ("large_block", 0.1)):
        factor[seen.surface == shapes.index(shape)] = np.exp(unevenness * log)
    seen = replace(seen, materials=specs(("white",)), photo=replace(
        seen.photo, signal=(seen.photo.signal * factor[..., None]).astype(np.float32)))
    dark = LearntSpectra(GRID.nm, np.full(GRID.nm.size, 0.15), 0.05**2 * np.exp(
        -np.abs(GRID.nm[:, None] - GRID.nm) / 60))
    pulled, free = (reconstruct_views([seen], plain_settings(
        9, errors_from_scene=True, spectrum_prior=prior, learnt=dark), silent)
        for prior in ("learnt", "none"))
    for name in ("green", "red"):
        own = pulled.materials.index(name)
        stated = [np.sqrt(np.diag(joint.model_covariance[own])) for joint in (pulled, free)]
        # with the pull it was 1.2 to 2.8 times as much
        np.testing.assert_allclose(stated[0], stated[1], rtol=0.25)
