"""A spectral EXR as a texture: what is rendered of a surface is the file's own spectrum."""
from pathlib import Path

import numpy as np
import pytest

from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.fixtures.cornell_box import cornell_box_xml
from spectrabox.measure.scene.relight import relight
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra.named_spectra import sensitivities
from spectrabox.radiometry.spectra.spectral_layers import layer_names
from spectrabox.reconstruct.rendering.renderer import register_spectral_texture, start_mitsuba
from spectrabox.reconstruct.scene.scene_file import scene_of_text
from spectrabox.reconstruct.scene.scene_xml import materials_xml, recovered_xml

NM = np.arange(400, 701, 10.0)


@pytest.fixture(scope="module")
def mitsuba():
    made = start_mitsuba("cpu")
    register_spectral_texture()
    return made


def picture(folder, pixels):
    write_exr(folder / "mean.exr", np.dstack([pixels[..., :3], pixels]),
              ["R", "G", "B", *layer_names(NM)])
    return str(folder / "mean.exr")


def test_every_pixel_reflects_its_own_spectrum(mitsuba, tmp_path):
    import drjit as dr
    pixels = np.random.default_rng(1).uniform(0.05, 0.95, (3, 4, NM.size)).astype(np.float32)
    texture = mitsuba.load_dict({"type": "spectral_picture",
                                 "filename": picture(tmp_path, pixels)})
    rows, columns = (each.ravel() for each in np.mgrid[:3, :4])
    for nm in (400.0, 553.0, 700.0):
        si = dr.zeros(mitsuba.SurfaceInteraction3f, rows.size)
        # the middles of the pixels; v runs upwards
        si.uv = mitsuba.Point2f((columns + 0.5) / 4, 1 - (rows + 0.5) / 3)
        si.wavelengths = mitsuba.Spectrum(nm, nm, nm, nm)
        found = np.array(texture.eval(si))
        expected = [np.interp(nm, NM, pixels[row, column])
                    for row, column in zip(rows, columns, strict=True)]
        # single precision of the place between two wavelengths
        np.testing.assert_allclose(found, np.tile(expected, (4, 1)), rtol=1e-5)


def test_a_rendered_card_has_the_reflectance_of_the_file(mitsuba, tmp_path):
    values = 0.2 + 0.6 * (NM - 400) / 300
    path = picture(tmp_path, np.tile(values, (2, 2, 1)).astype(np.float32))
    band = {"type": "regular", "wavelength_min": 540, "wavelength_max": 560, "values": "1, 1"}
    scene = mitsuba.load_dict({
        "type": "scene", "integrator": {"type": "path"},
        "light": {"type": "constant", "radiance": {"type": "uniform", "value": 1.0}},
        "card": {"type": "rectangle", "bsdf": {
            "type": "twosided", "inner": {"type": "diffuse", "reflectance": {
                "type": "spectral_picture", "filename": path}}}},
        "sensor": {"type": "orthographic", "to_world": mitsuba.ScalarTransform4f().look_at(
            [0, 0, 3], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "specfilm", "width": 2, "height": 2, "band": band,
                     "component_format": "float32"}}})
    width_nm = 20
    image = np.array(mitsuba.render(scene, spp=64, seed=1))
    # Under light from all sides a card is as bright as its reflectance, here linear over the band.
    # 256 paths, whose reflectances differ by 0.6 %: a standard error of 0.04 %, times 5.
    np.testing.assert_allclose(image.mean() / width_nm, np.interp(550, NM, values), rtol=0.002)


def test_a_picture_without_layers_is_no_texture(mitsuba, tmp_path):
    write_exr(tmp_path / "a.exr", np.ones((2, 2, 3)), ["R", "G", "B"])
    with pytest.raises((InputError, RuntimeError), match="no layers T"):
        mitsuba.load_dict({"type": "spectral_picture", "filename": str(tmp_path / "a.exr")})


BOX = cornell_box_xml(16, 4)


def relit_xyz(scene, spectra, light, textures):
    grid = grid_from_nm(NM)
    return relight(scene, dict(zip(spectra, spectra, strict=True)), spectra, grid, light,
                   sensitivities("CIE 1931 2 Degree Standard Observer", grid), size=(16, 16),
                   spp=64, seed=1, textures=textures)[0]


def test_a_scene_is_relit_with_its_textures(mitsuba, tmp_path):
    """A texture of one spectrum is that spectrum, and one of another is not."""
    scene = scene_of_text(BOX, tmp_path / "box.xml")
    rising, flat = np.linspace(0.1, 0.9, NM.size), np.full(NM.size, 0.4)
    spectra, light = dict.fromkeys(("white", "green", "red"), flat), np.linspace(1, 2, NM.size)
    plain = relit_xyz(scene, spectra, light, {})
    texture = {"green_wall": Path(picture(tmp_path, np.tile(rising, (2, 2, 1))))}
    painted = relit_xyz(scene, spectra | {"green": rising}, light, {})
    textured = relit_xyz(scene, spectra, light, texture)
    # the same paths; the place between two wavelengths in single precision
    np.testing.assert_allclose(textured, painted, rtol=2e-3, atol=1e-6)
    assert np.abs(textured / plain - 1).max() > 0.05


def test_a_scene_with_textures_loads_from_any_folder(mitsuba, tmp_path, monkeypatch):
    (tmp_path / "pictures").mkdir()
    (tmp_path / "out").mkdir()
    scene = scene_of_text(BOX, tmp_path / "box.xml")
    file = Path(picture(tmp_path / "pictures", np.full((2, 2, NM.size), 0.5)))
    spectra = dict.fromkeys(("white", "green", "red"), np.full(7, 0.4))
    text = recovered_xml(scene, spectra, (400.0, 700.0), tmp_path / "out", {"back": file})
    (tmp_path / "out" / "again.xml").write_text(text, encoding="utf-8")
    assert str(tmp_path) not in text
    monkeypatch.chdir("/")
    loaded = mitsuba.load_file(str(tmp_path / "out" / "again.xml"), optimize=False)
    names = {shape.id(): shape.bsdf().id() for shape in loaded.shapes()}
    assert names["back"] == "white of back" and names["floor"] == "white"
    materials = materials_xml(spectra, (400.0, 700.0), scene, tmp_path / "out", {"back": file})
    (tmp_path / "out" / "materials.xml").write_text(materials, encoding="utf-8")
    assert mitsuba.load_file(str(tmp_path / "out" / "materials.xml")) is not None
