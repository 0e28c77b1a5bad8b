"""Pictures of spectra between programs: what others wrote is read here, and they read what is
written here, number for number.
"""
from pathlib import Path

import colour
import numpy as np
import OpenImageIO as oiio
import pytest
from spectral.io import envi

from spectrabox.measure.pictures.pixel_spectra import PictureLayout
from spectrabox.measure.pictures.spectra_files import write_spectra
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectral_layers import layer_names, spectral_layers
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum, read_table
from spectrabox.reconstruct.rendering.renderer import all_cores, start_mitsuba
from spectrabox.session.commands.spectrum import convert

OTHERS = Path(colour.__file__).parent / "io" / "tests" / "resources"    # files of its own tests
HALF, SINGLE = 2.0**-11, 2.0**-24       # relative rounding of half and single floats
HEIGHT, WIDTH, MASKED = 21, 5, (20, 4)
RESPONSES = np.full((1, 3, 61), 1 / 61)
COMPRESSIONS = {"none": 0, "rle": 0, "zip": 0, "zips": 0, "piz": 0, "pxr24": 2.0**-16,
                "b44": 0, "b44a": 0,        # of half floats alone: others stay as they are
                "dwaa": 0.02, "dwab": 0.02}     # the coarseness that DWA is made with


@pytest.fixture(scope="module")
def spectra():
    """Mean (H, W, 61) and standard deviation, single floats, not numbers at one pixel."""
    rng = np.random.default_rng(11)
    mean, spread = rng.uniform(0.01, [[[[1.0]]], [[[0.1]]]], (2, HEIGHT, WIDTH, 61))
    mean[MASKED], spread[MASKED] = np.nan, np.nan
    return mean.astype(np.float32), spread.astype(np.float32)


def write(folder, spectra, kept):
    mean, deviation = spectra
    parts = mean[..., kept.mean], deviation[..., kept.deviation]
    blocks = ((first, last, tuple(part[first:last].reshape(-1, part.shape[2]) for part in parts))
              for first, last in ((0, 16), (16, HEIGHT)))
    return write_spectra(blocks, (HEIGHT, WIDTH), folder, kept, lambda share: None, RESPONSES)


@pytest.fixture(scope="module")
def pictures(spectra, tmp_path_factory):
    """Files and values by the kept wavelengths that they are written with."""
    made = {}
    for kept in (PictureLayout(10), PictureLayout(5, True), PictureLayout(10, form="envi")):
        folder = tmp_path_factory.mktemp("pictures")
        mean, spread = spectra
        made[kept] = [(path, nm, values) for path, nm, values in zip(
            write(folder, spectra, kept).values(), kept.nm,
            (mean[..., kept.mean], spread[..., kept.deviation]), strict=True)]
    return made


def files_of(pictures, form):
    return [(kept, *file) for kept, files in pictures.items() if kept.form == form
            for file in files]


def test_colour_science_reads_our_pictures(pictures):
    for kept, path, nm, values in files_of(pictures, "exr"):
        layers, told = colour.read_spectral_image_Fichet2021(str(path), additional_data=True)
        assert list(layers) == ["T"] and not told.is_emissive
        np.testing.assert_allclose(layers["T"][0], nm, rtol=1e-12)
        np.testing.assert_allclose(layers["T"][1], values, rtol=0 if kept.full else HALF)
        attributes = {each.name: each.value for each in told.attributes}
        assert attributes["spectralLayoutVersion"] == "1.0"


def test_mitsuba_reads_our_pictures(pictures):
    mitsuba = start_mitsuba("cpu")
    with all_cores():
        for kept, path, nm, values in files_of(pictures, "exr"):
            picture = mitsuba.Bitmap(str(path))
            names = [field.name for field in picture.struct_()]
            channels = [names.index(name) for name in layer_names(nm)]
            np.testing.assert_allclose(np.array(picture).astype(float)[..., channels], values,
                                       rtol=0 if kept.full else HALF)


def test_viewers_show_the_colour_under_d65(pictures):
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    within = (observer.wavelengths >= 360) & (observer.wavelengths <= 780)
    each_nm = observer.wavelengths[within]
    light = colour.SDS_ILLUMINANTS["D65"]
    weights = observer.values[within] * np.interp(each_nm, light.wavelengths,
                                                  light.values)[:, None]
    for kept, path, nm, values in files_of(pictures, "exr")[::2]:
        file = oiio.ImageInput.open(str(path))
        assert file.spec().channelnames[:3] == ("R", "G", "B")
        shown = file.read_image(0, 0, 0, 3, "float")[2]
        row = np.array([np.interp(each_nm, nm, pixel) for pixel in values[2]])
        expected = colour.XYZ_to_RGB(row @ weights / weights[:, 1].sum(),
                                     colour.RGB_COLOURSPACES["sRGB"])
        # four decimals of the matrix of IEC 61966-2-1, and half floats
        np.testing.assert_allclose(shown, expected, atol=3e-4, rtol=0 if kept.full else HALF)


def test_spy_reads_our_envi_images(pictures):
    for _, path, nm, values in files_of(pictures, "envi"):
        image = envi.open(str(path))
        assert image.bands.band_unit == "Nanometers"
        np.testing.assert_array_equal(image.bands.centers, nm)
        np.testing.assert_array_equal(image.open_memmap(), values)
        # the grid of 5 nm on which spectra are estimated, whatever share of it is kept
        assert image.bands.bandwidths == [5.0] * nm.size
        assert "not what the camera resolves" in image.metadata["description"]


