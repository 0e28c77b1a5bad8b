"""The lamps that a photo may have been taken by, and what they and measured cameras say of
products, before any photo.

The lamps that a photo may have been taken by: published spectra, and others by formula.

Published are the illuminants and light sources of colour-science. By formula come

    daylight     CIE daylights of 4000 to 12000 K [CIE 15:2004, Eqs. 3.3, 3.4], blackbodies above,
                 and daylights of 5000 to 20000 K through more air (a low sun: Angstrom's law),
                 and by glass and surroundings off the CIE locus
    halogen      blackbodies of 2300 to 3700 K, bare and through tinted glass
    led          a blue or violet pump with one or two phosphors, three to five narrow bands, and
                 a phosphor lamp with an added red or cyan diode
    fluorescent  mixtures of two published lamps: other blends of the same phosphors

Discharge lamps of other kinds (metal halide, mercury, sodium) count as fluorescent. Lamps that
leave most of the spectrum dark, such as low-pressure sodium, are no lamps to take colours by, and
are left out.

What measured cameras and known lamps say of their products, before any photo.

The product of sensitivity and light is one curve a band. The prior is a kernel mixture: every pair
of a camera and a lamp is a component, and all have one covariance about them, a share of that of
all pairs [methods of density estimation: Silverman 1986, Ch. 4]. Cameras are draws from the camera
prior, which holds no measured curve.

One vector of a component holds the product (mass at each node over the whole band, K N), the
logarithm of each band's white signal less their mean (K), and the lamp by itself (N, of mean 1):
what the photo says of the first two moves the third with them.
"""


from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.published import published_tables
from spectrabox.radiometry.records.spectra import UnknownLight
from spectrabox.radiometry.shaped import Record
from spectrabox.radiometry.spectra.light_words import LIGHT_KINDS

OBSERVER = "CIE 1931 2 Degree Standard Observer"
KIND_SHARE = {"daylight": 0.30, "halogen": 0.20, "led": 0.35, "fluorescent": 0.15}
PUBLISHED_SHARE = 0.5       # of a kind's probability, where it has published lamps
DAYLIGHT = ("B", "C", "D50", "D55", "D60", "D65", "D75", "E", "ID50", "ID65", "SC", "Kinoton 75P",
            "ISO 7589 Photographic Daylight", "ISO 7589 Sensitometric Daylight")
HALOGEN = ("A", "SA", "Incandescent", "Neodimium Incandescent", "60 A/W (Soft White)")
LED_WORDS = ("LED", "PHOS", "Luxeon")
DARK_SHARE = 0.05           # of the largest value
MIN_BRIGHT = 0.45           # of the wavelengths above it, to take colours by
BY_FORMULA = " by formula"  # ends the names of lamps that are not published
SEED = 20                   # of the formulas' parameters
DAYLIGHTS, HOT_BODIES, SKIES, FILAMENTS, TINTED = 30, 10, 60, 20, 20
PHOSPHORS, HYBRIDS, NARROW, BLENDS = 120, 40, 60, 80
CCT_MIRED_SD = 12.0         # of a stated temperature: labels are nominal
SECOND_RADIATION = 1.4388e7         # nm K


@dataclass(frozen=True, eq=False)
class Lamps(Record):
    """Spectra of L lamps of mean 1, every nm from 400 to 700 nm, and how probable each is."""

    spectra: Annotated[np.ndarray, "L P"]
    kind: Annotated[np.ndarray, "L"]                # index into LIGHT_KINDS
    weights: Annotated[np.ndarray, "L"]
    names: tuple[str, ...]


def lamps_like(light: UnknownLight, mired_sd: float = CCT_MIRED_SD) -> Lamps:
    """Lamps that a light may be, given its kind and colour temperature where they are known.

    Parameters
    ----------
    light : UnknownLight
    mired_sd : float
        By which the temperature may be off, in mired.
    """
    lamps = all_lamps()
    weights = lamps.weights * likeness(lamps, light, mired_sd)
    kept = np.flatnonzero(weights > 1e-3 * weights.max())
    return Lamps(lamps.spectra[kept], lamps.kind[kept], weights[kept] / weights[kept].sum(),
                 tuple(lamps.names[index] for index in kept))


def likeness(lamps: Lamps, light: UnknownLight, mired_sd: float = CCT_MIRED_SD) -> np.ndarray:
    """How well each lamp (L,) is what is stated of a light, 0 to 1.

    Parameters
    ----------
    lamps : Lamps
    light : UnknownLight
    mired_sd : float
        By which the temperature may be off, in mired.
    """
    like = np.ones(len(lamps.names))
    if light.kind is not None:
        like[lamps.kind != LIGHT_KINDS.index(light.kind)] = 0
    if light.cct is not None:
        away = np.abs(1e6 / colour_temperatures(lamps.spectra) - 1e6 / light.cct)
        like = like * np.exp(-0.5 * ((away - away.min()) / mired_sd) ** 2)
    return like


