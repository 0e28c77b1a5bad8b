"""What the report says of values just inside and just outside each limit.

Every criterion is swept across its limits, at them, and a few per cent to either side.
"""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from report_example import SURFACES, example_session
from report_variants import (
    a_posterior,
    a_view,
    left_out,
    spread_over,
    with_fit,
    with_made,
    with_ratio,
)

from spectrabox.radiometry.light_scale import REPEATABILITY, with_common_error
from spectrabox.radiometry.records import (
    CalibrationDoubt,
    Outcome,
    SurfaceMisfit,
)
from spectrabox.session.report import flat_verdict, verdict
from spectrabox.session.report.flat_methods import flat_methods
from spectrabox.session.report.verdict import judge
from spectrabox.session.report.words import (
    deviation_words,
    disagreement,
    exposure,
    fact,
    fixed,
    listed,
    number,
    percent,
    signed_percent,
)
from spectrabox.session.store.rehearsals import rehearsal_text, too_narrow

BANDS = ("R", "G", "B")
AROUND = (0.5, 0.97, 1.0, 1.03, 2.0)        # of a limit


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """A session on which nothing is wrong."""
    results = example_session(tmp_path_factory.mktemp("example"))
    return with_ratio(results, np.ones((len(SURFACES), 3)))


def row(found):
    """A criterion on one line, and its value."""
    return [" | ".join((found.status.name, found.name, found.shown, found.limit, found.says)),
            found.value]


def rows(found):
    return [found.status.name, found.says, [row(each) for each in found.criteria]]


def around(limits):
    return [share * limit for limit in limits if np.isfinite(limit) for share in AROUND]


def test_the_whole_verdict_of_a_session(example, tmp_path, recorded):
    recorded(rows(judge(example)), case="nothing is wrong")
    for case in ({"chart": False}, {"truth": False}, {}):
        results = example_session(tmp_path, **case)
        recorded(rows(judge(results)), case=f"example {case}")


def test_the_median_surface_is_judged_by_its_worst_band(example, recorded):
    """The median of the largest deviations of five surfaces, not of all values or of the mean."""
    found = []
    for value in around(verdict.MEDIAN_LIMITS):
        results = with_ratio(example, spread_over(value))
        found.append(row(judge(results).criteria[0]))
        # a sum and a difference of numbers near one
        assert found[-1][1] == pytest.approx(value, abs=1e-14)
    recorded(found)


def test_the_worst_surface_is_named_with_its_band(example, recorded):
    found = []
    for value in around(verdict.WORST_LIMITS):
        for sign in (1, -1):
            ratio = spread_over(0.01)
            ratio[3, 2] = 1 + sign * value
            found.append([*row(judge(with_ratio(example, ratio)).criteria[1]),
                          disagreement(with_ratio(example, ratio).reconstruction.agreement,
                                       BANDS)])
            assert "floor" in found[-1][0] and "band B" in found[-1][0]
    recorded(found)


def test_surfaces_that_were_not_compared(example, recorded):
    ratio = spread_over(0.03)
    found = []
    for surfaces in ([], [1], [0, 2], [0, 1, 3, 4], list(range(5))):
        some = ratio.copy()
        some[surfaces, 1] = np.nan
        results = with_ratio(example, some)
        found.append(rows(judge(results))[:2]
                     + [row(each) for each in judge(results).criteria[:2]]
                     + [disagreement(results.reconstruction.agreement, BANDS)])
    recorded(found)


def test_whether_all_bands_are_off_alike(example, recorded):
    """The hint turns where the bands differ by 0.3 of the largest deviation."""
    found = []
    for share in (0.0, 0.15, 0.29, 0.31, 0.6, 1.4):
        ratio = spread_over(0.01)
        ratio[2] = 1 - 0.2 * np.array([1.0, 1 - share / 2, 1 - share])
        agreement = with_ratio(example, ratio).reconstruction.agreement
        found.append(disagreement(agreement, BANDS))
    assert "same factor" in found[2] and "bands differ" in found[3]
    recorded(found)


