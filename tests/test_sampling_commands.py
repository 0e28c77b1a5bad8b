"""The commands on signals: keys of the contract, files, exit codes, and one sentence for every bad
input.
"""
import json
from pathlib import Path

import numpy as np
import pytest
from sampling_cameras import surface
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.radiometry.appearance import (
    TO_SRGB,
    decode_srgb,
    reflectance_to_lab,
    tristimulus_weights,
)
from spectrabox.radiometry.error_model import stated_causes
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import grid_from_nm, visible_grid
from spectrabox.radiometry.spectra.named_spectra import light, relative_response, sensitivities
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.session.cli import app
from spectrabox.session.commands.requests import OBSERVER

ROOT = Path(__file__).resolve().parent.parent
CAMERA = ["--sensitivity", "Nikon 5100 (NPL)", "--light", "LED-B3"]
KEYS = {"wavelengths_nm", "mean", "standard_deviation", "lower", "upper", "bound_lower",
        "bound_upper", "effective_samples", "seconds", "outcome"}


def call(*arguments, code=0):
    found = CliRunner().invoke(app, [str(part) for part in arguments])
    assert found.exit_code == code, found.output
    return found


def sample(*arguments, code=0):
    return json.loads(call("sample", *CAMERA, "--json", *arguments, code=code).stdout)


@pytest.mark.parametrize("method", ["prior", "uniform", "paper"])
def test_sample_keeps_its_contract(method, tmp_path):
    out = tmp_path / "draws.npz"
    grid = visible_grid(1)
    response = relative_response("Nikon 5100 (NPL)", "LED-B3", grid)
    signal = response @ surface(grid.nm, 3)
    facts = sample("--signal", ",".join(map(str, signal)), "--coefficients", 9, "--method", method,
                   "--samples", 1000, "--seed", 1, "--out", out)
    assert set(facts) >= KEYS
    arrays = [np.array(facts[key]) for key in ("wavelengths_nm", "mean", "standard_deviation",
                                               "lower", "upper")]
    assert len({array.shape for array in arrays}) == 1
    with np.load(out) as stored:
        assert stored["spectra"].shape == (1000, len(arrays[0]))
        assert stored["coefficients"].shape == (1000, 9)
        np.testing.assert_allclose(stored["spectra"].mean(axis=0), facts["mean"], atol=1e-12)
        # Draws are at 5 nm and the camera was integrated at 1 nm: straight lines miss a spline by
        # 1e-3 at most.
        seen = np.array([np.interp(grid.nm, stored["wavelengths_nm"],
                                   row) for row in stored["spectra"]]) @ response.T
        np.testing.assert_allclose(seen, np.tile(signal, (1000, 1)), atol=1e-3 if method != "prior"
                                   else 1e-9)


def test_a_seed_gives_the_same_answer():
    first, same = (sample("--signal", "0.2,0.3,0.15", "--samples", 1000, "--seed", 4)
                   for _ in range(2))
    assert {**first, "seconds": 0} == {**same, "seconds": 0}


def test_signals_of_a_file_give_one_result_each(tmp_path):
    path = tmp_path / "signals.csv"
    path.write_text("R,G,B\n0.2,0.3,0.15\n0.5,0.5,0.5\n")
    facts = sample("--signals", path, "--samples", 1000, "--method", "uniform", "--coefficients", 7)
    assert len(facts["results"]) == 2
    assert set(facts["results"][0]) >= KEYS
    path.write_text("0.2,0.3,0.15\n0.5,0.5,0.5\n")     # the first would be lost as a header
    assert "its first row must name the bands" in sample("--signals", path, code=3)["error"]


def test_white_and_noise_are_in_the_signals_unit():
    plain = sample("--signal", "0.2,0.3,0.15", "--noise", "0.002,0.003,0.0015", "--samples", 1000)
    scaled = sample("--signal", "20,60,7.5", "--white", "100,200,50", "--noise", "0.2,0.6,0.075",
                    "--samples", 1000)
    np.testing.assert_allclose(plain["mean"], scaled["mean"], atol=1e-9)  # round-off of a division


