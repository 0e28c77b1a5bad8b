"""Gloss: a share of the light that a surface mirrors, which can only add."""
import dataclasses

import numpy as np
import pytest

from spectrabox.measure.surfaces.surface_signals import measurement
from spectrabox.radiometry.error_model import (
    PHOTO_NOISE,
    SAMPLE_PLANE,
    SURFACE_REFLECTION,
    proportional_covariance,
)
from spectrabox.radiometry.gloss import KINDS, SURFACE_WORDS, draw_gloss, gloss_states
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.interreflection import response_matrix
from spectrabox.radiometry.records.spectra import SurfaceSignals
from spectrabox.radiometry.spectra.named_spectra import test_reflectances as published
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior
from spectrabox.sampling.prior.state_posteriors import state_shares

from tests.sampling_cameras import curves

NM, AT_5_NM = FINE_GRID.nm, slice(None, None, 5)
SURFACES = published(FINE_GRID)["CES99"][::2]
# of the bare lamp, and through gels that pass its ends and its long wavelengths
GELS = (np.ones(NM.size),
        np.interp(NM, [400, 470, 540, 600, 640, 700], [0.3, 0.5, 0, 0.02, 0.6, 0.9]),
        np.interp(NM, [400, 450, 540, 590, 640, 700], [0.15, 0.1, 0.02, 0.6, 0.9, 0.93]))
ERROR = "a symmetric error of 0.8 % of white"


def bands(photos):
    """Response (3 photos, P), rows summing to 1."""
    sensitivities, light = curves(NM)
    rows = np.vstack([response_matrix(FINE_GRID, sensitivities, light * gel)
                      for gel in GELS[:photos]])
    return rows / rows.sum(axis=1, keepdims=True)


def photographed(truth, photos, gloss, stated, seed=7):
    """Signals of surfaces (n, P) that mirror so much, level known to 3 %, 1 % of noise a band."""
    rng, rows = np.random.default_rng(seed), bands(photos)
    clean = truth @ rows.T
    signal = clean * (1 + 0.03 * rng.standard_normal((len(truth), 1))) \
        * (1 + 0.01 * rng.standard_normal(clean.shape)) + np.reshape(gloss, (-1, 1))
    count = len(rows)
    noise = ((0.01 * signal)**2 + 0.001**2)[:, :, None] * np.eye(count)
    if stated == ERROR:
        noise = noise + 0.008**2
    states = () if stated == ERROR else (gloss_states(stated, ["lamp"] * count),) * len(truth)
    return SurfaceSignals(
        tuple(map(str, range(len(truth)))), (False,) * len(truth), FINE_GRID, truth,
        tuple(map(str, range(count))), np.repeat(np.arange(photos), 3), rows, signal, {
            PHOTO_NOISE: noise, SAMPLE_PLANE: proportional_covariance(
                signal, np.full((count, count), 0.03**2))}, states)


def judged(signals, truth):
    """Share of wavelengths that 95 % bands hold, and their mean width."""
    bands_of = [solve_posterior(load_prior(), measurement(signals, index)).band(0.95)
                for index in range(len(truth))]
    lower, upper = np.swapaxes(bands_of, 0, 1)
    own = truth[:, AT_5_NM]
    return ((lower <= own) & (own <= upper)).mean(), (upper - lower).mean()


@pytest.mark.parametrize("photos", [1, 2, 3])
def test_bands_of_an_unstated_sample_hold_at_three_per_cent_of_gloss(photos):
    holds, width = judged(photographed(SURFACES, photos, 0.03, None), SURFACES)
    matt, _ = judged(photographed(SURFACES, photos, 0.0, None), SURFACES)
    before, narrow = judged(photographed(SURFACES, photos, 0.03, ERROR), SURFACES)
    # of these colours, which the prior knows least, bands hold .925 without gloss; 50 surfaces know
    # a share to .01
    assert holds > min(matt, 0.93) - 0.02 and width < 1.1 * narrow
    # what a symmetric error says of light that only adds
    assert before < 0.8


