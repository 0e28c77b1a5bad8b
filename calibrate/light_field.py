"""The light beyond a chart: the field at other regions of the picture, given that on the chart.

A quadratic that was fitted over the chart runs away beyond it. Light does not: lamps have a
position, and a lens darkens corners. So arrangements of lamps are drawn, near and far, one or two,
with light from all sides, and each gives the field at the patches and at any other point.
Arrangements count by how well they give the five terms over the chart, as far as enough of them are
left; linear regression over those of each distance then predicts the field at a point from the
terms [a bridge between particle and ensemble Kalman filter: Frei & Künsch 2013]. What they leave
open is what the arrangements that agree on the chart still differ by: next to nothing close to the
chart, and the more the further away.

    terms over the chart of one arrangement       c = pinv(terms at the patches) field(patches)
    at a point x, arrangements of one distance    field(x) = mean(x) + G(x) (c - mean c) + rest(x)

Distances are weighted by how well they give the chart's terms. Lengths are in widths of the card. A
photo that was divided by a white card in the samples' place may have no field left: that is one
more kind of arrangement, and the chart says whether it holds.
"""
from __future__ import annotations

import numpy as np

from spectrabox.calibrate.chart_equations import FIELD_SD, field_terms
from spectrabox.radiometry.covariance import symmetric
from spectrabox.radiometry.records.calibration import ChartWhite

LAMP_DISTANCES = (1.5, 3.0, 6.0, 12.0, 25.0)    # a Classic from 0.4 m, a Nano from 0.6 m
ARRANGEMENTS = 400           # of each distance
MIN_LEFT, BISECTIONS = 0.1, 20  # share of them that goes on counting; for the power that leaves it
DISTANCE_SPREAD = 0.25       # of the logarithm, within one class
MAX_ANGLE_DEG = 65.0         # of a lamp from the normal of the samples
MAX_AMBIENT = 0.3            # of the light on the chart, from all sides
MAX_DIRECTED = 3.0           # power of the cosine by which a lamp's beam falls off
MAX_CORNER_LOSS = 0.6        # of the light, by the lens, in the corners of the picture
EVEN_SD = 0.01               # of the log field left at the picture's border by a white card
FLAT_SHARE = 0.5             # beforehand: that a flat field took the light's fall-off too
RIDGE = 1e-10


