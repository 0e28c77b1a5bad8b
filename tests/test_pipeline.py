import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from spectrabox.measure import texts
from spectrabox.measure.captured import InputFile
from spectrabox.measure.opened_photos import develop
from spectrabox.measure.steps.inversion import materials_of, settings_of
from spectrabox.measure.surfaces.surface_signals import measurement, scene_signals
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import sha256_of
from spectrabox.sampling.prior.mixture import load_prior, of_families, reflectance_moments
from spectrabox.sampling.spectral_measurement import response_on, without_states
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import load_finished, stage_states

from tests.session_runs import edit, run

ROOT = Path(__file__).resolve().parent.parent
STAGES = ("chart", "photo", "calibrate", "reconstruct", "sample")


def states(folder):
    return {name: state for name, (state, _) in stage_states(read_session(folder)).items()}


def arrays_of(folder):
    return {stage: sha256_of(folder / "results" / stage / "arrays.npz") for stage in STAGES}


def test_a_finished_session_is_not_run_again(finished):
    assert set(run(finished).states.values()) == {"kept"}
    assert set(states(finished).values()) == {"done"}


def test_the_same_seed_gives_the_same_results_bit_for_bit_and_writes_no_input(finished):
    inputs = [path for path in finished.rglob("*") if path.is_file()
              and "results" not in path.parts]
    before, given = arrays_of(finished), [sha256_of(path) for path in inputs]
    assert set(run(finished, force=True).states.values()) == {"run"}
    assert arrays_of(finished) == before and [sha256_of(path) for path in inputs] == given


@pytest.mark.parametrize("change, stale", [
    (("draws = 1000", "draws = 1200"), {"sample"}),
    (("steps = 80", "steps = 81"), {"reconstruct", "sample"}),
    (('bsdf = "cube"', 'bsdf = "cube"\nfamily = "paint"'), {"reconstruct", "sample"}),
    (('bsdf = "cube"', 'bsdf = "cube"\nsurface = "satin"'), {"reconstruct", "sample"}),
    (("width = 40", "width = 30"), {"photo", "reconstruct", "sample"}),
    (("[sensitivity]\n", '[sensitivity]\nmethod = "smooth"\n'),
     {"calibrate", "reconstruct", "sample"}),
    (("seed = 1", "seed = 2"), {"calibrate", "reconstruct", "sample"})])
def test_only_what_a_change_touches_becomes_stale(finished, change, stale):
    edit(finished, *change)
    assert {name for name, state in states(finished).items() if state == "stale"} == stale


def test_the_family_that_was_stated_is_what_the_fit_expects(captured):
    edit(captured, 'bsdf = "cube"', 'bsdf = "cube"\nfamily = ["skin", "leaf"]')
    capture = read_session(captured).capture()
    materials = {each.name: each for each in materials_of(capture, capture.views[0].scene)}
    assert materials["white"].learnt is None
    expected = materials["cube"].learnt
    mean, covariance = reflectance_moments(of_families(load_prior(), ["skin", "leaves"]))
    np.testing.assert_array_equal(expected.mean, mean)
    np.testing.assert_array_equal(expected.covariance, covariance)
    assert not np.allclose(expected.mean, settings_of(capture).learnt.mean, rtol=0.1)
    edit(captured, "[reconstruct]", '[reconstruct]\nspectrum_prior = "smooth"')
    capture = read_session(captured).capture()
    plain = materials_of(capture, capture.views[0].scene)
    assert all(each.learnt is None for each in plain)


def test_a_changed_photo_says_why_its_stages_are_stale(finished):
    with (finished / "photos" / "chart.dng").open("ab") as stream:
        stream.write(b"\0")
    found = stage_states(read_session(finished))
    assert found["chart"] == ("stale", ("files: photos/chart.dng changed",))
    assert found["photo"] == ("done", ())
    assert found["reconstruct"] == ("stale", ("stages: calibrate changed",))


def test_results_of_a_cpu_are_not_up_to_date_for_a_gpu(finished):
    found = stage_states(read_session(finished), device="cuda")
    assert found["photo"] == ("done", ())               # which renders nothing
    assert "versions: device is new" in found["reconstruct"][1]
    assert set(stage_states(read_session(finished), device="cpu").values()) == {("done", ())}


def test_one_stage_can_be_run_alone(finished):
    edit(finished, "draws = 1000", "draws = 1100")
    assert run(finished, only="sample").states["sample"] == "run"
    edit(finished, "width = 40", "width = 30")
    with pytest.raises(InputError, match="stage 'photo', which comes before 'reconstruct', is not "
                       "up to date"):
        run(finished, only="reconstruct")
    with pytest.raises(InputError, match="no stage 'photos' in this session"):
        run(finished, only="photos")