def test_errors_of_light_and_curves_are_in_the_budget():
    signal = ["--signal", "0.2,0.3,0.15", "--samples", 1000, "--noise", "0.001,0.001,0.001"]
    plain, more = sample(*signal), sample(*signal, "--light-error", 0.05, "--sensitivity-error",
                                          0.03)
    assert more["error_budget"]["light"] > 0.01 and more["error_budget"]["sensitivities"] > 0.01
    assert sum(more["error_budget"].values()) == pytest.approx(1)
    assert plain["error_budget"]["light"] == 0 < more["error_budget"]["light"]
    assert "0 to 0.5 is needed" in sample(*signal, "--light-error", 2, code=3)["error"]


def test_an_error_of_the_light_is_common_to_the_bands_and_those_of_curves_are_not():
    signal = np.array([0.2, 0.4, 0.1])
    causes = stated_causes(signal, np.zeros((3, 3)), 0.05, 0.03)
    np.testing.assert_allclose(causes["light"], 0.05**2 * np.outer(signal, signal), rtol=1e-12)
    np.testing.assert_allclose(causes["sensitivities"], np.diag((0.03 * signal)**2), atol=1e-18)


def test_a_reading_is_obeyed():
    facts = sample("--signal", "0.2,0.3,0.15", "--reading", "700:0.35:0.002", "--samples", 1000)
    assert abs(facts["mean"][-1] - 0.35) < 0.01


def test_files_of_curves_and_lights_are_taken_as_names_are(tmp_path):
    nm = np.arange(380, 781, 5)
    curves = sensitivities("Nikon 5100 (NPL)", visible_grid(5))
    power = light("LED-B3", visible_grid(5))
    grid = visible_grid(5).nm
    (tmp_path / "c.csv").write_text("nm,R,G,B\n" + "\n".join(
                                        f"{w}," + ",".join(f"{v:.9g}" for v in column) for w,
                                        column in zip(grid, curves.T, strict=True)))
    (tmp_path / "l.csv").write_text("nm,power\n" + "\n".join(f"{w},{v:.9g}" for w,
                                                             v in zip(grid, power, strict=True)))
    assert nm.size
    facts = json.loads(call("sample", "--sensitivity", tmp_path / "c.csv", "--light",
                            tmp_path / "l.csv", "--signal", "0.2,0.3,0.15", "--samples", 1000,
                            "--json").stdout)
    # Five-nanometre files are interpolated; the names come with the same curves at 5 nm or finer.
    np.testing.assert_allclose(facts["mean"], sample("--signal", "0.2,0.3,0.15", "--samples",
                                                     1000)["mean"], atol=0.02)


@pytest.mark.parametrize("arguments, code, message", [
                             (["--signal", "0.2,0.3"], 3,
                              "--signal has 2 values; the sensitivities have 3 bands"),
                             (["--signal", "a,b,c"], 3, "is not a list of numbers"),
                             (["--signal", "0.2,0.3,nan"], 3, "holds a value that is not finite"),
                             (["--signal", "20,30,15"], 3, "perfect white reads (white)"),
                             (["--signal", "0.2,0.3,0.1", "--white", "1,0,1"], 3,
                              "is not positive in every band"),
                             (["--signal", "0.2,0.3,0.1", "--noise=-1,0,0"], 3,
                              "is negative; give standard errors"),
                             (["--signal", "0.2,0.3,0.1", "--method", "magic"], 3,
                              "known are paper, uniform, prior"),
                             (["--signal", "0.2,0.3,0.1", "--samples", "0"], 3,
                              "0 samples were asked for"),
                             (["--signal", "0.2,0.3,0.1", "--samples", "200"], 5,
                              "needs 1000 effective draws"),
                             (["--signal", "0.2,0.3,0.1", "--method", "uniform", "--coefficients",
                               "2"], 3, "at least 4 coefficients"),
                             (["--signal", "0.2,0.3,0.1", "--prior", "none.npz"], 3, "is missing"),
                             (["--signal", "0.2,0.3,0.1", "--reading", "seven"], 3,
                              "write NM:REFLECTANCE"),
                             (["--signals", "none.csv"], 3, "cannot be read"),
                             ([], 3, "give one of --signal V1,V2,V3, --signals FILE.csv"),
                             ])