def nominal_kind(source: str) -> str | None:
    """Kind of lamp that a CIE daylight or CIE A stands for; None of any other light.

    Parameters
    ----------
    source : str
        Of the spectrum: "CIE D65" names a published one.
    """
    if re.fullmatch(r"CIE I?D\d\d", source):
        return "daylight"
    return "halogen" if source == "CIE A" else None


def all_lamps() -> Lamps:
    """Every lamp, published and by formula."""
    published = _published()
    rng = np.random.default_rng(SEED)
    # filaments behind glass: a straight line in wavelength, on the logarithm
    slope = rng.uniform(-0.5, 0.5, TINTED)[:, None]
    tinted = blackbodies(rng.uniform(2500, 3400, TINTED)) \
        * np.exp(slope * (FINE_GRID.nm - 550) / 150)
    leds = np.vstack([_phosphor_leds(rng), _hybrids(rng), _narrow_bands(rng)])
    tubes = np.array([spectrum for kind, _, spectrum in published if kind == "fluorescent"])
    first, second = (tubes[rng.integers(len(tubes), size=BLENDS)] for _ in range(2))
    share = rng.uniform(0, 1, BLENDS)[:, None]
    computed = {"daylight": np.vstack([daylights(np.linspace(4000, 12000, DAYLIGHTS)),
                                       blackbodies(np.linspace(4000, 7500, HOT_BODIES)),
                                       _skies(np.random.default_rng([SEED, 1]))]),
                "halogen": np.vstack([blackbodies(np.linspace(2300, 3700, FILAMENTS)), tinted]),
                "led": leds,
                "fluorescent": share * first + (1 - share) * second}
    spectra, kinds, names, weights = [], [], [], []
    for kind, probability in KIND_SHARE.items():
        ours = [(name, spectrum) for other, name, spectrum in published if other == kind]
        rows = [spectrum for _, spectrum in ours] + list(computed[kind])
        spectra += rows
        names += [name for name, _ in ours] + [kind + BY_FORMULA] * len(computed[kind])
        kinds += [LIGHT_KINDS.index(kind)] * len(rows)
        weights += [probability * PUBLISHED_SHARE / len(ours)] * len(ours)
        weights += [probability * (1 - PUBLISHED_SHARE) / len(computed[kind])] * len(computed[kind])
    whole = np.array(spectra)
    return Lamps(whole / whole.mean(axis=1, keepdims=True), np.array(kinds), np.array(weights),
                 tuple(names))


def colour_temperatures(spectra: np.ndarray) -> np.ndarray:
    """Correlated colour temperatures (L,), K, by McCamy's formula; 1500 to 25000 K.

    Parameters
    ----------
    spectra : (L, P) array
        Every nm from 400 to 700 nm.
    """
    nm, matching = published_tables.published_curves(published_tables.OBSERVERS, OBSERVER)
    observer = np.array([np.interp(FINE_GRID.nm, nm, curve) for curve in matching])
    xyz = spectra @ observer.T
    x, y = (xyz[:, :2] / xyz.sum(axis=1, keepdims=True)).T
    n = (x - 0.3320) / (0.1858 - y)
    return np.clip(449 * n**3 + 3525 * n**2 + 6823.3 * n + 5520.33, 1500, 25000)


def blackbodies(kelvin: np.ndarray) -> np.ndarray:
    """Planck's spectra (n, P) of mean 1.

    Parameters
    ----------
    kelvin : (n,) array
    """
    nm = FINE_GRID.nm
    spectra = nm**-5.0 / np.expm1(SECOND_RADIATION / (nm * np.asarray(kelvin)[:, None]))
    return np.asarray(spectra / spectra.mean(axis=1, keepdims=True))


def daylights(kelvin: np.ndarray) -> np.ndarray:
    """CIE daylights (n, P) of mean 1; their three components follow from the published D50, D55
    and D75.

    Parameters
    ----------
    kelvin : (n,) array
        4000 to 25000 K.
    """
    named = {5003.0: "D50", 5503.0: "D55", 7504.0: "D75"}
    published = np.array([
        np.interp(FINE_GRID.nm, nm, curves[0])
        for nm, curves in (published_tables.published_curves(published_tables.LIGHTS, name)
                           for name in named.values())
    ])
    at_560 = published[:, np.searchsorted(FINE_GRID.nm, 560)]
    known = np.array([_daylight_terms(cct) for cct in named])
    components = np.linalg.solve(known, published / at_560[:, None])
    spectra = np.array([_daylight_terms(cct) for cct in kelvin]) @ components
    return np.asarray(spectra / spectra.mean(axis=1, keepdims=True))


