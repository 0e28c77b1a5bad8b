"""A Mitsuba scene as an operator wrote it, read as XML without any renderer, with the angular
profile of a lamp.

The measured angular profile of a lamp: radiance by angle from its normal, 1 straight ahead.

A scene gives it to an area light as ``<string name="profile" value="lamp.csv"/>`` in the <emitter>.
It is what a spectroradiometer reads that looks at the lamp from several angles. A luminaire file
(IES) states intensity instead: divide by the cosine of the angle. The transport engine weighs every
path with it; Mitsuba has no such light.

A Mitsuba scene as an operator wrote it, read as XML without any renderer.

The scene gives geometry, camera pose and light position. ``scene_xml`` rewrites it: its BSDFs are
replaced by diffuse ones, coats and metals excepted, whose spectra are the materials of the session;
its emitters get the measured light spectrum, its film the camera's bands.
"""


from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.radiometry import files, findings
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.system.words import is_number
from spectrabox.reconstruct.scene import import_scene, plugins, stated

if TYPE_CHECKING:
    import numpy as np


STEP_DEG = 0.5
TABLE_DEG = np.arange(0.0, 90.0 + STEP_DEG / 2, STEP_DEG)
ROUND = 1e-6
COLUMNS = (2, 3)


def read_profile(path: Path) -> np.ndarray:
    """Relative radiance (181,) at ``TABLE_DEG``, 1 straight ahead.

    Linear between the angles; the last value holds up to 90 degrees.

    Parameters
    ----------
    path : Path
        File of rows "angle in degrees, radiance"; a first row may name them, and a third column
        may state standard errors.

    Raises
    ------
    InputError
        If rows are no pairs of numbers, the angles do not rise from 0 to at most 90, or a radiance
        is negative.
    """
    try:
        # Latin-1 holds every byte: a name in any alphabet may stand in the first row
        text = files.read_text(path, "latin-1")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); give the lamp's "
                         "profile") from None
    rows = [line.split(",") for line in text.splitlines() if line.strip("\xef\xbb\xbf ")]
    if rows and not is_number(rows[0][0]):
        rows = rows[1:]
    if len(rows) < 2 or not all(len(row) in COLUMNS and all(map(is_number, row)) for row in rows):
        raise InputError(f"{path.name}: a lamp's profile needs two rows or more of an angle in "
                         "degrees and a radiance, with a comma between them")
    angle, radiance = np.array([row[:2] for row in rows], dtype=float).T
    if not (np.all(np.diff(angle) > 0) and abs(angle[0]) < ROUND and angle[-1] <= 90 + ROUND):
        raise InputError(f"{path.name}: the angles of a lamp's profile must rise from 0 (straight "
                         "ahead) to at most 90")
    if radiance.min() < 0 or not radiance[0] > 0 or not np.isfinite(radiance).all():
        raise InputError(f"{path.name}: the radiances of a lamp's profile must be finite and not "
                         "negative, and positive straight ahead")
    return np.interp(TABLE_DEG, angle, radiance / radiance[0])


def profile_text(angle_deg: np.ndarray, radiance: np.ndarray, standard_error: np.ndarray) -> str:
    """A profile as ``read_profile`` reads it.

    Parameters
    ----------
    angle_deg, radiance, standard_error : (J,) arrays
    """
    rows = [f"{angle:.4g},{value:.6g},{error:.3g}" for angle, value, error in
            zip(angle_deg, radiance, standard_error, strict=True)]
    return "\n".join(["angle_deg,radiance,standard_error", *rows]) + "\n"


