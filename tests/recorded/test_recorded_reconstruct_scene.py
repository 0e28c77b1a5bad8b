"""Recorded: scenes as they are read, put together, rewritten, and refused; no renderer."""
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from recorded_refusals import placeless, said

from spectrabox.reconstruct.scene.elsewhere import bsdf_of, plain_bsdf
from spectrabox.reconstruct.scene.light_profile import (
    TABLE_DEG,
    profile_text,
    read_profile,
    relative_radiance,
)
from spectrabox.reconstruct.scene.moved_light import light_number, with_light_moved
from spectrabox.reconstruct.scene.parts import defaults_of, filled_in, put_together
from spectrabox.reconstruct.scene.pose_scene import (
    camera_nodes,
    scene_with_camera,
    scene_with_light_moved,
)
from spectrabox.reconstruct.scene.refinements import Refinement, refinements, rounded
from spectrabox.reconstruct.scene.scene_file import (
    check_materials,
    not_plain_products,
    read_scene,
    scene_of_text,
)
from spectrabox.reconstruct.scene.scene_xml import materials_xml, scene_xml

HEAD = """<scene version="3.0.0"><default name="w" value="48"/><default name="n" value="lamp"/>
<integrator type="path"><integer name="max_depth" value="6"/></integrator>
<sensor type="perspective" id="Camera"><float name="fov" value="40"/><film type="hdrfilm">
<integer name="width" value="$w"/><integer name="height" value="32"/></film></sensor>
"""
LAMP = """<emitter type="point" id="Lamp"><point name="position" x="3" y="6" z="4.5"/>
<rgb name="intensity" value="9"/></emitter>"""
SPOT = '<emitter type="spot" id="Spot"><rgb name="intensity" value="9"/></emitter>'
PANEL = """<shape type="rectangle" id="Panel"><transform name="to_world"><scale value="2"/>
</transform><emitter type="area"><spectrum name="radiance" value="3"/>{more}</emitter></shape>"""
SKY = '<emitter type="envmap" id="Sky"><string name="filename" value="sky.exr"/></emitter>'
DIFFUSE = '<bsdf type="diffuse" id="{id}"><rgb name="reflectance" value="0.5"/></bsdf>'
GLOSSY = """<bsdf type="twosided" id="Gloss"><bsdf type="principled"><rgb name="base_color"
value="0.8 0.3 0.2"/><float name="roughness" value="0.4"/></bsdf></bsdf>"""
WALL = '<shape type="rectangle" id="{id}">{inside}</shape>'
GROUP = """<shape type="shapegroup" id="Cone"><shape type="cube" id="Base"><transform
name="to_world"><scale x="0.6"/></transform><ref id="White" name="bsdf"/></shape>
<shape type="sphere"><ref id="White"/></shape></shape>
<shape type="instance" id="Left"><ref id="Cone"/><transform name="to_world"><rotate y="1"
angle="30"/></transform></shape><shape type="instance"><ref id="Cone"/></shape>"""
WHITE, GREY = DIFFUSE.format(id="White"), DIFFUSE.format(id="Grey")


def wall(name, bsdf):
    return WALL.format(id=name, inside=f'<ref id="{bsdf}"/>')


