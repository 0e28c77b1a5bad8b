"""Gloss: light of the lamp that the outermost layer of a surface mirrors, beyond what a chart does.

    signal (J,) = response @ reflectance + g + errors,     g >= 0

It has the lamp's colour, so that it adds the same share g of white to all bands, and it can only
add. Which share depends on the kind of surface and on where the lamp is: of one kind of surface it
is normal, and what nobody stated is a mixture of the kinds.
"""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from spectrabox.radiometry.error_model import SURFACE_REFLECTION
from spectrabox.radiometry.records.spectra import CaptureStates


class Gloss(NamedTuple):
    """The share of white that surfaces of one kind mirror: mean and standard deviation."""

    mean: float
    deviation: float


# Matt: paper, matt paint, cloth, skin, earth; as a half-normal distribution of scale .002. Satin:
# silk paint, leaves, wood, leather. Glossy: varnish, glazes, plastic. A lamp at 45 degrees whose
# image in a mirror the camera does not see; on one measured chart with a glossy finish a sphere
# instrument reads .016 more with the specular part than without, up to .04 on single patches, and
# on a chart with a matt one .0012. Microfacets of a matt surface (``fixtures/near_lamps``) send
# -.0003 +- .0014 more than an instrument at 45 degrees reads, by where the lamp stands.
KINDS = {"matt": Gloss(0.0016, 0.0012), "satin": Gloss(0.012, 0.006),
         "glossy": Gloss(0.03, 0.012)}
SURFACE_WORDS = tuple(KINDS)
# Of surfaces of which nobody says anything, lit by somebody who keeps reflections away: most send
# no more than matt ones do. The estimate then is nearly that of a matt surface, and the band
# reaches to what 3 % of gloss would make of it: more glossy ones make dark greys black, and of
# fewer, bands leave what mirrors 3 % (benchmarks/bench_gloss.py).
USUAL = {"matt": 0.78, "satin": 0.13, "glossy": 0.09}
# A kind whose gloss varies by more than this under one lamp is taken as two narrower ones, one and
# the other side of its mean: a signal bends with it by more than a Gaussian follows.
WIDE, ASIDE = 0.01, 0.83
# between the gloss of one surface under lamps in two places, of one kind
SAME_SURFACE = 0.5
NAME = "gloss"


def gloss_states(stated: str | None, lamps: Sequence[str]) -> CaptureStates:
    """What a surface may mirror in J bands: a gloss for each place of a lamp, of one kind.

    Parameters
    ----------
    stated : str or None
        Of SURFACE_WORDS; None: nothing is known.
    lamps : sequence of J str
        The lamp of each band, the same for photos under one that stayed in its place.
    """
    places = list(dict.fromkeys(lamps))
    count = len(places)
    alike = SAME_SURFACE + (1 - SAME_SURFACE) * np.eye(count)
    parts = [(kind, share / len(narrow), each)
             for kind, share in (USUAL if stated is None else {stated: 1.0}).items()
             for narrow in [_narrow(KINDS[kind]) if count == 1 else [KINDS[kind]]]
             for each in narrow]
    return CaptureStates(
        tuple(NAME if number == 0 else f"{NAME} {number + 1}" for number in range(count)),
        (SURFACE_REFLECTION,) * count,
        np.array([[float(lamp == place) for place in places] for lamp in lamps]).reshape(-1, count),
        np.zeros(count), tuple(kind for kind, _, _ in parts),
        np.array([share for _, share, _ in parts]),
        np.array([np.full(count, gloss.mean) for _, _, gloss in parts]),
        np.array([gloss.deviation**2 * alike for _, _, gloss in parts]))


def _narrow(gloss: Gloss) -> list[Gloss]:
    """The gloss as one or two of the same mean and variance together."""
    if gloss.deviation <= WIDE:
        return [gloss]
    aside = ASIDE * gloss.deviation
    left = (gloss.deviation**2 - aside**2)**0.5
    return [Gloss(gloss.mean - aside, left), Gloss(gloss.mean + aside, left)]


def draw_gloss(stated: str | None, count: int, rng: np.random.Generator) -> np.ndarray:
    """Glosses (n,) of surfaces, each by itself.

    Parameters
    ----------
    stated : str or None
        As of `gloss_states`.
    count : int
        n.
    rng : numpy Generator
    """
    shares = USUAL if stated is None else {stated: 1.0}
    chosen = rng.choice(list(shares), count, p=list(shares.values()))
    return np.maximum([KINDS[kind].mean + KINDS[kind].deviation * normal
                       for kind, normal in zip(chosen, rng.standard_normal(count), strict=True)], 0)
