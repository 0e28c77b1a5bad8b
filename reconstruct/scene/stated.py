"""What a scene file may state, and what is done with each statement: honoured, honoured with a
limit, or refused.

The one list of it; ``docs/reference/scenes.md`` shows it as a table (``reference_table``). What the
functions here refuse or name follows the list: a statement that would change the picture and is
not kept is refused with what to do, or is a finding, ``scene.left-out``.
"""
from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.system.words import is_number
from spectrabox.reconstruct.scene import import_scene, plugins

if TYPE_CHECKING:
    from spectrabox.reconstruct.scene.scene_file import SceneFile

HONOURED, LIMITED, REFUSED = "honoured", "honoured with a limit", "refused"

# What is stated; what is done with it; how, or what to write instead.
STATEMENTS: tuple[tuple[str, str, str], ...] = (
    ("shapes, their places, meshes, groups and instances", HONOURED, "as Mitsuba has them"),
    ("camera of type `perspective` or `orthographic`, its pose, field of view, principal point and "
     "clipping distances", HONOURED, "of several cameras the first; the others are named"),
    ("film `width` and `height`", HONOURED, "the shape of the photo"),
    ("integrator `max_depth`", HONOURED, "most segments of a path; 12 where it is -1"),
    ("integrator `type`, its other parameters, film, sampler and reconstruction filter", LIMITED,
     "replaced in every rendering; kept in scenes that are written again; `hide_emitters` is "
     "named"),
    ("several lights: their relative strengths and colours", HONOURED,
     "radiance, intensity or irradiance as Mitsuba reads it, each relative to the strongest; one "
     "common scale is estimated. The light of the session is that of the strongest; `light.by_id` "
     "or `lights=` replaces what the file states of a light"),
    ("strength and colour of a single light", LIMITED,
     "a placeholder: light spectrum and scale are the session's"),
    ("an area light's `profile`", LIMITED, "diffuse scenes only"),
    ("`envmap`", LIMITED, "diffuse scenes only; grey: its picture gives the radiance by direction, "
     "the session's light its colour"),
    ("a light with a `<texture>` (area, spot, projector)", REFUSED,
     "give it a plain spectrum, or cut the shape into lights of one radiance each"),
    ("BSDF `diffuse`", HONOURED, "its reflectance is a placeholder of what is estimated"),
    ("BSDF `roughconductor` without `material`, `eta` and `k`", HONOURED,
     "its `specular_reflectance` is estimated, traced as that of diffuse surfaces"),
    ("BSDF `plastic`, `roughplastic`, `conductor`, `principled`, other `roughconductor`", LIMITED,
     "by descent, one photo: `diffuse_reflectance`, `specular_reflectance` of metals or "
     "`base_color` is estimated; all else, textures of roughness among it, stays as stated"),
    ("`principled` with `metallic`", LIMITED, "by descent: `base_color` colours the mirrored "
     "light too"),
    ("`principled` with `spec_trans`", REFUSED,
     "light goes through it: set spec_trans to 0, or model what is behind it as a surface"),
    ("BSDF `twosided`", HONOURED, "one BSDF for both sides"),
    ("BSDF `mask`, `blendbsdf`, `bumpmap`, `normalmap`, `null`, `dielectric` and others without a "
     "reflectance", REFUSED, "put a plain BSDF in its place"),
    ("BSDF of another program's plugin with a `reflectance`", LIMITED,
     "read as diffuse; its other parameters are named; with a `transmittance` it is refused"),
    ("a picture or pattern as reflectance", REFUSED,
     "a material has one spectrum: give it a plain reflectance; a picture of spectra "
     "(`[picture]`, `picture=`) finds the pattern; a pattern of known spectra is taken as known "
     "materials after `sb.split_texture`"),
    ("a medium around or inside of shapes (fog)", REFUSED,
     "its light is not traced: take <medium> and the references to it out"),
    ("camera of type `thinlens`", REFUSED,
     "write type=\"perspective\": the photo is taken as sharp everywhere"),
    ("camera of another type", REFUSED, "it takes no picture: write type=\"perspective\""),
    ("film `crop_width`, `crop_height`, `crop_offset_x`, `crop_offset_y`", REFUSED,
     "give the whole photo and take the crop out, or state the part's own size and "
     "principal_point_offset_x and _y"),
)