def test_our_own_pictures_are_shown_as_their_mean(pictures):
    for kept, path, nm, values in files_of(pictures, "exr"):
        table = read_table(path)
        np.testing.assert_array_equal(table.nm, nm)
        seen = values[np.isfinite(values[..., 0])].astype(float)
        np.testing.assert_allclose(table.values[0], seen.mean(axis=0),
                                   rtol=1e-12 if kept.full else HALF)
        assert f"1 of {HEIGHT * WIDTH} pixels hold no numbers and are left out" in table.notes
        assert table.facts["quantity"] == ("reflectance" if path.stem == "mean"
                                           else "standard deviation")


def test_a_standard_deviation_is_no_reflectance(pictures):
    path = next(path for _, path, _, _ in files_of(pictures, "exr") if path.stem != "mean")
    with pytest.raises(InputError, match="states the quantity 'standard deviation'"):
        read_spectrum(path, role=Quantity.REFLECTANCE)


def test_a_chart_that_colour_science_wrote_is_read():
    table = read_table(OTHERS / "Ohta1997.exr")
    chart = colour.colorimetry.sds_and_msds_to_msds(list(colour.SDS_COLOURCHECKERS[
        "ColorChecker N Ohta"].values())).align(colour.SpectralShape(400, 700, 20))
    np.testing.assert_allclose(table.nm, chart.wavelengths)     # whose shape counts in steps
    np.testing.assert_allclose(table.values[0], chart.values.mean(axis=1), rtol=HALF)
    assert table.facts["quantity"] == "reflectance"


def test_a_light_that_colour_science_wrote_is_read():
    spectrum = read_spectrum(OTHERS / "D65.exr", role=Quantity.RELATIVE)
    assert spectrum.quantity is Quantity.RADIANCE
    np.testing.assert_allclose(spectrum.values, colour.SDS_ILLUMINANTS["D65"].values, rtol=HALF)


@pytest.mark.parametrize("name, component", [("Polarised.exr", "S0"), ("BiSpectral.exr", "T")])
def test_what_a_renderer_wrote_is_read_without_polarisation_and_fluorescence(name, component):
    nm, values = colour.read_spectral_image_Fichet2021(str(OTHERS / name))[component]
    table = read_table(OTHERS / name)
    np.testing.assert_array_equal(table.nm, nm)
    np.testing.assert_allclose(table.values[0], values.reshape(-1, nm.size).astype(float).mean(0),
                               rtol=1e-12)


@pytest.mark.parametrize("quantity", [Quantity.RADIANCE, Quantity.IRRADIANCE, Quantity.RELATIVE,
                                      Quantity.REFLECTANCE])
def test_a_spectrum_converted_to_exr_keeps_its_numbers_and_quantity(tmp_path, quantity):
    nm, values = np.arange(380, 1101, 4.5), np.linspace(0.05, 0.9, 161)
    (tmp_path / "a.csv").write_text(
        f"# quantity: {quantity.name.lower()}\nwavelength_nm,value\n"
        + "".join(f"{x},{y}\n" for x, y in zip(nm, values, strict=True)), encoding="utf-8")
    convert(files=[tmp_path / "a.csv"], out=tmp_path / "a.exr")
    back = read_spectrum(tmp_path / "a.exr", role=quantity)
    assert back.quantity is quantity
    np.testing.assert_allclose(back.grid.nm, nm, rtol=1e-12)
    np.testing.assert_allclose(back.values, values, rtol=SINGLE)
    layers, told = colour.read_spectral_image_Fichet2021(str(tmp_path / "a.exr"),
                                                         additional_data=True)
    (their_nm, their_values), = layers.values()
    order = np.argsort(their_nm)
    np.testing.assert_allclose(their_nm[order], nm, rtol=1e-12)
    np.testing.assert_allclose(their_values[0, 0, order], values, rtol=SINGLE)
    assert told.is_emissive == (quantity is not Quantity.REFLECTANCE)


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("tile", [0, 16])
def test_every_compression_and_tiles_are_read(tmp_path, compression, tile):
    nm = np.arange(400, 701, 20.0)
    pixels = np.random.default_rng(3).uniform(0.2, 0.4, (40, 33, nm.size)).astype(np.float32)
    spec = oiio.ImageSpec(33, 40, nm.size, oiio.FLOAT)
    spec.channelnames = tuple(layer_names(nm))
    spec.attribute("compression", compression)
    spec.tile_width = spec.tile_height = tile
    file = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    assert file.open(str(tmp_path / "a.exr"), spec) and file.write_image(pixels) and file.close()
    table = read_table(tmp_path / "a.exr")
    np.testing.assert_allclose(table.values[0], pixels.reshape(-1, nm.size).astype(float).mean(0),
                               rtol=1e-12 + COMPRESSIONS[compression])


@pytest.mark.parametrize("names, expected", [
    (["R", "T.400,000000nm", "T.4,1e2nm"], ("T", [(400.0, 1), (410.0, 2)])),
    (["S0.0,5um", "S1.0,5um", "S0.500THz"], ("S0", [(500.0, 0), (599.584916, 2)])),
    (["700nm", "b.300nm", "400.5nm"], ("", [(400.5, 2), (700.0, 0)])),
    (["R", "b.T.400nm", "b.T.500nm"], ("T", [(400.0, 1), (500.0, 2)])),
    (["R", "b.400nm", "b.500nm"], ("b", [(400.0, 1), (500.0, 2)])),
    (["T.400nm.500nm", "R", "S2.400nm", "T.0nm"], ("", []))])
def test_names_of_layers_say_their_wavelengths(names, expected):
    assert spectral_layers(names, first="T") == expected


def test_a_picture_without_one_whole_pixel_is_an_error(tmp_path, spectra):
    empty = [np.full_like(values, np.nan) for values in spectra]
    paths = write(tmp_path, empty, PictureLayout(10))
    with pytest.raises(InputError, match="none of its 105 pixels holds numbers"):
        read_table(paths["mean"])
