"""Recorded: all materials of a scene at once, through its light transport."""
import dataclasses

import numpy as np
import pytest
from sampling_cameras import curves, surface
from sampling_inputs import lopsided_prior, result_or_refusal

from spectrabox.radiometry.records import LightTransport, Outcome
from spectrabox.sampling.polytope.diagnostics import tail_shape
from spectrabox.sampling.prior.mixture import GRID
from spectrabox.sampling.scene import sampling as scene_sampling
from spectrabox.sampling.scene.draws import draw_scene, shared_errors, surprise
from spectrabox.sampling.scene.labels import find_modes, near_labels
from spectrabox.sampling.scene.posterior import (
    JointProblem,
    climb,
    covariance_at,
    gaussian_of,
    information_bits,
    joint_problem,
    log_weight_of,
    logits_of,
    products,
    residual_and_jacobian,
    residual_by_logit,
)
from spectrabox.sampling.scene.sampling import (
    JointSamples,
    _equations,
    _propose,
    _proposer,
    sample_joint,
)

MATERIALS = ("wall", "box", "floor")
EXPONENTS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [2, 0, 1], [0, 1, 2], [1, 1, 1]])
PAINTS = {name: surface(GRID.nm, seed) for seed, name in enumerate(MATERIALS)}


def scene(known=("floor",), common=True, families=True, noise=0.01, regions=8):
    """What `joint_problem` and `draw_scene` are told of three materials that light one another."""
    rng = np.random.default_rng(12)
    coefficients = rng.uniform(0.02, 0.2, (regions, len(EXPONENTS)))
    coefficients[np.arange(regions), np.arange(regions) % 3] += rng.uniform(0.5, 0.9, regions)
    transport = LightTransport(MATERIALS, EXPONENTS, coefficients)
    sensitivity, light = curves(GRID.nm)
    response = sensitivity * light * GRID.weights_nm * np.array([[0.012], [0.009], [0.015]])
    signal = light_received(coefficients, response) * (1 + noise * rng.standard_normal((regions,
                                                                                        3)))
    error = noise * signal * rng.uniform(0.6, 1.7, signal.shape)
    signal[2], signal[5, 1] = np.nan, np.nan
    root = 0.02 * rng.standard_normal((3, 3))
    shared = shared_errors(signal, root @ root.T, 0.015, np.arange(regions) % 3, 0.006, 0.012)
    return {"transport": transport, "response": response, "signal": signal,
            "standard_error": error, "common": shared if common else None,
            "known": {name: PAINTS[name] for name in known},
            "families": {"box": ("leaf", "skin")} if families else None}


def light_received(coefficients, response):
    rho = np.array([PAINTS[name] for name in MATERIALS])
    terms = np.prod(rho[None] ** EXPONENTS[:, :, None], axis=1)
    return coefficients @ terms @ response.T


def problem_of(**named):
    return joint_problem(prior=lopsided_prior(), **scene(**named))


def small_problem(seed=6, scale=0.6):
    """Few rows and wavelengths, in which a scene is not linear in its logits."""
    rng = np.random.default_rng(seed)
    means = rng.normal(-0.5, 0.5, (4, 5))
    roots = scale * (np.eye(5) * rng.uniform(0.5, 1.5, (4, 1, 5)) + 0.2 * rng.random((4, 5, 5)))
    weights = np.array([[0.5, 0.3, 0.2, 1.0], [0.1, 0.0, 0.9, 1.0]])
    exponents = np.array([[1.0, 0], [0, 1], [1, 1], [2, 1]])
    rows, response = rng.uniform(1, 9, (6, 2, 4)), rng.uniform(0.2, 0.6, (2, 5))
    with np.errstate(divide="ignore"):
        problem = JointProblem(("a", "b"), exponents, rng.uniform(0.3, 1, (4, 5)), rows,
                               np.zeros(6), response, np.log(weights), means, roots)
    truth = rng.standard_normal(10)
    at = residual_and_jacobian(problem, np.array([1, 2]), truth)[0]
    return dataclasses.replace(problem, targets=at + rng.standard_normal(6)), truth


@pytest.mark.parametrize("named", [
    {}, {"known": (), "families": False}, {"common": False}, {"known": ("wall", "floor")},
    {"known": ("box",), "noise": 0.4}])
def test_problems_of_scenes(recorded, named):
    found = problem_of(**named)
    # rows are along singular vectors, of either sign: what is kept does not hang on it
    gram = np.einsum("fke,flh->kelh", found.rows, found.rows)
    recorded((found.materials, found.exponents, found.known, found.rows.shape, gram,
              np.einsum("fke,f->ke", found.rows, found.targets), found.response,
              found.log_weights, found.means, found.roots))


def test_one_gaussian(recorded):
    mean, root = gaussian_of(lopsided_prior())
    recorded((mean, root))


