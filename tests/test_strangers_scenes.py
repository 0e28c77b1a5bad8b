"""A scene from a stranger runs nothing, reads nothing outside its folder and ends no process."""
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.fixtures.cornell_box import cornell_box_xml
from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.rendering.renderer import load_scene
from spectrabox.reconstruct.scene.import_scene import EMITTED, MESHES, SKY_MAP, SPECTRAL_FACTOR
from spectrabox.reconstruct.scene.meshes import READERS, require_sound_mesh
from spectrabox.reconstruct.scene.plugins import MAX_DEPTH, PLUGINS
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.scene.scene_xml import scene_xml
from spectrabox.session.cli import app

ROOT = Path(__file__).resolve().parent.parent
# elements that name a plugin, where Mitsuba takes them
HOLDERS = {
    "texture": '<texture type="{}" id="odd"/>',
    "volume": '<volume type="{}" id="odd"/>',
    "bsdf": '<bsdf type="{}" id="odd"/>',
    "medium": '<medium type="{}" id="odd"/>',
    "phase": '<phase type="{}" id="odd"/>',
    "sensor": '<sensor type="{}" id="odd"/>',
    "spectrum": '<bsdf type="diffuse" id="unused"><spectrum type="{}" name="reflectance"/></bsdf>',
    "shape": '<shape type="{}" id="odd"/>',
    "emitter": '<emitter type="{}" id="odd"/>',
    "integrator": '<integrator type="{}" id="odd"/>',
    "film": '<sensor type="perspective" id="more"><film type="{}"/></sensor>',
    "sampler": '<sensor type="perspective" id="more"><sampler type="{}"/></sensor>',
    "rfilter": '<sensor type="perspective" id="more"><film type="hdrfilm">'
               '<rfilter type="{}"/></film></sensor>',
}


@pytest.fixture(scope="session")
def library(tmp_path_factory):
    """A shared library that leaves a file when it is loaded, and that file; without a compiler one
    that is missing.
    """
    folder = tmp_path_factory.mktemp("stranger")
    library, mark = folder / "odd.so", folder / "mark"
    if (compiler := shutil.which("cc") or shutil.which("gcc")) is not None:
        (folder / "odd.c").write_text(
            "#include <stdio.h>\n__attribute__((constructor)) static void mark(void) {\n"
            f'    FILE *file = fopen("{mark}", "w");\n    if (file) fclose(file);\n}}\n',
            encoding="utf-8")
        subprocess.run([compiler, "-shared", "-fPIC", "-o", library, folder / "odd.c"], check=True)
    return library, mark


@pytest.fixture
def never_given(mitsuba, monkeypatch):
    """Fails where Mitsuba is given a scene at all."""
    def given(*_, **__):
        pytest.fail("Mitsuba was given the scene")

    monkeypatch.setattr(mitsuba, "load_string", given)


def plugin_path(library):
    """The type by which Mitsuba would load a library that lies elsewhere."""
    import mitsuba
    folder = Path(mitsuba.__file__).resolve().parent / "plugins"
    return os.path.relpath(library.with_suffix(""), folder)


def with_more(text, more):
    return text.replace("</scene>", more + "</scene>")


def python(code, *words, cwd=ROOT):
    return subprocess.run([sys.executable, "-c", code, *map(str, words)], cwd=cwd, timeout=300,
                          text=True, capture_output=True, check=False)


# ---- plugins -------------------------------------------------------------------------------------

def test_the_planted_library_is_one_that_mitsuba_would_run(library):
    """Otherwise the tests below would show nothing."""
    planted, mark = library
    if not planted.exists():
        pytest.skip("no compiler on this machine to make a library with")
    code = ("import sys, mitsuba as mi\nmi.set_variant('scalar_rgb')\n"
            "try:\n    mi.load_string(sys.argv[1])\nexcept Exception as error:\n    print(error)")
    for holder in HOLDERS.values():
        mark.unlink(missing_ok=True)
        xml = f'<scene version="3.0.0">{holder.format(plugin_path(planted))}</scene>'
        python(code, xml)
        assert mark.exists(), holder
    mark.unlink()