def test_surfaces_beyond_chance(example, recorded):
    found = []
    for count in range(6):
        misfits = tuple(SurfaceMisfit(f"wall {at}", -0.03 * (at + 1), f"wall {at} does not fit")
                        for at in range(count))
        found.append([row(each) for each in judge(with_made(example, misfits=misfits)).criteria
                      if "beyond chance" in each.name])
    for deviation in around(verdict.WORST_LIMITS[1:]):
        for sign in (1, -1):
            misfits = (SurfaceMisfit("a", 0.01, "a does not fit"),
                       SurfaceMisfit("b", sign * deviation, "b does not fit"))
            found.append(rows(judge(with_made(example, misfits=misfits)))[:2])
    recorded(found)


def test_another_photo_is_judged_with_its_own_bands(example, recorded):
    misfits = (SurfaceMisfit("floor", 0.07, "floor does not fit"),)
    ratio = spread_over(0.015)[:, :2]
    ratio[1, 1] = 0.8
    results = dataclasses.replace(example, views=[a_view(example, ratio, misfits)])
    recorded(rows(judge(results)))


def test_a_picture_makes_information_of_what_is_off(example, recorded):
    found = []
    for worst, deviation in ((1.0, None), (1.3, None), (1.3, 0.08), (1.3, 0.4)):
        ratio = spread_over(0.03)
        ratio[2, 1] = worst
        misfits = () if deviation is None else (SurfaceMisfit("b", deviation, "b does not fit"),)
        results = with_made(with_ratio(example, ratio), misfits=misfits)
        found.append(rows(judge(dataclasses.replace(results, picture=object()))))
    recorded(found)


def test_the_chart_s_residual(example, recorded):
    found = []
    rng = np.random.default_rng(2)
    for value in around(verdict.CHART_LIMITS):
        residuals = rng.normal(0, 1, (24, 3))
        residuals[3, 1] = np.nan
        residuals *= value / np.sqrt(np.nanmean(residuals**2))
        if value == verdict.CHART_LIMITS[0]:
            residuals *= 1 - 1e-9           # at the limit itself round-off would decide
        found.append(row(verdict.chart_agreement(with_fit(example, residuals=residuals))))
    recorded(found)


def test_residuals_of_curves_from_a_file_are_those_of_the_chart(example, recorded):
    results = with_fit(example, residuals=None)
    found = verdict.chart_residuals(results)
    # two divisions and a subtraction of numbers near one
    np.testing.assert_allclose(found, 1 - results.chart.predicted / results.chart.samples.mean,
                               atol=1e-14)
    none = dataclasses.replace(results, chart=None)
    assert verdict.chart_residuals(none) is None
    recorded([found, row(verdict.chart_agreement(results)), row(verdict.chart_agreement(none))])


def test_patches_left_out_that_the_band_should_hold(example, recorded):
    found = []
    for short in (0.0, 0.015, 0.0291, 0.0309, 0.06):
        chart = dataclasses.replace(example.chart, left_out=left_out(0.97 - short))
        found += [row(each) for each in
                  verdict.left_out(dataclasses.replace(example, chart=chart))]
    assert [each[0][:4] for each in found] == ["INFO"] * 3 + ["WARN"] * 2
    assert verdict.left_out(example) == []
    assert verdict.left_out(dataclasses.replace(example, chart=None)) == []
    recorded(found)


