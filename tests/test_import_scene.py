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
    with pytest.raises(InputError, match="'Floor' is in a medium"):     # it is no BSDF
        scene_of(tmp_path, PAINT, '<medium type="homogeneous" id="air"/>', FLOOR.format(bsdf=both))


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
    lines = str(refused.value).splitlines()
    assert len(lines) == 3 and all(line.startswith("scene.xml: ") for line in lines)
    assert any("'wood' is coloured by a picture" in line for line in lines)
    assert any("'fur' is of type 'hair'" in line for line in lines)
    assert any("'lost' refers to no group" in line for line in lines)


def test_a_picture_that_colours_nothing_is_left_alone(tmp_path):
    roughness = PAINT.replace('<float name="roughness" value="0.4"/>',
                              '<texture type="bitmap" name="roughness"><string name="filename" '
                              'value="r.png"/></texture>')
    Path(tmp_path / "r.png").write_bytes(b"")
    assert scene_of(tmp_path, roughness, FLOOR.format(bsdf='<ref id="mat-Paint"/>')).surfaces


# ---- several files, older names, what has no spectrum --------------------------------------------

CAMERA = HEAD[HEAD.index("<sensor"):HEAD.index("  <emitter")]
LAMP = HEAD[HEAD.index("  <emitter"):]


def written(tmp_path, name, text, version="3.0.0"):
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'<scene version="{version}">{text}</scene>', encoding="utf-8")
    return path


def test_a_scene_in_several_files_is_read_as_one(tmp_path):
    written(tmp_path, "fragments/camera.xml", '<default name="depth" value="3"/>' + CAMERA)
    written(tmp_path, "lights/warm.xml", LAMP)
    written(tmp_path, "fragments/things.xml", PAINT + FLOOR.format(bsdf='<ref id="mat-Paint"/>')
            + '<shape type="ply" id="mesh"><string name="filename" value="mesh.ply"/>'
            '<ref id="mat-Paint"/></shape>')
    (tmp_path / "fragments" / "mesh.ply").write_text("ply", encoding="utf-8")
    main = written(tmp_path, "scene.xml", '<default name="depth" value="9"/>'
                   '<default name="light" value="warm"/><integrator type="path"><integer '
                   'name="max_depth" value="$depth"/></integrator>'
                   '<include filename="fragments/camera.xml"/><include filename='
                   '"lights/$light.xml"/><include filename="fragments/things.xml"/>')
    scene = read_scene(main, tmp_path)
    assert scene.surfaces == {"Floor": "mat-Paint", "mesh": "mat-Paint"}
    assert scene.light_ids == ("Light",) and scene.max_depth == 9   # the first default counts
    names = [file.relative_to(tmp_path).as_posix() for file in scene.files]
    assert names == ["fragments/camera.xml", "lights/warm.xml", "fragments/things.xml",
                     "fragments/mesh.ply"]
    named = [node.get("value") for node in scene.root.iter("string")
             if node.get("name") == "filename"]
    assert named == ["fragments/mesh.ply"]


def test_files_are_looked_for_where_a_path_says(tmp_path):
    (tmp_path / "common" / "meshes").mkdir(parents=True)
    (tmp_path / "common" / "meshes" / "a.ply").write_text("ply", encoding="utf-8")
    scene = scene_of(tmp_path, '<path value="common"/>', PAINT, '<shape type="ply" id="a"><string '
                     'name="filename" value="meshes/a.ply"/><ref id="mat-Paint"/></shape>')
    assert scene.files == (tmp_path / "common" / "meshes" / "a.ply",)
    assert scene.root.find("path") is None


