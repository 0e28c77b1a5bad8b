"""Further measurements of one surface: each is obeyed, contradictions are named, the paper's
ranking for comparison.
"""
import dataclasses
import json

import numpy as np
import pytest
from sampling_cameras import surface
from typer.testing import CliRunner

from spectrabox.measure.signals.options import SampleOptions
from spectrabox.measure.signals.sample import measurement_of_signal, reading_at, sample_signals
from spectrabox.measure.signals.signal_capture import SignalCapture
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.records.spectra import Outcome, SpectralMeasurement, SpectrumSamples
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.sampling.further.more_measurements import (
    given_reflected_twice,
    joined,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.published.baselines import refined_as_published
from spectrabox.sampling.spectral_measurement import spline_operator
from spectrabox.session.cli import app
from spectrabox.session.signals.measurement_file import read_more
from spectrabox.session.signals.signal_options import parse_reading

FINE = visible_grid(1)
CAMERA, LIGHT = "Nikon 5100 (NPL)", "LED-B3"
TRUTH = surface(FINE.nm, 3)


def response(light=LIGHT, camera=CAMERA):
    return relative_response(camera, light, FINE)


def signal(light=LIGHT, camera=CAMERA, times=1.0, power=1):
    return ",".join(f"{times * value:.6f}" for value in response(light, camera) @ TRUTH**power)


def run(name, *arguments, code=0):
    found = CliRunner().invoke(app, [name, "--sensitivity", CAMERA, "--light", LIGHT, "--json",
                                     *map(str, arguments)])
    assert found.exit_code == code, found.output
    return json.loads(found.stdout)


def sample(*arguments, code=0):
    return run("sample", "--signal", signal(), "--noise", "0.002,0.002,0.002", "--samples", 1000,
               *arguments, code=code)


def width(facts):
    return np.mean(np.subtract(facts["upper"], facts["lower"]))


def error(facts):
    return np.sqrt(np.mean((np.array(facts["mean"]) - TRUTH[::5])**2))


@pytest.fixture(scope="module")
def plain():
    return sample()


@pytest.fixture
def more(tmp_path):
    """A TOML file of every kind of measurement, and the files that it names."""
    curve = np.exp(-0.5 * ((FINE.nm - 620) / 10)**2)
    (tmp_path / "filter.csv").write_text("nm,filter\n" + "\n".join(
        f"{nm:g},{value:.6f}" for nm, value in zip(FINE.nm, curve, strict=True)))
    (tmp_path / "spot.csv").write_text("nm,value,standard_error\n" + "\n".join(
        f"{nm:g},{value:.6f},0.004" for nm, value in zip(FINE.nm[50:], TRUTH[50:], strict=True)))
    (tmp_path / "more.toml").write_text(f"""
[[reading]]
nm = 410
fwhm_nm = 8
reflectance = {float(np.interp(410, FINE.nm, TRUTH))}
error = 0.01
[[band]]
curve = "filter.csv"
reflectance = {float(curve @ TRUTH / curve.sum())}
[[photo]]
light = "A"
signal = [{signal("A")}]
noise = [0.002, 0.002, 0.002]
[[photo]]
light = "D65"
sensitivity = "CIE 1931 2 Degree Standard Observer"
signal = [{signal("D65", "CIE 1931 2 Degree Standard Observer", 10)}]
white = [10, 10, 10]
noise = [0.02, 0.02, 0.02]
[[same]]
signal = [{signal(times=1.001)}]
noise = [0.002, 0.002, 0.002]
""")
    return tmp_path


# ---- each is obeyed ------------------------------------------------------------------------------

@pytest.mark.parametrize("method", ["prior", "uniform"])
def test_a_second_photo_under_another_light_narrows_the_band(method):
    arguments = ("--method", method, "--coefficients", 9)
    before = sample(*arguments)
    after = sample(*arguments, "--signal-under", f"A={signal('A')}:0.002,0.002,0.002")
    assert width(after) < 0.95 * width(before)


def test_everything_of_a_file_is_used(plain, more):
    facts = sample("--more", more / "more.toml")
    assert width(facts) < 0.5 * width(plain)
    assert error(facts) < error(plain)
    assert facts["doubtful"] == []
    found = read_more(more / "more.toml", CAMERA, response())
    assert [name for name, _ in found] == [
        "the reading at 410 nm, 8 nm wide", "the band filter of filter.csv", "the photo under A",
        "the photo under D65 by CIE 1931 2 Degree Standard Observer",
        "patch 1 said to be the same material"]


def test_a_spectrometers_spot_is_obeyed_within_its_error(more):
    (more / "spot.toml").write_text('[[spot]]\nfile = "spot.csv"\n')
    facts = sample("--more", more / "spot.toml")
    # 26 readings of error 0.004: the mean of the draws lies within a few of them.
    assert np.abs(np.array(facts["mean"]) - TRUTH[::5])[10:].max() < 0.02


def test_bands_of_any_level_know_what_was_measured_further():
    spot = reading_at(600.0, float(np.interp(600, FINE.nm, TRUTH)))
    capture = SignalCapture(response(), (response() @ TRUTH)[None], ("",), noise=np.full(3, 0.003),
                            more=[("the spot", (spot,))])
    [one] = sample_signals(capture, SampleOptions(samples=1000))
    alone = sample_signals(dataclasses.replace(capture, more=()), SampleOptions(samples=1000))[0]
    at = int(np.flatnonzero(one.nm == 600)[0])
    for level in (0.5, 0.9, one.summary.level):
        widths = [np.subtract(*each.band(level)[::-1])[at] for each in (one, alone)]
        assert widths[0] < 0.5 * widths[1]
    assert one.draws(200)[:, at].std() < 0.5 * alone.draws(200)[:, at].std()
    # shares of the signal's errors are not those of what the reading left
    assert one.causes == {} and sum(alone.causes.values()) == pytest.approx(1)


def test_the_same_material_twice_halves_the_variance_of_the_signal():
    base = measurement_of_signal(response(), response() @ TRUTH, None, np.full(3, 0.01))
    again = sample("--same", signal() + ":0.002,0.002,0.002")
    assert again["outcome"]
    from spectrabox.session.signals.measurement_file import patch_of_text
    both = joined(base, [patch_of_text(f"{signal()}:0.01,0.01,0.01", response(), None, 1)])
    np.testing.assert_allclose(both.noise_covariance, base.noise_covariance / 2, rtol=1e-12)


def test_a_wide_reading_is_the_mean_over_its_band():
    reading = parse_reading("550/20:0.3:0.01")
    weights = reading.row(FINE)
    assert weights.sum() == pytest.approx(1)
    half = FINE.nm[weights > weights.max() / 2]
    assert np.ptp(half) == pytest.approx(20, abs=2)  # a step of 1 nm at either end


# ---- contradictions ------------------------------------------------------------------------------

def test_a_photo_that_no_reflectance_gives_is_named():
    text = sample("--signal-under", "A=0.95,0.02,0.95:0.001,0.001,0.001", "--reading", "550:0.2",
                  code=3)["error"]
    assert text.startswith("the photo under A contradicts the other measurements: no reflectance "
                           "between 0 and 1")


def test_a_patch_of_another_material_is_named():
    text = sample("--same", signal(times=1.5) + ":0.002,0.002,0.002", code=3)["error"]
    assert text.startswith("patch 1 said to be the same material: two patches said to be the same "
                           "material differ by")


def test_readings_at_one_place_that_differ_are_named():
    text = sample("--reading", "500:0.1:0.01", "--reading", "500:0.5:0.01", code=3)["error"]
    assert ("the reading at 500 nm (0.1) and the reading at 500 nm (0.5) contradict each other"
            in text)


def test_what_the_prior_finds_hard_to_believe_is_said():
    wrong = float(np.interp(550, FINE.nm, TRUTH)) + 0.35
    facts = sample("--reading", f"550:{wrong:.4f}:0.002", "--method", "uniform", "--coefficients",
                   21)
    assert len(facts["doubtful"]) == 1
    doubt, = (one for one in facts["findings"] if one["code"] == "reading.hard-to-believe")
    assert (doubt["subject"], doubt["values"]["value"]) == ("the reading at 550 nm",
                                                            pytest.approx(wrong, abs=1e-4))


@pytest.mark.parametrize("text, message", [
                             ("[[reading]]\nnm = 500", "reading 1.reflectance is missing"),
                             ("[[reading]]\nnm = 500\nreflectanse = 0.3",
                              r"unknown key 'reflectanse' in \[reading 1\]; "
                              r"did you mean 'reflectance'"),
                             ("[[reading]]\nnm = 'x'\nreflectance = 0.3",
                              "nm is 'x'; a number is needed"),
                             ("[reading]\nnm = 500", r"write \[\[reading\]\] with two brackets"),
                             ("[[raeding]]\nnm = 500",
                              "unknown key 'raeding'; did you mean 'reading'"),
                             ("[[photo]]\nlight = 'A'\nsignal = [0.1, 'b']",
                              "photo 1.signal is 'b'; a number is needed"),
                             ("[[photo]]\nlight = 'A'\nsignal = 0.1",
                              "a list of numbers is needed"),
                             ("[[photo]]\nlight = 'A'\nsignal = [0.1, 0.2]",
                              "has 2 values; the sensitivities have 3 bands"),
                             ("[[spot]]\nfile = 'none.csv'", "none.csv is missing"),
                             ("[[photo]", "is not valid TOML")])
def test_files_of_measurements_that_cannot_be_are_errors(tmp_path, text, message):
    (tmp_path / "more.toml").write_text(text)
    with pytest.raises(InputError, match=message):
        read_more(tmp_path / "more.toml", CAMERA, response())


@pytest.mark.parametrize("arguments, message", [
                             (["--signal-under", "0.1,0.2,0.3"], "write LIGHT=v1,v2,v3"),
                             (["--same", "0.1,0.2"], "--same has 2 values"),
                             (["--reading", "550/0.1:0.3"], "write NM:REFLECTANCE"),
                             (["--more", "none.toml"], "cannot be read"),
                             (["--best", "10"], "without it: leave it out, or take --method paper"),
                             (["--method", "paper", "--best", "1000"],
                              "--best ranks draws by further measurements; give some"),
                             (["--method", "paper", "--best", "9999", "--reading", "500:0.2"],
                              "the best 9999 of 1000 draws"),
                             (["--refine", "15"], "--refine belongs to splines"),
                             (["--method", "uniform", "--coefficients", "7", "--refine", "10"],
                              "the knots do not nest; take 11"),
                             (["--method", "paper", "--coefficients", "7", "--refine", "7"],
                              "the knots do not nest"),
                             (["--truth", "none.csv"], "none.csv is missing"),
                             (["--twice", "0.1,0.2"], "--twice has 2 values")])
def test_options_that_cannot_be_are_errors(arguments, message):
    assert message in sample(*arguments, code=3)["error"]


def test_further_measurements_belong_to_one_signal(tmp_path):
    (tmp_path / "signals.csv").write_text("R,G,B\n0.2,0.3,0.2\n")
    text = run("sample", "--signals", tmp_path / "signals.csv", "--same", "0.2,0.3,0.2",
               code=3)["error"]
    assert "belong to one surface; give its --signal" in text


# ---- light reflected twice, ranking, refinement --------------------------------------------------

def test_weighting_by_light_reflected_twice_is_bayes_rule():
    """Two draws whose likelihoods are 4 : 1 come out 4 : 1."""
    ones = np.ones((1, 61)) / 61
    levels = np.array([0.5, 0.6])
    spectra = levels[:, None] * np.ones((2, 61))
    samples = SpectrumSamples(PRIOR_GRID, spectra, np.zeros((2, 5)), "m", 2.0, 0, Outcome.FAMILIAR,
                              ())
    away = 0.36 - 0.25
    variance = away**2 / (2 * np.log(4))    # the second draw is then 4 times less likely
    twice = SpectralMeasurement(PRIOR_GRID, ones, np.array([0.25]), np.array([[variance - 1e-6]]))
    drawn = given_reflected_twice(samples, twice, 10_000)
    share = np.mean(drawn.spectra[:, 0] == 0.5)
    # Systematic: off by one of 10 000; the floor of the noise is 1e-6 of white squared, which was
    # taken off.
    assert share == pytest.approx(0.8, abs=2e-3)
    assert drawn.effective_samples == pytest.approx(1 / (0.8**2 + 0.2**2), rel=0.02)


def test_light_reflected_twice_narrows_the_band(plain):
    facts = sample("--twice", signal(power=2) + ":0.002,0.002,0.002")
    assert width(facts) < width(plain)
    assert "weighted by light reflected twice" in facts["method"]


def test_ranking_keeps_the_nearest_draws_of_the_paper():
    reading = float(TRUTH[-1])
    options = ("--method", "paper", "--coefficients", 7, "--samples", 5000, "--reading",
               f"700:{reading:.5f}")
    found = CliRunner().invoke(app,
                               ["sample", "--sensitivity", CAMERA, "--light", LIGHT, "--json",
                                "--signal", signal(), *map(str, options), "--best", "1000"])
    ranked = json.loads(found.stdout)
    assert ranked["samples"] == 1000 and "best 1000 of 5000" in ranked["method"]
    everything = run("sample", "--signal", signal(), "--method", "paper", "--coefficients", 7,
                     "--samples", 5000)
    assert abs(ranked["mean"][-1] - reading) <= abs(everything["mean"][-1] - reading)
    assert "need not agree" in ranked["outcome"]


def test_ranking_by_light_reflected_twice_is_the_papers_eq_10():
    options = ("--method", "paper", "--coefficients", 7, "--samples", 4000, "--signal", signal())
    ranked, every = (run("sample", *options, *more)
                     for more in (("--twice", signal(power=2), "--best", 1000), ()))
    response5 = relative_response(CAMERA, LIGHT, FINE) \
        @ interpolation_matrix(PRIOR_GRID.nm, FINE.nm)
    wanted = np.array([float(part) for part in signal(power=2).split(",")])
    # The mean of the kept draws need not be nearest, but their spread must have fallen.
    assert width(ranked) < width(every)
    assert np.abs(response5 @ np.square(ranked["mean"]) - wanted).max() < 0.05


def test_refining_as_published_keeps_the_signal_and_is_narrower():
    measurement = measurement_of_signal(response(), response() @ TRUTH, None, None)
    literal = refined_as_published(measurement, 7, 15, 500, 1)
    fitted = spline_operator(measurement, 15)
    # Knot insertion is exact and the residual directions are unseen: what the start misses is
    # bounded least squares'.
    np.testing.assert_allclose(literal @ fitted.A.T - fitted.y, 0, atol=1e-6)
    options = SampleOptions("uniform", samples=1000, seed=1, coefficients=7, refine=15)
    capture = SignalCapture(response(), (response() @ TRUTH)[None], ("",))
    each = sample_signals(capture, options)[0].samples
    assert each.coefficients.shape == (1000, 15)
    assert each.spectra.std(axis=0).mean() > literal.std(axis=0).mean()


# ---- truth, baselines, advice --------------------------------------------------------------------

def test_methods_are_judged_where_the_truth_is_given(tmp_path):
    (tmp_path / "truth.csv").write_text("nm,paint\n" + "\n".join(
        f"{nm:g},{value:.6f}" for nm, value in zip(FINE.nm, TRUTH, strict=True)))
    facts = sample("--truth", tmp_path / "truth.csv", "--baseline")
    assert set(facts["baselines"]) == {"Smits 1999", "Meng 2015", "Otsu 2018", "Jakob 2019",
                                       "Mallett 2019", "Belcour-style greedy"}
    assert set(facts["judged"]) == {"prior", *(name for name, found in facts["baselines"].items()
                                               if found)}
    # six digits of the file
    assert facts["judged"]["prior"]["rmse"] == pytest.approx(error(facts), rel=1e-3)
    assert set(facts["judged"]["Smits 1999"]["delta_e00"]) == {"D65", "A", "FL11"}
    assert facts["judged"]["Smits 1999"]["width"] is None
    shown = CliRunner().invoke(app,
                               ["sample", "--sensitivity", CAMERA, "--light", LIGHT, "--signal",
                                signal(), "--samples", "1000", "--truth",
                                str(tmp_path / "truth.csv")])
    assert "Winkler" in shown.stdout and "dE FL11" in shown.stdout


def test_advice_counts_what_was_measured_already(more):
    first = run("advise", "--signal", signal())
    after = run("advise", "--signal", signal(), "--more", more / "more.toml")
    assert after["overall"][0]["width_before"] < 0.6 * first["overall"][0]["width_before"]
    assert len(after["taken"]) == 5
