"""Families of reflectances made by physics: laws of their models, and published values."""
from __future__ import annotations

import numpy as np
import pytest

from spectrabox.sampling.prior.families import layered, leaves, made_materials
from spectrabox.sampling.prior.families.family_models import true_reflectances
from spectrabox.sampling.prior.families.layered import (
    absorption_of,
    behind_surface,
    reflectance_of,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior, of_families

FAMILIES = {
    made.__name__: made
    for made in (layered.skin, layered.skin_in_two_fluxes, layered.skin_by_absorbance,
                 leaves.leaves, leaves.petals, leaves.green_tissue, leaves.petal_tissue,
                 made_materials.textile, made_materials.plastic, made_materials.paper,
                 made_materials.whites, made_materials.tiles, layered.soils, layered.woods,
                 layered.animals)
}


@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_gives_reflectances_and_the_same_ones_for_the_same_seed(name):
    made = FAMILIES[name](np.random.default_rng(3), 400)
    assert made.shape == (400, PRIOR_GRID.nm.size)
    assert np.all((made > 0) & (made < 1))
    np.testing.assert_array_equal(made, FAMILIES[name](np.random.default_rng(3), 400))


def test_a_layer_of_kubelka_and_munk_is_its_own_inverse():
    inside = np.linspace(0.01, 0.99, 50)
    # the square root of K / S near R = 1 loses half the digits: sqrt(eps) would be the bound, 1e-10
    # holds from R = 0.99 down
    np.testing.assert_allclose(reflectance_of(absorption_of(inside)), inside, rtol=1e-10)


def test_a_white_body_behind_a_surface_stays_white():
    one = np.ones(3)
    # round-off of a quotient of numbers of order 1
    np.testing.assert_allclose(behind_surface(one, 0.04 * one, 0.6 * one), 1, rtol=1e-14)


def test_the_surface_transmits_what_fresnel_says_head_on():
    index = np.array([1.3, 1.5])
    # a cone of 0.1 degrees differs from none by its square in radians, 3e-6
    np.testing.assert_allclose(leaves.surface_transmission(index, 0.1), 4 * index / (index + 1)**2,
                               rtol=3e-6)


def test_a_leaf_without_pigment_reflects_or_transmits_all_light():
    index = np.full(PRIOR_GRID.nm.size, 1.45)
    r, t = leaves.leaf(np.array([[1.0], [1.7], [3.0]]), np.zeros((3, PRIOR_GRID.nm.size)), index)
    # absorption is floored at 1e-6 a plate, met a few times over by light that is caught inside
    np.testing.assert_allclose(r + t, 1, atol=5e-5)


def test_a_leaf_is_that_of_prospect_d():
    # prosail 2.0.5, run_prospect(1.8, 40, 8, 0, 0, 0.008, ant=3) at 400, 450 ... 700 nm; without
    # water, as here.
    expected = [0.04320755, 0.04159364, 0.05258007, 0.12861554, 0.08946332, 0.05217754, 0.15214131]
    _, index, green, yellow, red, dry = np.loadtxt(leaves.COEFFICIENTS, delimiter=",", skiprows=5).T
    r, t = leaves.leaf(np.array([[1.8]]), (40 * green + 8 * yellow + 3 * red + 0.008 * dry)[None],
                       index)
    # eight decimals were printed
    np.testing.assert_allclose(r[0, ::10], expected, atol=1e-8)
    assert np.all(r + t < 1)


def test_a_thick_layer_hides_its_ground_and_a_thin_one_is_its_ground():
    absorption = np.array([[0.001, 0.1, 1.0, 30.0]])
    # coth of 1000 times b = 0.045 or more differs from 1 by exp(-89)
    thick = leaves.layer(absorption, np.array([[1000.0]]), np.array([[0.7]]))
    np.testing.assert_allclose(thick, reflectance_of(absorption), rtol=1e-12)
    # to first order a layer of S X = 1e-6 absorbs and scatters a few 1e-6 of what passes, times
    # K / S of 30
    thin = leaves.layer(absorption, np.array([[1e-6]]), np.array([[0.7]]))
    np.testing.assert_allclose(thin, 0.7, atol=1e-4)


def test_a_layer_that_does_not_absorb_reflects_or_transmits_all_light():
    # Kubelka 1948: R = S X / (1 + S X) on black, in the limit of no absorption; sqrt(2e-12) times
    # S X = 10 enters squared, as 1e-10
    thickness = np.array([[0.1], [1.0], [10.0]])
    made = leaves.layer(np.full((3, 2), 1e-12), thickness, np.zeros((3, 1)))
    np.testing.assert_allclose(made, thickness / (1 + thickness) * np.ones(2), rtol=1e-8)


def test_pigments_of_plants_absorb_where_they_are_known_to():
    rng = np.random.default_rng(3)
    peak = {name: PRIOR_GRID.nm[make(rng, 500).argmax(axis=1)] for name, make in (
        ("chlorophyll", leaves.chlorophyll), ("carotenoids", leaves.carotenoids),
        ("anthocyanins", leaves.anthocyanins))}
    # the red band of a is up to 0.95 of the blue one; with that of b it may be the highest
    blue = (peak["chlorophyll"] >= 425) & (peak["chlorophyll"] <= 475)
    assert blue.mean() > 0.9 and np.all(peak["chlorophyll"][~blue] >= 640)
    assert np.all((peak["carotenoids"] >= 415) & (peak["carotenoids"] <= 515))
    # complexes have their second band 0.12 to 0.17 eV, some 40 nm, to the blue of the first
    assert np.ptp(peak["anthocyanins"]) > 100
    assert peak["anthocyanins"].min() >= 425 and peak["anthocyanins"].max() <= 605


@pytest.mark.parametrize("make", [layered.skin, layered.skin_in_two_fluxes,
                                  layered.skin_by_absorbance])
def test_skin_shows_the_two_bands_of_oxygenated_blood(make):
    made = np.log(make(np.random.default_rng(1), 2000))
    at = {nm: made[:, np.flatnonzero(PRIOR_GRID.nm == nm)[0]]
          for nm in (510, 540, 560, 575, 590, 600, 650)}
    oxygenated = at[560] - (at[540] + at[575]) / 2      # the hump between the bands
    assert np.mean(oxygenated > 0) > 0.8
    assert np.all(at[600] > at[575])


def test_dyes_add_as_absorption_does():
    few, many = (made_materials.dyes(np.random.default_rng(5), 500, strongest)
                 for strongest in (1, 10))
    assert np.all(few >= 0)
    # the same random numbers with a larger range are at least as strong
    assert np.all(many >= few - 1e-12)


def test_a_halftone_of_one_power_lies_between_its_overprints(monkeypatch):
    rng = np.random.default_rng(6)
    inks = tuple(np.exp(-((PRIOR_GRID.nm - nm) / 40)**2)[None] for nm in (620, 540, 440, 550))
    monkeypatch.setattr(made_materials, "_inks", lambda rng, count: inks)
    monkeypatch.setattr(made_materials, "DENSEST", ((1.0, 1.0),) * 4)
    made = made_materials.halftone(rng, 300)
    # paper where nothing is printed, all inks one above the other where everything is
    assert np.all(made <= 1 + 1e-12) and np.all(made >= np.exp(-sum(inks)) - 1e-12)
    # Without spread of light (n = 1) Neugebauer's shares factorise (Demichel): each ink lets
    # through what it does not cover, and what passes it.
    monkeypatch.setattr(layered, "uniform",
                        lambda rng, low, high, count: np.ones((count, 1)))
    monkeypatch.setattr(layered, "chance", lambda rng, used, count: np.ones((count, 1)))
    rng = np.random.default_rng(9)
    covered = [rng.beta(0.7, 0.9, (5, 1)) for _ in inks]
    expected = np.prod([1 - part + part * np.exp(-ink)
                        for part, ink in zip(covered, inks, strict=True)], axis=0)
    np.testing.assert_allclose(made_materials.halftone(np.random.default_rng(9), 5), expected,
                               rtol=1e-12)


def test_rutile_absorbs_violet_and_nothing_else():
    edge = made_materials.rutile_absorption(np.random.default_rng(2), 200)
    assert np.all(np.diff(edge, axis=1) <= 0)
    assert edge[:, 0].min() > 0.5
    # 0.2 eV below the gap at most exp(-0.2 / 0.06) = 4 % of 3 are left at 440 nm
    assert edge[:, PRIOR_GRID.nm >= 450].max() < 0.12


def test_mixtures_of_grey_pigments_are_smooth_and_of_a_red_one_red():
    red = np.where(PRIOR_GRID.nm < 590, 0.05, 0.8)
    made = made_materials.pigment_mixtures(np.random.default_rng(4), 300, red[None])
    assert np.all(made[:, -1] > made[:, 20])
    grey = made_materials.pigment_mixtures(np.random.default_rng(4), 300,
                                  np.full((2, PRIOR_GRID.nm.size), 0.3))
    # rutile is gone above 450 nm, and black changes by a sixth from there to 700 nm
    assert np.abs(np.diff(grey[:, PRIOR_GRID.nm > 450], axis=1)).max() < 0.01


def test_yellowing_makes_whites_fall_towards_the_blue():
    made = made_materials.whites(np.random.default_rng(6), 2000)
    assert np.mean(made[:, 5] <= made[:, 30]) > 0.8


def test_iron_makes_soils_rise_to_the_red():
    made = layered.soils(np.random.default_rng(7), 2000)
    assert np.mean(made[:, -1] > made[:, 0]) > 0.99


def test_truths_are_of_the_stated_families_and_unlike_the_mixture_fitted_to_them():
    rng = np.random.default_rng(2)
    stated = of_families(load_prior(), ["skin", "paint"])
    truths = true_reflectances(stated, 300, rng)
    assert truths.shape == (300, 61) and truths.min() > 0 and truths.max() < 1
    skins = true_reflectances(of_families(load_prior(), ["skin"]), 200, rng)
    # Skin of every colour is brighter at 650 nm than at 545, where blood absorbs; most paint is
    # not red. Of 300 truths, 10 parts in 60 are skin.
    at = [np.searchsorted(stated.nm, nm) for nm in (545, 650)]
    assert np.all(skins[:, at[1]] > 1.05 * skins[:, at[0]])
    assert 0.3 < np.mean(truths[:, at[1]] > 1.05 * truths[:, at[0]]) < 0.8
    np.testing.assert_array_equal(true_reflectances(stated, 5, np.random.default_rng(3)),
                                  true_reflectances(stated, 5, np.random.default_rng(3)))


def fixed(monkeypatch, module, name, limits, value):
    """A drawn number set to a value; every other is drawn as before."""
    drawn = getattr(module, name)

    def of(rng, low, high, count):
        found = drawn(rng, low, high, count)
        return np.full_like(found, value) if (low, high) == limits else found
    monkeypatch.setattr(module, name, of)


def test_blood_in_vessels_absorbs_less_than_the_same_blood_spread_out(monkeypatch):
    """Most where it absorbs most: what lies behind in a vessel gets no light."""
    found = []
    for radius_cm in (1e-9, 1e-3, 4e-3):
        with monkeypatch.context() as patched:
            fixed(patched, layered, "log_uniform", (5e-4, 4e-3), radius_cm)
            found.append(layered._layers(np.random.default_rng(3), 50)[1])
    spread, narrow, wide = found
    assert np.all(narrow < spread) and np.all(wide < narrow)
    violet, red = PRIOR_GRID.nm.tolist().index(420), PRIOR_GRID.nm.tolist().index(680)
    assert np.all(wide[:, violet] / spread[:, violet] < wide[:, red] / spread[:, red])


@pytest.mark.parametrize("n", [1.0, 2.0, 3.0])
def test_solid_ink_looks_the_same_however_far_light_spreads_in_paper(monkeypatch, n):
    """Yule and Nielsen: where all paper is covered there is nothing to spread to."""
    class AllCovered:
        def __init__(self):
            self.rng = np.random.default_rng(4)

        def beta(self, a, b, size):
            return np.ones(size)

        def __getattr__(self, name):
            return getattr(self.rng, name)

    monkeypatch.setattr(layered, "chance", lambda rng, probability, count:
                        np.ones((count, 1)))
    fixed(monkeypatch, layered, "uniform", (1, 3), 1.0)
    expected = made_materials.halftone(AllCovered(), 30)
    monkeypatch.undo()
    monkeypatch.setattr(layered, "chance", lambda rng, probability, count:
                        np.ones((count, 1)))
    fixed(monkeypatch, layered, "uniform", (1, 3), n)
    np.testing.assert_allclose(made_materials.halftone(AllCovered(), 30), expected, rtol=1e-9)
