"""Signals of a perfect white and of black, of more bands than splines, of fitted cameras, and
colours on another scale than they are taken on.
"""
import json

import numpy as np
import pytest
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.fixtures.demos.flat_demo import write_flat_demo
from spectrabox.measure import texts
from spectrabox.measure.signals.signal_capture import of_curves
from spectrabox.radiometry.findings import Finding, Severity, faults
from spectrabox.radiometry.spectra.filters import read_filters
from spectrabox.sampling.prior.signal_posterior import EDGE, INSIDE
from spectrabox.session.cli import app

NM = np.arange(400, 701, 5.0)
NAMED = {"camera": "Nikon 5100 (NPL)", "light": "D65"}


@pytest.mark.parametrize(("asked", "edge"), [
    ({"signals": [1, 1, 1], **NAMED}, 1), ({"signals": [0, 0, 0], **NAMED}, 0),
    ({"lab": [100, 0, 0]}, 1), ({"lab": [0, 0, 0]}, 0),
    # white points as they are printed, to two and three decimals
    ({"xyz": [95.05, 100, 108.9]}, 1), ({"xyz": [96.422, 100, 82.521], "light": "D50"}, 1)])
def test_a_perfect_white_and_black_are_answered(asked, edge):
    spectra = sb.sample(**asked)
    draws = spectra.samples.spectra
    assert draws.min() >= 0 and draws.max() <= 1
    # by what each band sees of it, each draw is within INSIDE of the edge; round-off of a sum
    seen = draws @ spectra.posterior.relative_response.T
    np.testing.assert_allclose(np.abs(seen - edge), INSIDE, atol=1e-9)
    assert spectra.lab().value[0] == pytest.approx(100 * edge, abs=0.1)     # of 903 Y, and less


@pytest.mark.parametrize("value", [1 - 2 * EDGE, 2 * EDGE])
def test_a_signal_beside_the_edge_is_reached_as_it_is(value):
    spectra = sb.sample([value] * 3, **NAMED)
    seen = spectra.samples.spectra @ spectra.posterior.relative_response.T
    # the camera is integrated exactly; the draws are at their signal to round-off
    np.testing.assert_allclose(seen, value, atol=1e-9)


@pytest.mark.parametrize("bands", [13, 14, 16])
def test_a_signal_of_many_bands_is_answered_among_others_as_alone(bands):
    centres = np.linspace(410, 690, bands)[:, None]
    camera = (NM, np.exp(-0.5 * ((NM - centres) / 10)**2))
    signal = np.linspace(0.2, 0.6, bands)
    alone = sb.sample(signal, camera=camera, light="D65", noise=0.003)
    among = sb.sample([signal, 0.9 * signal], camera=camera, light="D65", noise=0.003)[0]
    # exact bounds of both are linear programs over the same splines
    np.testing.assert_allclose(among.summary.bound_upper, alone.summary.bound_upper, atol=1e-6)
    np.testing.assert_allclose(among.summary.bound_lower, alone.summary.bound_lower, atol=1e-6)


def sampled(*words):
    return json.loads(CliRunner().invoke(app, ["sample", *words, "--json"]).stdout)


def test_a_colour_given_by_white_of_1_is_said_to_be_nearly_black():
    for colour, nearly_black in (("1,0.5,0.2", True), ("255,128,51", False), ("0,0,0", False)):
        found = [one["code"] for one in sampled("--srgb", colour)["findings"]]
        assert ("signal.srgb-nearly-black" in found) is nearly_black and "signal.of-srgb" in found


def write_curves(path, errors):
    curves = np.exp(-0.5 * ((NM - np.array([[600], [540], [450]])) / 30)**2)
    names = ["R", "G", "B"] + [f"standard_error {band}" for band in "RGB"] * errors
    np.savetxt(path, np.vstack([NM, curves, *[0.02 * curves] * errors]).T, delimiter=",",
               header="nm," + ",".join(names), comments="")
    return path


def test_standard_errors_of_curves_that_are_not_used_are_named(tmp_path):
    fitted, measured = (write_curves(tmp_path / f"{errors}.csv", errors) for errors in (1, 0))
    words = ("--light", "D65", "--signal", "0.3,0.2,0.1")

    def unused(facts):
        return [one["values"]["error"] for one in facts["findings"]
                if one["code"] == "camera.errors-not-used"]
    facts = sampled("--sensitivity", str(fitted), *words)
    # curves of 1, 31 of 61 points each: 2 % of them, root mean square
    assert unused(facts) == pytest.approx([0.0083], abs=5e-5)
    assert not unused(sampled("--sensitivity", str(measured), *words))
    assert not unused(sampled("--sensitivity", str(fitted), *words, "--sensitivity-error", "0.02"))
    spectra = sb.sample([0.3, 0.2, 0.1], camera=fitted, light="D65")
    assert facts["caveat"].splitlines() == list(spectra.caveats)
    assert "camera.errors-not-used" in [one.code for one in spectra.findings]
    assert all(caveat in repr(spectra) for caveat in spectra.caveats)


def test_doubts_of_a_fit_are_carried():
    assert of_curves(None, 0.0) == ()
    doubt = Finding("calibration.unlike-cameras", Severity.WARN, values={"probability": 1.0})
    for error in (None, 0.01):
        assert texts.says(doubt) in texts.says(of_curves(error, 0.0, (doubt,))[-1])
    assert len(of_curves(0.01, 0.02, (doubt,))) == 1


def test_a_fitted_camera_brings_its_doubts_and_says_that_its_errors_are_not_used(tmp_path):
    write_flat_demo(tmp_path / "painting")
    camera = sb.fit_camera(tmp_path / "painting/photos/painting.dng", light="D50")     # it is not
    found = faults(camera.calibration.findings)
    assert "light.contradicted" in {one.code for one in found}
    doubts = [texts.says(one) for one in found]
    for given in (camera, camera.calibration):
        estimate = sb.sample([0.3, 0.2, 0.1], camera=given, light="D65", noise=0.003)
        assert {"camera.errors-not-used", "camera.doubtful"} <= {
            one.code for one in estimate.findings}
        assert all(any(doubt in caveat for caveat in estimate.caveats) for doubt in doubts)


def test_what_states_to_be_a_reflectance_is_no_filter(tmp_path):
    path = tmp_path / "gels.csv"
    table = "nm,a,b\n" + "\n".join(f"{nm:g},0.5,0.4" for nm in NM)
    for quantity in ("reflectance", "Reflectance", "irradiance"):
        path.write_text(f"# quantity: {quantity}\n{table}\n")
        with pytest.raises(sb.InputError, match="of a filter the transmittance is needed"):
            read_filters(path)
    for stated in ("", "# quantity: relative\n", "# quantity: transmittance\n"):
        path.write_text(f"{stated}{table}\n")
        assert list(read_filters(path)) == ["a", "b"]
