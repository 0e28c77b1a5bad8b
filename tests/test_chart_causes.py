"""Causes of what is wrong with a chart photo compete: each is named where it is alone, and beside
its rivals where patches cannot tell.
"""
import numpy as np
import pytest
from calibrate_cameras import GRID

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.prior.camera_prior import shipped_prior
from spectrabox.capture.chart import quality
from spectrabox.capture.chart.chart_agreement import TYPICAL_SIGNALS
from spectrabox.measure import texts
from spectrabox.radiometry import chart_causes
from spectrabox.radiometry.chart import CLASSIC, chart_reflectances
from spectrabox.radiometry.findings import Finding, Severity, faults
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.named_spectra import light

REFLECTANCES = chart_reflectances("BabelColor Average", GRID)
X, Y = ((CLASSIC.centres_uv - CLASSIC.centres_uv.mean(axis=0))
        / np.ptp(CLASSIC.centres_uv[:, 0])).T      # X from -1/2 to 1/2, Y in the same unit
PRIOR = shipped_prior()
CURVES = PRIOR.curves(PRIOR.means[3]).reshape(3, -1) @ interpolation_matrix(PRIOR.nm, GRID.nm).T
DAYLIGHT = light("D65", GRID)
WHITE = CURVES @ DAYLIGHT / (CURVES @ DAYLIGHT).max()


def seen(power=DAYLIGHT):
    """Signals of a chart whose brightest band reads 1 of a perfect reflector."""
    return REFLECTANCES @ (CURVES * power).T / (CURVES @ power).max()


def noisy(signal, seed=1):
    rng = np.random.default_rng(seed)
    return signal * (1 + 0.004 * rng.standard_normal(signal.shape)
                     + 0.006 * rng.standard_normal((24, 1)))


def ranked(signal, expected=None, mixing_sd=0.05):
    return chart_causes.ranked(
        signal, seen() if expected is None else expected, np.full(signal.shape, 1e-4),
        CLASSIC.centres_uv, mixing_sd)


def only(*patches):
    return np.isin(np.arange(24), patches)[:, None].astype(float)


def of_two_lamps():
    filament, side = seen(light("A", GRID)), np.exp(0.8 * X)[:, None]
    return 0.5 * seen() * side + 0.5 * filament / side


# a matrix as a converter's: rows sum to 1, and each band takes from its neighbours
MATRIX = np.array([[1.7, -0.6, -0.1], [-0.25, 1.6, -0.35], [0.05, -0.6, 1.55]])
FAULTS = {
    chart_causes.VEIL: lambda: seen() + 0.08 * WHITE,
    chart_causes.REFLECTION: lambda: seen() + 0.15 * WHITE * only(14, 15, 21),
    chart_causes.UNEVEN: lambda: seen() * np.exp(0.9 * X + 0.3 * Y**2)[:, None],
    chart_causes.TWO_LIGHTS: of_two_lamps,
    chart_causes.TONE: lambda: seen() ** 0.6,
    chart_causes.COMPUTED: lambda: seen() / WHITE @ MATRIX.T,
    chart_causes.BLACK: lambda: seen() - 0.02,
    chart_causes.SHADING: lambda: seen() * np.exp(-(X**2 + Y**2)[:, None]
                                                  * np.array([1.2, 0.5, 0.2])),
    chart_causes.SHADOW: lambda: seen() * np.where(X + 0.3 * Y > 0.1, 0.6, 1.0)[:, None],
    chart_causes.CHART: lambda: seen() * np.exp(-only(2, 16) * np.array([0.1, 0.25, 0.4]))}

# a matrix and another light both mix bands; a lens in whose picture the chart lies at one side
# shades its colours as a second lamp does
ALIKE = {chart_causes.COMPUTED: {chart_causes.LIGHT},
         chart_causes.TWO_LIGHTS: {chart_causes.SHADING}}


@pytest.mark.parametrize("cause", FAULTS)
def test_a_fault_that_leaves_a_mark_of_its_own_is_named_and_its_rivals_are_excluded(cause):
    named = chart_causes.likely_causes(ranked(noisy(FAULTS[cause]())))
    assert named[0] == cause
    assert set(named[1:]) <= ALIKE.get(cause, set())


def test_evidence_of_another_kind_on_the_light_counts():
    patches = noisy(seen()), seen(), np.full((24, 3), 1e-4), CLASSIC.centres_uv, 0.05
    assert chart_causes.likely_causes(chart_causes.ranked(
        *patches, {chart_causes.LIGHT: 20.0})) == (chart_causes.LIGHT,)
    assert chart_causes.CHANCE in chart_causes.likely_causes(chart_causes.ranked(*patches))


