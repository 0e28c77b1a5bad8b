"""Edges inside regions: hard ones are named, even surfaces and textures are not."""
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from flat_example import PAINTS, picture, rect_of, write_spectra

import spectrabox as sb
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.measure import rules, texts
from spectrabox.measure.steps.photos import uneven_region
from spectrabox.radiometry.records.photos import EdgeKind
from spectrabox.session.page.pointed_answers import described

from benchmarks.bench_region_edges import TEXTURES, edge_of, region


@pytest.mark.parametrize("texture", TEXTURES)
def test_even_regions_and_textures_hold_no_edge(texture):
    rng = np.random.default_rng(41)
    named = sum(edge_of(*region(rng, texture)) is not None for _ in range(200))
    assert named <= 2       # of 200: 1 in 100


@pytest.mark.parametrize("texture", TEXTURES)
@pytest.mark.parametrize("bands", [1, 3])
def test_a_hard_edge_of_a_tenth_is_named_a_shadow_in_nine_of_ten(texture, bands):
    rng = np.random.default_rng(42)
    found = [edge_of(*region(rng, texture, bands * [rng.choice([0.9, 1 / 0.9])], bands))
             for _ in range(60)]
    named = [edge.kind for edge in found if edge is not None]
    assert len(named) >= 54
    wanted = EdgeKind.ONE_BAND if bands == 1 else EdgeKind.SHADOW
    assert named.count(wanted) >= 0.9 * len(named)


@pytest.mark.parametrize("texture", TEXTURES)
def test_two_paints_step_by_different_ratios(texture):
    rng = np.random.default_rng(43)
    found = [edge_of(*region(rng, texture, rng.permutation([1.0, 0.9, 0.75]))) for _ in range(60)]
    named = [edge.kind for edge in found if edge is not None]
    assert len(named) >= 54
    assert named.count(EdgeKind.PAINTS) >= 0.9 * len(named)


def test_the_line_and_its_larger_part_lie_where_the_edge_does():
    x = np.mgrid[:80, :100][1]
    signal = np.where(x[..., None] < 69.5, 0.5, 0.4) * np.ones(3)
    rng = np.random.default_rng(4)
    edge = edge_of(signal + 0.002 * rng.standard_normal(signal.shape), np.full(3, 4e-6))
    np.testing.assert_allclose(edge.step, -0.2, atol=0.005)     # the smaller part is darker
    # column 69.5 of the picture lies at 70 x 2 - 0.5 of the sensor; a cell is 5 pixels
    np.testing.assert_allclose(edge.line_px[:, 0], 139.5, atol=2)
    np.testing.assert_allclose(sorted(edge.line_px[:, 1]), [-0.5, 159.5], atol=11)
    x0, y0, x1, y1 = edge.larger_part_px
    assert (x0, y0, y1) == (0, 0, 159) and 120 <= x1 < 139


def test_a_shadow_across_a_region_is_said_by_the_surface_and_the_verdict(tmp_path):
    write_spectra(tmp_path / "spectra")
    light = picture()
    left, top, right, bottom = rect_of("cube")
    middle = (left + right) // 2
    x, y = np.meshgrid(np.arange(light.shape[1]), np.arange(light.shape[0]))
    shadow = (x > middle) & (x < right + 20) & (y > top - 20) & (y < bottom + 20)
    write_photo(tmp_path / "sample.dng", light * np.where(shadow, 0.85, 1.0)[..., None],
                Fraction(1, 60), np.random.default_rng(3))
    found = sb.flat(tmp_path / "sample.dng", regions={name: rect_of(name) for name in PAINTS},
                    light=tmp_path / "spectra" / "light.csv")
    edges = {region["name"]: region.get("edge") for region in found.facts()["regions"]}
    facts = edges.pop("cube")
    assert facts["kind"] == "shadow or fold"
    # a dark paint in 24 x 24 pixels of a small photo: noise of a cell is 2 to 4 %
    np.testing.assert_allclose(np.abs(facts["step"]), 0.15, atol=0.06)
    np.testing.assert_allclose(np.mean(facts["line_px"], axis=0)[0], middle, atol=4)
    assert not any(edges.values())
    assert found.verdict == "warn"
    found, = (one for one in found.facts()["findings"] if one["code"] == "flat.edge")
    assert (found["subject"], found["values"]["kind"]) == ("cube", "SHADOW")
    assert found["values"]["larger_part_px"] == facts["larger_part_px"]


def test_the_page_says_an_edge_in_place_of_unevenness():
    rng = np.random.default_rng(5)
    edge = edge_of(*region(rng, "grain", 3 * [0.8]))
    for edges, expected in (({"wall": edge}, rules.edge_in("wall", edge)),
                            ({}, uneven_region("wall", 0.3))):
        samples = SimpleNamespace(names=("wall",), scatter=np.array([[0.1, 0.3]]), edges=edges)
        white = SimpleNamespace(samples=samples, log_field=np.zeros(1), field_error=np.ones(1))
        told = described([white], np.zeros(3), np.ones(3), np.zeros((2, 3)), {}, {})
        note, = told["notes"]
        assert note == texts.says(expected)
