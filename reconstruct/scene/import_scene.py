"""Scenes as other programs write them, in the form that the rest of the code reads.

Exporters put BSDFs inside shapes or give none, refer to BSDFs among other things, and place copies
of a group of shapes as instances. All of it is written out here: every BSDF stands at the top with
an id, every shape refers to one, and an instance becomes the shapes of its group in their places.
"""
from __future__ import annotations

import copy
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from pathlib import Path

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import is_there, read_text
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.reconstruct.scene import plugins

MAX_INSTANCES = 10_000
GROUP, INSTANCE = "shapegroup", "instance"
# of BSDFs: what colours a whole surface, and so cannot be a picture
COLOURING = ("reflectance", "diffuse_reflectance", "base_color", "specular_reflectance")
MESHES = ("ply", "obj", "serialized")
PICTURES = ("bitmap", "checkerboard", "mesh_attribute", "volume")   # textures that are no spectrum
EMITTED = {"area": "radiance", "constant": "radiance", "point": "intensity", "spot": "intensity",
           "directional": "irradiance", "projector": "irradiance", "directionalarea": "radiance"}
# its picture gives the radiance by direction; its colours are Mitsuba's, not the light's
SKY_MAP = "envmap"
# BSDFs kept as they are, and the spectrum of each that is estimated
SPECTRAL_FACTOR = {"plastic": "diffuse_reflectance", "roughplastic": "diffuse_reflectance",
                   "principled": "base_color", "conductor": "specular_reflectance",
                   "roughconductor": "specular_reflectance"}
WRAPPERS = {"blendbsdf": "mixes two BSDFs", "mask": "is partly transparent",
            "bumpmap": "has bumps by a texture", "normalmap": "has bumps by a texture",
            "null": "lets all light through"}


def normalise_scene(root: ET.Element) -> list[str]:
    """Lift BSDFs out of shapes and instances out of their groups, in place.

    Parameters
    ----------
    root : Element
        A <scene>.

    Returns
    -------
    list of str
        A sentence for everything that is not understood, all at once.
    """
    problems = _expand_instances(root)
    _lift_bsdfs(root)
    problems += [f"shape {shape.get('id') or '(without id)'!r} is of type {shape.get('type')!r}; "
                 f"export it as a mesh ({', '.join(MESHES)})" for shape in root.iter("shape")
                 if shape.get("type") not in plugins.PLUGINS["shape"]]
    emitters = dict.fromkeys(node.get("type", "") for node in root.iter("emitter"))
    lights = plugins.PLUGINS["emitter"]
    problems += [f"emitter type {kind!r} is not supported; use one of {', '.join(lights)}"
                 for kind in emitters if kind not in lights]
    return problems + _without_spectrum(root)


def bsdf_of(shape: ET.Element, bsdf_ids: Iterable[str]) -> str:
    """Id of the BSDF that a shape refers to, among other references; empty where it has none."""
    references = list(shape.findall("ref"))
    known = set(bsdf_ids)
    for node in references:
        if node.get("name") == "bsdf" or node.get("id") in known:
            return node.get("id", "")
    return references[0].get("id", "") if references else ""


def _expand_instances(root: ET.Element) -> list[str]:
    groups = {node.get("id", ""): node for node in root.findall("shape")
              if node.get("type") == GROUP}
    instances = [node for node in root.findall("shape") if node.get("type") == INSTANCE]
    if len(instances) > MAX_INSTANCES:
        return [f"the scene has {len(instances)} instances; {MAX_INSTANCES} is the limit"]
    sizes = {name: sum(1 for _ in group.iter()) for name, group in groups.items()}
    written_out = sum(sizes.get(ref.get("id", ""), 0) for instance in instances
                      for ref in instance.findall("ref"))
    if written_out > plugins.MAX_ELEMENTS:
        return [f"the scene's instances have {written_out} elements together; "
                f"{plugins.MAX_ELEMENTS} is the limit: put their shapes into one mesh"]
    problems = []
    for number, instance in enumerate(instances, start=1):
        name = instance.get("id") or f"instance_{number}"
        reference = instance.find("ref")
        group = groups.get("" if reference is None else reference.get("id", ""))
        position = list(root).index(instance)
        root.remove(instance)
        if group is None:
            problems.append(f"instance {name!r} refers to no group of shapes in this file; export "
                            "the scene with its groups, or without instances")
            continue
        for index, shape in enumerate(group.findall("shape")):
            one = copy.deepcopy(shape)
            one.set("id", f"{name} {shape.get('id') or index + 1}")
            # the instance's transform comes after the shape's own
            own, by = one.find("transform"), instance.find("transform")
            if by is not None and own is None:
                one.append(copy.deepcopy(by))
            elif by is not None and own is not None:
                own.extend(copy.deepcopy(step) for step in by)
            root.insert(position + index, one)
    for group in groups.values():
        root.remove(group)
    return problems


