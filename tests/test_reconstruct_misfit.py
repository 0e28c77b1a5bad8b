"""Tests of surfaces against the rendering: silent on scenes that fit, and naming what does not.
NumPy alone, but for one rendered panel.
"""
from __future__ import annotations

import numpy as np
import pytest

from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.scenes import SurfaceAgreement
from spectrabox.reconstruct.agreement import scene_errors
from spectrabox.reconstruct.misfit import common_cause, holm, surface_misfits, surface_tests

NAMES = ("white / floor", "white / back", "red / wall", "grey / lid")
SIZE = 48
SURFACE = np.repeat(np.arange(4), SIZE // 4)[:, None] * np.ones((1, SIZE), dtype=int)
USED = np.ones((SIZE, SIZE), dtype=bool)
MODEL = np.stack([0.2 + 0.6 * np.linspace(0, 1, SIZE)[None, :] * np.ones((SIZE, 1))] * 3, axis=2)


def photo(rng, noise=0.03, gains=None):
    """The rendering with noise of photo and rendering, and the surfaces' gains (4, 3)."""
    gains = np.ones((4, 3)) if gains is None else gains
    return MODEL * gains[SURFACE] + noise * MODEL.mean() * rng.standard_normal(MODEL.shape)


def judged(measured, surface_error=0.01):
    return surface_misfits(NAMES, ("R", "G", "B"), measured, MODEL,
                           [index == SURFACE for index in range(4)], surface_error)


def test_the_surface_and_band_that_do_not_fit_are_named():
    rng = np.random.default_rng(1)
    gains = np.ones((4, 3))
    gains[2, 1] = 1.1
    misfit, = judged(photo(rng, gains=gains))
    # The mean of 576 pixels of 3 % noise: 0.13 %.
    assert misfit.values["level"] == {"G": pytest.approx(0.1, abs=0.006)}
    assert misfit.values["scatter"] is None
    assert misfit.subject == "red / wall" and misfit.values["value"] == pytest.approx(0.1, abs=0.02)


def test_a_gradient_that_keeps_the_mean_is_found_by_the_shape():
    rng = np.random.default_rng(2)
    measured = photo(rng)
    measured[SURFACE == 3] *= 1 + 0.15 * np.linspace(-1, 1, SIZE)[np.nonzero(SURFACE == 3)[1]][:,
                                                                                               None]
    misfit, = judged(measured)
    assert misfit.subject == "grey / lid" and misfit.values["scatter"] > 0.05


@pytest.mark.parametrize("factors, cause", [
    (np.full((4, 3), 1.2), "scene.one-factor"),
    (np.tile([1.15, 1.0, 0.9], (4, 1)), "scene.factor-of-bands"),
    (np.array([0.8, 1.2, 0.9, 1.15])[:, None] * np.ones(3), "scene.each-by-its-own")])
def test_what_many_misfits_have_in_common_is_said(factors, cause):
    ratio = factors * np.random.default_rng(4).normal(1, 0.01, (4, 3))
    agreement = SurfaceAgreement(NAMES, NAMES, np.full(4, 100), ratio, np.zeros((4, 3)))
    misfits = [Finding("scene.misfit", Severity.WARN, name, {"value": 0.2}) for name in NAMES[:3]]
    found = common_cause(agreement, misfits, ("R", "G", "B"))
    assert found.code == cause and (found.values["count"], found.values["compared"]) == (3, 4)
    assert common_cause(agreement, misfits[:2], ("R", "G", "B")) is None


def test_the_worst_surface_is_named_first():
    rng = np.random.default_rng(3)
    gains = np.ones((4, 3))
    gains[0], gains[3] = 0.93, 1.5
    misfits = judged(photo(rng, gains=gains))
    assert [misfit.subject for misfit in misfits] == ["grey / lid", "white / floor"]
    assert misfits[1].values["level"]["R"] < 0


def test_an_error_that_was_stated_is_no_misfit():
    rng = np.random.default_rng(4)
    gains = np.full((4, 3), 1.0)
    gains[1] = 1.1
    assert judged(photo(rng, gains=gains), 0.01)
    assert not judged(photo(rng, gains=gains), 0.1)


def test_surfaces_without_enough_pixels_are_not_judged():
    used = USED & (SURFACE != 1)
    used[SIZE // 4, :5] = True
    _, _, p = surface_tests(photo(np.random.default_rng(5)), MODEL,
                            [used & (index == SURFACE) for index in range(4)], 0.01)
    assert np.isnan(p[:, 1]).all() and np.isfinite(np.delete(p, 1, axis=1)).all()


def test_holm_by_hand():
    # Sorted 0.01 x 4, 0.02 x 3, 0.03 x 2, 0.04 x 1: made to rise.
    np.testing.assert_allclose(holm(np.array([0.03, 0.01, 0.04, 0.02])), [0.06, 0.04, 0.06, 0.06])
    assert holm(np.array([])).size == 0


def test_the_errors_of_a_scene_are_read_off_surfaces_of_one_paint():
    rng = np.random.default_rng(6)
    grey, colour = 0.2 * rng.standard_normal((400, 1)), 0.03 * rng.standard_normal((400, 3))
    ratio = np.exp(grey + colour)
    agreement = SurfaceAgreement(("s",) * 400, ("white",) * 400, np.full(400, 160), ratio,
                                 np.full((400, 3), 0.1))
    errors = scene_errors(agreement, frozenset({"white"}), regions=400 * 20)
    # 400 surfaces: standard deviations good to 3.5 %. The mean of three bands has colour / sqrt(3)
    # in it, 0.4 % of it.
    assert errors.brightness == pytest.approx(0.2, rel=0.12)
    assert errors.colour == pytest.approx(0.03, rel=0.12)
    assert errors.block == pytest.approx(0.1 * np.sqrt(20 / 5))  # 20 blocks of a surface count as 5
    unknown = scene_errors(agreement, frozenset(), regions=400)
    assert unknown.brightness == pytest.approx(errors.brightness,
                                               rel=0.1) and unknown.block == pytest.approx(0.1)


def test_a_scene_without_two_surfaces_of_one_paint_tells_no_errors():
    agreement = SurfaceAgreement(("a", "b"), ("white", "red"), np.array([9, 9]), np.ones((2, 3)),
                                 np.zeros((2, 3)))
    assert scene_errors(agreement, frozenset(), regions=2) is None


def test_a_part_that_is_off_counts_where_the_mean_agrees():
    rng = np.random.default_rng(4)
    measured = photo(rng, noise=0.01)
    highlight = np.interp(np.arange(SIZE), [0, 8, 16, 47], [0.15, 0.15, -0.05, -0.3])
    measured[SURFACE == 3] *= 1 + highlight[np.nonzero(SURFACE == 3)[1]][:, None]
    misfit, = judged(measured)
    # the block that is darkest by 28 %, less three times 1 % of noise over four
    assert misfit.values["part"] == pytest.approx(-0.28, abs=0.03)
    assert misfit.values["value"] == -misfit.values["part"]


def test_a_rendered_glossy_panel_that_the_scene_calls_matt_fails(tmp_path):
    import mitsuba as mi

    from spectrabox.fixtures.cornell_box import cornell_box_xml
    from spectrabox.measure import rules
    from spectrabox.radiometry.findings import worst
    from spectrabox.reconstruct.inverse_rendering import reconstruct
    from spectrabox.reconstruct.rendering.renderer import load_scene, start_mitsuba

    from tests.cornell_problem import TRUTH, WIDTH, photo_of, plain_settings, scene, view_of
    start_mitsuba("cpu")
    matt = '<bsdf type="diffuse" id="red"><spectrum name="reflectance"'
    glossy = ('<bsdf type="roughplastic" id="red"><float name="alpha" value="0.1"/>'
              '<spectrum name="diffuse_reflectance"')
    xml = cornell_box_xml(WIDTH)
    assert matt in xml
    (tmp_path / "true").mkdir()
    true = view_of(scene(tmp_path / "true", xml=xml.replace(matt, glossy)))
    light = np.array(mi.render(load_scene(true.xml(TRUTH)), spp=256, seed=3))
    noise = 1e-3 * light.mean()
    taken = photo_of(light + noise * np.random.default_rng(1).standard_normal(light.shape),
                     variance=np.full(light.shape, noise**2))
    fit = reconstruct(view_of(scene(tmp_path), taken),
                      plain_settings(8, errors_from_scene=True), lambda *_: None)
    largest = fit.misfits[0]
    # Fresnel reflection of 4 % at the normal on a red of 8 to 58 %, several times as much at the
    # angles at which the box shows it.
    assert largest.subject == "red / red_wall" and largest.values["value"] > 0.15
    assert worst(rules.misfits_of(fit, ("R", "G", "B"), "")) is Severity.FAIL
