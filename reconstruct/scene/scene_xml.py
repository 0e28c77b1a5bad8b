"""A scene with the session's spectra in place of its own, as XML text for Mitsuba."""
from __future__ import annotations

import copy
import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import plain
from spectrabox.reconstruct.scene import import_scene, plugins, scene_file

SPECTRUM_TAGS = ("spectrum", "rgb", "texture")
# in place of a reflectance of 0 at all wavelengths: Mitsuba refuses a spectrum without any mass
BLACK = 1e-6
DARK = 1e-12            # and of a light that is switched off
NO_TEXTURES: Mapping[str, Path] = {}


def scene_xml(scene: scene_file.SceneFile, *, reflectances: Mapping[str, np.ndarray],
              light: np.ndarray | Mapping[str, np.ndarray], bands: Mapping[str, np.ndarray],
              range_nm: tuple[float, float], size: tuple[int, int],
              integrator: str = "prb", textures: Mapping[str, Path] = NO_TEXTURES) -> str:
    """The scene as XML text with the session's spectra in place of its own.

    Parameters
    ----------
    scene : SceneFile
    reflectances : mapping of BSDF id to (P,)
        Reflectance at uniform wavelengths over ``range_nm``.
    light : (P,) array, or mapping of light id to (P,)
        Spectrum of every emitter, or of each.
    bands : mapping of band name to (P,)
        Camera sensitivities; the film's channels, in this order.
    range_nm : (float, float)
        First and last wavelength.
    size : (width, height)
        Of the film in pixels.
    integrator : str
        Mitsuba's name of it; it gets the scene's ``max_depth``.
    textures : mapping
        From ids of shapes to spectral EXR files of their reflectance.

    Raises
    ------
    InputError
        If a BSDF has no reflectance spectrum, a light no spectrum, or a light with an
        angular profile or a map of the sky is asked for with any spectrum but 1: a rendering would
        not be of that light.
    """
    root = _with_reflectances(scene, reflectances, range_nm)
    _set_textures(root, scene, textures)
    import_scene.write_out_defaults(root)
    root.set("version", import_scene.CURRENT)
    for node in root.iter("emitter"):
        _set_light(node, scene_file.light_id(root, node), light, range_nm, scene.path.name)
    for node, attribute in plugins.file_attributes(root):
        # Mitsuba gets text, no folder
        node.set(attribute, str((scene.path.parent / node.get(attribute, "")).resolve()))
    sensor = root.find("sensor")
    assert sensor is not None
    for child in [child for child in sensor if child.tag in ("film", "sampler")]:
        sensor.remove(child)
    film = ET.SubElement(sensor, "film", type="specfilm")
    ET.SubElement(film, "integer", name="width", value=str(size[0]))
    ET.SubElement(film, "integer", name="height", value=str(size[1]))
    ET.SubElement(film, "string", name="component_format", value="float32")
    ET.SubElement(film, "rfilter", type="box")
    for number, (name, values) in enumerate(bands.items()):
        # Mitsuba sorts channels by name
        film.append(_regular(f"band_{number:03d}_{name}", values, range_nm))
    ET.SubElement(sensor, "sampler", type="independent")
    for child in root.findall("integrator"):
        root.remove(child)
    node = ET.SubElement(root, "integrator", type=integrator)
    ET.SubElement(node, "integer", name="max_depth", value=str(scene.max_depth))
    # no Russian roulette: its noise feeds the gradient
    ET.SubElement(node, "integer", name="rr_depth", value="1000")
    return ET.tostring(root, encoding="unicode")


def materials_xml(reflectances: Mapping[str, np.ndarray], range_nm: tuple[float, float],
                  scene: scene_file.SceneFile | None = None, folder: Path | None = None,
                  textures: Mapping[str, Path] = NO_TEXTURES) -> str:
    """BSDFs that a stock Mitsuba loads, as XML text of a scene to ``<include>``.

    Parameters
    ----------
    reflectances : mapping of BSDF id to (P,)
        Evenly spaced over ``range_nm``.
    range_nm : (float, float)
        First and last wavelength.
    scene : SceneFile, optional
        Whose BSDFs they are: coats, metals and what stands around them stay. Diffuse without one.
    folder : Path, optional
        Where the text will lie: files that BSDFs name are seen from there.
    textures : mapping
        As of ``scene_xml``: a BSDF more for each, of id "BSDF of SHAPE".
    """
    root = ET.Element("scene", version="3.0.0")
    if scene is not None:
        own = _with_reflectances(scene, reflectances, range_nm)
        bsdfs = [node for node in own.findall("bsdf") if node.get("id") in reflectances]
        bsdfs += _set_textures(own, scene, textures)
        named = {ref.get("id") for bsdf in bsdfs for ref in bsdf.iter("ref")}
        root.extend(node for node in own.findall("texture") if node.get("id") in named)
        root.extend(bsdfs)
        _name_files_from(root, scene, folder or scene.path.parent)
    else:
        for identity, values in reflectances.items():
            node = ET.SubElement(root, "bsdf", type="diffuse", id=plain(identity))
            node.append(_reflectance("reflectance", values, range_nm))
    return _indented(root)


def recovered_xml(scene: scene_file.SceneFile, reflectances: Mapping[str, np.ndarray],
                  range_nm: tuple[float, float], folder: Path,
                  textures: Mapping[str, Path] = NO_TEXTURES) -> str:
    """A scene with recovered reflectances in its BSDFs, as XML text that a stock Mitsuba loads;
    camera, film, integrator and lights stay, but for measured profiles, which Mitsuba does not
    know.

    Parameters
    ----------
    scene : SceneFile
    reflectances : mapping of BSDF id to (P,)
        Evenly spaced over ``range_nm``.
    range_nm : (float, float)
        First and last wavelength.
    folder : Path
        Where the text will lie: files that the scene names are seen from there.
    textures : mapping
        As of ``scene_xml``; a Mitsuba that renders them needs ``register_spectral_texture``.
    """
    root = _with_reflectances(scene, reflectances, range_nm)
    _set_textures(root, scene, textures)
    for emitter in root.iter("emitter"):
        for node in [
                each for each in emitter.findall("string") if each.get("name") == scene_file.PROFILE
        ]:
            emitter.remove(node)
    _name_files_from(root, scene, folder)
    return _indented(root)


