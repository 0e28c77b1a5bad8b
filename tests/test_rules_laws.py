"""Rules of a result, each by itself: of several surfaces, bands and photos the one that counts."""
from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.measure import rules, texts
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import EdgeKind, RegionEdge
from spectrabox.radiometry.records.scenes import SurfaceAgreement
from spectrabox.radiometry.records.spectra import Quantity, Spectrum

BANDS = ("R", "G", "B")


def photo(name="", light=(), misfits=None, scatter=None, edges=None):
    return SimpleNamespace(name=name, light=dict(light), level_misfits=misfits or {},
                           scatter=scatter or {}, edges=edges or {})


def flat(*photos):
    return SimpleNamespace(photos=photos)


def agreement(*ratios):
    """Surfaces a, b, ... of materials A, B, ..., by what the photo shows of the rendering."""
    names = tuple("abcdefgh"[:len(ratios)])
    ratio = np.array(ratios, float).reshape(len(ratios), 3)
    return SurfaceAgreement(names, tuple(name.upper() for name in names),
                            np.full(len(names), 100), ratio, np.zeros(ratio.shape))


# ---- flat samples

def test_the_light_changes_by_its_largest_over_its_least_the_chart_s_among_them():
    photos = photo(light={"a": (1.2, 0.01), "b": (1.1, 0.01)}), photo(light={"c": (0.8, 0.3)})
    (one,) = rules.light_change(flat(*photos))
    assert one.values["value"] == pytest.approx(1.2 / 0.8 - 1) and one.severity is Severity.INFO
    (above,) = rules.light_change(flat(photo(light={"a": (1.2, 0.01), "b": (1.1, 0.01)})))
    assert above.values["value"] == pytest.approx(0.2)      # the chart's is 1


@pytest.mark.parametrize("order", [1, -1])
def test_of_several_photos_the_level_that_is_farthest_off_counts(order):
    photos = photo(misfits={"card": -4.0, "tile": 2.0}), photo(misfits={"card": 1.0, "tile": 2.5})
    (one,) = rules.known_levels(flat(*photos[::order]))
    assert (one.code, one.subject, one.severity) == ("flat.known-level", "card", Severity.WARN)
    assert one.values == {"value": 4.0, "passes": 3.0, "surfaces": ["card"]}
    (fine,) = rules.known_levels(flat(photo(misfits={"card": -3.0, "tile": 2.0})))
    assert fine.severity is Severity.INFO and fine.values["surfaces"] == []
    assert rules.known_levels(flat(photo())) == []


@pytest.mark.parametrize("order", [1, -1])
def test_the_photo_of_which_most_is_clipped_counts_and_is_named(order):
    shares = {"": 0.004, "second lamp": 0.08}
    photos = {name: SimpleNamespace(clipped_share=shares[name]) for name in [*shares][::order]}
    one = rules.clipped("flat.clipped", SimpleNamespace(photo_of_view=photos))
    assert one.severity is Severity.WARN and one.values["value"] == 0.08
    assert "of the photo “second lamp” is clipped" in texts.says(one)
    photos["second lamp"].clipped_share = 0.003
    one = rules.clipped("scene.clipped", SimpleNamespace(photo_of_view=photos))
    assert one.severity is Severity.INFO and "of the object photo is clipped" in texts.says(one)


@pytest.mark.parametrize("order", [1, -1])
def test_a_region_is_as_uneven_as_in_the_photo_that_shows_most_of_it(order):
    photos = photo(scatter={"a": 0.1, "b": 0.3}), photo(scatter={"a": 0.26, "b": 0.05})
    (one,) = rules.uneven_regions(flat(*photos[::order]))
    assert (one.subject, one.severity) == ("b", Severity.WARN)
    assert one.values["value"] == 0.3 and sorted(one.values["surfaces"]) == ["a", "b"]
    (fine,) = rules.uneven_regions(flat(photo(scatter={"a": 0.25, "b": 0.1})))
    assert (fine.subject, fine.severity) == ("a", Severity.INFO)
    assert fine.values["surfaces"] == []


def edge(step):
    return RegionEdge(step=np.array(step), line_px=np.array([[1.0, 2.0], [3.0, 4.0]]),
                      kind=EdgeKind.SHADOW, larger_part_px=None)