def _daylight_terms(cct: float) -> np.ndarray:
    """1, M1 and M2 of CIE 15:2004, Eqs. 3.3 and 3.4."""
    a = (0.244063, 0.09911e3, 2.9678e6, -4.6070e9) if cct <= 7000 else (
        0.237040, 0.24748e3, 1.9018e6, -2.0064e9)
    x = sum(value / cct**power for power, value in enumerate(a))
    y = -3 * x**2 + 2.87 * x - 0.275
    below = 0.0241 + 0.2562 * x - 0.7341 * y
    return np.array([1.0, (-1.3515 - 1.7703 * x + 5.9114 * y) / below,
                     (0.0300 - 31.4424 * x + 30.0717 * y) / below])


def _published() -> list[tuple[str, str, np.ndarray]]:
    """Kind, name and spectrum of every published lamp that lights the range."""
    lamps = []
    for name, (nm, curves) in published_tables.all_published(published_tables.LIGHTS).items():
        spectrum = np.maximum(np.interp(FINE_GRID.nm, nm, curves[0]), 0)
        covered = nm[0] <= 405 and nm[-1] >= 690
        if not covered or np.mean(spectrum > DARK_SHARE * spectrum.max()) <= MIN_BRIGHT:
            continue
        kind = ("daylight" if name in DAYLIGHT
                else "halogen" if name in HALOGEN or name.startswith("ISO 7589")
                else "led" if any(word in name for word in LED_WORDS) else "fluorescent")
        lamps.append((kind, name, spectrum / spectrum.mean()))
    return lamps


