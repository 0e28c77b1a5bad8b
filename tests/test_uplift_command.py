"""Spectra behind every pixel of a picture, as the command writes them."""
import json

import numpy as np
import OpenImageIO as oiio
import pytest
from shaded_images import CAMERA, LIGHT, shaded_image, write_image
from spectral.io import envi

from spectrabox.capture.photo import image_rows
from spectrabox.capture.photo.image_files import read_linear_file
from spectrabox.capture.photo.image_rows import exr_rows, open_rows
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.measure.pictures import pixel_spectra
from spectrabox.measure.pictures.uplift import uplift_image
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.uplift_table import (
    build_tables,
    relative_errors,
    uplift_pixels,
    uplift_signals,
)
from spectrabox.session.commands.requests import UpliftRequest
from spectrabox.session.signals.signal_options import response_of_names
from spectrabox.session.signals.uplift_answer import uplift_answer

SIDE = 5
HALF, SINGLE = 2.0**-11, 2.0**-24       # relative rounding of half and single floats


def picture(height=70, width=24):
    return shaded_image(height, width)


def answer(folder, image, **options):
    path = folder / "picture.exr"
    write_exr(path, image, ["R", "G", "B"])
    request = UpliftRequest(image=path, out=folder / "out", sensitivity=CAMERA, light=LIGHT,
                            **{"side": SIDE} | options)
    return uplift_answer(request, lambda stage, share, message: None)[0]


def stored(path):
    file = oiio.ImageInput.open(str(path))
    return np.asarray(file.read_image("float")), list(file.spec().channelnames)


def layers(path):
    """Spectra (H, W, P) and their channels, without the colours that viewers show."""
    pixels, channels = stored(path)
    spectral = [index for index, name in enumerate(channels) if name not in ("R", "G", "B")]
    return pixels[..., spectral], [channels[index] for index in spectral]


def test_the_files_hold_the_spectra_of_the_table(tmp_path):
    image = picture()
    facts = answer(tmp_path, image)
    [table], row = build_tables(load_prior(), response_of_names(CAMERA, LIGHT),
                                lambda signals: [relative_errors(signals, 0.01)],
                                np.ones((SIDE,) * 3, bool))
    mean, spread = uplift_pixels(table, row, image.reshape(-1, 3))
    for name, values, step in (("mean", mean, 2), ("standard_deviation", spread, 4)):
        kept, channels = layers(facts[name])
        assert channels == [f"T.{nm:g},000000nm" for nm in PRIOR_GRID.nm[::step]]
        # half floats, and 1e-6 of sums in another order
        np.testing.assert_allclose(kept.reshape(len(values), -1), values[:, ::step], rtol=HALF,
                                   atol=1e-6)
    assert facts["pixels"] == image[..., 0].size
    assert facts["outside_0_to_1"] == 0
    assert facts["wavelengths_nm"] == PRIOR_GRID.nm[::2].tolist()


def test_in_full_every_wavelength_is_kept_in_single_floats(tmp_path):
    image = picture(3, 4)       # fewer pixels than points of the table: each by itself
    facts = answer(tmp_path, image, full=True)
    signals = image.reshape(-1, 3).astype(float)
    mean, spread, _ = uplift_signals(load_prior(), response_of_names(CAMERA, LIGHT), signals,
                                     relative_errors(signals, 0.01))
    for name, values in (("mean", mean), ("standard_deviation", spread)):
        kept, _ = layers(facts[name])
        np.testing.assert_allclose(kept.reshape(12, 61), values, rtol=4 * SINGLE)


def test_envi_images_hold_the_same_spectra(tmp_path):
    image = picture(3, 4)
    exr, written = (answer(tmp_path, image, full=True, to=form) for form in ("exr", "envi"))
    for name in ("mean", "standard_deviation"):
        shown = envi.open(written[name]).open_memmap()
        np.testing.assert_array_equal(shown, layers(exr[name])[0])


