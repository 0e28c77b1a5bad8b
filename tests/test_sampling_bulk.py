"""Circuit hit-and-run and its diagnostics: against independent draws and closed forms."""
import numpy as np
import pytest
from sampling_cameras import camera, grey
from scipy import stats

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.sampling.polytope.circuit_hit_and_run import (
    design,
    find_circuits,
    sample_in_bulk,
    schedule,
)
from spectrabox.sampling.polytope.diagnostics import diagnose, refuse_poor
from spectrabox.sampling.polytope.tilted_rejection import sample_polytope

SIGNIFICANCE = 1e-4
NM = np.linspace(400, 700, 61)
DRAWS = 20_000


@pytest.mark.parametrize("bands, coefficients", [(3, 5), (3, 9), (4, 9), (3, 21)])
def test_the_camera_cannot_see_a_circuit(bands, coefficients):
    A = camera(coefficients, bands)
    circuits = find_circuits(A, np.random.default_rng(0))
    moved = np.einsum("knj,nj->nk", A[:, circuits.members], circuits.components)
    # Components set to 1e-6 instead of less move the signal by that; the rest is round-off.
    assert np.abs(moved).max() < 2e-6
    np.testing.assert_allclose(np.abs(circuits.components).max(axis=1), 1)


@pytest.mark.parametrize("coefficients", [5, 9, 13])
def test_a_schedule_moves_every_coefficient(coefficients):
    A, rng = camera(coefficients), np.random.default_rng(1)
    circuits = find_circuits(A, rng)
    order = schedule(circuits, design(circuits, A, np.zeros(coefficients), rng), 30, coefficients,
                     rng)
    visits = np.bincount(circuits.members[order].ravel(), minlength=coefficients)
    assert visits.min() >= 3


@pytest.mark.parametrize("bands, coefficients", [(3, 5), (3, 9), (3, 21), (4, 9)])
def test_bulk_draws_follow_the_law_of_independent_ones(bands, coefficients):
    operator, basis = grey(coefficients, bands=bands), basis_matrix(NM[::6], coefficients)
    bulk = sample_in_bulk(operator, DRAWS, seed=1)
    reference = sample_polytope(operator, DRAWS if bands == 3 else 4000, seed=2)
    p = [stats.ks_2samp(a, b).pvalue for a, b in zip((bulk.coefficients @ basis.T).T,
                                                     (reference.coefficients @ basis.T).T,
                                                     strict=True)]
    assert min(p) > SIGNIFICANCE / len(p)
    assert bulk.outcome is Outcome.EXACT


@pytest.mark.parametrize("coefficients", [5, 13, 31])
def test_bulk_draws_keep_the_signal_in_single_precision_and_never_leave_the_box(coefficients):
    operator = grey(coefficients)
    samples = sample_in_bulk(operator, 5000, seed=3)
    drift = np.abs(samples.coefficients @ operator.A.T - operator.y).max() / operator.y.max()
    assert drift < 1e-5  # float32 round-off of some hundred moves
    assert samples.coefficients.min() >= 0 and samples.coefficients.max() <= 1
    assert samples.effective_samples > 0.8 * 5000


def test_the_same_seed_gives_the_same_draws():
    operator = grey(9)
    first, second = (sample_in_bulk(operator, 3000, seed=5).coefficients for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_noise_is_refused_in_bulk():
    with pytest.raises(InputError, match="use tilted rejection"):
        sample_in_bulk(grey(9, error=0.01), 100, seed=0)


def test_a_chain_that_has_not_moved_is_refused():
    starts = np.random.default_rng(0).normal(size=(64, 3))
    ends = np.tile(starts, (40, 1))
    with pytest.raises(ConvergenceError, match="have not mixed"):
        refuse_poor(diagnose(starts, ends), len(ends))


def test_independent_draws_are_as_many_as_there_are():
    rng = np.random.default_rng(0)
    ends = rng.normal(size=(10_240, 3))
    found = diagnose(rng.normal(size=(256, 3)), ends)
    # A correlation of 1 / sqrt(10240) by chance counts 10240 / 256 times its square: 0.4 % at one
    # sigma.
    assert found.effective_samples > 0.9 * len(ends)
    assert found.r_hat < 1.001
