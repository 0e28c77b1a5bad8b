"""Many signals answered at once, without draws: against each alone, and against draws."""
import numpy as np
import pytest
from sampling_cameras import surface

from spectrabox.measure.signals.options import SampleOptions
from spectrabox.measure.signals.sample import sample_signals
from spectrabox.measure.signals.signal_capture import SignalCapture
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.summaries import summaries
from spectrabox.session.signals.signal_options import response_of_names

CAMERA, LIGHT = "Nikon 5100 (NPL)", "D65"
# What 4000 draws tell, in standard deviations, twice over: the mean to 1 / sqrt(4000) = 0.016, the
# spread to about 0.02, a 2.5 % quantile to 0.04, one of a skewed distribution's long tail to 0.06.
TOLD_BY_DRAWS = {"mean": 0.03, "standard_deviation": 0.04, "lower": 0.08, "upper": 0.12}
CURVES = ("mean", "standard_deviation", "lower", "upper")


def problem(count):
    response = response_of_names(CAMERA, LIGHT)
    signals = np.array([response @ surface(PRIOR_GRID.nm, seed) for seed in range(count)])
    return response, signals, {"photo noise": np.tile(1e-5 * np.eye(3), (count, 1, 1)),
                               "light": 1e-4 * signals[:, :, None] * signals[:, None, :]}


def test_a_signal_among_many_is_answered_as_alone():
    response, signals, causes = problem(110)        # more than one batch
    together = summaries(load_prior(), response, signals, causes, 0.95)
    for row in (0, 99, 109):
        alone = summaries(load_prior(), response, signals[[row]],
                          {name: part[[row]] for name, part in causes.items()}, 0.95)
        for name in (*CURVES, "budget", "family_shares"):
            # The posterior's mode is known to 1e-6 of a logit.
            np.testing.assert_allclose(getattr(together, name)[row], getattr(alone, name)[0],
                                       atol=1e-6)


def asked(signals, with_draws):
    capture = SignalCapture(relative_response(CAMERA, LIGHT, FINE_GRID), np.asarray(signals),
                            tuple(str(number) for number in range(len(signals))),
                            noise=np.full(3, 0.003), light_error=0.01)
    return [estimate.facts() for estimate in sample_signals(
        capture, SampleOptions(samples=4000), with_draws=with_draws)]


@pytest.fixture(scope="module")
def both_ways():
    _, signals, _ = problem(8)
    return asked(signals, False), asked(signals, True)


def test_answers_without_draws_agree_with_those_of_draws(both_ways):
    without, drawn = both_ways
    spread = np.array([facts["standard_deviation"] for facts in drawn])
    for name, most in TOLD_BY_DRAWS.items():
        away = np.array([facts[name] for facts in without]) - [facts[name] for facts in drawn]
        assert np.sqrt(np.mean((away / spread)**2)) < most, name


def test_what_needs_no_draws_is_the_same_either_way(both_ways):
    for without, drawn in zip(*both_ways, strict=True):
        assert without["samples"] == 0
        assert without["effective_samples"] is None
        assert {**drawn, **without}.keys() == drawn.keys()
        assert without["outcome"] == drawn["outcome"]
        # The same programmes, in another order: round-off over a weight of 1e-3.
        for bound in ("bound_lower", "bound_upper"):
            np.testing.assert_allclose(without[bound], drawn[bound], atol=1e-10)
        for cause, share in drawn["error_budget"].items():
            assert without["error_budget"][cause] == pytest.approx(share, abs=1e-6)


def test_a_signal_that_nothing_gives_falls_back_to_draws():
    facts = asked([[0.9, 0.05, 0.9], [0.3, 0.3, 0.3]], False)
    assert facts[0]["samples"] == 4000
    assert facts[1]["samples"] == 0