def test_bad_input_gives_one_sentence(arguments, code, message):
    assert message in sample(*arguments, code=code)["error"]


def test_bands_that_are_alike_or_blind_are_refused(tmp_path):
    nm = np.arange(400, 701, 10)
    green, red = (np.exp(-0.5 * ((nm - centre) / 40)**2) for centre in (540, 600))
    blind = np.where(nm == 400, 1.0, 0.0)
    for name, third, message in (("alike", green, "two bands respond alike"),
                                 ("dark", 0 * nm, "sees nothing of")):
        rows = "\n".join(f"{w},{a:.6f},{b:.6f},{c:.6f}" for w, a, b,
                         c in zip(nm, red, green, third, strict=True))
        (tmp_path / f"{name}.csv").write_text(f"nm,R,G,B\n{rows}\n")
        found = call("sample", "--sensitivity", tmp_path / f"{name}.csv", "--light", "D65",
                     "--signal", "0.2,0.3,0.3", "--json", code=3)
        assert message in json.loads(found.stdout)["error"]
    # A band under a light that is dark where it sees.
    (tmp_path / "uv.csv").write_text("nm,R,G,B\n" + "\n".join(
        f"{w},{a:.6f},{b:.6f},{c:.6f}" for w, a, b, c in zip(nm, red, green, blind, strict=True)))
    (tmp_path / "lamp.csv").write_text("nm,power\n" + "\n".join(f"{w},{float(w > 420)}"
                                                                for w in nm))
    found = call("sample", "--sensitivity", tmp_path / "uv.csv", "--light", tmp_path / "lamp.csv",
                 "--signal", "0.2,0.3,0.3", "--json", code=3)
    assert "sees nothing under" in json.loads(found.stdout)["error"]


@pytest.mark.parametrize("signal, method, sentence", [
                             ("-0.05,0.3,0.2", "prior",
                              "No spectrum between 0 and 1 gives the signal"),
                             ("0.2,1.3,0.2", "prior",
                              "No spectrum between 0 and 1 gives the signal"),
                             ("-0.05,0.3,0.2", "uniform", "No spectrum of 9 coefficients between 0 "
                              "and 1 gives the signal: it was moved by"),
                             ("0.95,0.05,0.95", "uniform", "No spectrum of 9 coefficients between "
                              "0 and 1 gives the signal: it was moved by")])
def test_signals_that_no_reflectance_gives_are_said_to_be_so(signal, method, sentence):
    facts = sample(f"--signal={signal}", "--method", method, "--coefficients", 9, "--samples", 1000)
    assert facts["outcome"].startswith(sentence)


@pytest.mark.parametrize("camera, lamp, message", [
                             ("Nikon 5101", "D65", "nearest are Nikon 5100 (NPL)"), ("Nikon 5100 "
                                                                                     "(NPL)", "D66",
                                                                                     "nearest are"),
                             ("none.csv", "D65", "none.csv is missing")])
def test_unknown_names_are_answered_with_the_nearest(camera, lamp, message):
    found = call("sample", "--sensitivity", camera, "--light", lamp, "--signal", "0.2,0.3,0.1",
                 "--json", code=3)
    assert message in json.loads(found.stdout)["error"]