def test_an_edge_is_said_with_its_steps_and_the_first_photo_that_shows_it():
    of_first, of_other = edge([-0.2, np.nan, 0.1]), edge([0.5, 0.5, 0.5])
    first, other = (photo(name, scatter={"a": 0.1}, edges={"a": one})
                    for name, one in (("first", of_first), ("other", of_other)))
    (one,) = rules.edges(flat(first, other))
    assert (one.code, one.subject, one.severity) == ("flat.edge", "a", Severity.WARN)
    assert one.values["value"] == 0.2 and one.values["smallest_step"] == 0.1
    assert one.values["photo"] == "first" and one.values["surfaces"] == ["a"]
    assert rules.edges(flat(first))[0].values["photo"] == ""    # of one photo nobody asks which
    # regions of one photo alone were looked at
    (none,) = rules.edges(flat(photo(), photo(scatter={"a": 0.1})))
    assert none.code == "flat.no-edge"
    assert rules.edges(flat(photo())) == []


# ---- scenes

def test_the_worst_surface_is_the_one_that_is_farthest_off_in_any_band():
    one = rules.worst_surface(agreement([1.02, 1, 1], [1, 0.9, 1.07], [np.nan] * 3), BANDS, "p")
    assert (one.code, one.subject, one.severity) == ("scene.worst", "b", Severity.WARN)
    assert one.values["value"] == pytest.approx(0.1) and one.values["ratio"] == pytest.approx(0.9)
    assert (one.values["band"], one.values["surfaces"], one.values["photo"]) == ("G", ["B"], "p")
    assert rules.worst_surface(agreement([1.2, 1, 1]), BANDS, "").severity is Severity.FAIL
    assert rules.worst_surface(agreement([1.049, 1, 1]), BANDS, "").severity is Severity.INFO
    assert rules.worst_surface(agreement([np.nan] * 3), BANDS, "").code == "scene.worst-unknown"


def test_half_of_the_surfaces_agree_within_the_median_of_their_worst_bands():
    of = agreement([1.01, 1, 1], [1, 0.96, 1.03], [1, 1, 1.2], [np.nan] * 3)
    assert rules.median_surface_error(of) == pytest.approx(0.04)
    assert rules.median_surface(of, "").severity is Severity.WARN
    assert rules.median_surface(agreement([1.019, 1, 1]), "").severity is Severity.INFO
    assert rules.median_surface(agreement([0.9, 1, 1]), "").severity is Severity.FAIL
    unknown = rules.median_surface(agreement([np.nan] * 3), "")
    assert (unknown.code, unknown.values["value"]) == ("scene.median-unknown", None)


def test_agreement_lists_what_is_off_the_worst_first_and_what_was_not_compared():
    one = rules.agreement_in(agreement([1.06, 1, 1], [1, 0.8, 0.9], [1.04, 1, 0.96],
                                       [np.nan, 1, 1]), BANDS)
    assert (one.values["compared"], one.values["not_compared"]) == (3, ["d"])
    assert one.values["largest"] == pytest.approx(0.2)
    assert [(each["surface"], each["band"]) for each in one.values["off"]] == [("b", "G"),
                                                                             ("a", "R")]
    assert one.values["off"][0]["ratio"] == pytest.approx(0.8)
    assert not one.values["all_bands_alike"]


@pytest.mark.parametrize("ratio, alike", [([0.8, 0.82, 0.84], True), ([0.8, 0.9, 0.8], False),
                                          ([1.3, 1.25, 1.28], True), ([1.01, 1.01, 1.01], False)])
def test_bands_are_alike_where_they_differ_by_less_than_a_third_of_what_is_off(ratio, alike):
    # of a surface that fits nothing is off
    assert rules.agreement_in(agreement(ratio), BANDS).values["all_bands_alike"] == alike


def made(of, misfits=(), light=None):
    return SimpleNamespace(agreement=of, misfits=misfits, known_light=light)


