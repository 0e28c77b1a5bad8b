"""Recorded: replays, parts of traced views, views that are refused, and engines that are chosen."""
import dataclasses

import numpy as np
import pytest
import views_by_hand as hand
from recorded_refusals import said

from spectrabox.radiometry.records import LightScale
from spectrabox.reconstruct.engines.gradient_engine import engine_for
from spectrabox.reconstruct.engines.per_wavelength import monochrome_job, monochrome_xml
from spectrabox.reconstruct.engines.transport_engine import (
    nuisances,
    require_named_lights,
    require_plain_products,
)
from spectrabox.reconstruct.fit.traced_view import fit_traced, smoothed_variance
from spectrabox.reconstruct.fit.view_terms import Nuisances
from spectrabox.reconstruct.inverse_rendering import reconstruction_of, settings_for
from spectrabox.reconstruct.joint_reconstruction import joint_record
from spectrabox.reconstruct.replay import Stage, Truth, replay
from spectrabox.reconstruct.settings import ENGINES, InversionSettings
from spectrabox.reconstruct.view import unknown_materials
from spectrabox.reconstruct.view_checks import (
    check_views,
    require_light_in_bands,
    require_lights,
    require_pixels,
    require_scales,
    require_sound_pixels,
)


def test_photos_of_several_lights_and_exposures(recorded, tmp_path):
    parts = [hand.view(tmp_path, "one", 11, given=hand.stated_scale(1.7), known=())[1],
             hand.view(tmp_path, "cold", 12, "cold", 0.6, known=())[1],
             hand.view(tmp_path, "again", 13, scale=3.1, known=())[1]]
    settings = dataclasses.replace(hand.SETTINGS, errors_from_scene=False)
    solution, record = hand.solved(parts, settings)
    recorded(hand.told(solution, record), rtol=hand.ENDS)
    assert record.bands == ("one: R", "one: G", "one: B", "cold: R", "cold: G", "cold: B")
    recorded({"unknown": [each.name for each in unknown_materials([p.view for p in parts])]},
             case="names")


def test_views_whose_responses_are_nearly_the_same(recorded, tmp_path):
    one, traced = hand.view(tmp_path, "one", 11, given=hand.stated_scale(1.7), known=())
    solution, record = hand.solved([traced], hand.SETTINGS)
    found = {}
    wave, dip = np.cos(hand.NM / 40), -1.0 * (hand.NM == 537.5)

    def varied(off, change):
        fit = dataclasses.replace(one.calibration.sensitivity,
                                  curves=one.sensitivities * (1 + off * change))
        other = dataclasses.replace(one, name="other", calibration=dataclasses.replace(
            one.calibration, sensitivity=fit))
        alone, both = (view.response / view.response.sum(axis=1)[:, None] for view in (other, one))
        return other, np.abs(alone - both).max() / both.max()
    for name, change in (("wave", wave), ("dip", dip)):
        unit = varied(1e-6, change)[1] / 1e-6
        for size in (0.0, 0.95e-9, 1.05e-9, 1e-6):      # of the response
            other, away = varied(size / unit, change)
            joint = joint_record([one, other], [record.views[0]] * 2, solution.fit, [None, None])
            found[f"{name} {size:g}"] = joint.bands, bool(away > 1e-9)
            recorded({"signal": joint.signal, "covariance": joint.signal_covariance,
                      "model": joint.model_covariance}, rtol=1e-4, case=f"{name} {size:g}")
    recorded(found)
    # a band is the same up to 1e-9 of the response
    assert all((len(bands) == 6) == apart for bands, apart in found.values())


def test_what_is_known_besides_pixels(recorded, tmp_path):
    chosen = InversionSettings(surface_error=0.02, brightness_error=0.03, light_error=0.04,
                               mixing_error=0.05, block_error=0.06)
    recorded([nuisances(hand.view(tmp_path, lights=lights, given=given)[0], chosen)
              for lights in (1, 2) for given in (None, hand.stated_scale(1.3))])


def test_an_answer_of_an_engine_for_one_view(recorded, tmp_path):
    _, traced = hand.view(tmp_path, seed=2)
    solution, _ = hand.solved([traced], hand.SETTINGS)
    answer = dataclasses.replace(solution.answers[0], regions=None, notes=("said",))
    record = reconstruction_of([traced.view], None, [answer], hand.SETTINGS)
    recorded({"signal": record.signal, "covariance": record.signal_covariance,
              "model": record.model_covariance, "regions": record.regions,
              "notes": record.views[0].notes, "scale": record.views[0].light_scale,
              "agreement": record.views[0].agreement, "misfits": record.views[0].misfits},
             rtol=hand.ENDS)


