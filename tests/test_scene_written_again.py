"""A scene with recovered spectra, written for a stock Mitsuba: it loads, and reflects them."""
import shutil
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from test_import_scene import FLOOR, INSIDE, PAINT, scene_of

import spectrabox as sb
from spectrabox.measure.results.scene_result import bsdf_reflectances
from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.scene.scene_xml import materials_xml, recovered_xml

NM = np.arange(400.0, 701.0)
ORANGE = 0.1 + 0.6 / (1 + np.exp((580 - NM) / 15))
LOOKED_AT = [430.0, 520.0, 580.0, 660.0]
COATED = """<texture type="checkerboard" id="grain"><float name="color0" value="0.1"/>
  <float name="color1" value="0.3"/></texture>
<bsdf type="roughplastic" id="coat"><rgb name="diffuse_reflectance" value="0.2"/>
  <float name="alpha" value="0.15"/></bsdf>
<bsdf type="principled" id="worn"><rgb name="base_color" value="0.2"/>
  <ref id="grain" name="roughness"/></bsdf>
"""


def reflected(mi, bsdf):
    """Diffuse reflectance at LOOKED_AT."""
    point = mi.SurfaceInteraction3f()
    point.wi, point.wavelengths = mi.Vector3f(0, 0, 1), mi.Spectrum(LOOKED_AT)
    return np.array(bsdf.eval_diffuse_reflectance(point)).ravel()


@pytest.fixture
def painted(tmp_path):
    """A scene with BSDFs as exporters write them, and a mesh."""
    walls = [FLOOR.format(bsdf=f'<ref id="{name}"/>').replace("Floor", f"wall-{name}")
             for name in ("mat-Paint", "coat", "worn")]
    (tmp_path / "mesh.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", encoding="utf-8")
    mesh = '<shape type="ply" id="leaf"><string name="filename" value="mesh.ply"/>' \
        f'{INSIDE}</shape>'
    return scene_of(tmp_path, COATED, PAINT, *walls, mesh)


def test_bsdfs_keep_coats_and_what_is_around_them(mitsuba, painted, tmp_path):
    reflectances = {"mat-Paint": ORANGE, "coat": ORANGE[::-1], "worn": 0.5 * ORANGE,
                    "leaf_bsdf": np.zeros(NM.size)}
    out = tmp_path / "out"
    out.mkdir()
    text = materials_xml(reflectances, (400.0, 700.0), painted, out)
    kinds = {node.get("id"): node.get("type") for node in ET.fromstring(text).findall("bsdf")}
    assert kinds == {"mat-Paint": "twosided", "coat": "roughplastic", "worn": "principled",
                     "leaf_bsdf": "diffuse"}
    (out / "materials.xml").write_text(text, encoding="utf-8")
    shapes = "".join(f'<shape type="sphere" id="ball-{number}"><ref id="{name}"/></shape>'
                     for number, name in enumerate(reflectances))
    (out / "mine.xml").write_text(
        f'<scene version="3.0.0"><include filename="materials.xml"/>{shapes}</scene>',
        encoding="utf-8")
    shown = mitsuba.load_file(str(out / "mine.xml")).shapes()
    assert len(shown) == 4
    for shape in shown:
        name = [*reflectances][int(shape.id().split("-")[1])]
        # single precision, and 1e-6 in place of no reflectance at all
        np.testing.assert_allclose(reflected(mitsuba, shape.bsdf()),
                                   np.interp(LOOKED_AT, NM, reflectances[name]), atol=2e-6)


def test_a_whole_scene_is_written_that_renders_elsewhere(mitsuba, painted, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    reflectances = dict.fromkeys(painted.bsdf_ids, ORANGE)
    (out / "again.xml").write_text(recovered_xml(painted, reflectances, (400.0, 700.0), out),
                                   encoding="utf-8")
    text = (out / "again.xml").read_text(encoding="utf-8")
    assert 'value="../mesh.ply"' in text and "<rgb name=\"base_color\"" not in text
    scene = mitsuba.load_file(str(out / "again.xml"))
    for shape in scene.shapes():
        np.testing.assert_allclose(reflected(mitsuba, shape.bsdf()),
                                   np.interp(LOOKED_AT, NM, ORANGE), atol=2e-6)
    picture = np.array(mitsuba.render(scene, spp=4))
    assert picture.shape == (32, 48, 3) and picture.max() > 0


def test_a_scene_is_not_written_over_itself(finished_demo, tmp_path):
    shutil.copytree(finished_demo, tmp_path / "mybox")
    session = sb.Session(tmp_path / "mybox")
    with pytest.raises(InputError, match="is the scene that was measured"):
        session.spectra.to_mitsuba(tmp_path / "mybox" / "scene" / "box.xml")


def test_materials_are_written_under_the_ids_of_their_bsdfs(finished_demo):
    """A material may have another name than its BSDF in the operator's scene."""
    found = sb.Session(finished_demo).spectra.found
    bsdfs = {surface.name: f"mat-{surface.name}" for surface in found.surfaces}
    reflectances, range_nm = bsdf_reflectances(found, bsdfs)
    assert set(reflectances) == set(bsdfs.values()) and range_nm == (400, 700)
    for surface in found.surfaces:
        np.testing.assert_array_equal(reflectances[f"mat-{surface.name}"],
                                      np.clip(surface.mean, 0, 1))
