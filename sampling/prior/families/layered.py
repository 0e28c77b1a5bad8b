"""Layers that scatter and absorb, and natural materials made of them: wood, soil, stone, hair, fur,
feathers, scales, shells, human skin.

Layers that scatter and absorb: what the families of surfaces share.

Kubelka and Munk (Z. techn. Phys. 12 (1931) 593): an opaque layer that absorbs K and scatters S per
unit of depth reflects R with K / S = (1 - R)^2 / (2 R), inside its surface. A glossy surface
reflects a share k1 of the light before it enters and k2 of what would leave (Saunderson, J. Opt.
Soc. Am. 32 (1942) 727): R_seen = k1 + (1 - k1) (1 - k2) R / (1 - k2 R). Absorption bands are taken
in photon energy, where their shape does not depend on where they are.

Natural materials: wood, soil and stone; hair, fur, feathers, scales and shells.

Wood, soil and stone: absorption that falls from blue to red, with the bands of iron.

Soil and stone: K / S of goethite, with bands at 425, 480 and 650 nm, and of haematite, at 445, 530
and 650 nm, whose edges lie near 500 and 580 nm (Scheinost, Chavernas, Barron and Torrent, Clays and
Clay Minerals 46 (1998) 528), humus exp(-(nm - 400) / s) with s 100 to 400 nm, and a neutral part;
water darkens by multiplying K / S.

Wood, bark, straw, cork, cardboard: lignin and its quinones, exp(-(nm - 400) / s), s 50 to 150 nm
(Schmidt and Heitner, Tappi J. 76 (1993) 117), tannins, and greying by the weather.

Hair, fur, feathers, scales and shells: melanins, carotenoids and structure in keratin.

K / S of eumelanin falls as nm^-2.5 to nm^-4 and of pheomelanin as exp(-(nm - 400) / 60 to 100)
(Zonios, J. Biomed. Opt. 13 (2008) 014017; Riley, Int. J. Biochem. Cell Biol. 29 (1997) 1235).
Carotenoids of feathers and scales: three vibronic bands 0.17 eV apart, the lowest at 470 to 560 nm
(yellow to red), so that they end in a steep edge (Stradi, Int. J. Mol. Sci. 1998; Toral, Funct.
Ecol. 22 (2008) 1). Structure: a reflection peak, Gaussian in photon energy and 0.12 to 0.45 eV
wide, over melanin, as keratin and air scatter coherently (Prum and Torres, J. Exp. Biol. 206 (2003)
2409). Iridescence, which depends on the angle, is left out.

Human skin: an epidermis that absorbs over a dermis that scatters.

Light crosses the epidermis twice, then diffuses in a dermis that is semi-infinite:

    R = gloss + (1 - gloss) g exp(-2 d mu_epi) (r + (1 - r)^2 D / (1 - r D)),
    D = exp(-A / sqrt(3 (1 + mu_s' / mu_a)))

with mu_epi = f_mel mu_mel + (1 - f_mel) mu_base and mu_a = f_blood C mu_blood + (1 - f_blood)
mu_base + mu_yellow, all per cm.

- mu_mel = 6.6e11 nm^-3.33, the melanosome (S. L. Jacques, Oregon Medical Laser Center News 1998 and
  Phys. Med. Biol. 58 (2013) R37); with pheomelanin the power is up to 4.75 (Donner and Jensen,
  Rendering Techniques 2006, 409), here 3 to 4.75 and normalised at 550 nm.
- r: what scatters between the melanin and the blood, the capillaries' loops beginning about 0.1 mm
  below the surface (Meglinski and Matcher, Physiol. Meas. 23 (2002) 741: no blood in the epidermis,
  0.04 in the papillary dermis): 0 to 0.15 at 500 nm, as mu_s' falls. Light that returns from there
  has not met blood, so that the strong bands at 400 to 440 nm never go all dark.
- mu_base = 0.244 + 85.3 exp(-(nm - 154) / 66.2), skin without blood (Saidi, in Jacques 1998).
- mu_blood from haemoglobin.csv, 150 g/l at 64 500 g/mol, ln 10 per decade of extinction; S is the
  oxygenation. Blood is packed in vessels of radius r, of which light sees the outside first:
  C = (1 - exp(-2 mu_blood r)) / (2 mu_blood r) (Verkruysse, Phys. Med. Biol. 42 (1997) 51).
- mu_yellow: bilirubin, one band at 460 nm, and beta-carotene, at 455 and 485 nm (Alaluf, J. Nutr.
  132 (2002) 399, found the latter in all skins).
- mu_s' = a (f (nm / 500)^-4 + (1 - f) (nm / 500)^-b), a 25 to 60 per cm, b 0.9 to 1.7, f 0.1 to 0.6
  (table 1 of Jacques 2013).
- A 5 to 9: of diffusion from a plane surface with mismatched indices (Jacques 1999, 'Diffuse
  reflectance from a semi-infinite medium', OMLC News); g: shape and shading.

Not in it: hair, make-up, tattoos, wounds, and the fluorescence of porphyrins.
"""