def relative_radiance(table: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Value of a profile, 0 or more, of the shape of ``cosine``.

    Parameters
    ----------
    table : (181,) array
        At ``TABLE_DEG``.
    cosine : array
        Of the angle from the lamp's normal.
    """
    return np.interp(np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))), TABLE_DEG, table)


# ---- a Mitsuba scene as an operator wrote it, read as XML without any renderer -------------------

MAX_DEPTH = 256         # reflections along a path; white walls leave 1e-6 of the light
MAX_SIDE = 100_000      # pixels of a film
SHOWN = 5               # files in a sentence
PROFILE = "profile"     # of an area light: a <string> that names its file; no Mitsuba knows it
MAX_ASPECT_ERROR = 0.01     # photo against film: above, the two do not show the same view


@dataclass(frozen=True)
class SceneFile:
    """What one XML scene says of itself. ``surfaces`` maps each shape id to the id of its BSDF."""

    path: Path
    root: ET.Element
    width: int
    height: int
    max_depth: int
    bsdf_ids: tuple[str, ...]
    surfaces: dict[str, str]
    light_ids: tuple[str, ...]
    files: tuple[Path, ...]     # meshes, textures and profiles that it names
    # light id -> table of light_profile.py
    profiles: Mapping[str, np.ndarray] = field(default_factory=dict)
    left_out: tuple[findings.Finding, ...] = ()  # what it states and nothing is made of

    @property
    def lamps(self) -> str:
        """Text of what emits light, with its place: the same where no lamp was moved."""
        shapes = [shape for shape in self.root.findall("shape")
                  if shape.find("emitter") is not None]
        return "".join(ET.tostring(lamp, encoding="unicode").strip()
                       for lamp in (*self.root.findall("emitter"), *shapes))


def read_scene(path: Path, folder: Path | None = None) -> SceneFile:
    """Parse and check a scene.

    Parameters
    ----------
    path : Path
        Mitsuba XML.
    folder : Path, optional
        Files that the scene names must lie in here; None allows any.

    Raises
    ------
    InputError
        If the file is missing, is no Mitsuba scene, has no sensor or emitter, names files outside
        ``folder``, or a plugin that is not on the list of ``plugins.py``.
    """
    try:
        text = files.read_text(path)
    except FileNotFoundError:
        raise InputError(f"{path} is missing: give the scene file or correct its name in "
                         "session.toml") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); give the scene file") from None
    except ValueError as error:         # no UTF-8
        raise InputError(f"{path.name} is not well-formed XML: {error}") from None
    return scene_of_text(text, path, folder)


def scene_of_text(text: str, path: Path, folder: Path | None = None) -> SceneFile:
    """As ``read_scene``, of XML that is not in a file yet.

    Parameters
    ----------
    text : str
        Mitsuba XML.
    path : Path
        Where it would lie: files that it names are seen from there.
    folder : Path, optional
        As of ``read_scene``.
    """
    root = parse_scene(text, path)
    included, folders, problems = import_scene.resolve_includes(root, path, folder)
    defaults = import_scene.defaults_of(root)
    for node in root.iter():        # as $integrator of scenes that offer several
        if "$" in node.get("type", ""):
            node.set("type", import_scene.substitute_defaults(node.get("type", ""), defaults))
    foreign, left_out = import_scene.make_foreign_bsdfs_diffuse(root)
    problems = [f"{path.name} {problem}" for problem in problems]
    problems += [f"{path.name}: {problem}" for problem in foreign]
    # normalise_scene says what else is possible for shapes and emitters
    problems += [f"{path.name}: {problem}"
                 for problem in plugins.plugin_problems(root, ("shape", "emitter"))]
    sensor = root.find("sensor")
    if sensor is None:
        problems.append(f"{path.name} has no <sensor>: the scene must hold the camera's pose and "
                        "field of view")
    problems += [f"{path.name}: {problem}" for problem in (
        *import_scene.normalise_scene(root), *stated.refusals(root))]
    # a picture that is refused is not looked for
    pictures = [
        node for texture in root.iter("texture") if texture.get("name") in import_scene.COLOURING
        for node in texture.iter("string")
    ] if problems else []
    named, missing = _named_files(root, path, folders, folder, pictures)
    files = tuple(dict.fromkeys(file.resolve() for file in (*included, *named)))
    lights = list(root.iter("emitter"))
    if not lights:
        missing.append(
            f"{path.name} has no <emitter>: the scene must hold the light at its position")
    if problems + missing or sensor is None:
        raise InputError("\n".join(problems + missing))
    # every shape gets an id, to tell surfaces from each other
    taken = {node.get("id") for node in root.iter() if node.get("id")}
    for number, shape in enumerate(root.iter("shape"), start=1):
        if not shape.get("id"):
            identity = f"shape_{number}"
            shape.set("id", identity if identity not in taken else f"surface_{number}")
    _name_lights(root, taken)
    film = sensor.find("film")
    integrator = root.find("integrator")
    width = _integer(film, "width", defaults, 768, path)
    height = _integer(film, "height", defaults, 576, path)
    depth = _integer(integrator, "max_depth", defaults, 8, path)
    if depth > MAX_DEPTH:
        raise InputError(f"{path.name} states max_depth = {depth}; {MAX_DEPTH} is the limit, "
                         "beyond which no light of a scene counts")
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise InputError(f"{path.name} states a film of {width} x {height} pixels; 1 to {MAX_SIDE} "
                         "along each side is possible")
    bsdfs = tuple(node.get("id", "") for node in root.findall("bsdf"))
    surfaces = {
        shape.get("id", ""): import_scene.bsdf_of(shape, bsdfs)
        for shape in root.iter("shape") if shape.find("emitter") is None
    }
    return SceneFile(path, root, width, height, depth if depth > 0 else 12, bsdfs, surfaces,
                     tuple(light_id(root, node) for node in lights), files, _profiles(root, path),
                     (*left_out, *stated.left_out(root)))


def _name_lights(root: ET.Element, taken: set[str | None]) -> None:
    """Give every light that stands by itself an id, its type, numbered where another has it: each
    has its own strength.
    """
    for light in root.findall("emitter"):
        if not light.get("id"):
            kind, number = light.get("type", ""), 2
            identity = kind
            while identity in taken:
                identity, number = f"{kind}_{number}", number + 1
            light.set("id", identity)
            taken.add(identity)


def check_materials(scene: SceneFile, bsdf_of_material: Mapping[str, str]) -> list[str]:
    """Sentences about materials and surfaces that do not match; empty when all is well.

    Parameters
    ----------
    scene : SceneFile
    bsdf_of_material : mapping of material name to BSDF id
    """
    problems = []
    used = set(scene.surfaces.values())
    for material, bsdf in bsdf_of_material.items():
        if bsdf not in scene.bsdf_ids:
            problems.append(f"material {material!r} names the BSDF {bsdf!r}, which "
                            f"{scene.path.name} lacks; it has "
                            f"{', '.join(scene.bsdf_ids) or 'none with an id'}")
        elif bsdf not in used:
            problems.append(f"material {material!r}: no surface in {scene.path.name} has the "
                            f"BSDF {bsdf!r}")
    for bsdf in sorted(used - set(bsdf_of_material.values())):
        shapes = ", ".join(shape for shape, name in scene.surfaces.items() if name == bsdf)
        problems.append(f"{scene.path.name}: the BSDF {bsdf or '(without id)'!r} of {shapes} has "
                        f"no material; add [materials.{bsdf or 'NAME'}] with bsdf = "
                        f"{bsdf or 'ID'!r} to session.toml")
    return problems


def not_plain_products(scene: SceneFile) -> tuple[str, ...]:
    """Ids of surfaces' BSDFs whose reflected light is not proportional to their spectrum."""
    used = set(scene.surfaces.values())
    return tuple(
        node.get("id", "") for node in scene.root.findall("bsdf") if node.get("id") in used
        and import_scene.plain_bsdf(node).get("type") in import_scene.SPECTRAL_FACTOR)


def needs_descent(scene: SceneFile) -> tuple[str, ...]:
    """Those of ``not_plain_products`` that the transport engine cannot trace: all but rough metals
    whose one spectrum is a factor on all that they mirror.

    A coat mirrors light beside what its spectrum colours, and the refractive index of a metal has
    a spectrum of its own.
    """
    plain = {node.get("id", "") for node in scene.root.findall("bsdf")
             if (inner := import_scene.plain_bsdf(node)).get("type") == "roughconductor"
             and not any(child.get("name") in ("material", "eta", "k") for child in inner)}
    return tuple(name for name in not_plain_products(scene) if name not in plain)


def estimated_spectrum(scene: SceneFile, bsdf: str) -> str:
    """Name of the parameter of a BSDF that is estimated, as scenes for the renderer have it.

    Parameters
    ----------
    scene : SceneFile
    bsdf : str
        Its id.
    """
    node = next(node for node in scene.root.findall("bsdf") if node.get("id") == bsdf)
    return import_scene.SPECTRAL_FACTOR.get(import_scene.plain_bsdf(node).get("type", ""),
                                            "reflectance")


def parse_scene(text: str, path: Path, comments: bool = False) -> ET.Element:
    """The <scene> of some XML.

    Parameters
    ----------
    text : str
    path : Path
        Of the file, for sentences.
    comments : bool
        Whether comments are kept.

    Raises
    ------
    InputError
        If it is not well-formed, larger than any scene is, or no Mitsuba scene.
    """
    root = plugins.parse_xml(text, path.name, comments)
    if root.tag != "scene":
        raise InputError(f"{path.name} is not a Mitsuba scene: its root is <{root.tag}>, <scene> "
                         "is needed")
    return root


def _named_files(root: ET.Element, path: Path, folders: list[Path], folder: Path | None,
                 left_out: list[ET.Element]) -> tuple[list[Path], list[str]]:
    """The files that a scene names, which it then names by the way to them, and sentences about
    those that cannot be used.
    """
    defaults, files, problems = import_scene.defaults_of(root), list[Path](), list[str]()
    missing: list[str] = []
    nodes = [(node, attribute) for node, attribute in plugins.file_attributes(root)
             if node not in left_out]
    nodes += [(node, "value") for node in root.iter("string") if node.get("name") == PROFILE]
    for node, attribute in nodes:
        name = import_scene.substitute_defaults(node.get(attribute, ""), defaults)
        if "$" in name:
            problems.append(f"{path.name} names the file {name!r} through a variable; write its "
                            "path out")
            continue
        file = import_scene.find_file(name, folders)
        target = (file or path.parent / name).resolve()
        if folder is not None and not target.is_relative_to(folder.resolve()):
            problems.append(f"{path.name} names {name!r}, which lies outside the session folder; "
                            "copy it into scene/")
        elif file is None:
            missing.append(name)
        else:
            files.append(target)
            if file != path.parent / name or name != node.get(attribute):
                node.set(attribute, os.path.relpath(target, path.parent))
    missing = [*dict.fromkeys(missing)]
    if len(missing) == 1:
        problems.append(f"{path.name} names {missing[0]!r}, which is missing")
    elif missing:
        more = f" and {len(missing) - SHOWN} more" if len(missing) > SHOWN else ""
        problems.append(f"{path.name} names {len(missing)} files that are missing: "
                        f"{', '.join(map(repr, missing[:SHOWN]))}{more}")
    return files, problems


def _profiles(root: ET.Element, path: Path) -> dict[str, np.ndarray]:
    profiles = {}
    for light in root.iter("emitter"):
        for node in [node for node in light.findall("string") if node.get("name") == PROFILE]:
            if light.get("type") != "area":
                raise InputError(f"{path.name}: only an area light can have a measured profile, "
                                 f"and {light_id(root, light)!r} is of type {light.get('type')!r}")
            profiles[light_id(root, light)] = read_profile(path.parent / node.get("value", ""))
    return profiles


def _integer(parent: ET.Element | None, name: str, defaults: Mapping[str, str], fallback: int,
             path: Path) -> int:
    node = None if parent is None else next((n for n in parent.iter("integer") if n.get("name")
                                             == name), None)
    if node is None:
        return fallback
    text = node.get("value", "")
    if text.startswith("$"):
        text = defaults.get(text[1:], text)
    try:
        return int(text)
    except ValueError:
        raise InputError(f"{path.name}: {name} is {text!r}; a whole number is needed") from None


def light_id(root: ET.Element, light: ET.Element) -> str:
    """Id of a light, or of the shape that emits it; its type where neither has one."""
    for shape in root.iter("shape"):
        if light in list(shape):
            return shape.get("id", "")
    return light.get("id", light.get("type", ""))


def require_same_shape(photo: LinearImage, scene: SceneFile, name: str) -> None:
    """Refuse a photo whose shape is not that of the scene's film.

    Parameters
    ----------
    photo : LinearImage
    scene : SceneFile
    name : str
        Of the photo's file, for the message.

    Raises
    ------
    InputError
        Naming both sizes.
    """
    height, width = photo.signal.shape[:2]
    mismatch = (width / height) / (scene.width / scene.height) - 1
    if abs(mismatch) > MAX_ASPECT_ERROR:
        full = (round(width * photo.sensor_step), round(height * photo.sensor_step))
        raise InputError(f"{name} is {full[0]} x {full[1]} pixels, but {scene.path.name} expects "
                         f"{scene.width} x {scene.height} ({mismatch:+.0%} in shape): give the "
                         "whole photo uncropped, or correct the film's width and height")
