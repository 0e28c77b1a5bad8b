"""A scene as an operator wrote it: what is read, what is rewritten, and every documented refusal by
its message.
"""
from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from spectrabox.fixtures.cornell_box import cornell_box_xml
from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.scene.scene_file import check_materials, not_plain_products, read_scene
from spectrabox.reconstruct.scene.scene_xml import scene_xml

ONES = np.ones(3)


def read(folder, text, name="box.xml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return read_scene(path, folder)


def rewritten(scene, **options):
    given = {"reflectances": {bsdf: np.array([0.1, 0.2, 0.3]) for bsdf in scene.bsdf_ids},
             "light": ONES,
             "bands": {"R": ONES, "G": 2 * ONES}, "range_nm": (400.0, 700.0), "size": (8, 6)}
    return ET.fromstring(scene_xml(scene, **(given | options)))


def test_what_a_scene_says_of_itself(tmp_path):
    scene = read(tmp_path, cornell_box_xml(64, 7))
    assert (scene.width, scene.height, scene.max_depth) == (64, 64, 7)
    assert scene.bsdf_ids == ("white", "green", "red") and scene.light_ids == ("lamp",)
    assert scene.surfaces["green_wall"] == "green" and "lamp" not in scene.surfaces and len(
        scene.surfaces) == 7


def test_the_session_s_spectra_replace_the_scene_s_own_and_the_scene_stays(tmp_path):
    scene = read(tmp_path, cornell_box_xml())
    before = ET.tostring(scene.root)
    root = rewritten(scene)
    assert ET.tostring(scene.root) == before
    for bsdf in root.findall("bsdf"):
        assert bsdf.get("type") == "diffuse"
        assert [node.get("value") for node in bsdf.iter("string")] == ["0.1, 0.2, 0.3"]
    film = root.find("sensor/film")
    assert film.get("type") == "specfilm"
    assert [node.get("name") for node in film.findall("spectrum")] == ["band_000_R", "band_001_G"]
    assert len(root.findall("integrator")) == 1 and len(root.findall("sensor/sampler")) == 1


def test_each_light_gets_its_own_spectrum(tmp_path):
    scene = read(tmp_path, cornell_box_xml())
    root = rewritten(scene, light={"lamp": np.array([1.0, 2.0, 3.0])})
    assert root.find(".//emitter/spectrum/string").get("value") == "1, 2, 3"
    with pytest.raises(InputError, match="the light 'lamp' has no spectrum; it is given for sun"):
        rewritten(scene, light={"sun": ONES})


def test_a_coated_surface_keeps_its_coat_and_is_no_plain_product(tmp_path):
    text = cornell_box_xml().replace('<bsdf type="diffuse" id="red"><spectrum name="reflectance" '
                                     'value="0.5"/>',
                                     '<bsdf type="roughplastic" id="red"><float name="alpha" '
                                     'value="0.1"/><rgb name="diffuse_reflectance" value="1,0,0"/>')
    scene = read(tmp_path, text)
    assert not_plain_products(scene) == ("red",)
    coat = next(node for node in rewritten(scene).findall("bsdf") if node.get("id") == "red")
    assert coat.get("type") == "roughplastic" and coat.find("float").get("value") == "0.1"
    assert [node.get("name") for node in coat.findall("spectrum")] == ["diffuse_reflectance"]
    assert coat.find("rgb") is None


def test_a_two_sided_surface_stays_two_sided(tmp_path):
    text = cornell_box_xml().replace('<bsdf type="diffuse" id="red"><spectrum name="reflectance" '
                                     'value="0.5"/></bsdf>', '<bsdf type="twosided" id="red"><bsdf '
                                     'type="diffuse"><spectrum name="reflectance" '
                                     'value="0.5"/></bsdf></bsdf>')
    wall = next(node for node in rewritten(read(tmp_path, text)).findall("bsdf") if node.get("id")
                == "red")
    assert wall.get("type") == "twosided" and wall.find("bsdf/spectrum/string").get(
        "value") == "0.1, 0.2, 0.3"


def test_a_surface_without_a_reflectance_is_refused(tmp_path):
    text = cornell_box_xml().replace('<bsdf type="diffuse" id="red"><spectrum name="reflectance" '
                                     'value="0.5"/>',
                                     '<bsdf type="dielectric" id="red">')
    with pytest.raises(InputError, match="'red' is of type 'dielectric', which has no reflectance "
                       "spectrum"):
        rewritten(read(tmp_path, text))


def test_files_are_named_in_full_whatever_the_folder_one_works_in(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "a.ply").write_text("ply", encoding="utf-8")
    text = cornell_box_xml().replace("</scene>", '<shape type="ply" id="mesh"><ref '
                                     'id="red"/><string name="filename" '
                                     'value="meshes/a.ply"/></shape></scene>')
    scene = read(tmp_path, text)
    named = [node.get("value") for node in rewritten(scene).iter("string") if node.get("name")
             == "filename"]
    assert named == [str(tmp_path / "meshes" / "a.ply")] and scene.files == (tmp_path / "meshes"
                                                                             / "a.ply",)


BROKEN = {
    "is not well-formed XML": "<scene>",
    "its root is <box>, <scene> is needed": "<box/>",
    "has no <sensor>: the scene must hold the camera's pose": "<scene/>",
    "has no <emitter>: the scene must hold the light":
        "<scene><sensor type='perspective'/></scene>",
    "emitter type 'sunsky' is not supported; use one of area":
        "<scene><sensor type='perspective'/><emitter type='sunsky'/></scene>",
    "names 'mesh.ply', which is missing":
        "<scene><sensor type='perspective'/>"
        "<shape type='ply'><string name='filename' value='mesh.ply'/></shape>"
        "</scene>",
    "names '/etc/hostname', which lies outside the session folder; copy it into scene/":
        "<scene><sensor type='perspective'/>"
        "<shape type='ply'><string name='filename' value='/etc/hostname'/></shape>"
        "</scene>",
    "through a variable; write its path out":
        "<scene><sensor type='perspective'/>"
        "<shape type='ply'><string name='filename' value='$mesh'/></shape></scene>",
    "max_depth is 'deep'; a whole number is needed":
        "<scene><sensor type='perspective'/><emitter type='constant'/>"
        "<integrator type='path'><integer name='max_depth' value='deep'/></integrator></scene>",
    "max_depth = 2000000000; 256 is the limit":
        "<scene><sensor type='perspective'/><emitter type='constant'/>"
        "<integrator type='path'><integer name='max_depth' value='2000000000'/></integrator>"
        "</scene>",
    "the BSDF 'wood' is coloured by a picture":
        "<scene><sensor type='perspective'/><emitter type='constant'/>"
        "<shape type='sphere' id='ball'><bsdf type='diffuse' id='wood'>"
        "<texture type='bitmap' name='reflectance'/></bsdf></shape></scene>",
}


@pytest.mark.parametrize("message", BROKEN)
def test_a_broken_scene_is_refused_in_a_sentence(tmp_path, message):
    with pytest.raises(InputError) as caught:
        read(tmp_path, BROKEN[message])
    assert message in str(caught.value) and "box.xml" in str(caught.value)


def test_a_missing_scene_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.xml is missing: give the scene file"):
        read_scene(tmp_path / "nowhere.xml")


def test_materials_and_surfaces_must_match(tmp_path):
    scene = read(tmp_path, cornell_box_xml())
    assert check_materials(scene, {"w": "white", "g": "green", "r": "red"}) == []
    first, second = check_materials(scene, {"w": "white", "g": "green", "blue paint": "blue"})
    assert first == ("material 'blue paint' names the BSDF 'blue', which box.xml lacks; it has "
                     "white, green, red")
    assert second.startswith("box.xml: the BSDF 'red' of red_wall has no material; add "
                             "[materials.red]")