def test_a_level_alike_in_all_bands_of_a_balanced_photo_is_a_veil_or_a_black_level():
    balanced = seen() / WHITE
    named = chart_causes.likely_causes(ranked(noisy(balanced + 0.05), balanced))
    assert set(named) == {chart_causes.VEIL, chart_causes.BLACK}


# ---- what becomes of findings --------------------------------------------------------------------

VEILED = Finding("chart.veiled", Severity.WARN, values={"veil": 0.1, "limit": 0.03})
TILTED = Finding("chart.tilted", Severity.WARN, values={"tilt_deg": 50.0, "limit_deg": 40.0})


@pytest.mark.parametrize("nats, causes", [
    ({"veil": 30.0, "tone-curve": 5.0, "chance": 0.0}, None),
    ({"veil": 30.0, "black-level": 29.0, "chance": 0.0}, ["veil", "black-level"]),
    ({"tone-curve": 30.0, "veil": 5.0, "chance": 0.0}, ["tone-curve"]),
    ({"chance": 0.0, "veil": -5.0}, ["veil", "chance"])])
def test_a_finding_that_names_a_cause_stays_only_where_its_rivals_are_excluded(nats, causes):
    found = chart_causes.settled([VEILED, TILTED], nats, "chart.cause")
    assert TILTED in found
    if causes is None:
        assert found == [VEILED, TILTED]
        return
    cause = found[-1]
    assert (cause.code, cause.severity, len(found)) == ("chart.cause", Severity.WARN, 2)
    assert cause.values == {"causes": causes, "doubts": {"chart.veiled": dict(VEILED.values)}}


def test_a_cause_that_is_named_already_is_not_named_twice():
    glare = Finding("chart.glare", Severity.WARN, values={"glare": 0.05, "names": ["white 9.5"]})
    ranking = {"veil": 30.0, "reflection": 3.0, "chance": 0.0}
    assert chart_causes.settled([VEILED, glare], ranking, "chart.cause") == [VEILED]
    alone, = chart_causes.settled([glare], ranking, "chart.cause")
    assert (alone.code, alone.values["causes"]) == ("chart.cause", ["veil"])


def test_every_cause_has_its_words_and_what_tells_it():
    assert set(texts.CAUSES) == {*chart_causes.CAUSES, chart_causes.CHANCE}
    for cause in texts.CAUSES:
        finding = Finding("calibration.cause", Severity.WARN, values={
            "causes": [cause, "veil"], "doubts": {}})
        assert all(texts.CAUSES[cause]) and texts.CAUSES[cause][0] in texts.sentence(finding)
        assert texts.CAUSES[cause][1] in texts.remedy(finding)


def samples_of(signal):
    return PatchSamples(signal, np.einsum("ik,kl->ikl", np.full((24, 3), 1e-8), np.eye(3)),
                        np.full(24, 400), np.zeros((24, 3)), np.zeros((24, 3)))


@pytest.mark.parametrize("signal, code, cause", [
    (FAULTS[chart_causes.VEIL], "chart.veiled", chart_causes.VEIL),
    (FAULTS[chart_causes.TONE], "chart.cause", chart_causes.TONE)])
def test_a_doubted_chart_photo_names_the_cause_that_its_patches_show(signal, code, cause):
    found, = quality.told_apart([VEILED], samples_of(noisy(0.8 * signal())), TYPICAL_SIGNALS)
    assert found.code == code and found.values.get("causes", [cause]) == [cause]


@pytest.mark.parametrize("fault, code, causes", [
    (lambda: seen() + 0.1 * WHITE, "calibration.veil", None),
    (lambda: seen() ** 0.75, "calibration.cause", [chart_causes.TONE])])
def test_a_fit_names_a_veil_and_no_veil_where_a_tone_curve_is(fault, code, causes):
    signal = noisy(fault())
    photo = ChartPhoto(samples_of(signal / signal.max()), REFLECTANCES, Spectrum(
        GRID, DAYLIGHT, Quantity.RELATIVE, "D65"), chart=CLASSIC)
    found = {one.code: one for one in faults(calibrate_chart([photo], GRID).calibration.findings)}
    assert code in found and len({"calibration.veil", "calibration.cause"} & set(found)) == 1
    assert found[code].values.get("causes") == causes


@pytest.mark.parametrize("size", [1e-3, 1.0, 30.0])
def test_a_freedom_that_changes_nothing_is_no_evidence_for_or_against_a_cause(size):
    chart = chart_causes._Chart(noisy(seen()), seen(), np.full((24, 3), 1e-4), CLASSIC.centres_uv,
                                0.05)
    nothing = chart.evidence(lambda signal, _: signal, np.zeros(0))
    free = chart.evidence(lambda signal, _: signal, np.array([size, 2 * size]))
    assert free == pytest.approx(nothing, abs=1e-6)