def test_scenes_that_are_refused(recorded):
    prior, given = lopsided_prior(), scene()

    def said(**changed):
        return result_or_refusal(lambda: joint_problem(prior=prior, **given | changed).materials)
    signal, error = given["signal"], given["standard_error"]
    zero, unseen = error.copy(), error.copy()
    zero[3, 1], unseen[2, 1] = 0, 0
    recorded({
        "good": said(), "fewer": said(signal=signal[:7]), "bands": said(signal=signal[:, :2]),
        "errors": said(standard_error=error[:, :2]), "common": said(common=np.zeros((3, 7, 3))),
        "nothing": said(signal=signal * np.nan), "exact": said(standard_error=zero),
        "exact where left out": said(standard_error=unseen),
        "negative": said(standard_error=-error), "family": said(families={"box": ("fur",)}),
        "word": said(families={"box": ("metal",)})})
    recorded({
        "unknown": result_or_refusal(draw_scene, given["transport"], signal, error,
                                     given["response"], 200, 1, prior,
                                     known={"roof": PAINTS["box"], "attic": PAINTS["box"]}),
        "all known": result_or_refusal(draw_scene, given["transport"], signal, error,
                                       given["response"], 200, 1, prior, known=PAINTS),
        "few": result_or_refusal(sample_joint, problem_of(), 1, None, 99)}, case="draws")


def test_errors_that_regions_share(recorded):
    rng, root = np.random.default_rng(4), np.array([[0.02, 0, 0], [0.01, 0.03, 0], [0, 0.005, 0]])
    signal = rng.uniform(0.1, 0.9, (5, 3))
    signal[3, 1] = np.nan
    surface_of = np.array([4, 2, 4, 7, 2])
    found = {}
    for name, call in {
            "bands": (root @ root.T,), "scale": (0 * root, 0.02),
            "surfaces": (0 * root, 0.0, surface_of, 0.01, 0.03),
            "colour": (0 * root, 0.0, surface_of, 0.01),
            "all": (root @ root.T, 0.02, surface_of, 0.01, 0.03),
            "negative scale": (root @ root.T, -0.02), "skewed": (root,),
            "negative colour": (root @ root.T, 0.02, surface_of, -0.01, 0.03),
            "negative brightness": (root @ root.T, 0.02, surface_of, 0.01, -0.03)}.items():
        errors = result_or_refusal(shared_errors, signal, *call)
        found[name] = errors if isinstance(errors, str) else (
            errors.shape, np.einsum("qrk,qsl->rksl", errors, errors))
    recorded(found)


def test_light_of_a_scene_and_its_slopes(recorded):
    problem, truth = small_problem()
    labels = np.array([1, 2])
    logits = logits_of(problem, labels, np.stack([truth, -0.4 * truth]))
    residual, by_logit = residual_by_logit(problem, logits[0])
    recorded((logits, products(problem, logits), residual, by_logit,
              residual_and_jacobian(problem, labels, truth), log_weight_of(problem, labels),
              covariance_at(problem, labels, truth)))
    jacobian, step = residual_and_jacobian(problem, labels, truth)[1], 1e-6
    for index in range(10):
        moved = truth + step * np.eye(10)[index]
        np.testing.assert_allclose(
            (residual_and_jacobian(problem, labels, moved)[0] - residual) / step,
            jacobian[:, index], atol=1e-4 * np.abs(jacobian).max())


def test_modes_and_their_evidence(recorded):
    problem, truth = small_problem()
    labels = np.array([[0, 2], [1, 2], [2, 0], [3, 3], [1, 1]])
    starts = np.linspace(-1, 1, 50).reshape(5, 10)
    found = climb(problem, labels, starts)
    # a climb ends where the cost falls by less than a hundredth of a nat
    recorded(found, rtol=1e-4)
    recorded((find_modes(problem, 3), find_modes(problem), information_bits(problem)), rtol=1e-4,
             case="best")
    chosen, z = near_labels(problem, logits_of(problem, labels[1], truth[None])[0], 4)
    recorded((chosen, z), case="near")
    far = dataclasses.replace(problem, targets=problem.targets + 40 * np.arange(6))
    recorded(result_or_refusal(climb, far, labels[:1], starts[:1]), rtol=1e-4, case="far")
    lost = dataclasses.replace(problem, targets=problem.targets * np.nan)
    with np.errstate(all="ignore"):     # no number is what it is about
        recorded(result_or_refusal(climb, lost, labels[:1], starts[:1]), case="lost")
    recorded((surprise(problem, found), surprise(far, found),
              surprise(dataclasses.replace(problem, targets=1.2 * problem.targets), found)),
             rtol=1e-3, case="surprise")


def test_proposals(recorded):
    problem, truth = small_problem()
    mode = climb(problem, np.array([[1, 2]]), truth[None])
    proposer = _proposer(problem, mode.labels[0], mode.z[0])
    logits, log_weights = _propose(problem, proposer, 200, np.random.default_rng(1))
    # directions are singular vectors, unlike one another
    recorded((logits, log_weights), rtol=1e-4)
    a = proposer.centre + np.linspace(-0.3, 0.4, proposer.size.size)
    base = logits_of(problem, mode.labels[0], 0.1 * truth[None])
    eta, slope, at = _equations(problem, proposer, base, a[None])
    recorded((eta, slope, at), rtol=1e-4, case="equations")
    step = 1e-6
    for index in range(a.size):
        moved = _equations(problem, proposer, base, a[None] + step * np.eye(a.size)[index])[0]
        np.testing.assert_allclose((moved - eta)[0] / step, slope[0, :, index],
                                   atol=1e-4 * np.abs(slope).max())