def test_photos_that_do_not_fit(recorded, tmp_path):
    """A brighter surface, a pattern and a shift, said in sentences."""
    view, traced = hand.view(tmp_path, seed=2, given=hand.stated_scale(1.7))
    signal = view.photo.signal.astype(float)
    signal[hand.surface_picture() == 3] *= [1.3, 1.1, 1.0]
    signal[:5] *= np.linspace(0.9, 1.1, hand.SIZE[0])[None, :, None]
    photo = dataclasses.replace(view.photo, signal=signal.astype(np.float32))
    other = dataclasses.replace(traced, view=view.with_photo(photo))
    settings = dataclasses.replace(hand.SETTINGS, errors_from_scene=False)
    solution, record = hand.solved([other], settings)
    moved = view.with_photo(dataclasses.replace(photo, signal=np.roll(photo.signal, 3, axis=1)))
    shifted = reconstruction_of([moved], solution.fit, solution.answers, hand.SETTINGS)
    recorded({"misfits": record.views[0].misfits, "notes": record.views[0].notes,
              "shifted": shifted.views[0].notes,
              "trust": solution.views[0].trust(solution.fit.views[0])}, rtol=hand.ENDS)


@pytest.mark.parametrize("stray", [False, True])
def test_replays(recorded, tmp_path, stray):
    _, traced = hand.view(tmp_path, seed=2, known=(), given=hand.stated_scale(1.7))
    settings = dataclasses.replace(hand.SETTINGS, block_error=0.01)
    stage = Stage((dataclasses.replace(traced, nuisances=Nuisances(1.7, 0.01, 0.02, 0, 0, 0.03)),),
                  settings)
    truth = Truth(hand.TRUTH, (1.7 * traced.view.responses,),
                  (np.array([0.01, 0.02, 0.005]) * stray,), (0.015 * stray,),
                  (hand.transport(traced.region, traced.group, 1, np.random.default_rng(9)),)
                  if stray else ())
    record = replay(stage, truth, np.random.default_rng(5))
    view = record.views[0]
    recorded({"photo": view.measured, "rendered": view.rendered, "signal": record.signal,
              "covariance": record.signal_covariance, "model": record.model_covariance,
              "spectra": record.spectra, "agreement": view.agreement, "scale": view.light_scale,
              "regions": record.regions}, rtol=hand.ENDS)


def test_parts_of_a_traced_view(recorded, tmp_path):
    view, traced = hand.view(tmp_path, seed=8, lights=2, own_light=True)
    errors = dataclasses.replace(traced, nuisances=Nuisances(None, 0.01, 0.02, 0.03, 0.01, 0.02))
    terms = errors.terms(6, np.linspace(0.1, 1, len(traced.group))[:, None])
    state = np.random.default_rng(1).normal(0.2, 0.05, terms.size)
    _, pull, curvature = terms.expand(state)
    recorded({"measured": traced.measured, "variance": errors.variance,
              "photo variance": errors.photo_variance, "weight": errors.weight,
              "sizes": (terms.size, terms.count, terms.gain, terms.light, terms.mix,
                        terms.free_scale).__repr__(), "prior": terms.prior,
              "misfit": terms.misfit(state), "pull": pull, "curvature": curvature,
              "start": terms.start_scale(state),
              "solution": terms.solution(state, np.diag(np.arange(1.0, terms.size + 1))),
              "smoothed": smoothed_variance(np.array([0.1, 0.4, 0.2, 0.7]), np.array([0, 0, 1, 3]),
                                            np.array([3, 9, 16, 5])),
              "deviations": traced.traced.deviations, "noise": traced.traced.relative_variance})
    # minus half the gradient, by differences
    step = 1e-5
    slopes = [(terms.misfit(state + step * unit) - terms.misfit(state - step * unit)) / (2 * step)
              for unit in np.eye(terms.size)[::7]]
    np.testing.assert_allclose(pull[::7], -0.5 * np.array(slopes),
                               atol=1e-4 * np.abs(pull).max())
    recorded({"variance": view.variance, "known": view.known_surface, "light": view.light,
              "responses": view.responses, "groups": view.light_groups, "own": view.own_lights,
              "materials": view.surface_materials, "used": view.used,
              "spectra": view.spectra(np.random.default_rng(2).uniform(size=(4, 5))),
              "xml": len(view.xml({name: hand.TRUTH[name] for name in hand.NAMES}))}, case="view")


def test_a_start_far_off(recorded, tmp_path):
    from spectrabox.reconstruct.fit.spectrum_prior import spectrum_prior
    _, traced = hand.view(tmp_path, seed=9)
    traced = dataclasses.replace(traced, nuisances=nuisances(traced.view, hand.SETTINGS))
    priors = [spectrum_prior(hand.SETTINGS, hand.GRID)] * 4
    fits = [fit_traced([traced], priors, start) for start in (None, np.full((4, 7), 0.9))]
    np.testing.assert_allclose(fits[0].coefficients, fits[1].coefficients, atol=2e-3)
    recorded({"first cost": [fit.cost_history[0] for fit in fits],
              "coefficients": fits[1].coefficients, "covariance": fits[1].covariance},
             rtol=hand.ENDS)