@pytest.mark.parametrize("scene", [True, False], ids=["scene", "flat"])
def test_clipped_pixels_are_those_with_any_band_clipped(scene, example, recorded):
    found = []
    clipped = verdict._clipped if scene else flat_verdict._clipped
    for share in (0.0, 0.002, 0.049, 0.051, 0.6):
        saturated = np.zeros(example.photo.saturated.shape, bool)
        count = round(share * saturated[..., 0].size)
        flat = saturated.reshape(-1, 3)
        flat[np.arange(count), np.arange(count) % 3] = True
        flat[:count // 2] = True            # clipped in all bands counts once too
        photo = dataclasses.replace(example.photo, saturated=saturated)
        found.append(row(clipped(dataclasses.replace(example, photo=photo))))
        assert found[-1][1] == pytest.approx(count / len(flat))
    recorded(found)


def flat_results(example, errors, levels, known=False, card=False):
    """What the verdict and the methods of flat samples read."""
    light = {f"r{at}": each for at, each in enumerate(zip(levels, errors, strict=True))}
    half = len(light) // 2
    photos = [SimpleNamespace(name=name, light=dict(list(light.items())[part]))
              for name, part in (("one", slice(half)), ("two", slice(half, None)))]
    materials = example.materials if known else example.materials[:2]
    inputs = [{"role": "flat-field photo"}] if card else []
    return SimpleNamespace(**(vars(example) | {"photos": photos, "materials": materials,
                                               "inputs": inputs}))


def test_the_light_on_flat_samples(example, recorded):
    found = []
    for error in around(flat_verdict.LIGHT_LIMITS):
        results = flat_results(example, [0.3 * error, error, 0.2 * error], [0.93, 0.8, 1.04])
        found.append([row(each) for each in flat_verdict._light(results)])
        assert found[-1][0][1] == error and "“r1”" in found[-1][0][0]
    found.append(rows(flat_verdict.judge_flat(flat_results(example, [0.01, 0.02], [1.1, 1.2]))))
    recorded(found)
    recorded([flat_methods(flat_results(example, [0.012, 0.034], [1.0, 0.9], known, card))
              for known in (True, False) for card in (True, False)], case="methods")


def test_every_outcome_has_its_grade(example, recorded):
    found = {}
    for outcome in Outcome:
        results = with_fit(with_made(example, outcome=outcome), outcome=outcome)
        named = [row(each) for each in judge(results).criteria
                 if each.name in ("Sensitivity fit", "Inverse rendering")]
        first = example.materials[0]
        samples = dataclasses.replace(first.samples, outcome=outcome,
                                      sentence="a sentence of its own")
        drawn = dataclasses.replace(example, materials=[
            dataclasses.replace(first, samples=samples), *example.materials[1:]])
        found[outcome.name] = [named, [row(each) for each in verdict.samplers(drawn)],
                               drawn.materials[0].doubtful]
    given = dataclasses.replace(example, materials=example.materials[-1:])
    assert verdict.samplers(given) == []
    recorded(found)


def test_two_samplers_in_doubt_are_both_named(example, recorded):
    materials = [each if each.samples is None else dataclasses.replace(
        each, samples=dataclasses.replace(each.samples, outcome=Outcome.UNFAMILIAR,
                                          sentence=f"sentence {number}"))
        for number, each in enumerate(example.materials)]
    recorded(rows(judge(dataclasses.replace(example, materials=materials))))


def test_doubts_of_the_calibration(example, recorded):
    found = []
    for doubts in ((), *((one,) for one in CalibrationDoubt), tuple(CalibrationDoubt)):
        calibration = dataclasses.replace(example.calibration, doubts=doubts)
        found.append([row(each) for each in verdict.calibration_doubts(
            dataclasses.replace(example, calibration=calibration))])
    posterior = a_posterior()
    calibration = dataclasses.replace(example.calibration, light_posterior=posterior)
    assert verdict.calibration_doubts(
        dataclasses.replace(example, calibration=calibration)) == []
    recorded(found)


def test_what_is_assumed_between_the_photos(example, recorded):
    found = [row(each) for each in verdict._between_photos(example)]
    assert found == []
    scale = with_common_error(example.light_scale, "another cause", 0.03)
    scale = with_common_error(scale, REPEATABILITY, 0.017)
    for shares in ((), (0.21,), (0.1, 0.46)):
        materials = [dataclasses.replace(each, variance_shares={REPEATABILITY: share, "x": 0.5})
                     for each, share in zip(example.materials, shares, strict=False)]
        found += [row(each) for each in verdict._between_photos(
            dataclasses.replace(example, light_scale=scale, materials=materials))]
    recorded(found)


def test_bands_and_truths(example, recorded):
    first, second, given = example.materials
    scores = dataclasses.replace(second.scores, coverage=0.71, coverage_95=0.8)
    found = [row(verdict.coverage(dataclasses.replace(example, materials=materials)))
             for materials in ([first, second, given], [given], [second],
                               [first, dataclasses.replace(second, scores=scores)])]
    recorded(found)


def rehearsed(coverage, error=0.01, level=0.9):
    return {"level": level, "seed": 3, "times": 40,
            "materials": [{"name": "red", "coverage": 0.93, "coverage_standard_error": 0.004,
                           "rmse": 0.031, "width": 0.14, "ranks": [3, 5, 2]},
                          {"name": "green", "coverage": coverage,
                           "coverage_standard_error": error, "rmse": 0.052, "width": 0.21,
                           "ranks": [1, 0, 9]}]}


def test_bands_are_too_narrow_beyond_two_errors_and_two_percent(example, recorded):
    found = []
    for coverage in (0.84, 0.8595, 0.8605, 0.875, 0.9, 0.95):
        for error in (0.004, 0.01):
            facts = rehearsed(coverage, error)
            results = dataclasses.replace(example, rehearsal=facts)
            found.append([too_narrow(facts), rehearsal_text(facts),
                          [row(each) for each in verdict._rehearsal(results)]])
    assert [each[0] for each in found[:8:2]] == [True, True, True, False]
    assert verdict._rehearsal(example) == []
    recorded(found)


def test_the_worst_criterion_is_the_verdict_and_says_why(example, recorded):
    """Reasons of the worst status alone, each once."""
    ratio = spread_over(0.03)
    ratio[0, 0] = 1.2
    scale = with_common_error(example.light_scale, REPEATABILITY, 0.02)
    results = dataclasses.replace(with_ratio(example, ratio), rehearsal=rehearsed(0.5),
                                  light_scale=scale)
    found = [rows(judge(results))[:2]]
    doubtful = dataclasses.replace(example.calibration, doubts=tuple(CalibrationDoubt))
    results = dataclasses.replace(example, rehearsal=rehearsed(0.5), calibration=doubtful)
    found.append(rows(judge(results))[:2])
    recorded(found)


def test_numbers_in_words(recorded):
    values = [None, np.nan, np.inf, -np.inf, 0.0, 1e-9, 0.0009, 0.00094, 0.00096, 0.012345, 0.0994,
              0.0996, 0.5, 0.989, 0.9901, 0.9949, 0.9951, 0.99996, 1.0, 1.004, 12.3456, -0.0213,
              -0.5, 1234567.0]
    recorded({"percent": [percent(each) for each in values],
              "percent of 0, 2 decimals": [[percent(each, 0), percent(each, 2)]
                                           for each in values],
              "signed": [signed_percent(each) for each in values],
              "number": [[number(each), number(each, 2), number(each, 6)] for each in values],
              "fixed": [[fixed(each), fixed(each, 1)] for each in values],
              "exposure": [exposure(each) for each in
                           (None, 0.0, 1e-4, 0.004, 0.29, 0.3, 0.31, 1.0, 2.5, 30.0)],
              "fact": [fact(each) for each in
                       (None, True, False, 3, 0.123456789, np.float64(2e-9), "x", [1, 2.5, "y"],
                        {"cores": 2, "gpu": False, "load": (0.5, None)})],
              "listed": [listed([f"s{at}" for at in range(count)], *more)
                         for count in (1, 2, 3, 6, 7, 9) for more in ((), (2,))],
              "deviation": [deviation_words(each) for each in (0.7, 0.999, 1.0, 1.001, 1.3)]})
