"""How each condition of a result is known: a table of what was stated and photographed, each row
for itself.
"""
from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.measure import conditions
from spectrabox.measure.captured import Surface
from spectrabox.radiometry import error_model
from spectrabox.radiometry.appearance import reflectance_to_lab

CARD_OF_INSTRUMENT, TYPED_CARD = {"card": 0.01}, {"card": 0.03}


def place(gloss_error=0.02, level_error=0.05):
    return {"gloss_error": gloss_error, "level_error": level_error}


NM = np.arange(400.0, 701, 10)


def sample(*places, known=False, level=0.4, budget=None, causes=None):
    """A grey surface, what a moved lamp showed of it in each place, and its errors by cause."""
    mean = np.full(NM.size, level)
    return SimpleNamespace(
        name="a", known=known, places=places, nm=NM, mean=mean, signal=np.full(3, level),
        causes=causes or {}, error_budget=budget or {},
        lab=lambda: SimpleNamespace(value=reflectance_to_lab(NM, mean)))


def stated(**changed):
    return SimpleNamespace(**{
        "chart_in_photo": True, "flat_fields": (), "known_errors": {}, "lamp_moved": False,
        "surfaces": {}, "surfaces_stated": False, "views": (), "dark_frames": False,
        "chart": None, "chart_stated": False, "scale_from_chart": True,
        "sensitivity": SimpleNamespace(curves=None, source="")} | changed)


def photo(misfits=(), light=("a",)):
    return SimpleNamespace(level_misfits=dict.fromkeys(misfits, 0.0), light=dict.fromkeys(light))


ONE_PHOTO, NO_ERRORS = (photo(),), (SimpleNamespace(common_errors={}),)


def flat(photos=ONE_PHOTO, surfaces=(), chart=None, processed=False, **of_stated):
    return SimpleNamespace(stated=stated(**of_stated), photos=photos, surfaces=surfaces,
                           chart=chart, measured_chart=None, layout=None, processed=processed)


def scale(**errors):
    return SimpleNamespace(common_errors=errors)


def scene(level_error=None, placements=(), known_light=None, views=(), surfaces=(),
          scales=NO_ERRORS, **of_stated):
    return SimpleNamespace(
        light_scale=scales[0],
        stated=stated(**of_stated), surfaces=surfaces, chart=None, measured_chart=None,
        layout=None, processed=False,
        level_error=level_error, placements=placements,
        reconstruction=SimpleNamespace(known_light=known_light),
        views={str(number): (None, SimpleNamespace(
            known_light=each, light_scale=scales[min(number + 1, len(scales) - 1)]))
            for number, each in enumerate(views)})


def known(made, name):
    """Standing of a condition and how it is known."""
    one = next(each for each in made if each.code == f"condition.{name}")
    return one.values["standing"], one.values["known_by"]


@pytest.mark.parametrize("photos, of_stated, expected", [
    ((photo(),), {}, ("measured", "chart-carried-on")),
    ((photo(),), {"flat_fields": ("white.dng",)}, ("measured", "flat-field")),
    ((photo(),), {"chart_in_photo": False}, ("assumed", "chart-apart")),
    ((photo(),), {"chart_in_photo": False, "flat_fields": ("white.dng",)},
     ("assumed", "chart-apart")),
    ((photo(["card"]),), {"known_errors": CARD_OF_INSTRUMENT}, ("measured", "known-regions")),
    ((photo(["card"]),), {"known_errors": TYPED_CARD}, ("stated", "known-typed")),
    ((photo(["card", "tile"]),), {"known_errors": CARD_OF_INSTRUMENT | {"tile": 0.03}},
     ("stated", "known-typed")),
    ((photo(["card"]),), {"known_errors": TYPED_CARD, "chart_in_photo": False},
     ("stated", "known-typed")),
    # a card in one of two photos tells of one
    ((photo(["card"]), photo()), {"known_errors": CARD_OF_INSTRUMENT},
     ("measured", "chart-carried-on")),
    ((photo(["card"]), photo()), {"known_errors": CARD_OF_INSTRUMENT, "chart_in_photo": False},
     ("assumed", "chart-apart")),
    # a photo that shows no region needs none
    ((photo(["card"]), photo(light=())), {"known_errors": CARD_OF_INSTRUMENT},
     ("measured", "known-regions"))])
