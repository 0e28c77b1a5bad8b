"""Scenes as other programs write them: BSDFs in shapes, instances, pictures; all said at once."""
from pathlib import Path

import numpy as np
import pytest

from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.scene.scene_file import check_materials, read_scene
from spectrabox.reconstruct.scene.scene_xml import scene_xml

# As the exporter of Blender writes scenes: defaults, refs by name, principled inside twosided.
HEAD = """<scene version="3.0.0">
  <default name="spp" value="128"/>
  <integrator type="path"><integer name="max_depth" value="6"/></integrator>
  <sensor type="perspective" id="Camera">
    <string name="fov_axis" value="x"/><float name="fov" value="40"/>
    <transform name="to_world">
      <lookat origin="0, 2, 8" target="0, 0.5, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm">
      <integer name="width" value="48"/><integer name="height" value="32"/></film>
  </sensor>
  <emitter type="point" id="Light">
    <point name="position" x="3" y="6" z="4"/><rgb name="intensity" value="10, 10, 10"/>
  </emitter>
"""
PAINT = """<bsdf type="twosided" id="mat-Paint"><bsdf type="principled">
  <rgb name="base_color" value="0.8 0.3 0.2"/><float name="roughness" value="0.4"/></bsdf></bsdf>
"""
FLOOR = """<shape type="rectangle" id="Floor"><transform name="to_world"><scale value="6"/>
  <rotate x="1" angle="-90"/></transform>{bsdf}</shape>
"""
INSIDE = '<bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.5 0.5"/></bsdf>'
GROUP = """<shape type="shapegroup" id="Cone">
  <shape type="cube" id="Base"><transform name="to_world"><scale x="0.6" y="0.2" z="0.6"/>
    <translate y="0.2"/></transform><ref id="mat-Paint" name="bsdf"/></shape>
  <shape type="sphere" id="Ball"><float name="radius" value="0.4"/>
    <point name="center" x="0" y="0.8" z="0"/><ref id="mat-Paint" name="bsdf"/></shape>
</shape>
<shape type="instance" id="Left"><ref id="Cone"/><transform name="to_world">
  <rotate y="1" angle="30"/><translate x="-1.4"/></transform></shape>
<shape type="instance" id="Right"><ref id="Cone"/><transform name="to_world">
  <scale value="0.7"/><translate x="1.4" z="0.5"/></transform></shape>
"""


def scene_of(tmp_path, *parts):
    path = tmp_path / "scene.xml"
    path.write_text(HEAD + "".join(parts) + "</scene>", encoding="utf-8")
    return read_scene(path, tmp_path)


def test_a_bsdf_inside_a_shape_is_lifted_and_named_after_it(tmp_path):
    scene = scene_of(tmp_path, PAINT, FLOOR.format(bsdf=INSIDE))
    assert scene.surfaces == {"Floor": "Floor_bsdf"}
    assert set(scene.bsdf_ids) == {"mat-Paint", "Floor_bsdf"}
    assert check_materials(scene, {"floor": "Floor_bsdf"}) == []


def test_bsdfs_that_are_written_alike_become_one_material(tmp_path):
    other = FLOOR.format(bsdf=INSIDE).replace("Floor", "Wall").replace("-90", "0")
    own = FLOOR.format(bsdf=INSIDE.replace("0.5", "0.2")).replace("Floor", "Roof")
    named = FLOOR.format(bsdf=INSIDE.replace("<bsdf", '<bsdf id="Lid"')).replace("Floor", "Top")
    scene = scene_of(tmp_path, FLOOR.format(bsdf=INSIDE), other, own, named)
    assert scene.surfaces == {"Floor": "Floor_bsdf", "Wall": "Floor_bsdf", "Roof": "Roof_bsdf",
                              "Top": "Lid"}


def test_the_bsdf_is_found_among_other_references(tmp_path):
    both = '<ref id="air" name="interior"/><ref id="mat-Paint" name="bsdf"/>'
    scene = scene_of(tmp_path, PAINT, '<medium type="homogeneous" id="air"/>',
                     FLOOR.format(bsdf=both))
    assert scene.surfaces == {"Floor": "mat-Paint"}


def test_an_instance_becomes_the_shapes_of_its_group(tmp_path):
    scene = scene_of(tmp_path, PAINT, FLOOR.format(bsdf=INSIDE), GROUP)
    assert scene.surfaces == {"Floor": "Floor_bsdf", "Left Base": "mat-Paint",
                              "Left Ball": "mat-Paint", "Right Base": "mat-Paint",
                              "Right Ball": "mat-Paint"}


def test_what_is_written_out_lies_where_mitsuba_puts_the_instances(tmp_path):
    from spectrabox.reconstruct.rendering.renderer import start_mitsuba
    start_mitsuba("cpu")
    import mitsuba as mi
    scene = scene_of(tmp_path, PAINT, FLOOR.format(bsdf=INSIDE), GROUP)
    flat = np.full(7, 0.5)
    ours = scene_xml(scene, reflectances={"mat-Paint": flat, "Floor_bsdf": flat}, light=np.ones(7),
                     bands={"R": np.ones(7)}, range_nm=(400, 700), size=(48, 32))
    theirs = scene.path.read_text(encoding="utf-8")
    across, down = np.meshgrid(np.arange(0.5, 48) / 48, np.arange(0.5, 32) / 32)
    places = []
    for text in (ours, theirs):
        loaded = mi.load_string(text, optimize=False)
        ray, _ = loaded.sensors()[0].sample_ray(0.0, 0.5, mi.Point2f(across.ravel(), down.ravel()),
                                                mi.Point2f(0.5, 0.5))
        met = loaded.ray_intersect(ray)
        places.append(np.where(np.array(met.is_valid()), np.array(met.p), -99.0))
    same = np.abs(places[0] - places[1]).max(axis=0) < 1e-3
    assert same.mean() > 0.998                      # a ray may graze an edge
    assert (places[0][1] > 0.05).mean() > 0.05      # above the floor: the instances are in view


def test_shapes_keep_their_order(tmp_path):
    """Paths are told apart by it."""
    scene = scene_of(tmp_path, PAINT, FLOOR.format(bsdf=INSIDE), GROUP)
    assert [node.get("type") for node in scene.root.findall("shape")] == [
        "rectangle", "cube", "sphere", "cube", "sphere"]


def test_everything_that_is_not_understood_is_said_at_once(tmp_path):
    picture = """<bsdf type="diffuse" id="wood"><texture type="bitmap" name="reflectance">
      <string name="filename" value="wood.png"/></texture></bsdf>"""
    parts = (picture, FLOOR.format(bsdf='<ref id="wood"/>'),
             '<shape type="hair" id="fur"><ref id="wood"/></shape>',
             '<shape type="instance" id="lost"><ref id="nothing"/></shape>')
    with pytest.raises(InputError) as refused:
        scene_of(tmp_path, *parts)
    said = str(refused.value).splitlines()
    assert len(said) == 3 and all(line.startswith("scene.xml: ") for line in said)
    assert any("'wood' is coloured by a picture" in line for line in said)
    assert any("'fur' is of type 'hair'" in line for line in said)
    assert any("'lost' refers to no group" in line for line in said)


def test_a_picture_that_colours_nothing_is_left_alone(tmp_path):
    roughness = PAINT.replace('<float name="roughness" value="0.4"/>',
                              '<texture type="bitmap" name="roughness"><string name="filename" '
                              'value="r.png"/></texture>')
    Path(tmp_path / "r.png").write_bytes(b"")
    assert scene_of(tmp_path, roughness, FLOOR.format(bsdf='<ref id="mat-Paint"/>')).surfaces