def _lift_bsdfs(root: ET.Element) -> None:
    """Put BSDFs of shapes to the top, one of several that are written alike, and refer to them.

    A surface without any gets the plain BSDF that Mitsuba gives it, one for each.
    """
    taken = {node.get("id") for node in root.iter() if node.get("id")}
    shapes = [(node, f"{node.get('id') or f'shape_{number}'}_bsdf")
              for number, node in enumerate(root.iter("shape"), start=1)
              if node.find("emitter") is None]

    def added(bsdf: ET.Element, wanted: str) -> str:
        """Append a BSDF under an id of its own: no two things of a scene share one."""
        while wanted in taken:
            wanted += "_"
        taken.add(wanted)
        bsdf.set("id", wanted)
        root.append(bsdf)
        return wanted

    lifted: dict[str, str] = {}
    for shape, wanted in shapes:
        if (own := shape.find("bsdf")) is None:
            continue
        shape.remove(own)
        if (identity := own.get("id")) is not None:
            root.append(own)
        else:
            written = ET.tostring(own, encoding="unicode").strip()
            identity = lifted.get(written) or lifted.setdefault(written, added(own, wanted))
        ET.SubElement(shape, "ref", name="bsdf", id=identity)
    bsdfs = {node.get("id") for node in root.findall("bsdf")}
    for shape, wanted in shapes:
        if shape.get("type") not in (GROUP, INSTANCE) and not any(
                node.get("name") == "bsdf" or node.get("id") in bsdfs or node.get("name") is None
                for node in shape.findall("ref")):
            identity = added(ET.Element("bsdf", type="diffuse"), wanted)
            ET.SubElement(shape, "ref", name="bsdf", id=identity)


def make_foreign_bsdfs_diffuse(root: ET.Element) -> tuple[list[str], list[Finding]]:
    """BSDFs of other programs' plugins that have a reflectance become diffuse, in place.

    Mitsuba never sees such a type. Only one that is a plain word is taken for a plugin's name.

    Parameters
    ----------
    root : Element
        A <scene>; is changed.

    Returns
    -------
    problems : list of str
        A sentence about each that lets light through.
    findings : list of Finding
        ``scene.left-out``, of each whose other parameters are not kept.
    """
    problems, findings = [], []
    for bsdf in root.iter("bsdf"):
        kind = bsdf.get("type", "")
        kept = [child for child in bsdf if child.get("name") == "reflectance"]
        if kept and kind not in plugins.PLUGINS["bsdf"] and re.fullmatch(r"[A-Za-z]\w*", kind):
            name = bsdf.get("id") or kind
            others = [child.get("name") or child.tag for child in bsdf if child not in kept]
            if "transmittance" in others:
                problems.append(f"the BSDF {name!r} of type {kind!r} lets light through "
                                "(transmittance), which is not traced: take it out if the surface "
                                "is opaque, or model what is behind it as a surface")
            elif others:
                findings.append(Finding("scene.left-out", Severity.NOTE, name, {
                    "element": "bsdf", "parameters": others}))
            bsdf.set("type", "diffuse")
            bsdf[:] = kept
    return problems, findings


def plain_bsdf(node: ET.Element) -> ET.Element:
    """The BSDF itself, out of a <bsdf type="twosided"> around it."""
    inside = node.find("bsdf") if node.get("type") == "twosided" else None
    return node if inside is None else inside