def _bump(peak: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Gaussians (n, P)."""
    return np.asarray(np.exp(-0.5 * ((FINE_GRID.nm - peak[:, None]) / sd[:, None]) ** 2))


def _skies(rng: np.random.Generator) -> np.ndarray:
    """Daylights through more air, by its optical depth at 550 nm, and tinted by what stands near:
    a straight line and a bow in wavelength, on the logarithm.
    """
    depth, power = rng.exponential(0.25, SKIES)[:, None], rng.uniform(1.0, 4.0, SKIES)[:, None]
    along = (FINE_GRID.nm - 550) / 150
    slope, bow = 0.08 * rng.standard_normal((2, SKIES, 1))
    return daylights(1e6 / rng.uniform(50, 200, SKIES)) * np.exp(
        -depth * (550 / FINE_GRID.nm) ** power + slope * along + bow * along**2)


def _phosphor_leds(rng: np.random.Generator, count: int = PHOSPHORS) -> np.ndarray:
    def uniform(low: float, high: float) -> np.ndarray:
        return rng.uniform(low, high, count)
    violet = rng.random(count) < 0.1
    pump = uniform(0.15, 1.8)[:, None] * _bump(
        np.where(violet, uniform(405, 425), uniform(440, 465)), uniform(7, 13))
    for_plants = rng.random(count) < 0.05
    broad = uniform(0.6, 1.0)[:, None] * _bump(
        np.where(for_plants, uniform(600, 660), uniform(525, 590)), uniform(38, 62))
    red = (uniform(0, 1.2) * (rng.random(count) < 0.7))[:, None] * _bump(uniform(600, 660),
                                                                        uniform(25, 55))
    blue = (0.6 * uniform(0.5, 1) * violet)[:, None] * _bump(uniform(450, 470), uniform(15, 30))
    return pump + broad + red + blue


def _hybrids(rng: np.random.Generator) -> np.ndarray:
    """A phosphor lamp with a red or cyan diode."""
    peak = np.where(rng.random(HYBRIDS) < 0.7, rng.uniform(615, 665, HYBRIDS),
                    rng.uniform(470, 505, HYBRIDS))
    return _phosphor_leds(rng, HYBRIDS) + rng.uniform(0.4, 2.0, HYBRIDS)[:, None] * _bump(
        peak, rng.uniform(7, 13, HYBRIDS))


def _narrow_bands(rng: np.random.Generator) -> np.ndarray:
    """Blue, green and red diodes, of half of them amber and cyan ones besides."""
    spectra = np.full((NARROW, FINE_GRID.nm.size), 0.002)
    for low, high, sd, share in ((440, 475, 9, 1.0), (510, 560, 14, 1.0), (605, 645, 8, 1.0),
                                 (580, 600, 8, 0.5), (480, 505, 11, 0.25)):
        there = rng.random(NARROW) < share
        spectra += (there * rng.uniform(0.4, 1.6, NARROW))[:, None] * _bump(
            rng.uniform(low, high, NARROW), sd * rng.uniform(0.8, 1.5, NARROW))
    return spectra


# ---- what measured cameras and known lamps say of their products, before any photo ---------------

CAMERAS = 400               # draws of the camera prior
COMPONENTS = 6600
LEAST_CURVE = 1e-4          # of the largest: below it a drawn curve is round-off of its floor


@dataclass(frozen=True, eq=False)
class ProductPrior(Record):
    """C components of X = K N + K + N entries, and the covariance of them all."""

    nm: Annotated[np.ndarray, "N"]                  # nodes
    bands: int
    components: Annotated[np.ndarray, "C X"]
    covariance: Annotated[np.ndarray, "X X"]
    weights: Annotated[np.ndarray, "C"]
    lamp: Annotated[np.ndarray, "C"]                # index into the lamps
    lamps: Lamps

    @property
    def products(self) -> slice:
        """Where a component's products lie."""
        return slice(0, self.bands * self.nm.size)

    @property
    def balance(self) -> slice:
        """Where its white balance lies."""
        return slice(self.bands * self.nm.size, self.bands * (self.nm.size + 1))

    @property
    def light(self) -> slice:
        """Where its lamp lies."""
        return slice(self.bands * (self.nm.size + 1), self.components.shape[1])


def product_prior(cameras: CameraPrior, lamps: Lamps, seed: int,
                  components: int = COMPONENTS) -> ProductPrior:
    """Prior on products of the cameras of a prior and some lamps.

    Parameters
    ----------
    cameras : CameraPrior
    lamps : Lamps
    seed : int
        Of the draws of cameras and of the pairs.
    components : int
        About how many pairs; every lamp has the same number of cameras.
    """
    rng = np.random.default_rng(seed)
    drawn = draw_cameras(cameras, CAMERAS, rng)
    each = max(components // len(lamps.names), 1)
    camera = np.concatenate([rng.permutation(len(drawn))[:each] for _ in lamps.names])
    lamp = np.repeat(np.arange(len(lamps.names)), min(each, len(drawn)))
    return paired(cameras.nm, drawn[camera], lamp, lamps)


def paired(nm: np.ndarray, curves: np.ndarray, lamp: np.ndarray, lamps: Lamps) -> ProductPrior:
    """Prior of given pairs of curves (C, K, N) at nodes and lamps, by index (C,).

    Parameters
    ----------
    nm : (N,) array
        Nodes.
    curves : (C, K, N) array
    lamp : (C,) int array
        Index into the lamps.
    lamps : Lamps
    """
    basis = interpolation_matrix(nm, FINE_GRID.nm)
    mass = FINE_GRID.weights_nm @ basis                  # of each node, nm
    at_nodes = (lamps.spectra * FINE_GRID.weights_nm) @ basis / mass
    product = curves * at_nodes[lamp][:, None] * mass
    white = product.sum(axis=2)
    balance = np.log(white) - np.log(white).mean(axis=1, keepdims=True)
    count = len(curves)
    components = np.hstack([(product / white[..., None]).reshape(count, -1), balance,
                            at_nodes[lamp]])
    weights = lamps.weights[lamp] / np.bincount(lamp, minlength=len(lamps.names))[lamp]
    weights = weights / weights.sum()
    away = components - weights @ components
    return ProductPrior(nm, curves.shape[1], components, (away * weights[:, None]).T @ away,
                        weights, lamp, lamps)


def draw_cameras(prior: CameraPrior, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Curves (T, K, N) of cameras as the prior expects them, as wide as it says that it may err.

    Parameters
    ----------
    prior : CameraPrior
    draws : int
    rng : numpy.random.Generator
    """
    roots = [np.linalg.cholesky(covariance) for covariance in prior.covariances()]
    component = rng.choice(len(prior.weights), draws, p=prior.weights)
    normal = rng.standard_normal((draws, prior.means.shape[1]))
    states = np.empty(normal.shape)
    for level, root in enumerate(roots):
        rows = np.flatnonzero(prior.level[component] == level)
        states[rows] = (prior.means[component[rows]]
                        + prior.widening[level] * normal[rows] @ root.T)
    curves = prior.curves(states)
    least = LEAST_CURVE * curves.max(axis=1, keepdims=True)
    return np.asarray(np.maximum(curves, least).reshape(draws, prior.bands, -1))