CAMERAS = ("perspective", "orthographic")
CROPS = ("crop_width", "crop_height", "crop_offset_x", "crop_offset_y")
SAME_COLOUR = 1e-3      # relative: spectra of lights closer than this differ in strength alone


def reference_table() -> str:
    """The list as a table of Markdown."""
    rows = [f"| {what} | {done} | {how} |" for what, done, how in STATEMENTS]
    return "\n".join(["| stated | what is done | how |", "|---|---|---|", *rows])


# ---- refused -------------------------------------------------------------------------------------

def refusals(root: ET.Element) -> list[str]:
    """Sentences about statements that would change the picture and cannot be honoured.

    Parameters
    ----------
    root : Element
        A <scene> in Mitsuba 3's own names, includes resolved and BSDFs at the top.
    """
    defaults = import_scene.defaults_of(root)

    def value(node: ET.Element) -> str:
        return import_scene.substitute_defaults(node.get("value", ""), defaults)
    return [*_fog(root), *_camera(root), *_crop(root, value), *_lights(root),
            *_transmitted(root, value)]


def _fog(root: ET.Element) -> Iterator[str]:
    media = {node.get("id") for node in root.findall("medium")}
    for node in root.iter():
        for child in node:
            inside = node.tag in ("shape", "sensor", "emitter") and (
                child.tag == "medium" or (child.tag == "ref" and child.get("id") in media))
            if inside:
                yield (f"the {node.tag} {node.get('id') or node.get('type', '')!r} is in a medium, "
                       "and light that fog or smoke scatters is not traced: take <medium> and the "
                       "references to it out; a photo of fog gives no spectra of surfaces")


def _camera(root: ET.Element) -> Iterator[str]:
    sensor = root.find("sensor")
    kind = "" if sensor is None else sensor.get("type", "")
    if kind == "thinlens":
        yield ("the camera is of type 'thinlens', whose blur is not rendered: write "
               "type=\"perspective\" and take aperture_radius and focus_distance out")
    elif sensor is not None and kind not in CAMERAS:
        yield (f"the camera is of type {kind!r}, which takes no picture; write "
               "type=\"perspective\"")


def _crop(root: ET.Element, value: Any) -> Iterator[str]:
    film = root.find("sensor/film")
    if film is None:
        return
    stated = {node.get("name", ""): value(node) for node in film.iter("integer")}
    crops = [name for name in CROPS if name in stated and stated[name] != (
        stated.get(name.removeprefix("crop_"), "") if "offset" not in name else "0")]
    if crops:
        yield (f"the film is cropped ({', '.join(crops)}), and a photo is compared with the whole "
               "film: give the whole photo and take the crop out, or state the part's own width, "
               "height, fov and principal point")


def _lights(root: ET.Element) -> Iterator[str]:
    textures = {node.get("id") for node in root.findall("texture")}
    for light in root.iter("emitter"):
        textured = [child for child in light if (
            child.tag == "texture" and child.get("type") in import_scene.PICTURES)
            or (child.tag == "ref" and child.get("id") in textures)]
        if textured:
            yield (f"a light of type {light.get('type')!r} has a texture, whose pattern is not "
                   "traced: give it a plain spectrum, or cut its shape into lights of one "
                   "radiance each")


def _transmitted(root: ET.Element, value: Any) -> Iterator[str]:
    for bsdf in root.iter("bsdf"):
        for node in bsdf:
            if bsdf.get("type") == "principled" and node.get("name") == "spec_trans" \
                    and not (is_number(value(node)) and float(value(node)) == 0):
                yield (f"the BSDF {bsdf.get('id')!r} lets light through (spec_trans): set it to 0, "
                       "or model what is behind it as a surface")


# ---- named ---------------------------------------------------------------------------------------

def left_out(root: ET.Element) -> list[Finding]:
    """A finding, ``scene.left-out``, for each statement that is read and not kept.

    Parameters
    ----------
    root : Element
        A <scene> in Mitsuba 3's own names, includes resolved.
    """
    found = [_named("sensor", node.get("id", node.get("type", "")), ["another camera"])
             for node in root.findall("sensor")[1:]]
    for node in root.findall("integrator"):
        if any(child.get("name") == "hide_emitters" and child.get("value") == "true"
               for child in node.iter("boolean")):
            found.append(_named("integrator", node.get("type", ""), ["hide_emitters"]))
    return found