def light_at_regions(white: ChartWhite, plane: list[np.ndarray], picture: list[np.ndarray],
                     flat_field: bool, seed: int = 0
                     ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The light at other regions of a photo, relative to the chart's mean, given its chart.

    Parameters
    ----------
    white : ChartWhite
        With E = 5 terms of the field.
    plane : list of (N, 2) arrays
        The I patches, then points of each of R regions, over which the light on it is the mean:
        where they lie in the plane of the chart, in widths of the card, from its corner at the
        first patch.
    picture : list of (N, 2) arrays
        The same in the picture, from its middle, half of the diagonal being 1.
    flat_field : bool
        Whether the photo was divided by that of a white card.
    seed : int
        Of the arrangements of lamps.

    Returns
    -------
    level : (K,) array
        Signal of white where the log field is 0.
    glare : (K,) array
        Signal.
    field : (R,) array
        Logarithm of the light.
    covariance : (Z, Z) array
        Of log level, glare and field together: Z = 2 K + R.
    """
    terms = field_terms(plane[0])
    project = np.linalg.pinv(terms)
    centre, information = _likelihood(white)
    kinds = [_of_distance(distance, plane, picture, flat_field, np.random.default_rng([seed, i]))
             for i, distance in enumerate(LAMP_DISTANCES)]
    shares = np.full(len(kinds), (1 - FLAT_SHARE * flat_field) / len(kinds))
    if flat_field:
        kinds.append(_nearly_even(picture, np.random.default_rng([seed, len(kinds)])))
        shares = np.append(shares, FLAT_SHARE)
    fits = [_given_the_chart(white, project, centre, information, *kind) for kind in kinds]
    logs = np.log(shares) + np.array([evidence for evidence, _, _ in fits])
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    means = np.array([mean for _, mean, _ in fits])
    mean = weights @ means
    covariance = sum(weight * (inside + np.outer(off, off)) for weight, off, (_, _, inside)
                     in zip(weights, means - mean, fits, strict=True))
    bands = len(white.level)
    return (white.level * np.exp(mean[:bands]), mean[bands:2 * bands], mean[2 * bands:],
            symmetric(np.asarray(covariance)))


def _likelihood(white: ChartWhite) -> tuple[np.ndarray, np.ndarray]:
    """What the patches alone say of the terms: the best (E,) and its information (E, E).

    The chart fit's own prior on the terms is taken out again.
    """
    own = slice(len(white.level), len(white.level) + len(white.field))
    posterior = np.linalg.inv(white.covariance[own, own])
    values, vectors = np.linalg.eigh(posterior - np.eye(len(posterior)) / FIELD_SD**2)
    values = np.maximum(values, RIDGE * values.max())
    information = (vectors * values) @ vectors.T
    return np.linalg.solve(information, posterior @ white.field), information


def _given_the_chart(white: ChartWhite, project: np.ndarray, centre: np.ndarray,
                     information: np.ndarray, on_patches: np.ndarray,
                     on_regions: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Log evidence of one kind of arrangement, and mean and covariance of (log level - that of
    the chart fit, glare, field at the regions), Z = 2 K + R.

    Arrangements first count by a power of the chart's likelihood, the largest that leaves enough
    of them, and their moments take the rest.
    """
    bands, count = len(white.level), len(white.field)
    terms = on_patches @ project.T
    square = np.einsum("ae,ef,af->a", terms - centre, information, terms - centre)
    power, shares = _tempered(square)
    mean = shares @ terms
    centred, unbiased = terms - mean, 1 / (1 - shares @ shares)
    products = (centred * shares[:, None]).T @ centred
    spread = unbiased * products
    spread = spread + RIDGE * np.trace(spread) * np.eye(count)
    left, innovation = (1 - power) * information, centre - mean
    total = np.eye(count) + spread @ left
    evidence = (np.log(np.mean(np.exp(-0.5 * power * (square - square.min()))))
                - 0.5 * power * square.min() - 0.5 * np.linalg.slogdet(total)[1]
                - 0.5 * innovation @ left @ np.linalg.solve(total, innovation))
    # The chart fit again, with this kind's prior on the terms in place of its own: the terms'
    # posterior is exchanged, and what was correlated with them moves along.
    own = slice(bands, bands + count)
    precise = np.linalg.inv(spread)
    terms_covariance = np.linalg.inv(left + precise)
    exchanged = terms_covariance @ (left @ centre + precise @ mean)
    along = white.covariance[:, own] @ np.linalg.inv(white.covariance[own, own])
    state = np.r_[np.zeros(bands), white.field, white.glare] + along @ (exchanged - white.field)
    covariance = white.covariance + along @ (terms_covariance
                                             - white.covariance[own, own]) @ along.T
    of_regions = shares @ on_regions
    regression = np.linalg.solve(products + RIDGE * np.trace(products) * np.eye(count),
                                 (centred * shares[:, None]).T @ (on_regions - of_regions)).T
    rest = on_regions - of_regions - centred @ regression.T
    regions = on_regions.shape[1]
    carry = np.zeros((2 * bands + regions, len(state)))
    carry[:bands, :bands] = np.eye(bands)
    carry[bands:2 * bands, bands + count:] = np.eye(bands)
    carry[2 * bands:, own] = regression
    moved = carry @ state
    moved[2 * bands:] += of_regions - regression @ mean
    covariance = carry @ covariance @ carry.T
    number = 1 / (shares @ shares)      # of arrangements of equal shares that tell as much
    covariance[2 * bands:, 2 * bands:] += (rest * shares[:, None]).T @ rest * (
        number / (number - count - 1))
    return float(evidence), moved, covariance


def _tempered(square: np.ndarray) -> tuple[float, np.ndarray]:
    """Largest power of a likelihood that leaves ``MIN_LEFT`` of the arrangements, and their shares.

    Parameters
    ----------
    square : (A,) array
        Minus twice the log likelihood of each arrangement.
    """
    def shares_by(power: float) -> np.ndarray:
        shares = np.exp(-0.5 * power * (square - square.min()))
        return np.asarray(shares / shares.sum())

    def leaves_enough(power: float) -> bool:
        return bool(np.sum(shares_by(power) ** 2) * MIN_LEFT * len(square) <= 1)

    low, high = (1.0, 1.0) if leaves_enough(1.0) else (0.0, 1.0)
    for _ in range(BISECTIONS * (low < high)):
        middle = (low + high) / 2
        low, high = (middle, high) if leaves_enough(middle) else (low, middle)
    return low, shares_by(low)


def _of_distance(distance: float, plane: list[np.ndarray], picture: list[np.ndarray],
                 flat_field: bool,
                 rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Log fields (A, I) at the patches and (A, R) at the regions, of lamps at about a distance."""
    field = _lamplight(np.vstack(plane), len(plane[0]), distance, rng)
    if not flat_field:
        squared = np.sum(np.vstack(picture) ** 2, axis=1)
        corner = 1 - MAX_CORNER_LOSS * rng.uniform(size=(ARRANGEMENTS, 1)) ** 2
        field = field - 2 * np.log1p((corner**-0.5 - 1) * squared)
    return _relative(field, plane)


def _nearly_even(picture: list[np.ndarray],
                 rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The same, of what a white card leaves: a slight slope and bend over the picture."""
    x, y = np.vstack(picture).T
    terms = np.column_stack([x, y, x**2, y**2, x * y])
    return _relative(EVEN_SD * rng.standard_normal((ARRANGEMENTS, 5)) @ terms.T, picture)


def _lamplight(plane: np.ndarray, patches: int, distance: float,
               rng: np.random.Generator) -> np.ndarray:
    """Log irradiance (A, N) at points of the plane from one or two lamps and from all sides.

    The first points are those of the ``patches``. Lamps are compared there alone: what light a
    point has does not depend on which other points are asked for.
    """
    total, middle = np.zeros((ARRANGEMENTS, len(plane))), plane[:patches].mean(axis=0)
    second = rng.uniform(size=(ARRANGEMENTS, 1)) * (rng.uniform(size=(ARRANGEMENTS, 1)) < 0.5)
    for strength in (np.ones((ARRANGEMENTS, 1)), second):
        away = distance * np.exp(DISTANCE_SPREAD * rng.standard_normal(ARRANGEMENTS))
        angle = np.radians(MAX_ANGLE_DEG) * np.sqrt(rng.uniform(size=ARRANGEMENTS))
        turn = 2 * np.pi * rng.uniform(size=ARRANGEMENTS)
        lamp = away[:, None] * np.column_stack([np.sin(angle) * np.cos(turn),
                                                np.sin(angle) * np.sin(turn), np.cos(angle)])
        # aimed next to the chart as often as at it
        aim = middle + 0.3 * away[:, None] * rng.standard_normal((ARRANGEMENTS, 2))
        offset = plane - (aim + lamp[:, :2])[:, None]
        squared = np.sum(offset**2, axis=2) + lamp[:, 2:]**2
        axis = -lamp / away[:, None]
        along = (offset @ axis[:, :2, None])[..., 0] - lamp[:, 2:] * axis[:, 2:]
        directed = MAX_DIRECTED * rng.uniform(size=(ARRANGEMENTS, 1))
        cosine = np.maximum(along / np.sqrt(squared), 1e-3)
        irradiance = lamp[:, 2:] / squared**1.5 * cosine**directed
        total += strength * irradiance / irradiance[:, :patches].mean(axis=1, keepdims=True)
    ambient = MAX_AMBIENT * rng.uniform(size=(ARRANGEMENTS, 1))
    return np.asarray(np.log(total + ambient * total[:, :patches].mean(axis=1, keepdims=True)))


def _relative(field: np.ndarray, points: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Fields at the patches and their means at the regions, relative to the patches' mean."""
    edges = np.cumsum([len(each) for each in points])[:-1]
    on_patches, *on_regions = np.split(field - field[:, :edges[0]].mean(axis=1, keepdims=True),
                                      edges, axis=1)
    return on_patches, np.column_stack([each.mean(axis=1) for each in on_regions])