@pytest.mark.parametrize("level", [0.02, 0.05, 0.1, 0.2])
def test_an_unstated_grey_is_estimated_as_matt_and_its_band_reaches_down_to_gloss(level):
    """What "PASS if matt" says: 3 % of gloss on a darker grey gives the same signal."""
    truth = np.full((8, NM.size), level)
    signals = photographed(truth, 1, 0.0, None)
    found = [solve_posterior(load_prior(), measurement(signals, index))
             for index in range(len(truth))]
    # of white: L* 1 of a grey of .05; the noise of the mean of 8 is 1 % of the level
    assert np.mean([each.mean.mean() for each in found]) - level == pytest.approx(
        0, abs=0.004 + 0.02 * level)
    darker = max(level - 0.03, 0.0)
    assert np.mean([each.band(0.95)[0].mean() for each in found]) < max(darker, 0.3 * level)


@pytest.mark.parametrize("photos", [1, 3])
def test_stated_matt_is_narrower_than_a_symmetric_error_and_holds(photos):
    gloss = draw_gloss("matt", len(SURFACES), np.random.default_rng(3))
    holds, width = judged(photographed(SURFACES, photos, gloss, "matt"), SURFACES)
    _, wider = judged(photographed(SURFACES, photos, gloss, ERROR), SURFACES)
    assert width < wider and holds > 0.93 - 0.02


@pytest.mark.parametrize("stated", SURFACE_WORDS)
@pytest.mark.parametrize("level", [0.04, 0.1])
def test_dark_greys_whose_gloss_is_what_is_stated_have_no_bias_by_it(stated, level):
    """Against the same greys of a gloss that is known: what the prior does to them is not asked."""
    truth = np.full((40, NM.size), level)
    gloss = draw_gloss(stated, len(truth), np.random.default_rng(5))
    signals = photographed(truth, 1, gloss, stated)
    off, errors = [], []
    for index, own in enumerate(gloss):
        seen = measurement(signals, index)
        known = dataclasses.replace(seen, signal=seen.signal - own, states=None)
        found = solve_posterior(load_prior(), seen)
        off.append(found.mean.mean() - solve_posterior(load_prior(), known).mean.mean())
        errors.append(found.states.standard_deviation[0])
    # a third of what the gloss makes uncertain, and what 40 greys tell of a mean at 3 sigma
    assert abs(np.mean(off)) < np.mean(errors) / 3 + 3 * np.std(off) / len(off)**0.5 / 2


def test_a_state_gains_nothing_by_how_usual_its_spectra_are_and_loses_by_what_none_explains():
    beforehand = np.log([[0.8], [0.2]])
    for nats in (-1.5, 0.0, 1.5):
        shares, whole = state_shares(beforehand, np.array([[3.0], [3.0 + nats]]))
        assert shares[:, 0] == pytest.approx([0.8, 0.2])
        # the signal's own evidence is whole
        assert whole[0] == pytest.approx(3 + np.log(0.8 + 0.2 * np.exp(nats)))
    shares, _ = state_shares(beforehand, np.array([[3.0], [-27.0]]))
    assert shares[:, 0] == pytest.approx([1, 0])
    # what photos differ by stands with what is known beforehand
    shares, _ = state_shares(beforehand + np.array([[0.0], [5.0]]), np.zeros((2, 1)))
    assert shares[1, 0] == pytest.approx(0.2 * np.exp(5) / (0.8 + 0.2 * np.exp(5)))


def test_a_gloss_of_one_place_of_the_lamp_is_one_and_of_two_places_two_alike():
    one = gloss_states(None, ["a"] * 6)
    assert one.names == ("gloss",) and one.causes == (SURFACE_REFLECTION,)
    np.testing.assert_array_equal(one.pattern, 1)
    two = gloss_states(None, ["a", "a", "a", "b", "b", "b"])
    assert two.names == ("gloss", "gloss 2")
    np.testing.assert_array_equal(two.pattern, np.kron(np.eye(2), np.ones((3, 1))))
    for states in (one, two):
        assert states.weights.sum() == pytest.approx(1)
        # cutting a wide kind in two leaves its mean and variance
        expected = gloss_states("glossy", ["a"])
        assert expected.mean[0] == pytest.approx(KINDS["glossy"].mean)
        assert expected.covariance[0, 0] == pytest.approx(KINDS["glossy"].deviation**2)
        assert states.mean[0] == pytest.approx(one.mean[0])
        assert states.covariance[0, 0] == pytest.approx(one.covariance[0, 0])
    within = two.covariances[1]
    assert within[0, 1] == pytest.approx(0.5 * within[0, 0])
    drawn = draw_gloss(None, 40_000, np.random.default_rng(1))
    assert drawn.min() >= 0
    # what is cut off below 0 moves the mean by 1 % of it
    assert drawn.mean() == pytest.approx(one.mean[0], rel=0.03)