def _named(element: str, subject: str, parameters: list[str]) -> Finding:
    return Finding("scene.left-out", Severity.NOTE, subject,
                   {"element": element, "parameters": parameters})


# ---- lights --------------------------------------------------------------------------------------

def relative_lights(scene: SceneFile, nm: np.ndarray) -> dict[str, np.ndarray]:
    """What a scene states of each of its lights, relative to the strongest: (P,) by id.

    A map of the sky states a grey picture: it is 1, and the others are relative to it. A grey
    <rgb>, which Mitsuba gives the colour of daylight, and a plain value, which it does not, differ
    in strength alone where no light states a colour. Mitsuba is started, and reads the spectra; of
    a single light it is not asked.

    Parameters
    ----------
    scene : SceneFile
    nm : (P,) array
        Wavelengths.

    Raises
    ------
    InputError
        If no light emits anything.
    """
    names = [*dict.fromkeys(scene.light_ids)]
    if len(names) < 2:
        return {name: np.ones(nm.size) for name in names}
    stated = dict(zip(scene.light_ids, (_emission(scene, node, nm)
                                        for node in scene.root.iter("emitter")), strict=True))
    daylight = _spectrum_of("", nm)
    plain = {name: next((float(one.mean()) for one in (values, values / daylight)
                         if strength(one) is not None), None) for name, values in stated.items()}
    if None not in plain.values():
        stated = {name: np.full(nm.size, value) for name, value in plain.items()}
    sky = [name for name, node in zip(scene.light_ids, scene.root.iter("emitter"), strict=True)
           if node.get("type") == import_scene.SKY_MAP]
    first = sky[0] if sky else max(names, key=lambda name: float(stated[name].mean()))
    dark = stated[first] <= 0
    if dark.all():
        raise InputError(f"{scene.path.name}: none of its lights emits anything: state their "
                         "strengths beside each other")
    of_first = np.where(dark, 1.0, stated[first])
    return {name: np.where(dark, 0.0, values / of_first) for name, values in stated.items()}


def strength(relative: np.ndarray) -> float | None:
    """The one factor by which a light differs from the strongest; None where its colour differs.

    Parameters
    ----------
    relative : (P,) array
        As ``relative_lights`` gives it.
    """
    mean = float(relative.mean())
    return mean if float(np.ptp(relative)) <= SAME_COLOUR * max(mean, 1e-30) else None


def strengths(scene: SceneFile) -> dict[str, np.ndarray]:
    """Flat spectra (2,) of each light, its mean over wavelengths: for scenes of unit spectra."""
    nm = np.linspace(400.0, 700.0, 31)
    return {name: np.full(2, float(relative.mean()))
            for name, relative in relative_lights(scene, nm).items()}


def _emission(scene: SceneFile, light: ET.Element, nm: np.ndarray) -> np.ndarray:
    """Radiance, intensity or irradiance (P,) as Mitsuba reads it of a light."""
    kind = light.get("type", "")
    node = ET.Element("emitter", type="constant")
    name = import_scene.EMITTED.get(kind)
    shared = {each.get("id"): each for each in scene.root}
    for child in [] if name is None else light:
        if child.get("name") == name:
            one = copy.deepcopy(shared[child.get("id")] if child.tag == "ref" else child)
            one.set("name", "radiance")
            node.append(one)
    root = ET.Element("scene", version=import_scene.CURRENT)
    root.extend(scene.root.findall("default"))
    root.append(node)
    import_scene.write_out_defaults(root)
    plugins.require_harmless(root)
    for each in node.iter():
        if each.get("filename"):
            each.set("filename", str((scene.path.parent / each.get("filename", "")).resolve()))
    node.set("version", import_scene.CURRENT)
    return _spectrum_of(ET.tostring(node, encoding="unicode"), nm)


def _spectrum_of(node: str, nm: np.ndarray) -> np.ndarray:
    """Radiance (P,) of a constant emitter, as XML; of Mitsuba's own, its daylight, where it is
    empty.
    """
    import drjit as dr
    import mitsuba as mi

    emitter: Any = mi.load_string(
        node or f'<emitter version="{import_scene.CURRENT}" type="constant"/>')
    at: Any = dr.zeros(mi.SurfaceInteraction3f)
    at.wavelengths = mi.Spectrum(mi.Float(nm.astype(np.float32)))
    return np.array(emitter.eval(at)[0], dtype=float) * np.ones(nm.size)
