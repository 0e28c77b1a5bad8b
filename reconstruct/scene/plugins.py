"""What the XML of a scene may hold: its size, its elements, and the plugins that it may name.

Mitsuba loads ``plugins/TYPE.so`` for the ``type`` of an element, so a type that holds ``..`` would
run a library that lies anywhere. A scene may come from a stranger: it names plugins of this list
alone, which are Mitsuba's own. ``docs/reference/scenes.md`` has the list as a table.
"""
from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import plain

MAX_BYTES = 20_000_000      # of one file: 10,000 shapes take about 5 MB
MAX_ELEMENTS = 500_000      # of a scene with all that it includes, its instances written out
MAX_DEPTH = 64              # elements inside each other: exporters write up to 8
MAX_VALUE = 10_000          # characters of a value, its $NAMES replaced

_SPECTRA = ("uniform", "regular", "irregular", "d65", "blackbody", "srgb", "rawconstant")

# By element. Left out on purpose: measured, measured_polarized, gridvolume and sdfgrid, whose files
# are not checked; batch (several cameras); blender (takes addresses in memory); sunsky (no light
# whose spectrum a session can state); the kernels of a Gaussian splat.
PLUGINS: dict[str, tuple[str, ...]] = {
    "bsdf": ("diffuse", "plastic", "roughplastic", "principled", "principledthin", "conductor",
             "roughconductor", "dielectric", "thindielectric", "roughdielectric", "twosided",
             "mask", "blendbsdf", "bumpmap", "normalmap", "null", "hair", "pplastic", "polarizer",
             "retarder", "circular"),
    "texture": ("bitmap", "checkerboard", "mesh_attribute", "volume", *_SPECTRA),
    "spectrum": _SPECTRA,
    "volume": ("constvolume",),
    "medium": ("homogeneous", "heterogeneous"),
    "phase": ("isotropic", "hg", "rayleigh", "blendphase", "sggx", "tabphase"),
    "sensor": ("perspective", "thinlens", "orthographic", "distant", "irradiancemeter",
               "radiancemeter"),
    "film": ("hdrfilm", "specfilm"),
    "sampler": ("independent", "stratified", "multijitter", "orthogonal", "ldsampler"),
    "rfilter": ("box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos"),
    "integrator": ("path", "direct", "depth", "aov", "moment", "stokes", "ptracer", "volpath",
                   "volpathmis", "prb", "prb_basic", "prbvolpath", "prb_projective",
                   "direct_projective"),
    "emitter": ("area", "constant", "point", "spot", "directional", "projector",
                "directionalarea", "envmap"),
    "shape": ("ply", "obj", "serialized", "rectangle", "cube", "sphere", "disk", "cylinder",
              "linearcurve", "bsplinecurve", "merge", "shapegroup", "instance"),
}
# the texture of our own, of spectra that were found: in what Mitsuba is given, not in scenes
SPECTRAL_PICTURE = "spectral_picture"
# elements that hold values and no plugin
VALUES = ("boolean", "integer", "float", "string", "point", "vector", "rgb", "ref", "alias",
          "default", "transform", "translate", "rotate", "scale", "lookat", "matrix")
# of string parameters: Mitsuba reads data/ior/NAME.eta.spd for them
MATERIAL_NAMES = ("material", "int_ior", "ext_ior")


class _Limited(ET.TreeBuilder):
    """A tree that ends where it grows beyond what a scene is: not after all was read."""

    def __init__(self, name: str, comments: bool) -> None:
        super().__init__(insert_comments=comments)
        self.name, self.depth, self.elements = name, 0, 0

    def start(self, tag: str, attrs: dict[str, str]) -> ET.Element:
        self.depth, self.elements = self.depth + 1, self.elements + 1
        if self.depth > MAX_DEPTH:
            raise InputError(f"{self.name} has elements nested more than {MAX_DEPTH} deep, as no "
                             "scene has; export the scene again")
        if self.elements > MAX_ELEMENTS:
            raise InputError(f"{self.name} has more than {MAX_ELEMENTS} elements; put its geometry "
                             "into meshes")
        return super().start(tag, attrs)

    def end(self, tag: str) -> ET.Element:
        self.depth -= 1
        return super().end(tag)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise InputError(f"{self.name} has a <!DOCTYPE>, whose entities can grow without end; "
                         "remove it")


