"""Edges inside regions: hard ones are named, even surfaces and textures are not.

The regions are simulated apart from how edges are looked for: a near lamp, pixels of one surface
with texture (grain, weave, blotches) and the noise of photons, and a line across that is as sharp
as a lens is.
"""
from fractions import Fraction

import numpy as np
import pytest
from flat_example import PAINTS, picture, rect_of, write_spectra
from scipy.ndimage import gaussian_filter

import spectrabox as sb
from spectrabox.capture.photo.region_edges import region_edge
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.radiometry.records.photos import EdgeKind

STEP_PX = 2.0       # of the sensor, a side of one pixel


def grain(rng, shape, blur):
    """A texture (h, w) of rms 1, of one pixel or blurred over several."""
    pad = int(4 * blur) + 1
    noise = rng.standard_normal((shape[0] + 2 * pad, shape[1] + 2 * pad))
    smooth = (gaussian_filter(noise, blur) if blur else noise)[pad:-pad, pad:-pad]
    return smooth / smooth.std()


def canvas(rng, x, y):
    """A weave of threads of two to nine pixels that wander a little, of rms 1."""
    turn, pitch = rng.uniform(0, 0.3), rng.uniform(2.2, 9.0)
    wander = 0.3 * grain(rng, x.shape, 2.0)
    along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    return sum(np.sin(2 * np.pi * axis / pitch + rng.uniform(0, 6) + wander)
               for axis in (along, across))


TEXTURES = {
    "even": lambda rng, x, y: np.zeros(x.shape),
    "grain": lambda rng, x, y: rng.uniform(0.01, 0.04) * grain(rng, x.shape, 0),
    "coarse grain": lambda rng, x, y: rng.uniform(0.005, 0.02) * grain(rng, x.shape,
                                                                       rng.uniform(0.5, 2)),
    "canvas": lambda rng, x, y: rng.uniform(0.01, 0.05) * canvas(rng, x, y),
    "blotches": lambda rng, x, y: rng.uniform(0.003, 0.01) * grain(
        rng, x.shape, rng.uniform(0.05, 0.15) * max(x.shape))}


def region(rng, texture, step=None, bands=3):
    """Signal (h, w, K) of one region and its pixels' variance (K,); across a line in its middle
    three fifths the bands step by factors (K,).
    """
    long = int(np.exp(rng.uniform(np.log(36), np.log(160))))
    height, width = rng.permutation([long, int(long / rng.uniform(1, 2))])
    y, x = np.mgrid[:height, :width].astype(float)
    distance, (lamp_x, lamp_y) = rng.uniform(0.8, 4) * long, rng.uniform(-1, 2, 2) * long
    light = (1 + ((x - lamp_x) ** 2 + (y - lamp_y) ** 2) / distance**2) ** -1.5
    surface = np.exp(TEXTURES[texture](rng, x, y))
    signal = ((light / light.mean() * surface)[..., None]
              * np.exp(rng.uniform(np.log(0.05), np.log(0.9), bands)))
    if step is not None:
        share = 0.0
        while not 0.2 < share < 0.8:
            angle = rng.uniform(0, np.pi)
            along = x * np.cos(angle) + y * np.sin(angle)
            beyond = along - rng.uniform(along.min(), along.max())
            share = np.mean(beyond > 0)
        signal *= np.asarray(step) ** np.clip(beyond / rng.uniform(0.5, 2) + 0.5, 0, 1)[..., None]
    electrons = np.exp(rng.uniform(np.log(4e3), np.log(4e4)))
    variance = signal.mean(axis=(0, 1)) / electrons + 1e-7
    return rng.normal(signal, np.sqrt(signal / electrons + 1e-7)), variance


def edge_of(signal, variance):
    y, x = np.mgrid[:signal.shape[0], :signal.shape[1]]
    return region_edge(signal.reshape(-1, signal.shape[2]), variance, x.ravel(), y.ravel(),
                       STEP_PX)


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
    assert any("“cube”: an edge runs across it" in reason and "shadow's edge or a fold" in reason
               and "outline its larger part, rect [" in reason for reason in found.reasons)
