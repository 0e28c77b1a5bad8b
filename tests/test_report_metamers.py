"""Two draws that one signal allows: one to the camera, two under other lights."""
import re

import numpy as np
import pytest
from report_example import example_session

from spectrabox.measure.surfaces.colour_comparison import (
    LIGHTS,
    apart_nm,
    metamer_pair,
    under_lights,
)
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.spectra import Outcome, SpectrumSamples
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.session.report.cards import metamer_drawing, metamer_facts
from spectrabox.session.report.numbers import scene_numbers
from spectrabox.session.report.page import render_report

GRID = visible_grid(5.0)


def samples_of(spectra):
    return SpectrumSamples(GRID, spectra, np.zeros((len(spectra), 5)), "test", float(len(spectra)),
                           1, Outcome.CONVERGED, ())


def spread_along(direction, count=400, seed=2):
    """Draws about a grey along one direction, with a little of everything else."""
    rng = np.random.default_rng(seed)
    return np.clip(0.5 + rng.normal(0, 1, (count, 1)) * direction
                   + rng.normal(0, 0.001, (count, GRID.nm.size)), 0, 1)


def metameric_direction(light):
    """A change of a spectrum that the eye does not see under a light."""
    response = relative_response("cie_2_1931", light, GRID)
    wave = np.sin(GRID.nm / 25.0)
    return 0.08 * (wave - np.linalg.pinv(response) @ (response @ wave))


def test_what_the_eye_cannot_tell_under_one_light_it_can_under_another():
    pair = metamer_pair(samples_of(spread_along(metameric_direction("D65"))))
    by_light = dict(zip(LIGHTS, under_lights(pair)[1], strict=True))
    assert by_light["D65"] < 0.5
    assert min(by_light[name] for name in LIGHTS[1:]) > 2 * by_light["D65"]
    assert by_light["LED-RGB1"] > 3


def test_the_pair_lies_at_the_ends_of_what_95_percent_of_the_draws_span():
    direction = metameric_direction("D65")
    spectra = spread_along(direction)
    pair = metamer_pair(samples_of(spectra))
    unit = direction / np.linalg.norm(direction)
    along = np.sort((spectra - 0.5) @ unit)
    ends = np.sort((pair.spectra - 0.5) @ unit)
    share = np.searchsorted(along, ends) / len(along)
    assert share == pytest.approx([0.025, 0.975], abs=0.01)
    assert any(np.array_equal(pair.spectra[0], one) for one in spectra)


def test_a_reading_is_advised_where_the_two_are_furthest_apart():
    bump = 0.1 * np.exp(-0.5 * ((GRID.nm - 610) / 8) ** 2)
    pair = metamer_pair(samples_of(spread_along(bump)))
    assert abs(apart_nm(pair) - 610) <= 5
    assert "610 nm" in metamer_drawing(pair) or "605 nm" in metamer_drawing(pair) \
        or "615 nm" in metamer_drawing(pair)


def test_page_and_numbers_say_the_same(tmp_path):
    results = example_session(tmp_path, materials=("white", "red", "green"))
    page, numbers = render_report(results)[0], scene_numbers(results.found)
    drawn = [one for one in results.found.surfaces if one.samples is not None]
    assert page.count('class="metamers"') == len(drawn) > 0
    facts = [one["metamers"] for one in numbers["materials"] if one["metamers"]]
    assert len(facts) == len(drawn)
    for fact, material in zip(facts, drawn, strict=True):
        wanted = metamer_facts(metamer_pair(material.samples))
        assert fact["delta_e00"] == wanted["delta_e00"]
        for difference in wanted["delta_e00"].values():
            assert re.search(f">{difference:.1f}</td>", page)