def test_views_that_are_refused(recorded, tmp_path):
    view, _ = hand.view(tmp_path, seed=2, known=())
    known, _ = hand.view(tmp_path, "known", 3)
    scaled, _ = hand.view(tmp_path, "scaled", 4, known=(), given=hand.stated_scale(1.0))
    other = hand.scene(tmp_path, change=lambda text: text.replace('id="white"', 'id="other"'))
    apart = dataclasses.replace(view, name="apart", scene_file=dataclasses.replace(
        other, surfaces={"alone": "other"}), materials=())
    recorded({name: said(lambda views=views: require_scales(views)) for name, views in (
        ("none", [view]), ("known", [known]), ("scaled", [scaled]), ("shared", [view, known]),
        ("of two", [scaled, view]), ("apart", [scaled, apart, view]))})
    off = dataclasses.replace(known, calibration=dataclasses.replace(
        known.calibration, sensitivity=dataclasses.replace(
            known.calibration.sensitivity, grid=dataclasses.replace(
                hand.GRID, nm=hand.GRID.nm + 1e-9))))
    lights = dataclasses.replace(known, light_spectra={"no": known.calibration.light})
    recorded({"grids": said(lambda: check_views([known, off])),
              "lights": said(lambda: require_lights(lights))}, case="others")


def test_where_bands_and_pixels_become_too_few(recorded, tmp_path):
    view, _ = hand.view(tmp_path, seed=2)
    curves = view.sensitivities.copy()

    def dimmed(share):
        fit = dataclasses.replace(view.calibration.sensitivity, curves=curves * np.array(
            [[1.0], [share], [0.5]]))
        return said(lambda: require_light_in_bands(dataclasses.replace(
            view, calibration=dataclasses.replace(view.calibration, sensitivity=fit))))
    white = view.response.sum(axis=1)
    edge = 1e-6 * white.max() / white[1]
    recorded({f"band {share}": dimmed(share * edge) for share in (0.0, 0.97, 1.03, 2)})

    def few(pixels):
        used = np.zeros(view.surface.shape, bool)
        for index in range(7):
            rows, columns = np.nonzero(view.surface == index)
            used[rows[:pixels], columns[:pixels]] = True
        other = dataclasses.replace(view)
        vars(other).update(surface=view.surface, used=used)
        return said(lambda: require_pixels([other]))
    recorded({f"{pixels} pixels": few(pixels) for pixels in (0, 11, 12)}, case="pixels")

    def sunk(pixels, sigmas):
        signal = np.full((40, 50, 3), 0.5)
        signal.reshape(-1, 3)[:pixels, 1] = -sigmas * 0.01
        return said(lambda: require_sound_pixels(dataclasses.replace(
            view.photo, signal=signal, variance=np.full(signal.shape, 1e-4),
            saturated=np.zeros(signal.shape, bool))))
    recorded({f"{pixels} at {sigmas}": sunk(pixels, sigmas) for pixels in (1, 2, 3)
              for sigmas in (5.9, 6.1)}, case="negative")
    lost = view.photo.signal.copy()
    lost[3, 4, 1], lost[5, 6] = np.nan, np.inf
    recorded(said(lambda: require_sound_pixels(dataclasses.replace(view.photo, signal=lost))),
             case="lost")


def test_engines_that_are_chosen(recorded, tmp_path):
    view, _ = hand.view(tmp_path, seed=2, given=LightScale(1.0, None, None, ""))
    glossy = dataclasses.replace(view, scene_file=hand.scene(tmp_path, change=lambda text: (
        text.replace('type="diffuse" id="red"', 'type="plastic" id="red"'))))
    unnamed = dataclasses.replace(view, scene_file=hand.scene(tmp_path, 2, lambda text: (
        text.replace(' id="second"', ""))))
    for each in (glossy, unnamed):
        vars(each).update(surface=view.surface, used=view.used)
    found = {}
    for engine in (*ENGINES, "other"):
        settings = InversionSettings(engine=engine, light_error=0.1)
        for name, views in (("one", [view]), ("two", [view, view]), ("glossy", [glossy]),
                            ("unnamed", [unnamed])):
            found[f"{engine} {name}"] = said(lambda v=views, s=settings: (
                (chosen := settings_for(v, s))[0].engine, chosen[1]))
    recorded(found | {"engines": [engine_for([each.scene_file]) for each in (view, glossy)],
                      "plain": said(lambda: require_plain_products(glossy)),
                      "lights": said(lambda: require_named_lights(unnamed, InversionSettings()))})
    recorded(InversionSettings(), case="defaults")


def test_jobs_of_single_wavelengths(recorded, tmp_path):
    view, _ = hand.view(tmp_path, seed=2, given=hand.stated_scale(1.7))
    job = monochrome_job(view, InversionSettings(6, steps=9, spp=5, seed=4))
    recorded(dataclasses.replace(job, xml=""))
    recorded(monochrome_xml(view), case="xml")
