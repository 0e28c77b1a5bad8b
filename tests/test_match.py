"""Measured spectra that could give a signal: how often the true one is among them, and none."""
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.measure.signals.matching import match_signal
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.spectra import Quantity, SpectralMeasurement
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.sampling.evaluation.identification import ALIKE_NM, SpectralLibrary, evidence
from spectrabox.sampling.prior.mixture import drawn_reflectances, load_prior
from spectrabox.sampling.prior.mixture_posterior import with_floor
from spectrabox.session.cli import app

GRID = visible_grid(5)
RESPONSE = relative_response("Nikon 5100 (NPL)", "D65", GRID)
SPREAD = np.array([[1.0, 0.8, 0.8], [0.8, 1.0, 0.8], [0.8, 0.8, 1.0]])
NOISE = 0.004**2 * SPREAD


def as_library(spectra, standard_error=None):
    """Spectra (n, P) by their numbers."""
    error = np.zeros_like(spectra) if standard_error is None else standard_error
    return SpectralLibrary(tuple(map(str, range(len(spectra)))), ("",) * len(spectra), spectra,
                           error, ())


def library(count, seed=1):
    """Smooth reflectances (count, P) between 0.05 and 0.95."""
    rng = np.random.default_rng(seed)
    x = (GRID.nm - 400) / 300
    waves = sum(rng.normal(0, 1.5 / order, (count, 1))
                * np.cos(np.pi * order * x + rng.uniform(0, np.pi, (count, 1)))
                for order in (1, 2, 3, 4))
    return 0.05 + 0.9 / (1 + np.exp(-waves - rng.normal(-0.5, 1, (count, 1))))


def measured(signal, noise=NOISE):
    return SpectralMeasurement(GRID, RESPONSE, signal, noise)


def identified(measurement, spectra, prior, variation=0.01):
    return match_signal("", measurement, as_library(spectra), prior, variation=variation)


def another_sample(spectrum, variation, rng):
    """Another sample (P,) of a material: it varies alike over ALIKE_NM."""
    alike = np.exp(-((GRID.nm[:, None] - GRID.nm) / ALIKE_NM)**2 / 2)
    values, vectors = np.linalg.eigh(alike)
    return spectrum + variation * vectors @ (np.sqrt(np.maximum(values, 0))
                                             * rng.standard_normal(GRID.nm.size))


@pytest.mark.parametrize("count, variation", [(20, 0.0), (400, 0.0), (400, 0.02)])
def test_the_true_spectrum_is_among_those_not_told_apart_in_95_of_100_cases(count, variation):
    rng = np.random.default_rng(5)
    spectra, times = library(count), 200
    # what else it may be is of no account here: one component is enough, and quick
    prior = replace(load_prior(), weights=np.ones(1), means=load_prior().means[:1],
                    covariances=load_prior().covariances[:1], family=np.zeros(1))
    root = np.linalg.cholesky(with_floor(NOISE))
    held = told_apart = 0
    for _ in range(times):
        true = rng.integers(count)
        seen = RESPONSE @ another_sample(spectra[true], variation, rng)
        found = identified(measured(seen + root @ rng.standard_normal(3)), spectra, prior,
                           variation)
        held += found.may_be[found.names.index(str(true))]
        told_apart += count - found.indistinguishable
    # binomial at three standard deviations; at most 99 % can hold, since 1 % are rejected
    assert 0.95 - 3 * np.sqrt(0.95 * 0.05 / times) <= held / times <= 0.995
    # It would hold as well if nothing were ever told apart.
    assert told_apart / times > 0.8 * count


def test_evidence_and_misfit_are_those_of_the_gaussian_in_closed_form():
    spectra, signal = library(3), np.array([0.2, 0.3, 0.25])
    error = np.full(spectra.shape, 0.03)
    error[0] = 0
    log_evidence, misfit, _ = evidence(measured(signal), as_library(spectra, error), 0.02)
    alike = np.exp(-((GRID.nm[:, None] - GRID.nm) / ALIKE_NM)**2 / 2)
    for index, spectrum in enumerate(spectra):
        variance = 0.02**2 + error[index, 0]**2
        covariance = NOISE + 0.001**2 * np.eye(3) + variance * RESPONSE @ alike @ RESPONSE.T
        r = signal - RESPONSE @ spectrum
        distance = r @ np.linalg.inv(covariance) @ r
        density = np.exp(-distance / 2) / np.sqrt((2 * np.pi)**3 * np.linalg.det(covariance))
        # round-off of the inverse
        assert log_evidence[index] == pytest.approx(np.log(density), rel=1e-9)
        assert misfit[index] == pytest.approx(np.sqrt(distance), rel=1e-9)


def test_evidence_of_the_prior_is_the_mean_density_of_its_draws():
    prior = load_prior()
    # of every family and level as the prior has them: a mixture times a function of the level
    spectra = drawn_reflectances(prior, 60000)
    signal, noise = np.array([0.35, 0.30, 0.25]), 0.03**2 * SPREAD
    residual = signal - spectra @ RESPONSE.T
    covariance = with_floor(noise)
    density = np.exp(-np.einsum("nk,kl,nl->n", residual, np.linalg.inv(covariance), residual) / 2) \
        / np.sqrt((2 * np.pi)**3 * np.linalg.det(covariance))
    of_none = identified(measured(signal, noise), library(2), prior).log_evidence_of_none
    # Laplace's approximation per component, and a few per cent of Monte Carlo error
    assert of_none == pytest.approx(np.log(density.mean()), abs=0.15)


