"""Whether a photo is linear, by what its scene shows: one paint on both sides of an edge.

Two facets of one paint that meet at an edge see a lamp from one place: neither its beam nor its
strength nor the paint's spectrum enters the ratio of their signals there, only the two cosines. A
linear photo has the rendering's ratio; a tone curve raises it to a power below 1. What else bends
the ratio is the lamp's position (along the difference of the two normals) and a tilt of the facets;
both are taken along with their errors, and edges of several directions tell them from a curve.
"""
from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.reconstruct.view import PhotoView

LAMP_ERROR = 0.03       # of the surfaces' extent along each axis: where the lamp is
TILT_ERROR = np.radians(1.0)    # of a facet
EDGE_ERROR = 0.05       # relative, of a ratio besides: uneven paint, a wrong beam's interreflection
REACH = 0.2             # of the smaller facet: two that come nearer than that meet at an edge
BESIDE = 1.5            # of the shortest distance between them: pixels that are compared
MIN_PAIRS = 8           # of pixels at an edge
MIN_ANGLE_COSINE = 0.94     # of two normals, above which they tell nothing
NORMAL_STEP = 0.05      # of the components of normals that are one facet's
DOUBTED = 3.0           # standard errors of the exponent, beyond which a photo is not linear
EXPLAINED = 0.5         # share of the deviations of the edges: more than the exponent leaves
MIN_DEPARTURE = 0.15    # of the exponent from 1: less is no tone curve


def exponent(photo: np.ndarray, rendered: np.ndarray, by_lamp: np.ndarray, error: np.ndarray,
             lamp_error: float) -> tuple[float, float, float, float]:
    """Exponent to which a photo raises ratios of light, 1 of a linear one, by generalised least
    squares.

    Parameters
    ----------
    photo, rendered : (E,) arrays
        Log ratio of the signals of two facets of one paint at each edge where they meet, mean over
        the bands; one edge at least.
    by_lamp : (E, 3) array
        Derivative of that ratio by the lamp's position.
    error : (E,) array
        Standard error of photo - rendered but for the lamp's position.
    lamp_error : float
        Standard deviation of the lamp's position along each axis, in the scene's unit.

    Returns
    -------
    value, standard_error : float
        The error is wider where the edges disagree by more than theirs.
    departure : float
        From 1, in standard errors by what is known of the edges alone.
    explained : float
        Share of the squared deviations of the edges that the exponent explains.
    """
    off = photo - rendered
    moved = lamp_error * by_lamp
    covariance = moved @ moved.T + np.diag(error**2)
    weighted = np.linalg.solve(covariance, rendered)
    information = float(rendered @ weighted)
    departure = float(off @ weighted) / information
    explained, whole = departure**2 * information, float(off @ np.linalg.solve(covariance, off))
    misfit = max(whole - explained, 0.0) / max(len(photo) - 1, 1)
    return (1 + departure, float(np.sqrt(max(misfit, 1.0) / information)),
            float(np.sqrt(explained)), explained / max(whole, 1e-12))