from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.sampling.prior.mixture import PRIOR_GRID

EV_NM = 1239.84                 # h c: photon energy in eV times wavelength in nm
ENERGY = EV_NM / PRIOR_GRID.nm


def reflectance_of(absorption: np.ndarray) -> np.ndarray:
    """Reflectance of an opaque layer of K / S, any shape."""
    return 1 / (1 + absorption + np.sqrt(absorption**2 + 2 * absorption))


def absorption_of(reflectance: np.ndarray) -> np.ndarray:
    """K / S of an opaque layer of a reflectance in (0, 1]."""
    return (1 - reflectance)**2 / (2 * reflectance)


def behind_surface(inside: np.ndarray, entering: np.ndarray, leaving: np.ndarray) -> np.ndarray:
    """Reflectance seen through a surface that reflects ``entering`` (k1) and ``leaving`` (k2)."""
    return entering + (1 - entering) * (1 - leaving) * inside / (1 - leaving * inside)


def band(peak_ev: np.ndarray | float, width_ev: np.ndarray | float,
         skew: np.ndarray | float = 0.0) -> np.ndarray:
    """Gaussian absorption bands (n, 61) of height 1, wider by ``skew`` towards the blue."""
    away = ENERGY - peak_ev
    return np.exp(-0.5 * (away / np.where(away > 0, width_ev * (1 + skew), width_ev))**2)


def log_uniform(rng: np.random.Generator, low: float, high: float, count: int) -> np.ndarray:
    """Column (count, 1) of numbers whose logarithm is uniform."""
    return np.exp(uniform(rng, np.log(low), np.log(high), count))


def uniform(rng: np.random.Generator, low: float, high: float, count: int) -> np.ndarray:
    """Column (count, 1) of uniform numbers."""
    return rng.uniform(low, high, (count, 1))


def chance(rng: np.random.Generator, probability: float, count: int) -> np.ndarray:
    """Column (count, 1) of zeros and, with a probability, ones."""
    return (rng.random((count, 1)) < probability).astype(float)


# ---- natural materials: wood, soil and stone; hair, fur, feathers, scales and shells -------------