def hear_interrupts():
    """A shell's background job ignores SIGINT, and its children would too."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_control_c_ends_a_run_with_130_and_the_run_can_go_on(captured):
    edit(captured, "steps = 80", "steps = 4000\nspp = 512\nengine = \"gradient\"")
    process = subprocess.Popen([sys.executable, "-m", "spectrabox", "run", str(captured),
                                "--device", "cpu"], cwd=ROOT, stderr=subprocess.PIPE,
                               stdout=subprocess.PIPE, text=True, preexec_fn=hear_interrupts)
    for line in process.stderr:
        if line.startswith("reconstruct"):
            break
    time.sleep(2)  # into the steps, past the loading of the renderer
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "interrupted: finished stages are kept" in errors
    assert "Traceback" not in errors
    assert states(captured) == {"chart": "done", "photo": "done", "calibrate": "done",
                                "reconstruct": "missing", "sample": "missing"}


def test_the_recovered_signals_are_those_of_the_truth(finished):
    from spectrabox.radiometry.interreflection import response_matrix
    from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
    run = load_finished(read_session(finished))
    capture, records = run.capture, run.records
    calibration, made = records.calibrations(capture.views)[0], records.reconstruct.joint
    light = spectrum_on_grid(calibration.light, made.grid)
    response = response_matrix(made.grid, calibration.sensitivity.curves, light)
    for index, name in enumerate(made.materials):
        truth = spectrum_on_grid(capture.materials[name].truth, made.grid)
        operator = without_states(measurement(scene_signals(made, [calibration]), index))
        error = response @ truth / response.sum(axis=1) - operator.signal
        chi_square = error @ np.linalg.solve(operator.noise_covariance, error)
        # Three bands: 21.1 is exceeded once in ten thousand if the stated covariance is right.
        assert chi_square < 21.1, (name, error, np.sqrt(np.diag(operator.noise_covariance)))


def test_draws_reproduce_the_signal_within_its_stated_noise(finished):
    run = load_finished(read_session(finished))
    records = run.records
    calibration, made = records.calibrations(run.capture.views)[0], records.reconstruct.joint
    for index, name in enumerate(made.materials):
        summary = records.spectra[name]
        samples = summary.samples
        operator = without_states(measurement(scene_signals(made, [calibration]), index))
        assert samples.spectra.min() >= 0 and samples.spectra.max() <= 1
        residual = samples.spectra @ response_on(operator, samples.grid).T - operator.signal
        chi_square = np.einsum("tk,kl,tl->t", residual, np.linalg.inv(operator.noise_covariance),
                               residual)
        # The prior only narrows the noise: its mean chi-square stays near 3 bands; 6 would be a
        # wrong covariance.
        assert chi_square.mean() < 6
        assert np.all(summary.lower <= summary.upper) and np.all(summary.bound_lower
                                                                 <= summary.bound_upper)


def test_stored_facts_are_plain_json_without_paths(finished):
    for stage in STAGES:
        text = (finished / "results" / stage / "facts.json").read_text(encoding="utf-8")
        assert json.loads(text)["key"]["versions"]["mitsuba"]
        assert str(finished) not in text and str(ROOT) not in text


def test_a_bracket_with_dark_frames_gives_the_same_signal(captured):
    """Two exposures and their dark frames in place of one photo: the same signal per second of
    exposure.
    """
    from fractions import Fraction

    from spectrabox.capture.photo.raw import read_raw
    from spectrabox.fixtures.dng import write_dng
    frame = read_raw(captured / "photos" / "box.dng")
    name = "photos/box.dng"
    single, _ = develop(read_session(captured).capture(),
                        {"": (InputFile(name, captured / name),)})
    black = frame.black_level[[0, 0, 1, 1], [0, 1, 0, 1]]
    base = Fraction(frame.exposure_s).limit_denominator(100000)
    rng, tile = np.random.default_rng(3), np.tile(frame.black_level, np.array(frame.mosaic.shape)
                                                  // 2)
    signal = frame.mosaic.astype(float) - tile
    make, model, serial = "Spectrabox", "Synthetic 5100", "DEMO-1"
    for name, factor in (("short", Fraction(1, 2)), ("long", Fraction(1))):
        settings = {"black": tuple(black), "white": int(frame.white_level),
                    "exposure_s": base * factor,
                    "f_number": frame.f_number, "iso": int(frame.iso), "make": make, "model": model,
                    "serial": serial}
        bright = tile + float(factor) * signal + rng.normal(0, 2, signal.shape)
        dark = tile + rng.normal(0, 2, signal.shape)
        write_dng(captured / "photos" / f"{name}.dng",
                  np.clip(bright, 0, 15871).round().astype(np.uint16), **settings)
        write_dng(captured / "photos" / f"{name}_dark.dng", dark.round().astype(np.uint16),
                  **settings)
    edit(captured, 'object = "photos/box.dng"', 'object = ["photos/short.dng", "photos/long.dng"]\n'
         'dark = ["photos/short_dark.dng", "photos/long_dark.dng"]')
    capture = read_session(captured).capture()
    merged, notes = develop(capture, capture.views[0].photo)
    ratio = (merged.signal.sum(axis=(0, 1)) / single.signal.sum(axis=(0, 1))
             * single.exposure_s / merged.exposure_s)
    # Sums over 16 000 pixels of a few per cent of noise each, and the dark frame's own black: well
    # within 0.5 %.
    np.testing.assert_allclose(ratio, 1, atol=5e-3)
    assert any("dark" in texts.says(note) for note in notes)