def linearity(view: PhotoView, rendered: np.ndarray) -> Finding | None:
    """Whether the view's photo is linear; None where no edge tells it.

    Parameters
    ----------
    view : PhotoView
        Under one lamp that has a position; None is found of others.
    rendered : (H, W, K) array
        Of the same scene, with the spectra of the fit.
    """
    scene, used = view.scene(), np.nonzero(view.used)
    if len(scene.emitters()) != 1 or not used[0].size:
        return None
    point, normal, to_lamp, lit = _geometry(view, scene, *used)
    facets = _facets(view.surface[used], normal, lit)
    surfaces = [int(view.surface[used][facet[0]]) for facet in facets]
    normals = [normal[facet].mean(axis=0) for facet in facets]
    names = list(view.scene_file.surfaces)
    signals = [image[used] for image in (view.measured, rendered)]
    found, ratios, by_lamp, errors = [], [], [], []
    for one, other in combinations(range(len(facets)), 2):
        if (view.surface_materials[surfaces[one]] != view.surface_materials[surfaces[other]]
                or normals[one] @ normals[other] > MIN_ANGLE_COSINE):
            continue
        ends = _beside_edge(point, facets[one], facets[other])
        if ends is None:
            continue
        way = np.mean([to_lamp[end].mean(axis=0) for end in ends], axis=0)
        along = [normals[facet] @ way for facet in (one, other)]
        if min(along) <= 0:
            continue
        logs = [np.log(np.maximum([signal[end] for end in ends], 1e-12)) for signal in signals]
        ratio = [float(np.median(each[0] - each[1], axis=0).mean()) for each in logs]
        if ratio[1] == 0:
            continue
        distance = float(np.linalg.norm(way))
        tangents = [np.sqrt(max((distance / each) ** 2 - 1, 0.0)) for each in along]
        found.append([names[surfaces[facet]] for facet in (one, other)])
        ratios.append(ratio)
        by_lamp.append(normals[one] / along[0] - normals[other] / along[1])
        errors.append(float(np.hypot(EDGE_ERROR, TILT_ERROR * np.hypot(*tangents))))
    if not found:
        return None
    photo, model = np.array(ratios).T
    extent = float(np.linalg.norm(np.ptp(point, axis=0)))
    value, error, departure, explained = exponent(photo, model, np.array(by_lamp),
                                                  np.array(errors), LAMP_ERROR * extent)
    if error > 1 / DOUBTED:
        return None             # which tells nothing
    bent = (departure > DOUBTED and explained > EXPLAINED and abs(value - 1) > MIN_DEPARTURE)
    return Finding("scene.not-linear" if bent else "scene.linear",
                   Severity.FAIL if bent else Severity.INFO, values={
        "value": value, "error": error, "edges": [
            {"surfaces": pair, "photo": float(np.exp(seen)), "rendering": float(np.exp(predicted))}
            for pair, (seen, predicted) in zip(found, ratios, strict=True)]})


def _geometry(view: PhotoView, scene: Any, row: np.ndarray, column: np.ndarray
              ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of n pixels the point (n, 3), the normal towards the camera (n, 3), the way to the lamp
    (n, 3), and whether the lamp reaches it (n,).
    """
    import mitsuba as mi

    position = mi.Point2f((column + 0.5) / view.size[0], (row + 0.5) / view.size[1])
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
    hit = scene.ray_intersect(mi.Ray3f(ray))
    lamp, radiance = scene.sample_emitter_direction(hit, mi.Point2f(0.5), True)
    point, normal, away, towards = (np.array(each).T for each in (hit.p, hit.n, ray.d, lamp.d))
    to_lamp = towards * np.array(lamp.dist)[:, None]
    normal = normal * np.where(np.sum(normal * away, axis=1) < 0, 1, -1)[:, None]
    lit = (np.array(radiance[0]) > 0) & (np.sum(normal * towards, axis=1) > 0) & np.isfinite(
        to_lamp).all(axis=1)
    return point, normal, to_lamp, lit


def _facets(surface: np.ndarray, normal: np.ndarray, lit: np.ndarray) -> list[np.ndarray]:
    """Numbers of the pixels of each plane part of a surface that the lamp reaches."""
    key = np.column_stack([surface, np.rint(normal / NORMAL_STEP).astype(int)])[lit]
    _, member, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    return [np.flatnonzero(lit)[member.ravel() == number]
            for number in np.flatnonzero(count >= MIN_PAIRS)]


def _beside_edge(point: np.ndarray, one: np.ndarray,
                 other: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Numbers of the pixels of two facets on both sides of their edge; None where none meets."""
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(point[other]).query(point[one])
    near = distance < BESIDE * distance.min()
    size = min(float(np.linalg.norm(np.ptp(point[facet], axis=0))) for facet in (one, other))
    if distance.min() > REACH * size or np.count_nonzero(near) < MIN_PAIRS:
        return None
    return one[near], other[nearest[near]]
