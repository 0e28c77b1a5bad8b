"""What a shape fit starts from: photos with a black ground, a sphere as large as their silhouettes,
and the light in that place; and how far the photos disagree on the found shape.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import photos, scenes
from spectrabox.reconstruct.rendering.renderer import load_scene
from spectrabox.reconstruct.scene import scene_file, stated
from spectrabox.reconstruct.scene.scene_xml import scene_xml

if TYPE_CHECKING:
    import mitsuba as mi

SHOWN = 0.05            # of the photo's bright pixels: where the object is taken to be
DARK_GROUND = 0.02      # of the photo's bright pixels: so bright may a ground without mask be
BRIGHT = 99.0           # percentile
DIRECTIONS = 4096       # of the light
LEAST_PIXELS = 16       # of a silhouette


def cut_out(photo: photos.LinearImage, mask: np.ndarray, name: str) -> photos.LinearImage:
    """The photo with a black ground.

    Parameters
    ----------
    photo : LinearImage
        (H, W, K).
    mask : (H, W) array
        Share of each pixel that shows the object, 0 to 1, or bool.
    name : str
        Of the photo, for errors.

    Raises
    ------
    InputError
        If the mask is not of the photo's size.
    """
    share = np.asarray(mask, dtype=np.float32)
    if share.shape != photo.signal.shape[:2]:
        raise InputError(f"the mask of {name} has the shape {share.shape}, and the photo has "
                         f"{photo.signal.shape[:2]} (height, width); give one value a pixel")
    if share.min() < 0 or share.max() > 1:
        raise InputError(f"the mask of {name} has values from {share.min():g} to {share.max():g}; "
                         "0 to 1 is needed, or True and False: the share that shows the object")
    share = share[..., None]
    return dataclasses.replace(photo, signal=photo.signal * share,
                               variance=photo.variance * share**2,
                               saturated=photo.saturated & (share > 0))


def object_pixels(photo: photos.LinearImage, name: str) -> np.ndarray:
    """Pixels (H, W) bool that show the object, of a photo with a black ground.

    Parameters
    ----------
    photo : LinearImage
    name : str
        Of the photo, for errors.

    Raises
    ------
    InputError
        If the ground is bright, the object leaves the picture, or there is none.
    """
    grey = photo.signal.mean(axis=2)
    bright = np.percentile(grey, BRIGHT)
    if not bright > 0:
        raise InputError(f"{name} shows nothing: all is black")
    edge = np.concatenate([grey[0], grey[-1], grey[1:-1, 0], grey[1:-1, -1]])
    if np.median(edge) > DARK_GROUND * bright:
        raise InputError(f"the ground of {name} is {np.median(edge) / bright:.0%} as bright as the "
                         f"object; at most {DARK_GROUND:.0%} can be taken for black: give masks=, "
                         "or photograph before black cloth")
    if np.mean(edge > SHOWN * bright) > SHOWN:
        raise InputError(f"the object in {name} reaches the picture's edge; all of it must be "
                         "seen, on a dark ground or within its mask")
    shown = grey > SHOWN * bright
    if np.count_nonzero(shown) < LEAST_PIXELS:
        raise InputError(f"the object in {name} covers {np.count_nonzero(shown)} pixels of the "
                         f"compared picture; at least {LEAST_PIXELS} are needed: give a larger "
                         "width=")
    return np.asarray(shown)


def sphere_of_silhouettes(pictures: Sequence[tuple[mi.Scene, np.ndarray]]
                          ) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of a sphere in the place and of the size of the silhouettes.

    The centre is the point nearest the rays through the silhouettes' middles; the radius is the
    median over the pictures of that of a disc whose angles from its middle have the same mean
    square.

    Parameters
    ----------
    pictures : sequence of (mi.Scene, (H, W) bool)
        Scene with its camera, and the pixels that show the object.
    """
    import mitsuba as mi

    system, right, rays = np.zeros((3, 3)), np.zeros(3), []
    for scene, shown in pictures:
        height, width = shown.shape
        rows, columns = np.nonzero(shown)
        ray, _ = scene.sensors()[0].sample_ray(
            0.0, 0.5, mi.Point2f((columns + 0.5) / width, (rows + 0.5) / height), mi.Point2f(0.5))
        directions = np.array(ray.d, dtype=float).reshape(3, -1).T
        origin = np.array(ray.o, dtype=float).reshape(3, -1).mean(axis=1)
        middle = directions.mean(axis=0)
        middle /= np.linalg.norm(middle)
        across = np.eye(3) - np.outer(middle, middle)
        system, right = system + across, right + across @ origin
        angles = np.arccos(np.clip(directions @ middle, -1, 1))
        rays.append((origin, float(np.sqrt(2 * np.mean(angles**2)))))
    centre = np.linalg.solve(system, right)
    return centre, float(np.median([np.linalg.norm(centre - origin) * np.sin(angle)
                                    for origin, angle in rays]))