def test_draws_of_a_small_scene(recorded, monkeypatch):
    problem, _ = small_problem()
    monkeypatch.setattr(scene_sampling, "ROUND", 300)
    found = sample_joint(problem, 3, kept=500, effective_wanted=150)
    # what a climb ends with to 1e-4 moves every proposal by as much, and some of a resampling by a
    # whole draw
    recorded((found.materials, found.proposals, found.seed, found.converged))
    recorded((found.spectra, found.effective_samples, found.tail, found.unsolved), rtol=3e-3,
             case="draws")
    again = sample_joint(problem, 3, find_modes(problem, 128), 500, 150)
    np.testing.assert_array_equal(found.spectra, again.spectra)
    monkeypatch.setattr(scene_sampling, "MOST_PROPOSALS", 600)
    recorded(result_or_refusal(sample_joint, problem, 3, None, 500, 590), case="refused")
    loose = sample_joint(problem, 3, None, 400, 590, refuse=False)
    recorded((loose.proposals, loose.spectra.shape, loose.converged), case="loose")


def test_the_law_of_draws_of_a_small_scene():
    """Weighted by hand: draws of the prior of a scene with one material, and its likelihood."""
    problem, _ = small_problem(scale=0.3)
    rng, count = np.random.default_rng(1), 200_000
    weights = np.exp(problem.log_weights[:, :3])
    labels = np.stack([rng.choice(3, count, p=each) for each in weights], axis=1)
    logits = problem.means[labels] + np.einsum("tmpq,tmq->tmp", problem.roots[labels],
                                               rng.standard_normal((count, 2, 5)))
    received = np.einsum("tep,kp->tke", products(problem, logits)[1], problem.response)
    chi = np.sum((np.einsum("tke,fke->tf", received, problem.rows) - problem.targets)**2, axis=1)
    weight = np.exp(-0.5 * (chi - chi.min()))
    weight /= weight.sum()
    rho = 1 / (1 + np.exp(-logits))
    mean = np.einsum("t,tmp->mp", weight, rho)
    spread = np.sqrt(np.einsum("t,tmp->mp", weight, (rho - mean)**2))
    found = sample_joint(problem, 5, kept=4000, effective_wanted=1000)
    effective = min(1 / np.sum(weight**2), 1000)
    # ten means, at 4.5 standard errors of the smaller effective number
    assert np.abs((found.spectra.mean(axis=0) - mean) / spread).max() < 4.5 / np.sqrt(effective) \
        + 4.5 / np.sqrt(found.effective_samples)


@pytest.mark.parametrize("tail", [0.69, 0.7, 0.71])
@pytest.mark.parametrize("effective", [396.0, 400.0, 404.0])
def test_draws_of_a_scene_converge_where_enough_are_effective(recorded, effective, tail):
    recorded(JointSamples(("a",), np.full((1, 1, 2), 0.5), effective, tail, 2000, 0.01,
                          1).converged)
    assert tail_shape(np.ones(400)) == 0


@pytest.mark.parametrize("off, chance", [(0.0147, 1.058e-3), (0.015, 0.943e-3)])
def test_a_picture_agrees_above_a_chance_of_one_in_a_thousand(recorded, off, chance):
    given = scene(noise=0.02)
    given["signal"] = given["signal"] * (1 + off * np.linspace(-1, 1, 8)[:, None])
    problem = joint_problem(prior=lopsided_prior(), **given)
    assert surprise(problem, find_modes(problem, 128)) == pytest.approx(chance, rel=0.01)
    transport, signal, error, response = (given.pop(name) for name in (
        "transport", "signal", "standard_error", "response"))
    found = draw_scene(transport, signal, error, response, 100, 2, lopsided_prior(), **given,
                       effective_wanted=5.0)
    assert found["box"].outcome is (Outcome.THROUGH_TRANSPORT if chance > 1e-3
                                    else Outcome.DISAGREES)
    recorded(found["wall"].coefficients.shape)


@pytest.mark.parametrize("off", [0.0, 0.9])
def test_draws_of_a_scene(recorded, off):
    given = scene(noise=0.02)
    signal = given["signal"] * (1 + off * np.linspace(-1, 1, 8)[:, None])
    found = draw_scene(given["transport"], signal, given["standard_error"], given["response"], 300,
                       2, lopsided_prior(), common=given["common"], known=given["known"],
                       families=given["families"], coefficients=9, effective_wanted=60.0)
    assert set(found) == {"wall", "box"}
    recorded({name: (one.method, one.outcome, one.sentence, one.seed, one.spectra.shape,
                     one.coefficients.shape) for name, one in found.items()})
    # rows of a problem are along singular vectors, and chains of steps follow them
    recorded({name: (one.spectra, one.coefficients, one.effective_samples)
              for name, one in found.items()}, rtol=1e-3, case="draws")