def test_advice_on_a_signal_ranks_readings_and_photos():
    facts = json.loads(call("advise", *CAMERA, "--signal", "0.2,0.3,0.15", "--noise", "0.003",
                            "--lamps", "A", "--json").stdout)
    assert {one["action"] for one in facts["overall"]} == {"reading", "second-lamp"}
    # one width is said of a signal, by its estimate and by the advice on it
    estimate = sb.sample([0.2, 0.3, 0.15], camera=CAMERA[1], light=CAMERA[3], noise=0.003)
    assert {one["width_before"] for one in facts["overall"]} == {estimate.band_width}
    assert {one.width_before for one in sb.advise(estimate)} == {estimate.band_width}
    after = [one["width_after"] for one in facts["overall"]]
    assert after == sorted(after) and after[-1] < facts["overall"][-1]["width_before"]


def test_advice_on_an_estimate_is_for_the_level_of_its_band():
    wide, narrow = (sb.sample([0.2, 0.3, 0.15], camera=CAMERA[1], light=CAMERA[3], noise=0.003,
                              level=level) for level in (0.95, 0.5))
    (wider,), (narrower,) = (sb.advise(one, lamps=["A"], camera=CAMERA[1], light=CAMERA[3])[:1]
                             for one in (wide, narrow))
    assert narrower.width_before == narrow.band_width < wider.width_before == wide.band_width
    # of nearly normal bands: 0.67 standard deviations for 1.96
    assert narrower.width_after == pytest.approx(wider.width_after * 0.67 / 1.96, rel=0.2)


def write_folder(folder, seed, count):
    folder.mkdir()
    nm = np.arange(400, 701, 5)
    rows = [",".join(f"{value:.5f}" for value in surface(nm, 1000 * seed + i))
            for i in range(count)]
    (folder / "curves.csv").write_text("\n".join([",".join(map(str, nm)), *rows]))
    return folder


def test_a_stated_family_narrows_the_band_and_is_said():
    skin = ("--signal", "0.46,0.31,0.22", "--samples", 1000)
    free, said = sample(*skin), sample(*skin, "--family", "skin")
    assert max(free["families"], key=free["families"].get) == "skin"
    assert said["families"] == {"skin": 1.0}
    widths = [np.mean(np.array(facts["upper"]) - facts["lower"]) for facts in (free, said)]
    assert widths[1] < widths[0]
    assert "the signal allows skin" in free["conditional_on"]
    assert "the surface being skin, as stated" in said["conditional_on"]
    assert "'jam' is no family of surfaces" in sample(*skin, "--family", "jam", code=3)["error"]


def test_a_signal_says_what_bands_of_its_families_held():
    certificates = load_prior().certificates
    skin = ("--signal", "0.46,0.31,0.22", "--samples", 1000)
    free, (said,) = sample(*skin), sample(*skin, "--family", "skin")["certified"]
    named = {one["name"]: one for one in free["certified"]}
    assert set(named) == {name for name, share in free["families"].items() if share >= 0.05}
    assert not any(one["stated"] for one in named.values())
    assert named["skin"]["coverage"] == certificates["skin"].unstated["coverage"]
    assert named["skin"]["share"] == free["families"]["skin"]
    assert said == {"name": "skin", "share": 1.0, "stated": True, "measured": False,
                    **certificates["skin"].stated}
    held = f"skin {100 * said['coverage']:.1f} % at a mean width of {said['width']:.3f}"
    assert held in call("sample", *CAMERA, *skin, "--family", "skin").stdout
    assert "certified" not in sample(*skin, "--method", "uniform")


def test_a_signal_like_no_measured_one_has_no_certificate(tmp_path):
    wild = sample("--signal", "0.9,0.1,0.9", "--samples", 1000)
    assert wild["method"] == "smoothness prior" and wild["certified"] == []
    assert wild["certificate"].startswith("No certificate")
    path = tmp_path / "signals.csv"
    path.write_text("red,green,blue\n0.46,0.31,0.22\n0.9,0.1,0.9\n")
    known, unknown = sample("--signals", path)["results"]
    assert known["certificate"] == sample("--signal", "0.46,0.31,0.22")["certificate"]
    assert unknown["certified"] == []