def test_misfits_beyond_three_are_said_together_by_the_largest():
    of = agreement(*[[1, 1, 1]] * 5)
    sizes = {"a": 0.3, "b": 0.2, "c": 0.16, "d": 0.1, "e": 0.14}
    misfits = [Finding("scene.misfit", Severity.NOTE, name, {"value": size})
               for name, size in sizes.items()]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rules.misfit, "common_cause", lambda *_: None)
        *named, others = rules.misfits_of(made(of, misfits), BANDS, "p")
    assert [one.subject for one in named] == ["a", "b", "c"]
    assert [one.values["surfaces"] for one in named] == [["A"], ["B"], ["C"]]
    assert {one.severity for one in named} == {Severity.FAIL}
    assert (others.code, others.severity) == ("scene.more-misfits", Severity.WARN)
    assert others.values["value"] == 0.14 and others.values["names"] == ["d", "e"]
    assert others.values["surfaces"] == ["D", "E"] and others.values["photo"] == "p"


def test_what_misfits_have_in_common_is_said_once_by_the_largest():
    misfits = [Finding("scene.misfit", Severity.NOTE, name, {"value": size})
               for name, size in (("a", 0.1), ("b", 0.2))]
    cause = Finding("scene.brighter", Severity.NOTE, values={"band": "R"})
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rules.misfit, "common_cause", lambda *_: cause)
        (one,) = rules.misfits_of(made(agreement([1] * 3, [1] * 3), misfits), BANDS, "p")
    assert (one.code, one.severity) == ("scene.brighter", Severity.FAIL)
    assert one.values["value"] == 0.2 and one.values["surfaces"] == ["A", "B"]
    assert one.values["band"] == "R" and one.values["photo"] == "p"
    (fits,) = rules.misfits_of(made(agreement([1] * 3)), BANDS, "p")
    assert (fits.code, fits.values["photo"]) == ("scene.fits", "p")


def test_a_scene_with_a_picture_says_patterns_once_for_all_photos():
    def of(*sizes):
        return made(agreement([1] * 3, [1] * 3), [
            Finding("scene.misfit", Severity.NOTE, name, {"value": size})
            for name, size in sizes])
    (one,) = rules.patterned([of(("a", 0.1)), of(("a", 0.3), ("b", 0.2)), of()])
    assert one.values["value"] == 0.3 and one.values["names"] == ["a", "b"]
    assert one.values["surfaces"] == ["A", "B"] and one.severity is Severity.WARN
    (none,) = rules.patterned([of(), of()])
    assert none.code == "scene.fits"


@pytest.mark.parametrize("colour, severity", [([1, 1.1, 1], Severity.WARN),
                                              ([1, 0.9, 1], Severity.WARN),
                                              ([1, 1.01, 1], Severity.INFO)])
def test_light_on_known_surfaces_is_as_far_off_as_its_worst_band(colour, severity):
    light = SimpleNamespace(materials=("card",), colour=np.array(colour), level=None)
    (one,) = rules.light_of_known(made(None, light=light), "p")
    assert one.values["size"] == pytest.approx(np.abs(np.array(colour) - 1).max())
    assert one.values["value"] == pytest.approx(
        one.values["size"] / rules.known_light.LAMP_COLOUR_ERROR)
    assert one.severity is (severity if one.values["value"] > 3 else Severity.INFO)


def test_a_level_that_contradicts_the_chart_comes_before_the_colour():
    light = SimpleNamespace(materials=("card",), colour=np.ones(3), level=0.8, contradiction=4.0)
    level, colour = rules.light_of_known(made(None, light=light), "p")
    assert (level.code, level.severity) == ("scene.known-level", Severity.WARN)
    assert level.values["size"] == pytest.approx(0.2) and level.values["ratio"] == 0.8
    assert (colour.code, colour.severity) == ("scene.known-colour", Severity.INFO)
    assert rules.light_of_known(made(None), "p") == []


# ---- results of any kind

def test_coverage_is_the_mean_over_surfaces_of_known_truth_alone():
    def surface(coverage, level=0.9):
        return SimpleNamespace(scores=None if coverage is None else SimpleNamespace(
            coverage=coverage), summary=SimpleNamespace(level=level))
    found = SimpleNamespace(surfaces=[surface(1.0), surface(0.8), surface(None)])
    (one,) = rules.truth_coverage(found)
    assert one.values == {"value": pytest.approx(0.9), "intended": pytest.approx(0.9), "tested": 2}
    (none,) = rules.truth_coverage(SimpleNamespace(surfaces=[surface(None)]))
    assert none.code == "truth.not-given"


