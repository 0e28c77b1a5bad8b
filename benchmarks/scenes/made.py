"""Ten scenes in the manner of those that people render, written as files that anybody can read.

A scene's folder holds what an inversion is given, and in ``truth.csv`` what it should find:

    scene.xml       Mitsuba 3: shapes, camera, lamps; every reflectance is a placeholder of 0.5
    light.csv       wavelength_nm, value: spectrum of the lamps, times what each states
    camera.csv      wavelength_nm, R, G, B: sensitivities of the camera
    known.csv       wavelength_nm and a column for each material that is given; may have none
    truth.csv       wavelength_nm and the reflectance of every material, 380 to 730 nm by 1 nm
    *.ply           meshes of the scene

All shapes are by formulas here. Spectra are published or ship with the project: patches of the
ColorChecker Classic, paints and pigments of ``fixtures/paints.py``, illuminants of the CIE,
measured cameras.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from spectrabox.fixtures import lamp, paints
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry import chart
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra import named_spectra

from benchmarks.scenes.score import write_spectra

WIDTH, HEIGHT = 128, 96          # of a photo, in pixels
SEGMENTS = 8                    # of a path, as the scene states; the renderings go on to 24
CAMERAS = ("Nikon D5300", "Canon EOS 5D Mark II", "Sony ILCE-7M4")
CARD = "chart neutral 5"


@dataclass(frozen=True)
class Scene:
    """One scene.

    Attributes
    ----------
    about : str
        What it is in the manner of.
    paints : mapping
        Name of the spectrum of every material, by the id of its BSDF.
    shapes, camera : str
        XML: BSDFs, shapes and emitters; the sensor's transform with its field of view.
    light : str
        Name of the lamps' spectrum.
    known : tuple of str
        Materials whose spectrum is given.
    meshes : mapping
        Vertices (V, 3) and triangles (F, 3) by file.
    segments : int
        Most segments of a path, as stated.
    """

    about: str
    paints: Mapping[str, str]
    shapes: str
    camera: str
    light: str
    known: tuple[str, ...] = ()
    meshes: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    segments: int = SEGMENTS


def write(name: str, folder: Path) -> None:
    """Write everything of a scene but its photo."""
    scene = SCENES[name]()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.xml").write_text(
        f'<scene version="3.0.0">\n<integrator type="path"><integer name="max_depth" '
        f'value="{scene.segments}"/></integrator>\n<sensor type="perspective" id="camera">'
        f'{scene.camera}<film type="hdrfilm"><integer name="width" value="{WIDTH}"/><integer '
        f'name="height" value="{HEIGHT}"/></film></sensor>\n{scene.shapes}</scene>\n',
        encoding="utf-8")
    for file, (vertices, faces) in scene.meshes.items():
        write_ply(folder / file, vertices, faces)
    truth = {material: spectrum(paint) for material, paint in scene.paints.items()}
    write_spectra(folder / "truth.csv", NM, truth)
    write_spectra(folder / "known.csv", NM, {each: truth[each] for each in scene.known})
    write_spectra(folder / "light.csv", NM, {"value": light(scene.light)})
    camera = CAMERAS[list(SCENES).index(name) % len(CAMERAS)]
    curves = named_spectra.sensitivities(camera, grid_from_nm(NM))
    write_spectra(folder / "camera.csv", NM, dict(zip("RGB", curves / curves.max(), strict=True)))


def spectrum(name: str) -> np.ndarray:
    """Reflectance (P,) at NM: "chart PATCH", a paint or a pigment of fixtures/paints.py."""
    if name.startswith("chart "):
        return chart_table()[chart.PATCH_NAMES.index(name.removeprefix("chart "))]
    return paints.PIGMENTS[name] if name in paints.PIGMENTS else paints.paint(name)[1]


@cache
def chart_table() -> np.ndarray:
    """Reflectances (24, P) at NM of the chart."""
    return np.asarray(chart.chart_reflectances(chart.COPIES_SINCE_2014, grid_from_nm(NM)))


def light(name: str) -> np.ndarray:
    """Spectrum (P,) at NM, 1 at its peak: of the CIE's illuminants, or "phone"."""
    values = lamp.radiance(NM) if name == "phone" else named_spectra.light(name, grid_from_nm(NM))
    return np.asarray(values / values.max())


