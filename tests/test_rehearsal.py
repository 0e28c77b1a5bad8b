"""Rehearsals: a session's own photos again, with known truths."""
import dataclasses
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.measure.scene import rehearsal
from spectrabox.measure.scene.rehearsal import Rehearsed
from spectrabox.measure.steps.inversion import settings_of, views_of
from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.agreement import within_to_block
from spectrabox.reconstruct.replay import _patterns, _photographed, replay, replayable
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import load_finished
from spectrabox.session.replayed import rehearse
from spectrabox.session.store.rehearsals import save_rehearsal, stored_rehearsal

from tests.session_runs import edit, run, silent

TIMES, FEW = 20, 6


def test_a_photo_of_the_spectra_that_were_found_gives_their_signals_back(finished, mitsuba):
    made = load_finished(read_session(finished))
    joint = made.records.reconstruct.joint
    settings = settings_of(made.capture)
    views = replayable(views_of(made.capture, made.records), settings, silent)
    view = views[0].view
    spectra = dict(zip(joint.materials, joint.spectra, strict=True))
    response = view.response[None] * joint.views[0].light_scale.value
    again = replay(views, settings, spectra, [response], [np.zeros(3)], [0.0],
                   np.random.default_rng(5))
    expected = joint.spectra @ joint.response.T
    # the photo's noise, and surfaces brighter or darker by the stated error; of twelve signals
    # one is beyond 3.5 standard deviations in less than one of a hundred replays
    error = np.sqrt(np.einsum("mjj->mj", again.signal_covariance)
                    + (views[0].nuisances.surface_error * expected) ** 2)
    assert np.abs((again.signal - expected) / error).max() < 3.5
    # light that no scene holds: the same photo with it, less the photo without
    traced, region = views[0], views[0].region
    clean, hazy, lit = (_photographed(traced, spectra, response, glare, ambient,
                                      np.zeros_like(traced.traced.coefficients),
                                      np.random.default_rng(6)).measured
                        for glare, ambient in ((np.zeros(3), 0.0), (np.full(3, 0.2), 0.0),
                                               (np.zeros(3), 0.2)))
    mean = clean.mean(axis=(0, 1))
    shown = region >= 0
    # Noise grows with the light: 1 % of the mean signal covers it, a fifth of which is asked for.
    np.testing.assert_allclose((hazy - clean)[shown].mean(axis=0), 0.2 * mean, rtol=0.05)
    dark, bright = (np.argmin(joint.signal.sum(axis=1)), np.argmax(joint.signal.sum(axis=1)))
    materials = np.array([joint.materials.index(name)
                          for name in traced.view.surface_materials])[traced.view.surface]
    added = [(lit - clean)[shown & (materials == index)].mean(axis=0) for index in (dark, bright)]
    # light from everywhere is reflected as the lamp's is
    np.testing.assert_allclose(added[0] / added[1], expected[dark] / expected[bright], rtol=0.1)


def test_surfaces_of_a_rehearsed_photo_are_uneven_as_the_session_showed(finished, mitsuba):
    made = load_finished(read_session(finished))
    views = replayable(views_of(made.capture, made.records), settings_of(made.capture), silent)
    traced = dataclasses.replace(views[0], nuisances=dataclasses.replace(
        views[0].nuisances, block_error=0.02))
    surfaces = np.unique(traced.group)
    within = 0.02 / within_to_block(len(traced.group), surfaces.size)
    rng = np.random.default_rng(3)
    patterns = np.log([_patterns(traced, rng)[:, 0] for _ in range(400)])
    for surface in surfaces:
        own = patterns[:, traced.group == surface]
        if own.shape[1] > 5:
            # the mean of 5 squared normal numbers over 400 patterns is known to 1 / sqrt(1000)
            assert np.mean(own**2) == pytest.approx(within**2, rel=4 / np.sqrt(1000))
            # round-off of sums of numbers of about 0.02
            np.testing.assert_allclose(own.mean(axis=1), 0, atol=1e-12)


@pytest.fixture(scope="module")
def honest(_finished):
    return rehearse(read_session(_finished), TIMES, 4, "cpu", silent)


def test_bands_of_the_demo_hold_truths_that_its_own_errors_explain(honest):
    coverage = honest.coverage.mean()
    # 80 truths; coverage of one truth scatters by about 0.1, so the mean by about 0.012
    assert 0.91 < coverage <= 1
    assert honest.times == TIMES and not honest.too_narrow
    assert np.all(honest.ranks.sum(axis=1) == TIMES * 11)


def test_a_rehearsal_hears_an_error_that_the_session_does_not_state(finished, honest, monkeypatch):
    response = rehearsal._response

    def under_another_light(*given):
        return response(*given) * np.array([1.3, 1.0, 0.75])[:, None]
    monkeypatch.setattr(rehearsal, "_response", under_another_light)    # of truths alone
    monkeypatch.setattr(rehearsal, "MIN_TIMES", FEW)
    mistaken = rehearse(read_session(finished), FEW, 4, "cpu", silent)
    held = [some.coverage.mean() for some in (honest, mistaken)]
    # bands of about 0.15 in reflectance hold few bright truths that are off by a quarter
    assert held[1] < held[0] - 0.1
    assert mistaken.too_narrow


def test_the_command_answers_and_the_report_hears_it(finished, monkeypatch):
    monkeypatch.setattr(rehearsal, "MIN_TIMES", 2)
    outcome = CliRunner().invoke(app, ["rehearse", str(finished), "--times", "2", "--json",
                                       "--device", "cpu"])
    assert outcome.exit_code == 0, outcome.output
    answers = json.loads(outcome.stdout)
    assert {"level", "seed", "times", "materials", "file"} <= set(answers)
    config = read_session(finished)
    kept = stored_rehearsal(config)
    assert kept is not None
    assert kept.facts["materials"] == answers["materials"]
    report = CliRunner().invoke(app, ["report", str(finished)])
    assert report.exit_code == 0
    assert "Known truth inside the band, rehearsed" in (finished / "report.html").read_text()


def test_a_rehearsal_of_other_results_is_not_shown(finished):
    config = read_session(finished)
    save_rehearsal(config, Rehearsed(0.95, 1, 20, (), *np.zeros((4, 0)), np.zeros((0, 10))))
    assert stored_rehearsal(config) is not None
    edit(finished, "draws = ", "draws = 1")     # a digit before the number
    assert run(finished).states["sample"] == "run"
    assert stored_rehearsal(config) is None


def test_the_same_seed_gives_the_same_rehearsal(finished, monkeypatch):
    config = read_session(finished)
    monkeypatch.setattr(rehearsal, "MIN_TIMES", 2)
    first, second = (rehearse(config, 2, 8, "cpu", silent) for _ in range(2))
    assert first.facts == second.facts


def test_too_few_rehearsals_are_refused(finished):
    with pytest.raises(InputError, match="5 rehearsals tell nothing of coverage: 20 or more"):
        rehearse(read_session(finished), 5, 1, "cpu", silent)


def test_a_session_that_was_not_run_is_refused(captured):
    with pytest.raises(InputError, match="is not up to date: run 'spectrabox run' first"):
        rehearse(read_session(captured), TIMES, 1, "cpu", silent)