def _with_reflectances(scene: scene_file.SceneFile, reflectances: Mapping[str, np.ndarray],
                       range_nm: tuple[float, float]) -> ET.Element:
    """A copy of the scene's XML with spectra in its BSDFs."""
    root = copy.deepcopy(scene.root)
    for node in root.findall("bsdf"):
        if (values := reflectances.get(node.get("id", ""))) is not None:
            _set_reflectance(node, values, range_nm, scene.path.name)
    return root


def _set_textures(root: ET.Element, scene: scene_file.SceneFile,
                  textures: Mapping[str, Path]) -> list[ET.Element]:
    """Give surfaces the spectra of files in place of their one spectrum, in place; the BSDFs."""
    bsdfs = []
    for shape in root.iter("shape"):
        if (file := textures.get(shape.get("id", ""))) is None:
            continue
        own = scene.surfaces[shape.get("id", "")]
        bsdf = ET.Element("bsdf", type="diffuse", id=f"{own} of {shape.get('id')}")
        texture = ET.SubElement(bsdf, "texture", name="reflectance", type=plugins.SPECTRAL_PICTURE)
        ET.SubElement(texture, "string", name="filename", value=str(file.resolve()))
        node = next(ref for ref in shape.findall("ref") if ref.get("id") == own)
        node.set("id", bsdf.get("id", ""))
        bsdfs.append(bsdf)
    root.extend(bsdfs)
    return bsdfs


def _name_files_from(root: ET.Element, scene: scene_file.SceneFile, folder: Path) -> None:
    """Name the files of a scene as they are seen from a folder."""
    for node, attribute in plugins.file_attributes(root):
        file = scene.path.parent.resolve() / node.get(attribute, "")
        node.set(attribute, Path(os.path.relpath(file, folder.resolve())).as_posix())


def _indented(root: ET.Element) -> str:
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _set_light(node: ET.Element, name: str, light: np.ndarray | Mapping[str, np.ndarray],
               range_nm: tuple[float, float], file: str) -> None:
    """Put a spectrum into an emitter, and take its profile out; refuse a spectrum that a rendering
    of a profile or a map of the sky would not show.
    """
    shaped = [child for child in node.findall("string") if child.get("name") == scene_file.PROFILE]
    sky = node.get("type") == import_scene.SKY_MAP
    spectrum = light if isinstance(light, np.ndarray) else light.get(name)
    if (shaped or sky) and (spectrum is None or np.any(spectrum != spectrum[0]) or (
            isinstance(light, np.ndarray) and spectrum[0] != 1)):
        what = "measured profile" if shaped else "map of the sky"
        raise InputError(f"{file}: only the transport engine knows the {what} of {name!r}; set "
                         "[reconstruct] engine = \"transport\", or take it out")
    if spectrum is None:
        raise InputError(f"{file}: the light {name!r} has no spectrum; it is given for "
                         f"{', '.join(light)}")
    emitted = import_scene.EMITTED.get(node.get("type", ""))
    for child in [*shaped, *(child for child in node if child.get("name") == emitted and not sky)]:
        node.remove(child)
    if emitted is not None:     # a map of the sky has its picture
        node.append(_regular(emitted, spectrum if np.any(spectrum > 0)
                             else np.full(len(spectrum), DARK), range_nm))


def _set_reflectance(node: ET.Element, values: np.ndarray, range_nm: tuple[float, float],
                     file: str) -> None:
    """Put a spectrum into a BSDF: coats and metals stay, anything else with a reflectance becomes
    diffuse, whatever its plugin is called.
    """
    inner = import_scene.plain_bsdf(node)
    kind = inner.get("type", "")
    names = [child.get("name") for child in inner if child.tag in SPECTRUM_TAGS]
    if kind in import_scene.SPECTRAL_FACTOR:
        for child in [
                child for child in inner if child.get("name") == import_scene.SPECTRAL_FACTOR[kind]
        ]:
            inner.remove(child)
        inner.append(_reflectance(import_scene.SPECTRAL_FACTOR[kind], values, range_nm))
        return
    if kind != "diffuse" and "reflectance" not in names:
        raise InputError(f"{file}: the BSDF {node.get('id')!r} is of type {kind!r}, which has no "
                         "reflectance spectrum to be estimated; use diffuse, "
                         f"{', '.join(import_scene.SPECTRAL_FACTOR)}")
    for child in list(inner):
        inner.remove(child)
    inner.set("type", "diffuse")
    inner.append(_reflectance("reflectance", values, range_nm))


def _reflectance(name: str, values: np.ndarray, range_nm: tuple[float, float]) -> ET.Element:
    return _regular(name, values if np.any(values > 0) else np.full(len(values), BLACK), range_nm)


def _regular(name: str, values: np.ndarray, range_nm: tuple[float, float]) -> ET.Element:
    node = ET.Element("spectrum", name=name, type="regular")
    ET.SubElement(node, "float", name="wavelength_min", value=f"{range_nm[0]:g}")
    ET.SubElement(node, "float", name="wavelength_max", value=f"{range_nm[1]:g}")
    ET.SubElement(node, "string", name="values",
                  value=", ".join(f"{value:.9g}" for value in values))
    return node
