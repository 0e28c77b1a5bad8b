"""A surface of known texture cut into known materials."""
from __future__ import annotations

import numpy as np
import pytest

import spectrabox as sb
from spectrabox.fixtures.cornell_box import cornell_box_xml
from spectrabox.radiometry.interreflection import response_matrix, white_signal
from spectrabox.radiometry.spectra.given_spectra import as_reflectance
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.scene.split_texture import paints_of_picture

from benchmarks import bench_known_texture as bench

pytestmark = pytest.mark.usefixtures("mitsuba")
PAINTS = [0.2, 0.5, 0.8]
MAP = np.array([[0, 1, 1], [2, 0, 1]])      # the first row is the top


def box(folder, change=lambda text: text):
    (folder / "box.xml").write_text(change(cornell_box_xml(16, 3)), encoding="utf-8")
    return folder / "box.xml"


def paint_seen_by(scene, places, direction):
    """BSDF id that a ray finds from each of some places."""
    import mitsuba as mi

    found = []
    for place in places:
        hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(*place), mi.Vector3f(*direction)))
        found.append(hit.bsdf()[0].id())
    return found


def test_every_texel_of_a_rectangle_is_of_its_paint(tmp_path):
    import mitsuba as mi

    written, materials, error = sb.split_texture(box(tmp_path), "back", (MAP, PAINTS))
    assert error == 0 and [as_reflectance(file, name)[0] for name, file in materials.items()
            ] == pytest.approx(PAINTS)
    scene = mi.load_file(str(written), optimize=False)
    # the back wall is seen along -z, x to the right and y upwards, from the middles of the texels
    places = [(-1 + (column + 0.5) * 2 / 3, 1 - (row + 0.5), -0.9) for row in range(2)
              for column in range(3)]
    assert paint_seen_by(scene, places, (0, 0, -1)) == [f"back {paint + 1}"
                                                        for paint in MAP.ravel()]
    # and the rest of the scene is as it was
    before, after = read_scene(tmp_path / "box.xml"), read_scene(written)
    assert {name: bsdf for name, bsdf in before.surfaces.items() if name != "back"} == {
        name: bsdf for name, bsdf in after.surfaces.items() if "back" not in name}


def test_a_mesh_is_cut_along_its_texture_coordinates(tmp_path):
    """Of a cube every face shows the whole texture: shares of area are those of texels."""
    paint = np.arange(16).reshape(4, 4) % 3
    written, _, _ = sb.split_texture(box(tmp_path), "small_block", (paint, PAINTS))
    import mitsuba as mi
    areas = {shape.bsdf().id(): float(shape.surface_area()[0])
             for shape in mi.load_file(str(written), optimize=False).shapes()
             if "small_block" in shape.id()}
    shares = np.bincount(paint.ravel()) / paint.size
    total = sum(areas.values())
    assert total == pytest.approx(24 * 0.3**2, rel=1e-5)    # single precision
    assert [areas[f"small_block {number + 1}"] / total for number in range(3)] == pytest.approx(
        shares, rel=1e-5)


def test_a_picture_of_few_spectra_is_kept_and_another_loses_no_light():
    rng = np.random.default_rng(3)
    few = rng.uniform(0.1, 0.9, (3, 31))[MAP]
    paint, spectra, error = paints_of_picture(few, 8)
    np.testing.assert_allclose(spectra[paint], few, atol=1e-12)
    assert len(spectra) == 3 and error < 1e-12
    many = rng.uniform(0.1, 0.9, (20, 30, 31))
    paint, spectra, error = paints_of_picture(many, 5)
    assert len(spectra) == 5 and error == pytest.approx(np.sqrt(np.mean((spectra[paint] - many)
                                                                        ** 2)))
    np.testing.assert_allclose(spectra[paint].mean(axis=(0, 1)), many.mean(axis=(0, 1)))


def test_walls_beside_a_known_texture_have_their_spectra(tmp_path):
    photo = bench.box(tmp_path, 3, 40, 256)
    scene, paints, error = sb.split_texture(tmp_path / "box.xml", bench.WALL, tmp_path / "wall.exr")
    assert error < 1e-6 and len(paints) == 3
    found = sb.reconstruct_scene(photo, scene=scene, camera=bench.CAMERA, width=40,
                                 light=(bench.GRID.nm, np.ones(bench.GRID.nm.size)),
                                 materials=dict.fromkeys(bench.TRUTH) | paints,
                                 progress=False)
    relative = response_matrix(bench.GRID, bench.measured_camera().sensitivity.curves,
                               np.ones(bench.GRID.nm.size))
    for name, patch in bench.TRUTH.items():
        truth = relative @ bench.patch(patch) / white_signal(relative)
        # the light is that of the known wall's pixels: 1 % of noise and of blocks on its squares
        assert found[name].measurement.signal == pytest.approx(truth, rel=0.03)


@pytest.mark.parametrize("shape, picture, change, words", [
    ("wall", (MAP, PAINTS), str, "no shape 'wall' directly in <scene>; it has 'lamp', 'floor'"),
    ("back", (MAP, PAINTS[:2]), str, "values from 0 to 2, with 2 reflectances"),
    ("back", (MAP[0], PAINTS), str, "rows and columns"),
    ("back", (MAP, PAINTS), lambda text: text.replace(
        'type="rectangle" id="back"', 'type="sphere" id="back"'), "no texture coordinates")])
def test_what_cannot_be_cut_is_refused(tmp_path, shape, picture, change, words):
    with pytest.raises(sb.InputError, match=words):
        sb.split_texture(box(tmp_path, change), shape, picture)


def test_a_scene_that_is_not_there_is_named(tmp_path):
    with pytest.raises(sb.InputError, match=r"other\.xml is missing"):
        sb.split_texture(tmp_path / "other.xml", "back", (MAP, PAINTS))