def test_signals_keep_their_names_in_answer_table_and_picture(tmp_path):
    (tmp_path / "s.csv").write_text("name,R,G,B\nwall,0.2,0.3,0.15\nleaf,0.1,0.2,0.05\n",
                                    encoding="utf-8")
    facts = sample("--signals", tmp_path / "s.csv", "--noise", "0.004", "--out",
                   tmp_path / "o.csv", "--plot", tmp_path / "o.png")
    assert [each["name"] for each in facts["results"]] == ["wall", "leaf"]
    table = read_table(tmp_path / "o.csv")
    assert table.names[:4] == tuple(f"wall {name}" for name in
                                    ("mean", "standard_deviation", "lower", "upper"))
    # a table holds six digits
    np.testing.assert_allclose(table.values[4], facts["results"][1]["mean"], rtol=1e-5)
    assert (tmp_path / "o.png").read_bytes().startswith(b"\x89PNG")
    three = sample("--signals", tmp_path / "s.csv", "--noise", "0.004,0.004,0.004")["results"]
    assert three[1]["mean"] == facts["results"][1]["mean"]     # one number stands for every band
    assert "signal wall" in call("sample", *CAMERA, "--signals", tmp_path / "s.csv").stdout


def test_an_srgb_colour_is_what_the_observer_sees_in_daylight_and_says_what_it_is_not():
    outcome = CliRunner().invoke(app, ["sample", "--srgb", "#c86432", "--json"])
    facts = json.loads(outcome.stdout)
    nm = np.array(facts["wavelengths_nm"])
    response = relative_response(OBSERVER, "D65", grid_from_nm(nm))
    linear = decode_srgb(np.array([200, 100, 50]) / 255)
    # the matrix has four digits, and 5 nm steps round the integral
    np.testing.assert_allclose(TO_SRGB @ (response @ facts["mean"] * np.linalg.inv(TO_SRGB).sum(1)),
                               linear, atol=0.01)
    assert "not of what was photographed" in facts["caveat"]
    for words, said in ((["--srgb", "1,2"], "R,G,B from 0 to 255"),
                        (["--srgb", "1,2,300"], "R,G,B from 0 to 255"),
                        (["--srgb", "1,2,3", "--light", "A"], "leave --sensitivity"),
                        (["--signal", "1,2,3"], "--sensitivity and --light")):
        refused = CliRunner().invoke(app, ["sample", *words])
        assert refused.exit_code in (2, 3) and said in refused.stderr


def test_a_stated_colour_comes_back_as_it_was_stated():
    by_command = CliRunner().invoke(app, ["sample", "--lab", "45,-27,30", "--json"])
    assert by_command.exit_code == 0, by_command.output
    facts = json.loads(by_command.stdout)
    lab = reflectance_to_lab(np.array(facts["wavelengths_nm"]), np.array(facts["mean"]))
    np.testing.assert_allclose(lab, [45, -27, 30], atol=0.5)
    estimate = sb.sample(xyz=[14.5, 20.1, 3.6], light="A")
    np.testing.assert_allclose(
        100 * tristimulus_weights(estimate.nm, "A") @ estimate.mean, [14.5, 20.1, 3.6], rtol=0.02)
    for words, said in ((["--lab", "45,1,2", "--sensitivity", "x"], "leave --sensitivity"),
                        (["--lab", "45,1,2", "--xyz", "1,2,3"], "give one of"),
                        (["--lab", "145,1,2"], "no colour of a surface"),
                        (["--lab", "45,1,2", "--light", "my.csv"], "my.csv")):
        refused = CliRunner().invoke(app, ["sample", *words])
        assert refused.exit_code in (2, 3) and said in refused.output
    with pytest.raises(InputError, match="need the camera"):
        sb.sample([0.1, 0.2, 0.3])