@pytest.mark.parametrize("element", HOLDERS)
def test_a_library_that_a_scene_names_is_not_loaded(element, library, tmp_path, never_given):
    planted, mark = library
    odd = HOLDERS[element].format(plugin_path(planted))
    path = tmp_path / "box.xml"
    path.write_text(with_more(cornell_box_xml(), odd), encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_scene(path, tmp_path)
    said = str(refused.value)
    assert "box.xml: " in said and element in said and PLUGINS[element][0] in said
    assert "odd" in said and len(said.splitlines()) == 1
    with pytest.raises(InputError, match=f"<{element}>.* is of type '.*odd', which a scene may"):
        load_scene(f'<scene version="3.0.0">{odd}</scene>')
    # through a default, and out of an included file
    (tmp_path / "part.xml").write_text('<scene version="3.0.0"><default name="kind" value='
                                       f'"{plugin_path(planted)}"/>'
                                       f'{HOLDERS[element].format("$kind")}</scene>',
                                       encoding="utf-8")
    path.write_text(with_more(cornell_box_xml(), '<include filename="part.xml"/>'),
                    encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(repr(plugin_path(planted)))):
        read_scene(path, tmp_path)
    assert not mark.exists()


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize("scene", ["box.xml", "chart.xml"])
def test_a_session_of_a_stranger_runs_nothing(command, scene, captured, library, never_given):
    planted, mark = library
    path = captured / "scene" / scene
    odd = "".join(holder.format(plugin_path(planted)) for holder in HOLDERS.values())
    path.write_text(with_more(path.read_text(encoding="utf-8"), odd), encoding="utf-8")
    outcome = CliRunner().invoke(app, [command, str(captured), "--json"])
    assert outcome.exit_code == 3
    said = json.dumps(json.loads(outcome.stdout))
    for element in ("texture", "volume", "bsdf", "medium", "phase", "sensor", "spectrum"):
        assert f"the <{element}>" in said
    assert scene in said and not mark.exists()


@pytest.mark.parametrize("name", ["diffuse", "path", "d65"])
def test_a_plugin_of_mitsuba_s_own_is_not_taken_from_the_working_folder(name, library, tmp_path):
    planted, mark = library
    (tmp_path / "plugins").mkdir()
    if planted.exists():
        shutil.copy(planted, tmp_path / "plugins" / f"{name}.so")
    code = ("import sys\nsys.path.insert(0, sys.argv[2])\n"
            "from spectrabox.reconstruct.rendering.renderer import load_scene, start_mitsuba\n"
            "mi = start_mitsuba('cpu')\nmi.load_dict({'type': sys.argv[1]})\n"
            "load_scene('<scene version=\"3.0.0\"><bsdf type=\"diffuse\"/></scene>')\n"
            "print([str(folder) for folder in mi.file_resolver()])")
    done = python(code, name, ROOT, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert str(tmp_path) not in done.stdout and not mark.exists()


def test_the_list_is_of_plugins_that_mitsuba_has(mitsuba):
    """A name that Mitsuba lacks would be looked for in the working folder."""
    folder = Path(mitsuba.__file__).parent / "plugins"
    in_python = {"prb", "prb_basic", "prbvolpath", "prb_projective", "direct_projective"}
    for element, names in PLUGINS.items():
        for name in names:
            assert name in in_python or list(folder.glob(f"{name}.*")), (element, name)
            assert re.fullmatch(r"\w+", name)
    for name in in_python:
        mitsuba.load_dict({"type": name})


def test_what_the_code_honours_is_on_the_list():
    assert {*EMITTED, SKY_MAP} == {*PLUGINS["emitter"]}
    assert {*SPECTRAL_FACTOR} < {*PLUGINS["bsdf"]}
    assert {*MESHES} < {*PLUGINS["shape"]} and {*READERS} < {*PLUGINS["shape"]}


def test_the_reference_has_the_list():
    page = (ROOT / "docs" / "reference" / "scenes.md").read_text(encoding="utf-8")
    rows = {cells[1].strip().strip("`<>"): re.findall(r"`(\w+)`", cells[2])
            for line in page.splitlines() if len(cells := line.split("|")) == 4
            and cells[1].strip().startswith("`<")}
    assert rows == {element: [*names] for element, names in PLUGINS.items()}


HARMLESS = """
<default name="integrator" value="volpath"/><default name="depth" value="7"/>
<default name="deep" value="$depth"/>
<integrator type="$integrator"><integer name="max_depth" value="$deep"/>
  <boolean name="hide_emitters" value="false"/></integrator>
<texture type="checkerboard" id="checks"><rgb name="color0" value="0.1, 0.2, 0.3"/>
  <transform name="to_uv"><scale x="10" y="10"/></transform></texture>
<bsdf type="roughplastic" id="coat"><string name="distribution" value="ggx"/>
  <float name="alpha" value="0.1"/><string name="int_ior" value="polypropylene"/>
  <rgb name="diffuse_reflectance" value="0.5"/></bsdf>
<bsdf type="roughconductor" id="metal"><string name="material" value="Au"/>
  <float name="alpha_u" value="0.05"/><float name="alpha_v" value="0.3"/></bsdf>
<bsdf type="bumpmap" id="bumps"><ref id="checks"/><bsdf type="diffuse"/></bsdf>
<bsdf type="mask" id="holes"><ref id="checks" name="opacity"/><bsdf type="twosided">
  <bsdf type="diffuse"/></bsdf></bsdf>
<bsdf type="blendbsdf" id="mixed"><texture type="checkerboard" name="weight"/>
  <bsdf type="plastic"/><bsdf type="conductor"/></bsdf>
<bsdf type="thindielectric" id="pane"/><bsdf type="dielectric" id="glass">
  <string name="int_ior" value="bk7"/><string name="ext_ior" value="air"/></bsdf>
<bsdf type="principled" id="paint"><rgb name="base_color" value="1, 0, 0"/></bsdf>
<alias id="paint" as="varnish"/>
<medium type="homogeneous" id="fog"><rgb name="albedo" value="0.9"/><float name="scale" value="2"/>
  <phase type="hg"><float name="g" value="0.3"/></phase></medium>
<medium type="heterogeneous" id="smoke"><volume type="constvolume" name="sigma_t">
  <float name="value" value="1"/></volume></medium>
<shape type="sphere" id="ball"><float name="radius" value="10"/><ref id="coat"/></shape>
<shape type="disk" id="plate"><ref name="bsdf" id="metal"/>
  <transform name="to_world"><lookat origin="0, 1, 0" target="1, 1, 1" up="0, 1, 0"/></transform>
</shape>
<shape type="cylinder" id="post"><ref id="varnish"/><point name="p0" value="0 0 0"/></shape>
<shape type="sphere" id="bulb"><emitter type="area"><spectrum type="d65" name="radiance"/></emitter>
</shape>
<emitter type="spot" id="beam"><spectrum name="intensity" value="400:1, 700:2"/></emitter>
"""


def test_scenes_as_others_write_them_load_as_before(mitsuba, tmp_path):
    path = tmp_path / "box.xml"
    path.write_text(with_more(cornell_box_xml(), HARMLESS), encoding="utf-8")
    scene = read_scene(path, tmp_path)
    ones = np.ones(7)
    xml = scene_xml(scene, reflectances=dict.fromkeys(
        ("white", "green", "red", "coat", "metal", "paint"), ones), light=ones,
                    bands={"R": ones}, range_nm=(400, 700), size=(8, 6))
    assert "$" not in xml and "<default" not in xml
    assert {"ball", "plate", "post", "bulb"} < {shape.id() for shape in load_scene(xml).shapes()}


# ---- files, names and sizes ----------------------------------------------------------------------

BITMAP = ('<bsdf type="principled" id="odd"><texture type="bitmap" name="roughness">{}</texture>'
          "</bsdf>")
OUTSIDE = {
    "a name that is a default":
        ('<default name="x" value="filename"/>'
         + BITMAP.format('<string name="$x" value="{secret}"/>'), "has a \\$ in its name"),
    "a file that is a default":
        ('<default name="x" value="{secret}"/>'
         + BITMAP.format('<string name="filename" value="$x"/>'), "lies outside the session"),
    "a default of a default":
        ('<default name="y" value="{secret}"/><default name="x" value="$y"/>'
         + BITMAP.format('<string name="filename" value="$x"/>'), "lies outside the session"),
    "a default whose name begins another's":
        ('<default name="x" value="{secret}"/>'
         + BITMAP.format('<string name="filename" value="$xtra"/>'), "through a variable"),
    "a folder that is looked in":
        ('<path value="{folder}"/>'
         + BITMAP.format('<string name="filename" value="secret.png"/>'), "lies outside"),
    "a link":
        (BITMAP.format('<string name="filename" value="link.png"/>'), "lies outside"),
    "a spectrum":
        ('<bsdf type="conductor" id="odd"><spectrum name="eta" filename="{secret}"/></bsdf>',
         "lies outside"),
    "a metal":
        ('<bsdf type="conductor" id="odd"><string name="material" value="../../secret"/></bsdf>',
         "is no material's name"),
    "an include inside a shape":
        ('<shape type="sphere" id="odd"><include filename="inner.xml"/></shape>',
         "the <include> is no element"),
    "a pipe": (BITMAP.format('<string name="filename" value="pipe.png"/>'), "missing"),
}


@pytest.mark.parametrize("way", OUTSIDE)
def test_no_file_outside_is_read_whatever_way_it_is_named(way, tmp_path, never_given):
    inside = tmp_path / "session"
    inside.mkdir()
    secret = tmp_path / "secret.png"
    secret.write_bytes(b"secret")
    (inside / "link.png").symlink_to(secret)
    (inside / "inner.xml").write_text('<scene version="3.0.0"/>', encoding="utf-8")
    os.mkfifo(inside / "pipe.png")
    odd, message = OUTSIDE[way]
    odd = odd.replace("{secret}", str(secret)).replace("{folder}", str(tmp_path))
    path = inside / "box.xml"
    path.write_text(with_more(cornell_box_xml(), odd), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_scene(path, inside)


def test_a_file_that_a_default_names_is_found(tmp_path):
    (tmp_path / "r.png").write_bytes(b"")
    path = tmp_path / "box.xml"
    path.write_text(with_more(cornell_box_xml(), '<default name="x" value="r"/>' + BITMAP.format(
        '<string name="filename" value="$x.png"/>')), encoding="utf-8")
    assert read_scene(path, tmp_path).files == (tmp_path / "r.png",)


LARGE = {
    "nested more than": "<scene>" + "<bsdf>" * 20_000 + "</bsdf>" * 20_000 + "</scene>",
    "more than 500000 elements": "<scene>" + "<bsdf/>" * 500_001 + "</scene>",
    "is longer than 20 MB": "<scene>" + " " * 20_000_000 + "</scene>",
    "has a <!DOCTYPE>": '<!DOCTYPE scene [<!ENTITY a "aaaa">]><scene>&a;</scene>',
    "with its defaults in place": '<scene><default name="a" value="' + "b" * 9000 + '"/><default '
                                  'name="c" value="$a$a"/></scene>',
}


@pytest.mark.parametrize("message", LARGE)
@pytest.mark.parametrize("included", [False, True])
def test_a_scene_that_grows_without_end_is_refused(message, included, tmp_path):
    (tmp_path / "part.xml").write_text(LARGE[message], encoding="utf-8")
    path = tmp_path / ("box.xml" if included else "part.xml")
    if included:
        path.write_text(with_more(cornell_box_xml(), '<include filename="part.xml"/>'),
                        encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_scene(path, tmp_path)


def test_instances_that_multiply_are_refused(tmp_path):
    group = '<shape type="shapegroup" id="g">' + '<shape type="cube"/>' * 1000 + "</shape>"
    copies = '<shape type="instance"><ref id="g"/></shape>' * 1000
    path = tmp_path / "box.xml"
    path.write_text(with_more(cornell_box_xml(), group + copies), encoding="utf-8")
    with pytest.raises(InputError, match="instances have 1001000 elements together"):
        read_scene(path, tmp_path)


def test_a_scene_of_usual_depth_is_read(tmp_path):
    path = tmp_path / "box.xml"
    bsdf = '<bsdf type="twosided">' * (MAX_DEPTH - 1) + "</bsdf>" * (MAX_DEPTH - 1)
    path.write_text(with_more(cornell_box_xml(), bsdf), encoding="utf-8")
    assert read_scene(path, tmp_path).light_ids == ("lamp",)


# ---- meshes --------------------------------------------------------------------------------------

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
FACES = [[0, 1, 2], [0, 2, 3]]


def ply(faces, form, header=None, corners=CORNERS):
    head = (f"ply\nformat {form} 1.0\ncomment made here\nelement vertex {len(corners)}\n"
            "property float x\nproperty float y\nproperty float z\nproperty uchar red\n"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n")
    head = (head if header is None else header(head)).encode()
    if form == "ascii":
        rows = [" ".join(f"{value:g}" for value in corner) + " 7" for corner in corners]
        rows += [f"3 {' '.join(map(str, face))}" for face in faces]
        return head + "\n".join(rows).encode()
    order = "<" if "little" in form else ">"
    return head + b"".join(corner.astype(order + "f4").tobytes() + b"\7" for corner in corners) \
        + b"".join(b"\3" + np.array(face, order + "i4").tobytes() for face in faces)


def obj(faces, base=1):
    return ("".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "vt 0 0\nvn 0 0 1\n" + "".join(
        "f " + " ".join(f"{index + base}/1/1" for index in face) + "\n"
        for face in faces)).encode()


def serialized(faces, flags=0x1000, vertices=None, corners=CORNERS, version=4):
    """A file of two meshes, of which the second is the one."""
    def one(faces, vertices):
        kind = "<f8" if flags & 0x2000 else "<f4"
        name = b"mesh\0" if version == 4 else b""
        return struct.pack("<HH", 0x041C, version) + zlib.compress(
            struct.pack("<I", flags) + name + struct.pack("<QQ", vertices, len(faces))
            + corners.astype(kind).tobytes() + np.array(faces, "<u4").tobytes())

    first = one(FACES, len(corners))
    second = one(faces, vertices or len(corners))
    return first + second + struct.pack("<QQI" if version == 4 else "<III", 0, len(first), 2)


FORMS = ("ascii", "binary_little_endian", "binary_big_endian")
WRITERS = {**{f"ply {form}": ("ply", lambda faces, form=form: ply(faces, form), 0)
              for form in FORMS},
           "obj": ("obj", obj, 0),
           "serialized": ("serialized", serialized, 1),
           "serialized, double": ("serialized", lambda faces: serialized(faces, 0x2000), 1),
           "serialized 3": ("serialized", lambda faces: serialized(faces, version=3), 1)}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_face_that_names_no_vertex_is_refused_before_mitsuba_sees_it(writer, tmp_path, mitsuba):
    kind, write, part = WRITERS[writer]
    path = tmp_path / f"ball.{kind}"
    shape = (f'<scene version="3.0.0"><shape type="{kind}"><string name="filename" '
             f'value="{path}"/>' + (f'<integer name="shape_index" value="{part}"/>' if part else "")
             + "</shape></scene>")
    path.write_bytes(write(FACES))
    assert load_scene(shape).shapes()[0].face_count() == 2     # Mitsuba reads what was checked
    for index in (4, 99_999_999, *(() if kind != "ply" else (-1,))):
        path.write_bytes(write([FACES[0], [0, 1, index]]))
        with pytest.raises(InputError) as refused:
            load_scene(shape)
        said = str(refused.value)
        named = index + (kind == "obj")
        assert said.startswith(f"ball.{kind} is damaged: face 1 names the vertex {named}, and "
                               "there are 4")


DAMAGED = {
    "bytes of triangles": ("ply", ply(FACES, FORMS[1])[:-1]),
    "bytes of triangles and": ("ply", ply(FACES, FORMS[1], lambda head: head.replace(
        "vertex 4", "vertex 99999999999"))),
    "numbers of triangles": ("ply", ply(FACES, "ascii", lambda head: head.replace(
        "vertex 4", "vertex 99999999999"))),
    "element vertex -1": ("ply", ply(FACES, "ascii", lambda head: head.replace(
        "vertex 4", "vertex -1"))),
    "has a face of 4 vertices": ("ply", ply(FACES, FORMS[1]).replace(b"\3", b"\4")),
    "is no whole number": ("ply", ply([[0, 1, "2.5"]], "ascii")),
    "is no number": ("ply", ply([[0, 1, "two"]], "ascii")),
    "of a PLY": ("ply", b"\0" * 100),
    "one vertex and one face": ("ply", b"ply\nformat ascii 1.0\nend_header\n"),
    "is damaged: its face 0 reads": ("obj", obj(FACES).replace(b"f 1/1/1 ", b"f -1 ")),
    "the texture coordinate 2": ("obj", obj(FACES).replace(b"f 1/1/1", b"f 1/2/1")),
    "the normal 1431655766": ("obj", obj(FACES).replace(b"f 1/1/1", b"f 1/1/1431655766")),
    "holds zero bytes": ("obj", obj(FACES) + b"\0f 99 99 99"),
    "has no face": ("obj", obj([])),
    "1099511627776 vertices": ("serialized", serialized(FACES, vertices=1 << 40)),
    "are not numbers": ("serialized", serialized(FACES, corners=CORNERS * np.nan)),
    "ends after": ("serialized", serialized(FACES, vertices=500)),
    "is no serialized mesh": ("serialized", b"PK" + b"\0" * 50),
    "has in line 2": ("linearcurve", b"0 0 0 1\n0 0 one 1\n"),
    "has no point": ("bsplinecurve", b"\n\n"),
}


@pytest.mark.parametrize("message", DAMAGED)
def test_a_damaged_mesh_is_refused_in_a_sentence(message, tmp_path):
    kind, content = DAMAGED[message]
    path = tmp_path / "ball.mesh"
    path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        require_sound_mesh(path, kind, int(kind == "serialized"))       # the second of two meshes
    assert message in str(refused.value) and "ball.mesh" in str(refused.value)


def test_a_compressed_mesh_is_inflated_no_further_than_it_says(tmp_path):
    """A megabyte of zeros compressed a thousand times: what is read is what the header says."""
    path = tmp_path / "ball.serialized"
    bomb = struct.pack("<I", 0x1000) + b"\0" + struct.pack("<QQ", 1 << 60, 1) + bytes(50_000_000)
    path.write_bytes(struct.pack("<HH", 0x041C, 4) + zlib.compress(bomb))
    with pytest.raises(InputError, match="is the limit; give a coarser mesh"):
        require_sound_mesh(path, "serialized")


def test_a_mesh_that_is_replaced_is_read_again(tmp_path):
    path = tmp_path / "ball.ply"
    path.write_bytes(ply(FACES, FORMS[1]))
    require_sound_mesh(path, "ply")
    path.write_bytes(ply([FACES[0], [0, 1, 9]], FORMS[1]))
    with pytest.raises(InputError, match="names the vertex 9"):
        require_sound_mesh(path, "ply")


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_command_survives_a_mesh_that_is_damaged(command, captured):
    scene, mesh = captured / "scene" / "box.xml", captured / "scene" / "ball.ply"
    material = re.findall(r'<ref id="([^"]+)"', scene.read_text(encoding="utf-8"))[0]
    scene.write_text(with_more(
        scene.read_text(encoding="utf-8"), '<shape type="ply" id="ball"><string name="filename" '
        f'value="ball.ply"/><ref id="{material}"/></shape>'), encoding="utf-8")
    mesh.write_bytes(ply([FACES[0], [0, 1, 99_999_999]], FORMS[1]))
    done = subprocess.run([sys.executable, "-m", "spectrabox", command, str(captured), "--json"],
                          cwd=ROOT, text=True, capture_output=True, check=False, timeout=600)
    assert done.returncode == 3, done.stderr
    assert "ball.ply is damaged: face 1 names the vertex 99999999" in done.stdout