def write_ply(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Write a mesh of triangles as ASCII PLY."""
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}",
             *(f"property float {axis}" for axis in "xyz"), f"element face {len(faces)}",
             "property list uchar int vertex_indices", "end_header",
             *(" ".join(f"{value:.5f}" for value in vertex) for vertex in vertices),
             *("3 " + " ".join(map(str, face)) for face in faces)]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def grid_mesh(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles over points (M, N, 3) of a surface."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (each.ravel() for each in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:],
                                            index[1:, :-1]))
    return points.reshape(-1, 3), np.concatenate([np.column_stack([a, b, c]),
                                                  np.column_stack([a, c, d])])


# ---- parts of scenes, as XML

def matt(*names: str) -> str:
    """Diffuse BSDFs."""
    return "".join(f'<bsdf type="diffuse" id="{name}"><spectrum name="reflectance" value="0.5"/>'
                   "</bsdf>\n" for name in names)


def metal(name: str, alpha: float) -> str:
    """A rough metal, coloured by its specular reflectance."""
    return (f'<bsdf type="twosided" id="{name}"><bsdf type="roughconductor"><float name="alpha" '
            f'value="{alpha}"/><spectrum name="specular_reflectance" value="0.5"/></bsdf></bsdf>\n')


def shape(kind: str, bsdf: str, transform: str, inside: str = "") -> str:
    """A shape; "bsdf" may be "" for the black of a lamp."""
    reference = f'<ref id="{bsdf}"/>' if bsdf else ""
    return (f'<shape type="{kind}">{reference}<transform name="to_world">{transform}</transform>'
            f"{inside}</shape>\n")


def sphere(bsdf: str, centre: tuple[float, ...], radius: float, inside: str = "") -> str:
    """A sphere."""
    return shape("sphere", bsdf, f'<scale value="{radius}"/>{moved(*centre)}', inside)


def box(bsdf: str, centre: tuple[float, ...], size: tuple[float, ...], turned: float = 0) -> str:
    """A box of whole edges, turned about its upright axis."""
    x, y, z = (edge / 2 for edge in size)
    return shape("cube", bsdf, f'<scale x="{x}" y="{y}" z="{z}"/><rotate y="1" angle="{turned}"/>'
                               f"{moved(*centre)}")


def wall(bsdf: str, side: str, centre: tuple[float, ...], size: tuple[float, float],
         inside: str = "") -> str:
    """A rectangle of whole edges that faces up, down, left, right, front (+z) or back."""
    turn = {"up": 'x="1" angle="-90"', "down": 'x="1" angle="90"', "right": 'y="1" angle="90"',
            "left": 'y="1" angle="-90"', "front": 'y="1" angle="0"', "back": 'y="1" angle="180"'}
    return shape("rectangle", bsdf, f'<scale x="{size[0] / 2}" y="{size[1] / 2}"/>'
                                    f"<rotate {turn[side]}/>{moved(*centre)}", inside)


def moved(x: float, y: float, z: float) -> str:
    """A translation."""
    return f'<translate x="{x:.4g}" y="{y:.4g}" z="{z:.4g}"/>'


def shining(strength: float = 1.0) -> str:
    """What makes a shape a lamp."""
    return f'<emitter type="area"><spectrum name="radiance" value="{strength:.6g}"/></emitter>'


def looking(origin: str, target: str, fov_deg: float) -> str:
    """A camera's field of view across and its place."""
    return (f'<string name="fov_axis" value="x"/><float name="fov" value="{fov_deg}"/><transform '
            f'name="to_world"><lookat origin="{origin}" target="{target}" up="0, 1, 0"/>'
            "</transform>")


def open_box(floor: str, ceiling: str, back: str, left: str, right: str) -> str:
    """Five walls of a box of edge 2 about the origin, open to the front."""
    return (wall(floor, "up", (0, -1, 0), (2, 2)) + wall(ceiling, "down", (0, 1, 0), (2, 2))
            + wall(back, "front", (0, 0, -1), (2, 2)) + wall(left, "right", (-1, 0, 0), (2, 2))
            + wall(right, "left", (1, 0, 0), (2, 2)))


CEILING_LAMP = wall("", "down", (0, 0.99, 0.1), (0.5, 0.4), shining())
INTO_BOX = looking("0, -0.08, 3.9", "0, -0.08, 0", 40)
BLOCKS = ((0.33, -0.7, 0.35), (0.6, 0.6, 0.6), -17), ((-0.33, -0.4, -0.3), (0.6, 1.2, 0.6), 18)


# ---- the scenes

def cornell() -> Scene:
    """White walls and blocks, a red and a green wall."""
    small, large = BLOCKS
    return Scene(
        "Cornell box, nothing known",
        {"white": "white_wall", "red": "red_wall", "green": "green_wall"},
        matt("white", "red", "green") + open_box("white", "white", "white", "red", "green")
        + box("white", *small) + box("white", *large) + CEILING_LAMP, INTO_BOX, "phone")


def cornell_painted() -> Scene:
    """Other colours, painted blocks, and a grey card that leans on the small one."""
    small, large = BLOCKS
    return Scene(
        "Cornell box of five colours with a grey card",
        {"white": "chart white 9.5", "left": "chart orange", "right": "chart blue sky",
         "small": "naples yellow", "large": "viridian", "card": CARD},
        matt("white", "left", "right", "small", "large", "card")
        + open_box("white", "white", "white", "left", "right") + box("small", *small)
        + box("large", *large) + shape(
            "rectangle", "card", '<scale x="0.22" y="0.22"/><rotate x="1" angle="-20"/>'
            + moved(-0.35, -0.78, 0.62)) + CEILING_LAMP,
        INTO_BOX, "FL11", ("card",))


def material_ball() -> Scene:
    """A ball in a shell on a foot, before a bright sweep, tiles below, two soft boxes."""
    turn = np.linspace(0, 2 * np.pi, 49)
    profile = np.array([[0.62, -0.98], [0.6, -0.9], [0.42, -0.82], [0.3, -0.7], [0.3, -0.6]])
    foot = np.stack([profile[:, None, 0] * np.cos(turn), np.broadcast_to(
        profile[:, None, 1], (len(profile), turn.size)), -profile[:, None, 0] * np.sin(turn)], -1)
    tiles = "".join(wall("dark" if (i + k) % 2 else "light", "up", (0.9 * i, -1, 0.9 * k),
                         (0.9, 0.9)) for i in range(-2, 3) for k in range(-2, 3))
    return Scene(
        "a material ball on tiles under two soft boxes, nothing known",
        {"ball": "cerulean", "foot": "yellow ochre", "light": "chart neutral 8",
         "dark": "chart neutral 3.5", "sweep": "white_wall"},
        matt("ball", "light", "dark", "sweep") + '<bsdf type="twosided" id="foot"><bsdf '
        'type="diffuse"><spectrum name="reflectance" value="0.5"/></bsdf></bsdf>\n' + tiles
        + sphere("ball", (0, 0.05, 0), 0.75)
        + '<shape type="ply"><string name="filename" value="foot.ply"/><ref id="foot"/></shape>\n'
        + wall("sweep", "front", (0, 0.6, -2.1), (4.2, 3.2))
        + shape("rectangle", "", '<scale x="0.7" y="0.7"/><rotate x="1" angle="60"/>'
                + moved(-1.2, 2.6, 1.6), shining())
        + shape("rectangle", "", '<scale x="0.5" y="0.9"/><rotate y="1" angle="-90"/>'
                + moved(2.8, 0.6, 0.8), shining(0.5)),
        looking("0, 0.9, 4.4", "0, -0.15, 0", 36), "D50",
        meshes={"foot.ply": grid_mesh(foot[::-1])})


def lit_room() -> Scene:
    """A room with a window, a table, a picture on the wall, and a white card on the table."""
    legs = "".join(box("wood", (x, -0.78, z), (0.06, 0.44, 0.06)) for x in (-0.5, 0.5)
                   for z in (-0.55, 0.05))
    return Scene(
        "a room lit by its window, a white card on the table",
        {"walls": "lead white", "floor": "burnt umber", "wood": "yellow ochre",
         "picture": "ultramarine", "sofa": "chart moderate red", "card": "chart white 9.5"},
        matt("walls", "floor", "wood", "picture", "sofa", "card")
        + wall("floor", "up", (0, -1, 0), (3, 2.4)) + wall("walls", "down", (0, 1, 0), (3, 2.4))
        + wall("walls", "front", (0, 0, -1.2), (3, 2)) + wall("walls", "right", (-1.5, 0, 0),
                                                              (2.4, 2))
        + wall("walls", "left", (1.5, 0, 0), (2.4, 2)) + wall("walls", "back", (0, 0, 1.2), (3, 2))
        + wall("", "right", (-1.49, 0.2, 0.2), (1.0, 0.9), shining())
        + box("wood", (0, -0.53, -0.25), (1.2, 0.06, 0.8)) + legs
        + box("sofa", (1.1, -0.72, -0.2), (0.6, 0.55, 1.4))
        + wall("picture", "front", (0.1, 0.3, -1.19), (0.9, 0.6))
        + wall("card", "up", (-0.25, -0.495, -0.2), (0.35, 0.35)),
        looking("0, 0.15, 1.15", "0, -0.3, -0.8", 78), "D65", ("card",))


def veach_lamps() -> Scene:
    """Four plates of rough metals that mirror lamps of three sizes, equally strong in all."""
    plates, bsdfs = "", ""
    for number, (height, depth, tilt, alpha) in enumerate((
            (0.55, -1.4, 57, 0.3), (0.1, -0.7, 66, 0.25), (-0.3, 0.0, 73, 0.2),
            (-0.6, 0.8, 79, 0.15)), start=1):
        bsdfs += metal(f"plate{number}", alpha)
        plates += shape("rectangle", f"plate{number}", '<scale x="1.5" y="0.3"/><rotate x="1" '
                        f'angle="-{tilt}"/>{moved(0, height - 0.6, depth)}')
    lamps = "".join(sphere("", (x, 1.9, -1.6), radius, shining((0.4 / radius)**2))
                    for x, radius in ((-1.1, 0.4), (0, 0.25), (1.1, 0.15)))
    return Scene(
        "Veach's plates of rough metals under lamps of three sizes, nothing known",
        {"plate1": "chart cyan", "plate2": "chart yellow green", "plate3": "chart moderate red",
         "plate4": "chart neutral 8", "ground": "lead white"},
        bsdfs + matt("ground") + wall("ground", "up", (0, -1.6, 0), (6, 6))
        + wall("ground", "front", (0, 0.4, -2.6), (6, 4)) + plates + lamps,
        looking("0, 1.0, 5.4", "0, -0.35, -0.3", 38), "A")


def relief() -> Scene:
    """Rings and ridges in low relief, in a frame, under raking light."""
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 61), np.linspace(-0.6, 0.6, 46))
    radius = np.hypot(x, y)
    height = (0.07 * np.cos(14 * radius) * np.exp(-3 * radius**2)
              + 0.05 * np.exp(-((x - 0.45) ** 2 + (y - 0.3) ** 2) / 0.02)
              + 0.02 * np.sin(9 * x + 5 * y))
    return Scene(
        "a painted relief in a frame under raking light, nothing known",
        {"relief": "vermilion", "frame": "naples yellow", "wall": "chart bluish green"},
        matt("relief", "frame", "wall")
        + '<shape type="ply"><string name="filename" value="relief.ply"/><ref id="relief"/>'
        "</shape>\n" + wall("wall", "front", (0, 0, -0.2), (4, 3))
        + "".join(box("frame", centre, size) for centre, size in (
            ((0, 0.66, 0), (1.84, 0.12, 0.3)), ((0, -0.66, 0), (1.84, 0.12, 0.3)),
            ((0.86, 0, 0), (0.12, 1.2, 0.3)), ((-0.86, 0, 0), (0.12, 1.2, 0.3))))
        + sphere("", (-2.2, 1.2, 1.3), 0.25, shining()),
        looking("0, 0, 3.2", "0, 0, 0", 38), "LED-B3",
        meshes={"relief.ply": grid_mesh(np.stack([x, y, height], axis=-1))})