def test_the_light_on_flat_samples_is_known_by_cards_in_all_photos_or_by_a_chart_in_them(
        photos, of_stated, expected):
    assert known(conditions.flat_conditions(flat(photos, **of_stated)), "light") == expected


MOVED = {"lamp_moved": True}
SHOWN = sample(place(0.011, 0.03), place(0.012, 0.04))      # by 2.5 standard errors of 3 and 10 %
ONE_BAD_PLACE = sample(place(0.011, 0.03), place(0.013, 0.041))


@pytest.mark.parametrize("surfaces, of_stated, gloss, level", [
    ((SHOWN,), MOVED, "measured", "measured"), ((SHOWN,), {}, "assumed", "assumed"),
    ((SHOWN, ONE_BAD_PLACE), MOVED, "assumed", "assumed"),
    ((SHOWN, sample()), MOVED, "assumed", "assumed"),       # of one sample no place is known
    ((SHOWN, sample(known=True)), MOVED, "measured", "measured"),
    ((sample(place(0.011, 0.05)),), MOVED, "measured", "assumed"),
    ((sample(place(0.02, 0.03)),), MOVED, "assumed", "measured")])
def test_a_moved_lamp_measures_what_it_would_show_of_every_sample_in_every_place(
        surfaces, of_stated, gloss, level):
    made = conditions.flat_conditions(flat(surfaces=surfaces, **of_stated))
    assert known(made, "gloss")[0] == gloss
    assert known(made, "plane")[0] == known(made, "shadow")[0] == level


def test_a_card_beside_the_samples_measures_their_plane_as_well_as_it_is_known():
    for errors, standing in ((CARD_OF_INSTRUMENT, "measured"), (TYPED_CARD, "stated")):
        made = conditions.flat_conditions(flat((photo(["card"]),), known_errors=errors))
        assert known(made, "plane") == (standing, "known-beside")
        assert known(made, "shadow")[0] == "assumed"        # none of the card
    assert known(conditions.flat_conditions(flat()), "plane") == ("assumed", "no-photo")


@pytest.mark.parametrize("surfaces, all_stated, expected", [
    ({"a": Surface(surface="matt"), "b": Surface(surface="satin")}, True,
     ("stated", "surfaces-stated")),
    ({"a": Surface(surface="matt"), "b": Surface()}, False, ("assumed", "taken-as-matt")),
    ({}, False, ("assumed", "taken-as-matt"))])
def test_gloss_is_stated_where_it_is_of_every_surface(surfaces, all_stated, expected):
    result = flat(surfaces_stated=all_stated)
    result.stated.surfaces = surfaces
    assert known(conditions.flat_conditions(result), "gloss") == expected


def view(files):
    return SimpleNamespace(photo={"object": ["photo.dng"] * files})


@pytest.mark.parametrize("of_stated, processed, expected, ways", [
    ({}, False, ("assumed", "nothing"), []),
    ({"views": (view(1), view(1))}, False, ("assumed", "nothing"), []),
    ({"views": (view(1), view(3))}, False, ("measured", "exponent"), ["exposures"]),
    ({"dark_frames": True}, False, ("measured", "exponent"), ["dark-frames"]),
    ({"dark_frames": True, "views": (view(2),)}, False, ("measured", "exponent"),
     ["exposures", "dark-frames"]),
    ({"dark_frames": True}, True, ("assumed", "tone-curve"), ["dark-frames"])])
def test_linearity_is_measured_by_exposures_or_dark_frames_of_photos_that_nobody_developed(
        of_stated, processed, expected, ways):
    made = conditions.flat_conditions(flat(processed=processed, **of_stated))
    assert known(made, "linearity") == expected
    assert next(one for one in made if one.code == "condition.linearity").values["ways"] == ways


