"""Whether a photo is linear, by what its scene shows: one paint on both sides of an edge.

Two facets of one paint that meet at an edge see a lamp from one place: neither its beam nor its
strength nor the paint's spectrum enters the ratio of their signals there, only the two cosines. A
linear photo has the rendering's ratio; a tone curve raises it to a power below 1. What else bends
the ratio is the lamp's position (along the difference of the two normals) and a tilt of the facets;
both are taken along with their errors, and edges of several directions tell them from a curve.
"""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Edge:
    """Two facets of one paint where they meet."""

    names: tuple[str, str]      # of their surfaces
    photo: float                # log ratio of their signals, mean over the bands
    rendered: float
    by_lamp: np.ndarray         # (3,) derivative of that ratio by the lamp's position
    error: float                # standard error of photo - rendered but for the lamp's position


@dataclass(frozen=True)
class Exponent:
    """The power to which a photo raises ratios of light; 1 of a linear one."""

    value: float
    error: float        # standard error; wider where the edges disagree by more than theirs
    departure: float    # from 1, in standard errors by what is known of the edges alone
    explained: float    # share of the squared deviations of the edges that it explains


def exponent(edges: list[Edge], lamp_error: float) -> Exponent:
    """Exponent to which a photo raises ratios of light, by generalised least squares.

    Parameters
    ----------
    edges : list of Edge
        One at least.
    lamp_error : float
        Standard deviation of the lamp's position along each axis, in the scene's unit.
    """
    rendered = np.array([edge.rendered for edge in edges])
    off = np.array([edge.photo for edge in edges]) - rendered
    by_lamp = lamp_error * np.array([edge.by_lamp for edge in edges])
    covariance = by_lamp @ by_lamp.T + np.diag([edge.error**2 for edge in edges])
    weighted = np.linalg.solve(covariance, rendered)
    information = float(rendered @ weighted)
    departure = float(off @ weighted) / information
    explained, whole = departure**2 * information, float(off @ np.linalg.solve(covariance, off))
    misfit = max(whole - explained, 0.0) / max(len(edges) - 1, 1)
    return Exponent(1 + departure, float(np.sqrt(max(misfit, 1.0) / information)),
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
    scene = view.scene()
    if len(scene.emitters()) != 1:
        return None
    facets, extent = _facets(view, scene)
    edges = [edge for edge in _edges(view, rendered, facets) if edge.rendered != 0]
    if not edges:
        return None
    found = exponent(edges, LAMP_ERROR * extent)
    if found.error > 1 / DOUBTED:
        return None             # which tells nothing
    bent = (found.departure > DOUBTED and found.explained > EXPLAINED
            and abs(found.value - 1) > MIN_DEPARTURE)
    return Finding("scene.not-linear" if bent else "scene.linear",
                   Severity.FAIL if bent else Severity.INFO, values={
        "value": found.value, "error": found.error, "edges": [
            {"surfaces": list(edge.names), "photo": float(np.exp(edge.photo)),
             "rendering": float(np.exp(edge.rendered))} for edge in edges]})


@dataclass(frozen=True, eq=False)
class _Facet:
    """Pixels of a plane part of a surface that the lamp reaches."""

    name: str
    material: str
    normal: np.ndarray          # (3,) towards the camera
    row: np.ndarray             # (n,)
    column: np.ndarray          # (n,)
    point: np.ndarray           # (n, 3)
    to_lamp: np.ndarray         # (n, 3)

    @property
    def size(self) -> float:
        return float(np.linalg.norm(np.ptp(self.point, axis=0)))


def _facets(view: PhotoView, scene: Any) -> tuple[list[_Facet], float]:
    """The facets of a view, and the extent of all its surfaces in the scene's unit."""
    import mitsuba as mi

    row, column = np.nonzero(view.used)
    if not row.size:
        return [], 0.0
    position = mi.Point2f((column + 0.5) / view.size[0], (row + 0.5) / view.size[1])
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
    hit = scene.ray_intersect(mi.Ray3f(ray))
    lamp, radiance = scene.sample_emitter_direction(hit, mi.Point2f(0.5), True)
    point, normal, away, towards = (np.array(each).T for each in (hit.p, hit.n, ray.d, lamp.d))
    to_lamp = towards * np.array(lamp.dist)[:, None]
    normal = normal * np.where(np.sum(normal * away, axis=1) < 0, 1, -1)[:, None]
    lit = (np.array(radiance[0]) > 0) & (np.sum(normal * towards, axis=1) > 0) & np.isfinite(
        to_lamp).all(axis=1)
    surface, names = view.surface[row, column], list(view.scene_file.surfaces)
    key = np.column_stack([surface, np.rint(normal / NORMAL_STEP).astype(int)])[lit]
    _, member, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    facets = []
    for number in np.flatnonzero(count >= MIN_PAIRS):
        own = np.flatnonzero(lit)[member.ravel() == number]
        index = int(surface[own[0]])
        facets.append(_Facet(names[index], view.surface_materials[index],
                             normal[own].mean(axis=0), row[own], column[own], point[own],
                             to_lamp[own]))
    return facets, float(np.linalg.norm(np.ptp(point, axis=0)))


def _edges(view: PhotoView, rendered: np.ndarray, facets: list[_Facet]) -> Iterator[Edge]:
    """Where two facets of one paint meet."""
    from scipy.spatial import cKDTree

    for one, other in combinations(facets, 2):
        if one.material != other.material or one.normal @ other.normal > MIN_ANGLE_COSINE:
            continue
        distance, nearest = cKDTree(other.point).query(one.point)
        near = distance < BESIDE * distance.min()
        if (distance.min() > REACH * min(one.size, other.size)
                or np.count_nonzero(near) < MIN_PAIRS):
            continue
        nearest = nearest[near]
        places = ((one.row[near], one.column[near]), (other.row[nearest], other.column[nearest]))
        photo, model = (np.log(np.maximum([image[place] for place in places], 1e-12))
                        for image in (view.measured, rendered))
        seen, predicted = (float(np.median(logs[0] - logs[1], axis=0).mean())
                           for logs in (photo, model))
        to_lamp = np.mean([one.to_lamp[near].mean(axis=0), other.to_lamp[nearest].mean(axis=0)],
                          axis=0)
        along = [facet.normal @ to_lamp for facet in (one, other)]
        if min(along) <= 0:
            continue
        distance = float(np.linalg.norm(to_lamp))
        tangents = [np.sqrt(max((distance / each) ** 2 - 1, 0.0)) for each in along]
        yield Edge((one.name, other.name), seen, predicted,
                   one.normal / along[0] - other.normal / along[1],
                   float(np.hypot(EDGE_ERROR, TILT_ERROR * np.hypot(*tangents))))
