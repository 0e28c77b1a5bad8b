"""What a chart says for and against a stated light, and the verdict on a fitted camera."""
import functools
import json
import os
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from flat_example import picture
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.fixtures.paints import NM
from spectrabox.measure import texts
from spectrabox.radiometry.chart import AFTER_2014
from spectrabox.radiometry.published.published_tables import LIGHTS, published_curves
from spectrabox.session.cli import app


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    """A chart under the filaments of CIE A."""
    path = tmp_path_factory.mktemp("stated") / "chart.dng"
    nm, curves = published_curves(LIGHTS, "A")
    light = picture(power=np.interp(NM, nm, curves[0]))
    write_photo(path, light, Fraction(1, 60), np.random.default_rng(3), brightest=0.75)
    return path


@pytest.fixture(scope="module")
def fitted(photo):
    """The camera under a stated light, the lines of ``camera fit`` and its JSON."""
    @functools.cache
    def fit(light):
        camera = sb.fit_camera(photo, light=light, reference=AFTER_2014)
        return camera, camera.text().splitlines(), camera.facts()
    return fit


@pytest.mark.parametrize("light", ["A", "halogen", "2900K"])
def test_a_right_statement_is_agreed_with_before_anything_else(fitted, light):
    camera, lines, facts = fitted(light)
    evidence, = camera.light_evidence
    assert evidence.values["against"] < 0 and evidence.code == "light.agrees"
    assert camera.findings[0] == evidence
    assert lines[1] == f"- {texts.says(evidence)}" == f"- {camera.checks[0]}"
    assert facts["findings"] == [texts.facts(one) for one in camera.findings]
    assert camera.verdict == facts["verdict"] == "pass"
    assert lines[-1] == f"verdict: PASS. {camera.says}" and facts["says"] == camera.says
    likeliest = max(facts["light_evidence"][0]["kinds"].items(), key=lambda kind: kind[1])[0]
    assert likeliest == "halogen"


@pytest.mark.parametrize("light", ["D65", "daylight", "6500K"])
def test_a_wrong_statement_is_contradicted_first_and_in_the_verdict(fitted, light):
    camera, lines, facts = fitted(light)
    evidence, = camera.light_evidence
    assert evidence.code == "light.contradicted" and camera.findings[0] == evidence
    assert camera.verdict == facts["verdict"] == "warn"
    assert lines[-1].startswith("verdict: WARN. ")
    assert texts.says(evidence) in lines[-1] and facts["doubts"]
    said, = facts["light_evidence"]
    assert said["contradicts"] and said["against"] > said["limit"]
    assert said["kinds"] == evidence.values["kinds"]


def test_the_kind_of_an_unknown_light_is_a_finding_and_a_stated_kind_is_none(fitted):
    unknown = fitted("unknown")[0]
    stated = fitted("halogen")[0]
    assert not unknown.light_evidence
    assert unknown.findings[0].code == "light.kind"
    assert "light.kind" not in {one.code for one in stated.findings}
    # by the same photo and the same lamps
    np.testing.assert_allclose(list(stated.light_evidence[0].values["kinds"].values()),
                               unknown.calibration.light_posterior.probabilities, atol=1e-9)


def test_the_verdict_says_what_was_fitted_and_how_surely(fitted):
    camera = fitted("A")[0]
    lower, upper = camera.band()
    assert camera.says.startswith("Curves of R, G, B, from one photo under CIE A, known within "
                                  f"{50 * (upper - lower).mean():.0f} % of the highest peak")
    assert camera.says.endswith("For photos under any light.")
    products = fitted("unknown")[0]
    assert products.says.startswith("Products of R, G, B with the light, from one photo under an "
                                    "unknown light")
    assert products.says.endswith("For photos under this light, and for no other.")
    assert repr(camera) == f"<CameraEstimate pass: {camera.says}>"


def test_the_command_prints_the_same(photo, fitted):
    words = ("camera", "fit", str(photo), "--light", "daylight", "--reference", AFTER_2014)
    _, lines, facts = fitted("daylight")
    assert CliRunner().invoke(app, words).stdout.splitlines() == lines
    said = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)
    assert said["light_evidence"] == facts["light_evidence"]
    assert (said["verdict"], said["says"]) == (facts["verdict"], facts["says"])


@pytest.mark.parametrize("name, light, verdict", [
    ("canon550d_dusk", "unknown", "pass"), ("canon550d_dusk", "halogen", "pass"),
    ("canon550d_dusk", "D65", "warn"), ("industrial_outdoor2", "daylight", "warn"),
    ("industrial_indoor1", "halogen", "pass")])
def test_a_real_chart_gets_a_verdict_and_its_stated_light_is_answered_first(name, light, verdict):
    if "SPECTRABOX_DATA" not in os.environ:
        pytest.skip("SPECTRABOX_DATA names no folder of real chart photos")
    camera = sb.fit_camera(Path(os.environ["SPECTRABOX_DATA"]) / "raw_charts" / f"{name}.dng",
                           light=light)
    assert camera.verdict == verdict
    if light == "unknown":
        assert camera.findings[0].code == "light.kind"
    else:
        evidence, = camera.light_evidence
        assert camera.findings[0] == evidence
        assert (evidence.code == "light.contradicted") == (light == "D65")