@pytest.mark.parametrize("curves, source, has_chart, expected", [
    (None, "", True, ("measured", "fitted")), (None, "", False, ("stated", "curves-of-file")),
    (1, "curves.csv", True, ("stated", "curves")), (1, "curves.csv", False, ("stated", "curves"))])
def test_a_camera_is_measured_where_a_chart_was_fitted(curves, source, has_chart, expected,
                                                       monkeypatch):
    monkeypatch.setattr(conditions, "exponent_of_greys", lambda *_: None)
    result = flat(chart=SimpleNamespace(copy=None) if has_chart else None,
                  sensitivity=SimpleNamespace(curves=curves, source=source))
    assert known(conditions.flat_conditions(result), "camera") == expected


@pytest.mark.parametrize("measured, by_reference, expected", [
    (True, True, ("measured", "own-reflectances")), (False, True, ("stated", "reference")),
    (False, False, ("assumed", "published")), (None, False, ("assumed", "published"))])
def test_a_chart_is_known_by_its_own_reflectances_or_is_as_published(measured, by_reference,
                                                                     expected, monkeypatch):
    monkeypatch.setattr(conditions, "exponent_of_greys", lambda *_: None)
    result = flat(chart=SimpleNamespace(copy=None), chart_stated=by_reference)
    result.stated.chart = None if measured is None else SimpleNamespace(measured=measured)
    made = conditions.flat_conditions(result)
    assert known(made, "chart") == expected
    assert all(one.code != "condition.chart" for one in conditions.flat_conditions(flat()))


@pytest.mark.parametrize("of_scene, light, at", [
    ({}, ("measured", "chart-in-photo"), ("assumed", "as-stated")),
    ({"chart_in_photo": False}, ("assumed", "stated-errors"), ("assumed", "as-stated")),
    ({"known_light": 1}, ("measured", "known-materials"), ("measured", "known-materials")),
    ({"known_light": 1, "views": (None,), "chart_in_photo": False}, ("assumed", "stated-errors"),
     ("assumed", "as-stated")),
    ({"known_light": 1, "views": (1,)}, ("measured", "known-materials"),
     ("measured", "known-materials")),
    ({"scale_from_chart": False}, ("measured", "known-materials"),
     ("measured", "known-materials")),
    ({"level_error": 0.1}, ("measured", "expected-surfaces"), ("stated", "scene"))])
def test_the_light_of_a_scene_is_known_by_known_surfaces_in_every_photo_or_by_a_chart(
        of_scene, light, at):
    made = conditions.scene_conditions(scene(**of_scene))
    assert known(made, "scene-light") == light and known(made, "light-place") == at


def test_geometry_is_measured_where_it_was_estimated():
    assert known(conditions.scene_conditions(scene()), "geometry") == ("stated", "scene")
    made = conditions.scene_conditions(scene(placements=(SimpleNamespace(what="camera"),)))
    assert known(made, "geometry") == ("measured", "estimated")
    assert next(one for one in made if one.code == "condition.geometry").values["names"] == [
        "camera"]


@pytest.mark.parametrize("standing, known_by, lightness, b_star, named", [
    ("assumed", "no-photo", 1.0, None, True), ("assumed", "no-photo", -1.0, None, True),
    ("assumed", "no-photo", 0.5, -1.2, True), ("assumed", "no-photo", 0.9, None, False),
    ("assumed", "no-photo", None, None, False), ("measured", "fitted", 5.0, None, False),
    ("stated", "reference", 5.0, None, False), ("stated", conditions.TYPED, 5.0, None, True)])
def test_a_verdict_names_what_is_assumed_or_typed_and_would_be_seen(standing, known_by, lightness,
                                                                    b_star, named):
    one = conditions.condition("condition.light", standing, known_by, lightness=lightness,
                               b_star=b_star)
    assert one.values["named"] == named
    assert conditions.named([one]) == ((one,) if named else ())


# ---- what they cost