def test_none_fits_where_the_true_spectrum_is_missing_and_far():
    spectra, prior = library(200), load_prior()
    signals = spectra @ RESPONSE.T
    distances = np.linalg.norm(signals[:, None] - signals, axis=2) + np.eye(len(spectra))
    lonely = int(np.argmax(distances.min(axis=1)))
    others = np.delete(spectra, lonely, axis=0)
    found = identified(measured(signals[lonely]), others, prior)
    assert found.none_fits and found.probability_of_none > 0.95
    found = identified(measured(signals[lonely]), spectra, prior)
    assert np.array(found.names)[found.may_be].tolist() == [str(lonely)]
    assert found.probability_of_none < 0.5


def test_a_library_given_twice_is_no_likelier():
    spectra, prior = library(20), load_prior()
    signal = measured(RESPONSE @ spectra[3] + np.array([0.0125, -0.0125, 0.0125]))
    once, twice = (identified(signal, given, prior).probability_of_none
                   for given in (spectra, np.tile(spectra, (2, 1))))
    assert 0.01 < once < 0.99 and twice == pytest.approx(once, rel=1e-9)


def call(*words):
    return CliRunner().invoke(app, ["match", *map(str, words)])


@pytest.fixture(scope="module")
def session(_finished_flat, tmp_path_factory):
    return shutil.copytree(_finished_flat, tmp_path_factory.mktemp("match") / "session")


def test_regions_of_a_flat_session_are_told_from_the_other_paints(session):
    words = [session / "spectra" / f"{name}.csv" for name in ("red_wall", "green_wall", "cube")]
    outcome = call(session, *words, "--only", "red_wall", "--only", "white_wall", "--json")
    facts = json.loads(outcome.stdout)
    red, white = facts["surfaces"]
    assert red["matches"][0]["name"] == "red_wall" and red["indistinguishable"] == 1
    assert white["none_fits"] and white["findings"][0]["code"] == "match.none"
    assert facts["indistinguishable"] == 1 and len(facts["matches"]) == 6
    assert {match["surface"] for match in facts["matches"]} == {"red_wall", "white_wall"}
    assert "may be it" in call(session, *words).stdout


def test_spectra_that_cover_a_part_are_left_out_by_name(session, tmp_path):
    nm = np.arange(450.0, 651.0, 5)
    (tmp_path / "short.csv").write_text(table_text(
        nm, {"ochre": np.full(nm.size, 0.3)}, quantity=Quantity.REFLECTANCE, source="ochre"))
    alone = call(session, tmp_path / "short.csv")
    assert alone.exit_code == 3 and "covers 450-650 nm; 400-700 nm is needed" in alone.output
    whole = (session / "spectra" / "cube.csv").read_text(encoding="utf-8")
    (tmp_path / "blue [red].csv").write_text(whole, encoding="utf-8")
    facts = json.loads(call(session, tmp_path, "--only", "cube", "--json").stdout)
    assert [match["name"] for match in facts["matches"]] == ["blue [red]"]
    assert "blue [red]" in call(session, tmp_path, "--only", "cube").stdout     # no markup
    assert len(facts["left_out"]) == 1 and "covers 450-650 nm" in facts["left_out"][0]


@pytest.mark.parametrize("words, says", [
    (["no such set"], "is no file and no published set of reflectances"),
    (["missing.csv"], "is missing"),
    (["CES99", "--only", "wall"], "is no surface of unknown spectrum"),
    (["CES99", "--variation", "2"], "0 to 0.5 of white is needed"),
    (["CES99", "--ratio", "0.5"], "a number above 1 is needed"),
])
def test_what_cannot_be_matched_is_said_in_a_sentence(session, words, says):
    outcome = call(session, *words)
    assert outcome.exit_code == 3 and says in " ".join(outcome.output.split()), outcome.output


def test_lamps_of_a_session_are_ranked_and_the_present_one_brings_next_to_nothing(session):
    present = session / "spectra" / "light.csv"
    facts = json.loads(CliRunner().invoke(app, [
        "advise", str(session), "--lamps", f"{present},A,FL11", "--json"]).stdout)
    lamps = [one for one in facts["overall"] if one["action"] == "second-lamp"]
    assert len(facts["surfaces"]) == 4 and {"A", "FL11"} <= {one["subject"] for one in lamps}
    after = {one["subject"]: one["width_after"] for one in lamps}
    assert after.get(str(present), np.inf) > max(after["A"], after["FL11"])
    assert all(one["width_after"] < one["width_before"] for one in lamps)


def test_advice_says_what_it_needs(session):
    for words, says in (((), "nothing to advise on"), (("--light", "A"), "nothing to advise on"),
                        ((session, "--light", "A"), "has its own"),
                        ((session, "--lamps", ","), "no lamp or filter was named"),
                        ((session, "--filters", session / "session.toml"), "session.toml")):
        outcome = CliRunner().invoke(app, ["advise", *map(str, words)])
        assert outcome.exit_code == 3 and says in " ".join(outcome.output.split()), outcome.output