def _without_spectrum(root: ET.Element) -> list[str]:
    """BSDFs of surfaces that have no one reflectance spectrum to be estimated."""
    textures = {node.get("id"): node.get("type") for node in root.findall("texture")}
    used = {node.get("id") for shape in root.iter("shape") if shape.find("emitter") is None
            for node in shape.findall("ref")}
    problems = []
    for bsdf in root.findall("bsdf"):
        if bsdf.get("id") not in used:
            continue
        name, inner = f"the BSDF {bsdf.get('id')!r}", plain_bsdf(bsdf)
        kind = inner.get("type", "")
        if len(bsdf.findall("bsdf")) > 1 and bsdf.get("type") == "twosided":
            problems.append(f"{name} has another BSDF on its back, and a material has one "
                            "spectrum; give the back a surface of its own")
        if kind in WRAPPERS:
            problems.append(f"{name} is of type {kind!r}, which {WRAPPERS[kind]}: put a plain BSDF "
                            "in its place")
        elif kind != "diffuse" and kind not in SPECTRAL_FACTOR \
                and not any(child.get("name") == "reflectance" for child in inner):
            problems.append(f"{name} is of type {kind!r}, which has no reflectance spectrum to be "
                            f"estimated; use diffuse, {', '.join(SPECTRAL_FACTOR)}")
        for node in bsdf.iter():
            texture = node.get("type") if node.tag == "texture" else \
                textures.get(node.get("id")) if node.tag == "ref" else None
            if texture is not None and node.get("name") in COLOURING:
                what = "a picture" if texture == "bitmap" else f"a texture of type {texture!r}"
                problems.append(f"{name} is coloured by {what}, and a material has one spectrum: "
                                "give it a plain reflectance (any value), and surfaces of other "
                                "paints BSDFs of their own; a texture that you know is cut into "
                                "known materials by sb.split_texture")
    return problems


# ---- several files -------------------------------------------------------------------------------
# A scene in several files, or of an older Mitsuba, as one tree of Mitsuba 3.
#
# ``<include>`` is replaced by what the file holds, ``<path>`` names folders in which files are
# looked for, ``$NAME`` in a file's name is the <default> of that name, and names of Mitsuba 0.x
# ("toWorld", "lookAt") become those of Mitsuba 3 ("to_world", "lookat").

MAX_INCLUDES = 100
RENAMED = {"lookAt": "lookat", "srgb": "rgb"}
CURRENT = "3.0.0"
# plugins of Mitsuba 0.x that Mitsuba 3 has under another name, or does without
OLD_TYPES = {"bsdf": {"roughdiffuse": "diffuse"},
             "integrator": dict.fromkeys(("bdpt", "pssmlt", "mlt", "erpt", "photonmapper", "ppm",
                                          "sppm", "vpl", "irrcache", "adaptive"), "path"),
             "sampler": dict.fromkeys(("halton", "hammersley", "sobol"), "independent"),
             "film": dict.fromkeys(("ldrfilm", "mfilm", "tiledhdrfilm"), "hdrfilm")}


def resolve_includes(root: ET.Element, scene: Path, inside: Path | None = None
                     ) -> tuple[list[Path], list[Path], list[str]]:
    """Replace every <include> and <path> of a <scene>, in place, and bring names up to date.

    Parameters
    ----------
    root : Element
        Is changed.
    scene : Path
        Its file.
    inside : Path, optional
        Included files must lie in here; None allows any.

    Returns
    -------
    files : list of Path
        That are included.
    folders : list of Path
        In which files are looked for.
    problems : list of str
        What is wrong with them.
    """
    files, folders, problems = list[Path](), [scene.parent], list[str]()
    _upgrade(root)
    elements = sum(1 for _ in root.iter())
    while (node := next((child for child in root if child.tag in ("include", "path")), None)
           ) is not None:
        position, defaults = list(root).index(node), defaults_of(root)
        root.remove(node)
        if node.tag == "path":
            folder = scene.parent / substitute_defaults(node.get("value", ""), defaults)
            folders.append(folder)
            continue
        name = substitute_defaults(node.get("filename", ""), defaults)
        file = find_file(name, folders)
        if file is None:
            problems.append(f"includes {name!r}, which is missing; copy it next to the scene")
            continue
        if inside is not None and not file.resolve().is_relative_to(inside.resolve()):
            problems.append(f"includes {name!r}, which lies outside the session folder; copy it "
                            "into scene/")
            continue
        if len(files) == MAX_INCLUDES:
            problems.append(f"includes more than {MAX_INCLUDES} files; {name!r} may include "
                            "itself")
            break
        files.append(file)
        folders.append(file.parent)
        if (part := _scene_of(file, problems)) is not None:
            _upgrade(part)
            elements += sum(1 for _ in part.iter())
            if elements > plugins.MAX_ELEMENTS:
                problems.append(f"has more than {plugins.MAX_ELEMENTS} elements with what it "
                                "includes; put its geometry into meshes")
                break
            for index, child in enumerate(list(part)):
                root.insert(position + index, child)
    return files, folders, problems