def test_an_error_allowed_is_the_largest_of_surfaces_and_their_causes_add_as_squares():
    budget = {error_model.WHITE: np.array([0.03, 0.03, np.nan]),
              error_model.LIGHT_FIELD: np.array([0.04, 0.0, np.nan]),
              error_model.PHOTO_NOISE: np.full(3, 9.0)}
    one, worse = sample(budget=budget), sample(budget={error_model.WHITE: np.full(3, 0.05)})
    causes = (error_model.WHITE, error_model.LIGHT_FIELD)
    # of the bands that show it: the root of the mean of .05 and .03 squared
    assert conditions.error_by(one, causes) == pytest.approx(np.sqrt((0.05**2 + 0.03**2) / 2))
    for order in ((one, worse), (worse, one)):
        assert conditions.allowed_error(order, causes) == pytest.approx(0.05)
    assert conditions.allowed_error([one], (error_model.LIGHT,)) is None
    unseen = sample(budget={error_model.WHITE: np.full(3, np.nan)})
    assert conditions.error_by(unseen, causes) is None


def test_a_share_of_variance_is_the_mean_over_surfaces_that_have_the_cause():
    one = sample(causes={error_model.WHITE: 0.2, error_model.LIGHT_FIELD: 0.1, "other": 0.7})
    two, none = sample(causes={error_model.WHITE: 0.1}), sample(causes={"other": 1.0})
    causes = (error_model.WHITE, error_model.LIGHT_FIELD)
    assert conditions.allowed_share([one, two, none], causes) == pytest.approx((0.3 + 0.1) / 2)
    assert conditions.allowed_share([none], causes) is None


def test_a_fault_costs_what_it_changes_of_the_estimated_surface_that_it_changes_most():
    dark, light, card = sample(level=0.1), sample(level=0.8), sample(level=0.9, known=True)
    for surfaces in ([dark, light, card], [light, card, dark]):
        assert conditions.darker_by(surfaces, 0.1) == pytest.approx(
            reflectance_to_lab(NM, 0.9 * light.mean)[0] - reflectance_to_lab(NM, light.mean)[0])
        # what is added to all changes the dark most
        assert conditions.largest_change(surfaces, lambda nm, mean: mean + 0.03) == pytest.approx(
            reflectance_to_lab(NM, dark.mean + 0.03)[0] - reflectance_to_lab(NM, dark.mean)[0])
    assert conditions.darker_by([card], 0.1) is None
    assert conditions.darker_by([light], 2.0) == pytest.approx(-light.lab().value[0])


@pytest.mark.parametrize("order", [1, -1])
def test_the_error_of_the_light_of_a_scene_is_that_of_the_photo_that_knows_it_least(order):
    repeats, others = error_model.REPEATABILITY, error_model.LAMP_AT_CHART
    scales = [scale(**{repeats: 0.03, error_model.KNOWN_SURFACES: 0.04, others: 0.2}),
              scale(**{repeats: 0.02})][::order]
    made = conditions.scene_conditions(scene(views=(None,), scales=scales))
    errors = {one.code: one.values["error"] for one in made}
    assert errors["condition.scene-light"] == pytest.approx(0.05)
    assert errors["condition.light-place"] == pytest.approx(0.2)


def test_what_surfaces_mirror_errs_as_the_one_of_which_it_is_known_least():
    def of(error, level, signal=None):
        one = sample(level=level, budget={error_model.SURFACE_REFLECTION: np.full(3, error)})
        if signal is not None:
            one.signal = np.array(signal)
            shown = np.isfinite(one.signal)
            one.error_budget[error_model.SURFACE_REFLECTION] = np.full(shown.sum(), error)
        return one
    surfaces = [of(0.02, 0.9), of(0.1, 0.3, [0.1, np.nan, 0.3]), of(0.1, 0.2)]
    made = conditions.flat_conditions(flat(surfaces=surfaces))
    one = next(each for each in made if each.code == "condition.gloss")
    assert one.values["error"] == pytest.approx(0.03)      # of white, in its brightest band