PLAIN = (LAMP, WHITE, wall("back", "White"))
SCENES = {
    "plain": PLAIN, "group": (LAMP, WHITE, GROUP), "glossy": (LAMP, GLOSSY, wall("a", "Gloss")),
    "inside": (LAMP, WALL.format(id="a", inside=DIFFUSE.replace(' id="{id}"', "")),
               WALL.format(id="b", inside=DIFFUSE.replace(' id="{id}"', "")),
               WALL.format(id="c", inside=DIFFUSE.replace(' id="{id}"', "").replace("5", "2")),
               WALL.format(id="d", inside=DIFFUSE.format(id="Own"))),
    "bare": (LAMP, '<bsdf type="diffuse" id="shape_1_bsdf"/>', '<shape type="cube"/>',
             WALL.format(id="w", inside='<ref id="air" name="interior"/>'),
             '<shape type="disk" id="shape_3"/>', '<shape type="sphere"/>'),
    "lights": (LAMP, SPOT, PANEL.format(more=""), '<emitter type="constant"/>', WHITE,
               wall("back", "White")),
    "no light": (WHITE, wall("back", "White")), "odd light": ('<emitter type="sunsky"/>', *PLAIN),
    "odd shape": ('<shape type="heightfield" id="hill"/>', *PLAIN),
    "lost instance": ('<shape type="instance" id="x"><ref id="No"/></shape>', *PLAIN),
    "mask": ('<bsdf type="mask" id="M"/>', wall("m", "M"), *PLAIN),
    "glass": ('<bsdf type="dielectric" id="G"/>', wall("g", "G"), *PLAIN),
    "unused glass": ('<bsdf type="dielectric" id="G"/>', *PLAIN),
    "two sides": (f'<bsdf type="twosided" id="T">{WHITE}{GREY}</bsdf>', wall("t", "T"), *PLAIN),
    "picture": ('<bsdf type="diffuse" id="P"><texture type="bitmap" name="reflectance">'
                '<string name="filename" value="no.png"/></texture></bsdf>', wall("p", "P"),
                *PLAIN),
    "checks": ('<texture type="checkerboard" id="C"/><bsdf type="diffuse" id="P">'
               '<ref id="C" name="reflectance"/></bsdf>', wall("p", "P"), *PLAIN),
    "missing file": ('<shape type="ply" id="m"><string name="filename" value="no.ply"/>'
                     '<ref id="White"/></shape>', *PLAIN),
    "missing files": (*(f'<shape type="ply" id="m{n}"><string name="filename" value="no{n}.ply"/>'
                        '<ref id="White"/></shape>' for n in range(7)), *PLAIN),
    "variable": ('<shape type="ply" id="m"><string name="filename" value="$x.ply"/></shape>',
                 *PLAIN),
    "outside": ('<shape type="ply" id="m"><string name="filename" value="../a.ply"/></shape>',
                *PLAIN),
    "mesh": ('<path value="$n"/><shape type="ply" id="m"><string name="filename" value="m.ply"/>'
             '<ref id="White"/></shape>', *PLAIN),
    "profile": (PANEL.format(more='<string name="profile" value="$n.csv"/>'), WHITE,
                wall("back", "White")),
    "odd profile": (LAMP.replace("</emitter>", '<string name="profile" value="lamp.csv"/>'
                                 "</emitter>"), WHITE, wall("back", "White")),
    "included": ('<include filename="$n.xml"/>', wall("back", "White")),
    "includes": ('<include filename="no.xml"/><include filename="lamp.csv"/>'
                 '<include filename="root.xml"/><include filename="../b.xml"/>', *PLAIN),
    "instances": (GROUP, *10_000 * ('<shape type="instance"/>',), *PLAIN),
    "itself": ('<include filename="loop.xml"/>', *PLAIN)}
FILES = {"lamp.csv": "angle,radiance,error\n0,2,0.1\n30,1.5,0.1\n80,0.4,0.1\n", "root.xml": "<a/>",
         "lamp.xml": f'<scene version="0.6.0">{LAMP}{WHITE}<shape type="cube" id="old"><ref '
                     'id="White"/><transform name="toWorld"><lookAt origin="0, 0, 1"/>'
                     "</transform></shape></scene>",
         "loop.xml": '<scene><include filename="loop.xml"/></scene>',
         "m.ply": "", "lamp/m.ply": ""}