def patterned_wall() -> Scene:
    """Tiles of eight colours on a wall, floor before it."""
    colours = ("chart dark skin", "chart foliage", "chart blue flower", "chart orange",
               "chart purple", "chart blue", "chart yellow", "chart magenta")
    names = [f"tile{number}" for number in range(1, 9)]
    tiles = "".join(wall(names[(3 * row + column) % 8], "front",
                         (-1.05 + 0.3 * column, -0.6 + 0.3 * row, 0.01), (0.28, 0.28))
                    for row in range(6) for column in range(8))
    return Scene(
        "a wall of tiles in eight colours, nothing known",
        dict(zip(names, colours, strict=True)) | {"mortar": "chart neutral 6.5",
                                                  "floor": "lead white"},
        matt(*names, "mortar", "floor") + wall("mortar", "front", (0, 0.15, 0), (2.6, 2.0))
        + wall("floor", "up", (0, -0.85, 1), (2.6, 2)) + tiles
        + shape("rectangle", "", '<scale x="0.5" y="0.3"/><rotate x="1" angle="125"/>'
                + moved(0.5, 1.7, 1.8), shining()),
        looking("-0.5, 0.3, 3.6", "0, 0.05, 0", 40), "FL2", segments=5)


def two_lamps() -> Scene:
    """A vase in a box under a lamp and a tenth of it from the side."""
    turn, along = np.linspace(0, 2 * np.pi, 49), np.linspace(0, 1, 25)
    radius = 0.3 + 0.14 * np.sin(2 * np.pi * along + 0.3) - 0.08 * along
    vase = np.stack([radius[:, None] * np.cos(turn), np.broadcast_to(
        -1 + 1.2 * along[:, None], (25, 49)), -radius[:, None] * np.sin(turn)], axis=-1)
    return Scene(
        "a vase in a box under two lamps of 10 : 1, a grey card",
        {"white": "white_wall", "left": "chart purplish blue", "right": "burnt umber",
         "vase": "cerulean", "card": CARD},
        matt("white", "left", "right", "card") + '<bsdf type="twosided" id="vase"><bsdf '
        'type="diffuse"><spectrum name="reflectance" value="0.5"/></bsdf></bsdf>\n'
        + open_box("white", "white", "white", "left", "right")
        + '<shape type="ply"><string name="filename" value="vase.ply"/><ref id="vase"/></shape>\n'
        + shape("rectangle", "card", '<scale x="0.22" y="0.22"/><rotate x="1" angle="-20"/>'
                + moved(0.55, -0.78, 0.4))
        + wall("", "down", (0, 0.99, 0.1), (0.5, 0.4), shining(10))
        + sphere("", (-1.6, 0.8, 2.4), 0.25, shining(1)),
        INTO_BOX, "LED-B1", ("card",), meshes={"vase.ply": grid_mesh(vase)})