def test_a_scene_of_mitsuba_0_5_is_that_of_mitsuba_3(tmp_path):
    from spectrabox.reconstruct.rendering.renderer import load_scene, start_mitsuba
    start_mitsuba("cpu")
    text = """<integrator type="bdpt"><integer name="maxDepth" value="40"/></integrator>
      <sensor type="perspective"><string name="fovAxis" value="x"/><float name="fov" value="40"/>
        <float name="nearClip" value="0.1"/><transform name="toWorld">
        <lookAt origin="0, 2, 8" target="0, 0.5, 0" up="0, 1, 0"/></transform>
        <sampler type="ldsampler"><integer name="sampleCount" value="4"/></sampler>
        <film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="32"/>
        </film></sensor>
      <bsdf type="plastic" id="paint"><srgb name="diffuseReflectance" value="0.5, 0.4, 0.3"/>
        <float name="intIOR" value="1.6"/></bsdf>
      <shape type="rectangle"><transform name="toWorld"><scale value="6"/></transform>
        <ref id="paint"/></shape>
      <shape type="sphere"><point name="center" x="0" y="3" z="3"/>
        <float name="radius" value="0.3"/><emitter type="area">
        <spectrum name="radiance" value="400:1, 700:2"/></emitter></shape>"""
    scene = read_scene(written(tmp_path, "old.xml", text, "0.5.0"), tmp_path)
    assert scene.max_depth == 40 and scene.surfaces == {"shape_1": "paint"}
    xml = scene_xml(scene, reflectances={"paint": np.full(7, 0.5)}, light=np.ones(7),
                    bands={"R": np.ones(7)}, range_nm=(400, 700), size=(48, 32))
    for word in ('name="to_world"', 'name="int_ior"', 'name="diffuse_reflectance"', "<lookat"):
        assert word in xml
    assert len(load_scene(xml).shapes()) == 2


def test_a_surface_without_a_bsdf_has_a_material_of_its_own(tmp_path):
    bare = '<shape type="rectangle" id="Wall"/><shape type="cube"/>'
    lamp = '<shape type="sphere" id="bulb"><emitter type="area"/></shape>'
    scene = scene_of(tmp_path, PAINT, FLOOR.format(bsdf='<ref id="mat-Paint"/>'), bare, lamp)
    assert scene.surfaces == {"Floor": "mat-Paint", "Wall": "Wall_bsdf", "shape_3": "shape_3_bsdf"}
    assert check_materials(scene, dict.fromkeys(())) != []
    assert check_materials(scene, {"p": "mat-Paint", "w": "Wall_bsdf", "c": "shape_3_bsdf"}) == []


CHECKS = '<texture type="checkerboard" id="checks"/>'
NO_SPECTRUM = {
    "is coloured by a texture of type 'checkerboard'":
        '<bsdf type="diffuse" id="odd"><texture type="checkerboard" name="reflectance"/></bsdf>',
    "is coloured by a texture of type 'checkerboard', and":
        CHECKS + '<bsdf type="diffuse" id="odd"><ref name="reflectance" id="checks"/></bsdf>',
    "is of type 'dielectric', which has no reflectance spectrum":
        '<bsdf type="dielectric" id="odd"/>',
    "is of type 'mask', which is partly transparent":
        '<bsdf type="mask" id="odd"><bsdf type="diffuse"/></bsdf>',
    "is of type 'bumpmap', which has bumps by a texture":
        '<bsdf type="bumpmap" id="odd"><texture type="checkerboard"/><bsdf type="diffuse"/></bsdf>',
    "is of type 'blendbsdf', which mixes two BSDFs":
        '<bsdf type="blendbsdf" id="odd"><bsdf type="diffuse"/><bsdf type="plastic"/></bsdf>',
    "has another BSDF on its back":
        '<bsdf type="twosided" id="odd"><bsdf type="diffuse"/><bsdf type="plastic"/></bsdf>',
}


@pytest.mark.parametrize("message", NO_SPECTRUM)
def test_a_surface_without_one_spectrum_is_refused_before_anything_runs(tmp_path, message):
    odd = NO_SPECTRUM[message]
    with pytest.raises(InputError, match=f"the BSDF 'odd' {message}"):
        scene_of(tmp_path, odd, FLOOR.format(bsdf='<ref id="odd"/>'))
    # of a lamp, or of nothing, it does not matter
    bulb = '<shape type="sphere"><ref id="odd"/><emitter type="area"/></shape>'
    assert scene_of(tmp_path, odd, PAINT, FLOOR.format(bsdf='<ref id="mat-Paint"/>'),
                    bulb).surfaces == {"Floor": "mat-Paint"}