HEADS = {"no sensor": HEAD.replace("sensor", "sensors"), "width word": HEAD.replace("48", "4x"),
         "no width": HEAD.replace('name="width"', 'name="crop"'),
         "default": "<scene><sensor/>", "zero": HEAD.replace("48", "0"),
         **{f"depth {n}": HEAD.replace('"6"', f'"{n}"') for n in (-1, 0, 1, 256, 257)},
         **{f"side {n}": HEAD.replace("48", f"{n}") for n in (100_000, 100_001)},
         "no scene": "<box>", "damaged": "<scene"}


@pytest.fixture
def folder(tmp_path):
    inside = tmp_path / "scene"
    (inside / "lamp").mkdir(parents=True)
    for name, text in FILES.items():
        (inside / name).write_text(text, encoding="utf-8")
    (tmp_path / "b.xml").write_text("<scene/>", encoding="utf-8")
    return inside


def of_text(folder, parts, head=HEAD, inside=None):
    return scene_of_text(head + "".join(parts) + "</scene>", folder / "own.xml", inside or folder)


def told(scene, folder):
    return {"size": (scene.width, scene.height), "depth": scene.max_depth, "bsdfs": scene.bsdf_ids,
            "surfaces": scene.surfaces, "lights": scene.light_ids, "profiles": dict(scene.profiles),
            "files": [file.name for file in scene.files], "glossy": not_plain_products(scene),
            "xml": placeless(ET.tostring(scene.root, encoding="unicode"), folder)}


def test_scenes_as_they_are_read(recorded, folder):
    recorded({name: said(lambda parts=parts: told(of_text(folder, parts), folder), folder.parent)
              for name, parts in SCENES.items()})
    recorded({name: said(lambda head=head: {key: value for key, value in told(of_text(
        folder, PLAIN, head), folder).items() if key in ("size", "depth")}, folder.parent)
        for name, head in HEADS.items() if name != "no scene"}
        | {"no scene": said(lambda: scene_of_text("<box/>", folder / "own.xml")),
           "missing": said(lambda: read_scene(folder / "no.xml"), folder),
           "folder": said(lambda: read_scene(folder), folder)}, case="heads")


def test_parts_of_scenes(recorded, folder):
    root = ET.fromstring('<scene version="1.0"><default name="a" value="1"/><default name="a" '
                         'value="2"/><include filename="lamp.xml"/><path value="lamp"/><bsdf '
                         'name="intIOR"><srgb name="specularReflectance"/></bsdf></scene>')
    parts = put_together(root, folder / "own.xml", folder)
    recorded({"files": parts.files, "folders": parts.folders, "problems": parts.problems,
              "defaults": defaults_of(root), "xml": ET.tostring(root, encoding="unicode"),
              "filled": filled_in("$a/$b.$a", {"a": "1"})})
    found = {}
    for version in ("0.6.0", "1.9", "2.0", "3.0.0", ""):
        root = ET.fromstring(f'<scene version="{version}"><lookAt name="toWorld"/></scene>')
        put_together(root, folder / "own.xml")
        found[version] = ET.tostring(root, encoding="unicode")
    recorded(found, case="versions")
    shape = ET.fromstring('<shape><ref id="x"/><ref id="y" name="bsdf"/></shape>')
    recorded({"of": [bsdf_of(shape, ()), bsdf_of(shape, ("x",)), bsdf_of(ET.Element("a"), ())],
              "named": bsdf_of(ET.fromstring('<s><ref id="x"/><ref id="y"/></s>'), ("y",)),
              "plain": [plain_bsdf(ET.fromstring(text)).get("id") for text in (
                  '<bsdf id="a" type="twosided"><bsdf id="b"/></bsdf>',
                  '<bsdf id="a" type="mask"><bsdf id="b"/></bsdf>')]}, case="references")


def test_materials_of_a_scene(recorded, folder):
    scene = of_text(folder, (LAMP, WHITE, GREY, wall("a", "White"), wall("b", "None"),
                             wall("c", "White")))
    recorded({f"{pairs}": check_materials(scene, pairs) for pairs in (
        {"w": "White"}, {"w": "White", "g": "Grey"}, {"w": "White", "x": "Red"},
        {"w": "White", "n": "None"})})