def light_on_card(scene_file: scene_file.SceneFile, point: np.ndarray) -> float:
    """Irradiance on a card at a point, turned to the light and in nothing's shadow, for lights
    whose strongest has the spectrum 1.

    Parameters
    ----------
    scene_file : SceneFile
    point : (3,) array
        In its unit.

    Raises
    ------
    InputError
        If no light reaches the point.
    """
    import drjit as dr
    import mitsuba as mi

    ones = np.ones(2)
    scene = load_scene(scene_xml(scene_file, reflectances=dict.fromkeys(scene_file.bsdf_ids, ones),
                                 light=stated.strengths(scene_file), bands={"one": ones},
                                 range_nm=(400.0, 700.0), size=(4, 4), integrator="path"))
    interaction: Any = dr.zeros(mi.SurfaceInteraction3f)
    interaction.p = mi.Point3f(*point.tolist())
    interaction.wavelengths = mi.Spectrum(550.0)
    numbers = np.random.default_rng(0).random((2, DIRECTIONS)).astype(np.float32)
    towards, weight = scene.sample_emitter_direction(interaction, mi.Point2f(*numbers), False)
    directions = np.broadcast_to(np.array(towards.d, dtype=float).reshape(3, -1).T,
                                 (DIRECTIONS, 3))
    radiance = np.broadcast_to(np.array(weight[0], dtype=float), DIRECTIONS)
    facing = radiance @ directions
    if not np.linalg.norm(facing) > 0:
        raise InputError(f"{scene_file.path.name}: no light reaches the object's middle "
                         f"({', '.join(f'{value:g}' for value in point)})")
    facing /= np.linalg.norm(facing)
    return float(np.mean(radiance * np.maximum(directions @ facing, 0.0)))


def read_closed_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and faces (F, 3) of a PLY file.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    scene = load_scene('<scene version="3.0.0"><shape type="ply" id="object"><string '
                       f'name="filename" value="{path.resolve()}"/></shape></scene>')
    mesh = scene.shapes()[0]
    vertices = np.array(mesh.vertex_positions_buffer(), dtype=float).reshape(-1, 3)
    faces = np.array(mesh.faces_buffer(), dtype=int).reshape(-1, 3)
    return closed_mesh(vertices, faces, path.name)


def closed_mesh(vertices: np.ndarray, faces: np.ndarray, name: str
                ) -> tuple[np.ndarray, np.ndarray]:
    """The mesh, vertices that lie in one place joined.

    Parameters
    ----------
    vertices : (V, 3) array
    faces : (F, 3) int
    name : str
        For errors.

    Raises
    ------
    InputError
        If an edge has one face, or more than two.
    """
    unique, index = np.unique(vertices, axis=0, return_inverse=True)
    joined = index.reshape(-1)[faces]
    edges = np.sort(joined[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    count = np.unique(edges, axis=0, return_counts=True)[1]
    if np.any(count != 2):
        raise InputError(f"the mesh {name} is not closed: {np.count_nonzero(count != 2)} of its "
                         f"{count.size} edges do not have two faces; close its holes")
    return unique, joined


def signal_of_photos(found: Sequence[scenes.Reconstruction],
                     material: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A material's signal by all photos that tell of it, and how far each by itself is from it.

    Parameters
    ----------
    found : sequence of Reconstruction
        Of one object, each from one photo on the found shape.
    material : str
        Known in the records of photos that do not tell of it.

    Returns
    -------
    signal : (K,) array
        Relative to white; the mean over the photos.
    noise : (K, K) array
        Its covariance by the noise of photos and renderings.
    apart : (V, K) array
        Logarithm of each photo's signal over the mean. Neighbouring photos see the same error of
        the shape, so their scatter itself, undivided, is the shape's part of the signal's error.
    """
    own = [(one, index) for one in found for index, name in enumerate(one.materials)
           if name == material and not one.known[index]]
    signals = np.array([one.signal[index] for one, index in own])
    mean = signals.mean(axis=0)
    noise = np.mean([one.signal_covariance[index] for one, index in own], axis=0) / len(own)
    return mean, noise, np.log(signals / mean)