def test_processed_photos_and_findings_of_charts_are_said_by_photo():
    assert [one.severity for one in rules.processed(SimpleNamespace(processed=True))] == [
        Severity.WARN]
    assert rules.processed(SimpleNamespace(processed=False)) == []
    fault = Finding("chart.glare", Severity.WARN)
    found = SimpleNamespace(chart_findings={
        "": (Finding("chart.note", Severity.NOTE),), "second": (fault, Finding(
            "chart.note", Severity.NOTE))})
    good, bad = rules.chart_photos(found)
    assert (good.code, good.subject) == ("chart.good", "")
    assert (bad.code, bad.subject) == ("chart.glare", "second")


def test_a_surface_that_is_off_is_named_unless_it_was_as_a_misfit_in_any_photo():
    of = agreement([1.06, 0.92, 1], [1.2, 1, 1], [1.049, 1, 1], [1, 1, 1.3], [np.nan] * 3)
    of_second = made(agreement([1] * 3), [Finding("scene.misfit", Severity.NOTE, "d", {})])
    found = SimpleNamespace(
        reconstruction=made(of, [Finding("scene.misfit", Severity.NOTE, "b", {})]), bands=BANDS,
        views={"second": (None, of_second)})
    (one,) = rules.surfaces_off(found)
    assert (one.code, one.subject, one.values["band"]) == ("scene.surface-off", "a", "G")
    assert one.values["value"] == pytest.approx(-0.08)


@pytest.mark.parametrize("known, from_chart, scale, said", [
    ((True, False), True, 1.0, []), ((True, False), False, 1.0, ["scene.scale-of-known"]),
    ((True, False), True, None, ["scene.scale-of-known"]), ((False, False), False, None, [])])
def test_known_surfaces_tell_the_light_where_no_chart_does(known, from_chart, scale, said):
    fit = SimpleNamespace(basis=None, residuals=np.zeros(3))
    found = SimpleNamespace(
        calibration=SimpleNamespace(sensitivity=fit, light_scale=scale), level_error=None,
        surfaces=[SimpleNamespace(known=one) for one in known],
        stated=SimpleNamespace(flat_fields=("flat.dng",), scale_from_chart=from_chart))
    assert [one.code for one in rules.not_corrected(found)] == said
    found.stated.flat_fields, fit.residuals, found.level_error = (), None, 0.2
    level = [one for one in rules.not_corrected(found) if one.code == "scene.level-by-prior"]
    assert [one.severity for one in level] == [Severity.WARN]
    assert [one.code for one in rules.not_corrected(found)] == [
        "scene.no-flat-field", "scene.level-by-prior", "camera.of-file"]
    fit.basis = object()        # a chart was fitted
    assert "camera.of-file" not in [one.code for one in rules.not_corrected(found)]


def truth_of(off, spread):
    """A surface whose stated truth is off by so much at each wavelength."""
    grid = visible_grid(100)
    mean = np.full(grid.nm.size, 0.4)
    return SimpleNamespace(
        truth=Spectrum(grid, mean + off, Quantity.REFLECTANCE, "stated"),
        summary=SimpleNamespace(grid=grid, mean=mean, standard_deviation=np.broadcast_to(
            spread, mean.shape)))


def test_a_truth_is_of_another_surface_where_it_is_far_off_in_the_mean_over_wavelengths():
    near, far = truth_of(0.1, 0.05), truth_of([0, 0.2, 0, -0.2], [0.05, 0.02, 0.05, 0.02])
    near.name, far.name = "near", "far"
    (one,) = rules.stated_truths(SimpleNamespace(surfaces=[near, far]))
    assert (one.code, one.subject, one.severity) == ("truth.of-another", "far", Severity.WARN)
    assert one.values["value"] == pytest.approx(np.sqrt(200 / 4))
    assert one.values["surfaces"] == ["far"]
    (fine,) = rules.stated_truths(SimpleNamespace(surfaces=[near]))
    assert (fine.code, fine.values["value"]) == ("truth.possible", pytest.approx(2.0))
    # no spectrum is known to better than spectra repeat
    sure = truth_of(0.004, 1e-6)
    sure.name = "sure"
    (two,) = rules.stated_truths(SimpleNamespace(surfaces=[sure]))
    assert two.values["value"] == pytest.approx(2.0)
    assert rules.stated_truths(SimpleNamespace(surfaces=[])) == []