def parse_xml(text: str, name: str, comments: bool = False) -> ET.Element:
    """The root of some XML, whose size and depth are those of a scene.

    Parameters
    ----------
    text : str
    name : str
        Of its file, for sentences.
    comments : bool
        Whether comments are kept.

    Raises
    ------
    InputError
        If it is not well-formed, has a document type, is longer than 20 MB, or has more than
        500,000 elements or elements nested more than 64 deep.
    """
    if len(text) > MAX_BYTES:
        raise InputError(f"{name} is longer than {MAX_BYTES // 1_000_000} MB, as no scene is; put "
                         "its geometry into meshes")
    try:
        return ET.fromstring(text, ET.XMLParser(target=_Limited(name, comments)))
    except (ET.ParseError, ValueError, RecursionError) as error:
        raise InputError(f"{name} is not well-formed XML: {error}") from None


def file_attributes(root: ET.Element) -> list[tuple[ET.Element, str]]:
    """Where a scene names files: elements, and the attribute of each that holds the name."""
    return [(node, "value") for node in root.iter("string") if node.get("name") == "filename"] + [
        (node, "filename") for node in root.iter() if node.get("filename")]


def plugin_problems(root: ET.Element, left_out: Collection[str] = (),
                    written: bool = False) -> list[str]:
    """Sentences about all of a scene that Mitsuba must not be given; empty when there is none.

    Parameters
    ----------
    root : Element
        A <scene>, its includes and the $NAMES in its types replaced.
    left_out : collection of str
        Elements whose types are checked elsewhere.
    written : bool
        Whether the scene was written here: it may have textures of spectra then.
    """
    problems: dict[str, None] = {}
    for node in root.iter():
        if node is root or not isinstance(node.tag, str):       # a comment
            continue
        what = f"the <{plain(node.tag)}>"
        if name := node.get("id") or node.get("name"):
            what += f" {name!r}"
        if "$" in node.get("name", ""):
            problems[f"{what} has a $ in its name, which only values may have; write the name "
                     "out"] = None
        # a spectrum without a type holds values, as an rgb does
        if node.tag in VALUES or (node.tag == "spectrum" and node.get("type") is None):
            if node.tag == "string" and node.get("name") in MATERIAL_NAMES \
                    and not re.fullmatch(r"[\w .+-]*", node.get("value", "")):
                problems[f"{what} has the value {node.get('value')!r}, which is no material's "
                         "name; write one of Mitsuba's, such as Au or bk7"] = None
        elif node.tag not in PLUGINS:
            problems[f"{what} is no element that a scene may hold; take it out, or write one of "
                     f"{', '.join((*PLUGINS, *VALUES))}"] = None
        elif node.get("type") not in PLUGINS[node.tag] and node.tag not in left_out \
                and not (written and node.get("type") == SPECTRAL_PICTURE):
            problems[f"{what} is of type {node.get('type')!r}, which a scene may not name; write "
                     f"type=\"{PLUGINS[node.tag][0]}\", or another of "
                     f"{', '.join(PLUGINS[node.tag])}"] = None
    return [*problems]


def require_harmless(root: ET.Element) -> None:
    """Refuse a scene that names a plugin that is not on the list, before Mitsuba is given it.

    Parameters
    ----------
    root : Element
        A <scene> in Mitsuba 3's own names, as ``scene_xml`` writes it.

    Raises
    ------
    InputError
    """
    version = root.get("version", "")
    if root.tag != "scene" or not re.fullmatch(r"[2-9](\.\d+){0,2}", version):
        raise InputError(f"the scene has the root <{plain(root.tag)}> of version {version!r}; "
                         'write <scene version="3.0.0">')
    if problems := plugin_problems(root, written=True):
        raise InputError("\n".join(f"the scene: {problem}" for problem in problems))