def soils(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of soils, stones, bricks and ochres."""
    goethite = (band(EV_NM / 425, 0.30) + uniform(rng, 0.4, 0.8, count) * band(EV_NM / 480, 0.13)
                + uniform(rng, 0.02, 0.08, count) * band(EV_NM / 650, 0.12))
    haematite = (band(EV_NM / 445, 0.40)
                 + uniform(rng, 0.6, 1.0, count) * band(EV_NM / (530 + uniform(rng, -6, 10, count)),
                                                        0.13)
                 + uniform(rng, 0.05, 0.15, count) * band(EV_NM / 650, 0.12))
    humus = np.exp(-(PRIOR_GRID.nm - 400) / uniform(rng, 100, 400, count))
    dirt = log_uniform(rng, 0.002, 4, count) * (PRIOR_GRID.nm / 550)**-uniform(rng, 0, 0.6, count)
    total = (log_uniform(rng, 0.01, 8, count) * goethite
             + chance(rng, 0.6, count) * log_uniform(rng, 0.01, 12, count) * haematite
             + chance(rng, 0.7, count) * log_uniform(rng, 0.02, 6, count) * humus + dirt)
    return _surface(rng, reflectance_of(total))


def woods(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of wood, bark, straw, cork, cardboard and unbleached wool."""
    lignin = log_uniform(rng, 0.05, 6, count) * np.exp(
        -(PRIOR_GRID.nm - 400) / uniform(rng, 50, 150, count))
    tannin = chance(rng, 0.5, count) * log_uniform(rng, 0.02, 3, count) * np.exp(
        -(PRIOR_GRID.nm - 400) / uniform(rng, 100, 300, count))
    red = chance(rng, 0.4, count) * log_uniform(rng, 0.01, 0.6, count) * band(
        EV_NM / uniform(rng, 460, 540, count), uniform(rng, 0.12, 0.3, count))
    dirt = log_uniform(rng, 0.002, 1.5, count) * (PRIOR_GRID.nm / 550)**-uniform(rng, 0, 0.5, count)
    return _surface(rng, reflectance_of(lignin + tannin + red + dirt))


def _surface(rng: np.random.Generator, inside: np.ndarray) -> np.ndarray:
    gloss = uniform(rng, 0, 0.04, len(inside))
    return (1 - gloss) * inside + gloss


def animals(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of hair, fur, feathers, scales and shells."""
    nm = PRIOR_GRID.nm
    eumelanin = log_uniform(rng, 0.01, 20, count) * (nm / 550)**-uniform(rng, 2.5, 4, count)
    pheomelanin = chance(rng, 0.5, count) * log_uniform(rng, 0.05, 30, count) * np.exp(
        -(nm - 400) / uniform(rng, 60, 100, count))
    lowest = EV_NM / uniform(rng, 470, 560, count)
    width = uniform(rng, 0.05, 0.1, count)
    chain = sum(height * band(lowest + step * 0.17, width * (1 + step / 4))
                for step, height in enumerate((0.8, 1.0, 0.7, 0.3)))
    carotenoids = chance(rng, 0.4, count) * log_uniform(rng, 0.1, 40, count) * chain
    keratin = 0.02 + 0.1 * np.exp(-(nm - 400) / 40)
    pigment = reflectance_of(eumelanin + pheomelanin + carotenoids + keratin)
    structure = chance(rng, 0.3, count) * uniform(rng, 0.02, 0.5, count) * band(
        EV_NM / uniform(rng, 390, 620, count), uniform(rng, 0.12, 0.45, count))
    shade = uniform(rng, 0.5, 1.05, count)
    gloss = uniform(rng, 0, 0.04, count)
    return shade * (pigment + structure * (1 - pigment)) * (1 - gloss) + gloss


# ---- human skin: an epidermis that absorbs over a dermis that scatters ---------------------------

AT_500 = int(np.argmin(np.abs(PRIOR_GRID.nm - 500)))
MOLAR_BLOOD = np.log(10) * 150 / 64500      # per cm for an extinction of 1 / (cm M)
USUAL_BLOOD = 53_236            # 1 / (cm M) of oxygenated blood at 542 nm


def skin(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of skin, by diffusion in the dermis."""
    epidermis, dermis, scattering = _layers(rng, count)
    A = uniform(rng, 5, 9, count)
    return _seen(rng, epidermis, np.exp(-A / np.sqrt(3 * (1 + scattering / dermis))), scattering)


def skin_in_two_fluxes(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of skin whose dermis is a layer of Kubelka and Munk.

    K = 2 mu_a and S = 3/4 mu_s' (Mudgett and Richards, Appl. Opt. 10 (1971) 1485). The dermis is
    the same and the theory another: what the two differ by is what either does not know.
    """
    epidermis, dermis, scattering = _layers(rng, count)
    inside = reflectance_of(8 / 3 * dermis / scattering)
    leaving = uniform(rng, 0.35, 0.6, count)
    return _seen(rng, epidermis, (1 - leaving) * inside / (1 - leaving * inside), scattering)


def skin_by_absorbance(rng: np.random.Generator, count: int) -> np.ndarray:
    """Reflectances (count, 61) of skin whose absorbances add, as light took the same path at all
    wavelengths.

    Dawson, Barker, Ellis, Grassam, Cotterill, Fisher and Feather, Phys. Med. Biol. 25 (1980) 695;
    a third theory. What blood absorbs is limited, since some of the light never meets any: an
    absorbance A becomes a (1 - exp(-A / a)), a 0.3 to 3.
    """
    nm = PRIOR_GRID.nm
    melanin = log_uniform(rng, 0.05, 2, count) * (nm / 500)**-uniform(rng, 3.0, 4.75, count)
    blood = log_uniform(rng, 0.03, 0.4, count) * _blood(rng, count) / USUAL_BLOOD
    met = log_uniform(rng, 0.3, 3, count)
    base = uniform(rng, 0, 0.5, count) * np.exp(-(nm - 400) / uniform(rng, 60, 120, count))
    whole = (uniform(rng, 0.3, 1, count) + melanin + base + 0.3 * _yellow(rng, count)
             - met * np.expm1(-blood / met))
    gloss = uniform(rng, 0, 0.04, count)
    return (1 - gloss) * np.exp(-whole) + gloss


def _layers(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Optical density of the epidermis there and back; absorption and scattering of the dermis."""
    nm = PRIOR_GRID.nm
    base = 0.244 + 85.3 * np.exp(-(nm - 154) / 66.2)
    melanosome = 6.6e11 * 550**-3.33 * (nm / 550)**-uniform(rng, 3.0, 4.75, count)
    melanin = log_uniform(rng, 0.008, 0.35, count)
    depth = uniform(rng, 0.004, 0.009, count)
    epidermis = 2 * depth * (melanin * melanosome + (1 - melanin) * base)
    blood = MOLAR_BLOOD * _blood(rng, count)
    double_radius = 2 * blood * log_uniform(rng, 5e-4, 4e-3, count)
    packed = (1 - np.exp(-double_radius)) / double_radius
    share = log_uniform(rng, 0.003, 0.07, count)
    yellow = _yellow(rng, count)
    dermis = share * packed * blood + (1 - share) * uniform(rng, 0.4, 1.0, count) * base + yellow
    small = uniform(rng, 0.1, 0.6, count)
    scattering = uniform(rng, 25, 60, count) * (
        small * (nm / 500)**-4.0 + (1 - small) * (nm / 500)**-uniform(rng, 0.9, 1.7, count))
    return epidermis, dermis, scattering


def _blood(rng: np.random.Generator, count: int) -> np.ndarray:
    """Molar extinction (count, 61) of haemoglobin, 40 to 98 % of it with oxygen."""
    _, oxygenated, deoxygenated = np.loadtxt(Path(__file__).with_name("haemoglobin.csv"),
                                             delimiter=",", skiprows=4).T
    saturation = uniform(rng, 0.4, 0.98, count)
    return saturation * oxygenated + (1 - saturation) * deoxygenated


def _yellow(rng: np.random.Generator, count: int) -> np.ndarray:
    """Absorption (count, 61), per cm, of bilirubin and beta-carotene."""
    bilirubin = np.exp(-0.5 * ((PRIOR_GRID.nm - 460) / 32)**2)
    carotene = np.exp(-0.5 * ((PRIOR_GRID.nm - 455) / 22)**2) + 0.8 * np.exp(
        -0.5 * ((PRIOR_GRID.nm - 485) / 14)**2)
    return log_uniform(rng, 0.02, 0.6, count) * bilirubin \
        + log_uniform(rng, 0.02, 0.8, count) * carotene


def _seen(rng: np.random.Generator, epidermis: np.ndarray, dermis: np.ndarray,
          scattering: np.ndarray) -> np.ndarray:
    count = len(dermis)
    gloss = uniform(rng, 0, 0.04, count)
    bloodless = uniform(rng, 0, 0.15, count) * scattering / scattering[:, AT_500, None]
    below = bloodless + (1 - bloodless)**2 * dermis / (1 - bloodless * dermis)
    return (1 - gloss) * uniform(rng, 0.85, 1.1, count) * np.exp(-epidermis) * below + gloss