def defaults_of(root: ET.Element) -> dict[str, str]:
    """Values of a scene's <default>s by name; the first of a name counts.

    Raises
    ------
    InputError
        If a value is longer than any that a scene needs.
    """
    values: dict[str, str] = {}
    for node in root.iter("default"):
        values.setdefault(node.get("name", ""),
                          substitute_defaults(node.get("value", ""), values))
    return values


def substitute_defaults(text: str, defaults: Mapping[str, str]) -> str:
    """A value with every $NAME replaced by its default; one that has none stays.

    Parameters
    ----------
    text : str
    defaults : mapping

    Raises
    ------
    InputError
        If it becomes longer than any value that a scene needs.
    """
    if "$" not in text:
        return text
    names = re.findall(r"\$(\w+)", text)
    length = len(text) + sum(len(defaults.get(name, "")) for name in names)
    if length > plugins.MAX_VALUE:
        raise InputError(f"a value of the scene has {length} characters with its defaults in "
                         f"place; {plugins.MAX_VALUE} is the limit: write shorter defaults")
    return re.sub(r"\$(\w+)", lambda name: defaults.get(name[1], name[0]), text)


def write_out_defaults(root: ET.Element) -> None:
    """Replace every $NAME in a scene's values and types and take its <default>s out, in place: what
    was checked is then what Mitsuba gets, whatever its own rules of replacement are.

    Parameters
    ----------
    root : Element
        A <scene>; is changed.
    """
    defaults = defaults_of(root)
    for node in [*root.iter()]:
        for child in node.findall("default"):
            node.remove(child)
        for name, value in [*node.attrib.items()]:
            if "$" in value:
                node.set(name, substitute_defaults(value, defaults))


def find_file(name: str, folders: list[Path]) -> Path | None:
    """The first of some folders' files of a name, None where no folder has one.

    A pipe or a device is none: Mitsuba, or whoever reads it, would wait for it.
    """
    return next((folder / name for folder in folders
                 if is_there(folder / name) and (folder / name).is_file()), None)


def _scene_of(file: Path, problems: list[str]) -> ET.Element | None:
    """An included scene; None, and one more of the problems, where it is none."""
    try:
        root = plugins.parse_xml(read_text(file), file.name)
    except (InputError, OSError, ValueError) as error:
        problems.append(f"includes {file.name!r}, which cannot be read: {error}")
        return None
    if root.tag != "scene":
        problems.append(f"includes {file.name!r}, whose root is <{root.tag}>; <scene> is needed")
        return None
    return root


def _upgrade(root: ET.Element) -> None:
    """Names of Mitsuba 0.x become those that Mitsuba has since 2.0."""
    if not re.match(r"[01]\.", root.get("version", "")):
        return
    root.set("version", CURRENT)
    for node in root.iter():
        node.tag = RENAMED.get(node.tag, node.tag)
        if node.tag in OLD_TYPES and node.get("type") not in plugins.PLUGINS[node.tag]:
            old = OLD_TYPES[node.tag]
            node.set("type", old.get(node.get("type", ""), node.get("type", "")))
        if "name" in node.attrib and node.tag != "default":
            # "toWorld" becomes "to_world", "intIOR" "int_ior"
            node.set("name", re.sub(r"(?<=[a-z0-9])([A-Z]+)", r"_\1",
                                    node.get("name", "")).lower())