def test_lights_and_files_that_cannot_be_used_are_said_with_the_rest(tmp_path):
    meshes = "".join(f'<shape type="ply" id="m{number}"><string name="filename" '
                     f'value="mesh{number}.ply"/></shape>' for number in range(7))
    with pytest.raises(InputError) as refused:
        scene_of(tmp_path, '<include filename="gone.xml"/>', meshes,
                 '<emitter type="sunsky"/><emitter type="volumelight"/>',
                 '<shape type="ply" id="out"><string name="filename" value="../../up.ply"/>'
                 '</shape>')
    lines = str(refused.value).splitlines()
    assert len(lines) == 5
    assert lines[0] == "scene.xml includes 'gone.xml', which is missing; copy it next to the scene"
    assert next(line for line in lines if "emitter type" in line).startswith(
        "scene.xml: emitter type 'sunsky' is not supported; use one of area, constant")
    assert any("names '../../up.ply', which lies outside the session folder" in line
               for line in lines)
    assert lines[-1] == ("scene.xml names 7 files that are missing: 'mesh0.ply', 'mesh1.ply', "
                         "'mesh2.ply', 'mesh3.ply', 'mesh4.ply' and 2 more")


def test_what_includes_itself_or_lies_elsewhere_is_refused(tmp_path):
    inner = tmp_path / "session"
    written(inner, "loop.xml", CAMERA + LAMP + '<include filename="loop.xml"/>')
    with pytest.raises(InputError, match=r"more than 100 files; 'loop.xml' may include itself"):
        read_scene(inner / "loop.xml", inner)
    written(tmp_path, "secret.xml", LAMP)
    main = written(inner, "scene.xml", CAMERA + '<include filename="../secret.xml"/>')
    with pytest.raises(InputError, match=r"includes '\.\./secret\.xml', which lies outside"):
        read_scene(main, inner)
    (inner / "bad.xml").write_text("<scene>", encoding="utf-8")
    main = written(inner, "scene.xml", CAMERA + LAMP + '<include filename="bad.xml"/>')
    with pytest.raises(InputError, match=r"includes 'bad\.xml', which cannot be read"):
        read_scene(main, inner)


def test_a_light_whose_place_is_a_vector_can_be_moved(tmp_path):
    """As Blender's exporter has written it since Mitsuba 3.5."""
    from spectrabox.reconstruct.scene.edit_scene import with_light_moved
    text = HEAD.replace('<point name="position"', '<vector name="position"')
    path = tmp_path / "scene.xml"
    path.write_text(text + PAINT + FLOOR.format(bsdf='<ref id="mat-Paint"/>') + "</scene>",
                    encoding="utf-8")
    moved = with_light_moved(read_scene(path), 0, np.array([1.0, 0, -1]))
    position = next(node for node in moved.root.iter("vector") if node.get("name") == "position")
    assert position.get("value") == "4, 6, 3"


def test_a_scene_of_several_files_is_not_copied_in_part(tmp_path):
    from spectrabox.reconstruct.scene.edit_scene import scene_with_light_moved
    written(tmp_path, "lamp.xml", LAMP)
    main = written(tmp_path, "scene.xml", CAMERA + '<include filename="lamp.xml"/>')
    with pytest.raises(InputError, match="includes other files, whose parts a copy could not"):
        scene_with_light_moved(main, 0, np.zeros(3), tmp_path)


def test_no_two_things_share_an_id_whatever_a_lifted_bsdf_would_be_called(tmp_path):
    inside = INSIDE.replace("0.5 0.5 0.5", "0.2 0.3 0.4")
    named = INSIDE.replace("<bsdf ", '<bsdf id="Wall_bsdf" ')
    scene = scene_of(tmp_path, named, FLOOR.format(bsdf='<ref id="Wall_bsdf" name="bsdf"/>'),
                     FLOOR.replace("Floor", "Wall").format(bsdf=inside))
    assert scene.surfaces["Wall"] != scene.surfaces["Floor"] == "Wall_bsdf"
    ids = [node.get("id") for node in scene.root.iter() if node.get("id") and node.tag != "ref"]
    assert len(ids) == len(set(ids))