def environment() -> Scene:
    """Three bodies on a ground under an even sky."""
    return Scene(
        "bodies on a ground under an even sky, nothing known",
        {"ground": "yellow ochre", "ball": "chart red", "cube": "cube",
         "pillar": "chart yellow green"},
        matt("ground", "ball", "cube", "pillar") + wall("ground", "up", (0, -1, -2), (12, 12))
        + sphere("ball", (-0.9, -0.45, 0), 0.55) + box("cube", (0.25, -0.6, 0.3), (0.8, 0.8, 0.8),
                                                       30)
        + box("pillar", (0.95, -0.2, -0.9), (0.45, 1.6, 0.45), 10)
        + '<emitter type="constant"><spectrum name="radiance" value="1"/></emitter>\n',
        looking("0, 1.4, 4.2", "0, -0.6, 0", 40), "D75")


def indirect() -> Scene:
    """A room that a floor lamp lights by way of its ceiling alone."""
    shade = "".join(box("shade", (0.95 + x, 0.35, -0.55 + z), size) for x, z, size in (
        (0.2, 0, (0.02, 0.3, 0.42)), (-0.2, 0, (0.02, 0.3, 0.42)), (0, 0.2, (0.42, 0.3, 0.02)),
        (0, -0.2, (0.42, 0.3, 0.02))))
    return Scene(
        "a room lit by way of its ceiling, a grey card",
        {"walls": "chart white 9.5", "floor": "chart light skin", "shade": "chart purple",
         "chest": "vermilion", "ball": "viridian", "card": CARD},
        matt("walls", "floor", "shade", "chest", "ball", "card")
        + open_box("floor", "walls", "walls", "walls", "walls")
        + wall("walls", "back", (0, 0, 1), (2, 2)) + shade
        + box("shade", (0.95, 0.21, -0.55), (0.42, 0.02, 0.42))
        + box("shade", (0.95, -0.4, -0.55), (0.04, 1.2, 0.04))
        + wall("", "up", (0.95, 0.3, -0.55), (0.3, 0.3), shining())
        + box("chest", (-0.45, -0.7, -0.55), (0.8, 0.6, 0.5), 8)
        + sphere("ball", (0.3, -0.75, -0.1), 0.25)
        + wall("card", "front", (-0.3, 0.15, -0.99), (0.5, 0.4)),
        looking("0, 0, 0.95", "0, -0.3, -0.6", 76), "FL8", ("card",), segments=10)


SCENES: dict[str, Callable[[], Scene]] = {
    "cornell": cornell, "cornell-painted": cornell_painted, "material-ball": material_ball,
    "lit-room": lit_room, "veach-lamps": veach_lamps, "relief": relief,
    "patterned-wall": patterned_wall, "two-lamps": two_lamps, "environment": environment,
    "indirect": indirect}