def test_a_spectrum_and_the_responses_in_its_file_give_the_pixel(tmp_path):
    image = picture(3, 4)
    path = answer(tmp_path, image, full=True)["mean"]
    kept = json.loads(oiio.ImageInput.open(path).spec().get_string_attribute(
        "spectrabox:bandResponses"))
    assert kept["wavelengths_nm"] == PRIOR_GRID.nm.tolist()
    signals = layers(path)[0] @ np.array(kept["relative"][0]).T
    # a posterior mean gives back its signal but for the noise that the command takes, 1 %
    np.testing.assert_allclose(signals, image, rtol=0.01)


@pytest.mark.parametrize("height", [3, 70])
def test_an_image_in_memory_gives_what_the_files_hold(tmp_path, height, monkeypatch):
    """Few pixels one by one, and more of them from a table, however many rows are read at once."""
    image = picture(height)
    facts = answer(tmp_path, image, full=True)
    monkeypatch.setattr(pixel_spectra, "ROWS_PER_BLOCK", 1)
    monkeypatch.setattr(pixel_spectra, "PIXELS_AT_ONCE", 1)
    arrays = uplift_image(image, response_of_names(CAMERA, LIGHT), load_prior(), side=SIDE)
    for name, values in zip(("mean", "standard_deviation"), arrays, strict=True):
        np.testing.assert_array_equal(values, layers(facts[name])[0])


def test_pixels_beyond_white_are_counted(tmp_path):
    image = picture()
    image[:3] *= 40
    assert answer(tmp_path, image)["outside_0_to_1"] == pytest.approx(3 / 70)
    image[3:7] *= 40
    with pytest.raises(InputError, match="10% of the pixels are brighter than a perfect white"):
        answer(tmp_path, image)


def test_one_band_beyond_white_is_beyond_white(tmp_path):
    image = picture()
    image[:7, ..., 0] *= 40
    with pytest.raises(InputError, match="10% of the pixels are brighter than a perfect white"):
        answer(tmp_path, image)


@pytest.mark.parametrize("options, message", [
    ({"step": 7}, "--step 7 does not divide 400-700 nm into steps of 5 nm"),
    ({"side": 8}, "--side 8 is not odd and at least 3"),
    ({"white": "1,1"}, "--white has 2 values; the sensitivities have 3 bands")])
def test_options_that_cannot_be_are_errors(tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        answer(tmp_path, picture(2, 2), **options)


def test_a_picture_of_other_bands_is_an_error(tmp_path):
    write_exr(tmp_path / "four.exr", np.full((4, 4, 4), 0.5), ["b1", "b2", "b3", "b4"])
    request = UpliftRequest(image=tmp_path / "four.exr", out=tmp_path, sensitivity=CAMERA,
                            light=LIGHT, side=5)
    with pytest.raises(InputError, match="the image has 4 bands and the sensitivities 3"):
        uplift_answer(request, lambda stage, share, message: None)


@pytest.mark.parametrize("kind", ["uint16", "half", "float"])
def test_rows_are_those_of_the_whole_picture(tmp_path, kind):
    path = tmp_path / ("picture.tif" if kind == "uint16" else "picture.exr")
    write_image(path, picture(), kind=kind)
    (size, rows), whole = open_rows(path), read_linear_file(path).signal
    assert size == whole.shape
    read = np.concatenate([rows(0, 33), rows(33, 70)])
    # integers are divided by their full scale in another order
    np.testing.assert_allclose(read, whole, rtol=2 * SINGLE)


def test_a_value_that_is_no_number_is_an_error(tmp_path):
    image = picture()
    image[5, 5, 1] = np.nan
    with pytest.raises(InputError, match=r"picture.exr has 1 of \d+ values that are NaN"):
        answer(tmp_path, image)


def test_a_picture_that_was_not_written_to_its_end_leaves_no_file(tmp_path):
    with pytest.raises(ZeroDivisionError), \
            exr_rows(tmp_path / "a.exr", 32, 8, ["R", "G", "B"], half=True) as write:
        write(0, np.zeros((16, 8, 3), np.float32))
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_the_way_is_an_error(tmp_path):
    (tmp_path / "a.exr").mkdir()
    with pytest.raises(EnvironmentProblem, match=r"a.exr cannot be written: it is a folder"), \
            image_rows.exr_rows(tmp_path / "a.exr", 4, 4, ["R", "G", "B"], half=True):
        pass