NM = np.array([400.0, 500, 600, 700])


def test_scenes_with_the_spectra_of_a_session(recorded, folder):
    scene = of_text(folder, (LAMP, SPOT, GLOSSY, WHITE, GREY, wall("a", "White"),
                             wall("b", "Gloss"), '<shape type="ply" id="m"><string name="filename" '
                             'value="m.ply"/><ref id="Grey"/></shape>'))
    reflectances = {"White": NM / 1000, "Gloss": 1 - NM / 1000}
    lights = {"Lamp": NM / 500, "Spot": NM / 300}
    bands = {"R": NM / 700, "B": 1 - NM / 800}

    def text(light, **options):
        return placeless(scene_xml(scene, reflectances=reflectances, light=light, bands=bands,
                                   range_nm=(400.0, 700.0), size=(30, 20), **options), folder)
    recorded({"one": text(NM), "each": text(lights, integrator="path"),
              "missing": said(lambda: text({"Lamp": NM})),
              "materials": materials_xml(reflectances, (400.0, 700.0)),
              "black": materials_xml({"a": 0 * NM, "b": np.array([0, 0.5, 0, 0])}, (400.0, 700.0))})

    def lit(parts, light):
        return said(lambda: scene_xml(of_text(folder, parts), reflectances={}, light=light,
                                      bands=bands, range_nm=(400.0, 700.0), size=(3, 2)), folder)
    (folder / "sky.exr").write_bytes(b"")
    shaped = (PANEL.format(more='<string name="profile" value="lamp.csv"/>'), *PLAIN[1:])
    recorded({f"{name} {kind}": lit(parts, light) for name, parts in
              (("profile", shaped), ("sky", (SKY, *PLAIN[1:]))) for kind, light in
              (("one", np.ones(4)), ("other", NM), ("each", {"Panel": np.ones(4)}))}, case="shaped")


def test_lights_that_are_moved(recorded, folder):
    offset = np.array([0.5, -1.25, 1 / 3])
    scene = of_text(folder, (LAMP, SPOT, PANEL.format(more=""), '<shape type="sphere" id="Ball">'
                             '<point name="center" value="1, 2, 3"/><emitter type="area"/></shape>',
                             '<emitter type="constant" id="Sky"/>', *PLAIN[1:]))
    recorded({"numbers": {f"{name}": said(lambda name=name: light_number(scene, name))
                          for name in (None, "Lamp", "Panel", "Ball", "Sky", "No")},
              "moved": [ET.tostring(with_light_moved(scene, number, offset).root,
                                    encoding="unicode") for number in range(4)],
              "one": light_number(of_text(folder, PLAIN), None)})
    words = ("1 2 3", "1, 2", "a, b, c", "$x 2 3")
    recorded({word: said(lambda word=word: ET.tostring(with_light_moved(of_text(folder, (
        f'<emitter type="point" id="L"><point name="position" value="{word}"/></emitter>',
        *PLAIN[1:])), 0, offset).root.find("emitter"), encoding="unicode")) for word in words},
        case="positions")


CAMERA = {"to_world": np.arange(16).reshape(4, 4) / 7, "fov": 41.25, "fov_axis": "x",
          "principal_point_offset_x": 0.0125, "principal_point_offset_y": -0.5}
SAID = Refinement(what="camera", name="of -- the photo", how="found", place=(1, 2.5, 3),
                  standard_error=(0.1, 0.2, 0.3))
MOVED = Refinement(what="light", name="Lamp", how="moved", moved=(1, -2, 0.5),
                   standard_error=(0.1, 0.2, 0.3))


def test_scenes_that_are_written_over(recorded, folder):
    path = folder / "own.xml"
    heads = {"own": HEAD, "same shape": HEAD.replace("48", "96").replace("32", "64"),
             "cropped": HEAD.replace("<integer name=\"height\"", '<integer name="crop_width" '
                                     'value="3"/><integer name="height"'),
             "no film": "<scene><sensor type=\"perspective\"><float name=\"fov\" value=\"3\"/>"
                        "</sensor>", "orthographic": HEAD.replace("perspective", "orthographic"),
             "no sensor": "<scene>"}
    found = {}
    for name, head in heads.items():
        path.write_text(head + "".join(PLAIN) + "</scene>", encoding="utf-8")
        for size in ((48, 32), (96, 64), (60, 32)):
            found[f"{name} {size}"] = said(lambda size=size: scene_with_camera(
                path, CAMERA, size, folder, SAID), folder)
    path.write_text(HEAD + "".join(PLAIN) + "</scene>", encoding="utf-8")
    for said_of in (SAID, MOVED, SAID, MOVED.model_copy(update={"moved": (0.0, 1.0, 2.0)})):
        path.write_text(scene_with_light_moved(path, 0, np.array([1.0, 2, 3]), folder, said_of),
                        encoding="utf-8")
    found["light"] = path.read_text("utf-8")
    found["comments"] = [each.model_dump() for each in refinements(path)]
    path.write_text(HEAD + SKY + "".join(PLAIN[1:]) + "</scene>", encoding="utf-8")
    found["elsewhere"] = said(lambda: scene_with_camera(path, CAMERA, (48, 32), folder.parent),
                              folder)
    found["beside"] = len(scene_with_camera(path, CAMERA, (48, 32), folder))
    path.write_text(HEAD + '<include filename="lamp.xml"/></scene>', encoding="utf-8")
    found["included"] = said(lambda: scene_with_camera(path, CAMERA, (48, 32), folder))
    path.write_text("<box/>", encoding="utf-8")
    found["no scene"] = said(lambda: scene_with_camera(path, CAMERA, (48, 32), folder))
    found["missing"] = said(lambda: scene_with_camera(folder / "no.xml", CAMERA, (1, 1), folder),
                            folder)
    found["nodes"] = [ET.tostring(node, encoding="unicode") for node in camera_nodes(CAMERA)]
    found["rounded"] = rounded(np.array([1 / 3, 12345678.0, -1e-9]))
    recorded(found)


PROFILES = {"named": FILES["lamp.csv"], "bare": "0,3\n15.5,2\n60,0.5\n90,0\n",
            "one": "0,1\n", "letters": "0,1\n10,x\n", "four": "0,1,2,3\n10,1,2,3\n",
            "falling": "0,1\n20,1\n10,1\n", "not ahead": "5,1\n20,1\n", "dark": "0,0\n10,1\n",
            "negative": "0,1\n10,-0.1\n", "infinite": "0,1\n10,inf\n",
            "mark": "\ufeffa,b\n0,2\n9,1",
            **{f"last {last}": f"0,1\n{last},0.5\n" for last in (90.0000005, 90.000002)},
            **{f"first {first}": f"{first},1\n50,0.5\n" for first in (5e-7, -5e-7, 2e-6)}}


def test_profiles_of_lamps(recorded, tmp_path):
    path, found = tmp_path / "lamp.csv", {}
    for name, text in PROFILES.items():
        path.write_text(text, encoding="utf-8")
        found[name] = said(lambda: read_profile(path))
    found["missing"] = said(lambda: read_profile(tmp_path / "no.csv"), tmp_path)
    cosine = np.array([[1.0, 0.999, 0.8], [0.3, 0.01, -0.5], [1.1, 0.0, 0.6]])
    found["radiance"] = relative_radiance(found["named"], cosine)
    found["text"] = profile_text(np.array([0.0, 12.345678, 60]), np.array([1.0, 2 / 3, 1e-7]),
                                 np.array([0.01, 0.0234567, 3]))
    recorded(found)
    np.testing.assert_allclose(found["named"][::60], np.interp(
        TABLE_DEG[::60], [0, 30, 80], [1, 0.75, 0.2]), rtol=1e-12)
