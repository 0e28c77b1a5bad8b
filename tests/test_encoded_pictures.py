"""Pictures in sRGB: spectra of what would look so, by command and in Python, and no camera's."""
import json

import numpy as np
import OpenImageIO as oiio
import pytest
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.capture.photo.image_writers import write_png
from spectrabox.measure import texts
from spectrabox.measure.pictures.uplift import with_colours
from spectrabox.measure.signals.signal_capture import OF_SRGB
from spectrabox.radiometry import appearance
from spectrabox.radiometry.appearance import (
    decode_srgb,
    encode_srgb,
    reflectance_to_srgb,
    signal_of_srgb,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.session.cli import app
from spectrabox.session.signals.signal_options import response_of_names

COLOURS = np.array([[200, 100, 50], [90, 140, 70], [128, 128, 128], [60, 70, 130]], np.uint8)
PICTURE = np.repeat(np.repeat(COLOURS.reshape(2, 2, 3), 4, axis=0), 5, axis=1)      # 8 x 10
NAMED = ("--sensitivity", "Nikon 5100 (NPL)", "--light", "D65")


def answer(*arguments):
    done = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    return done.exit_code, json.loads(done.stdout)


@pytest.fixture
def png(tmp_path):
    write_png(tmp_path / "picture.png", PICTURE)
    return tmp_path / "picture.png"


def test_signals_of_srgb_undo_what_a_screen_shows():
    """White is 1 in each band, and a grey as light as it is."""
    np.testing.assert_allclose(signal_of_srgb(np.ones(3)), 1, rtol=1e-12)
    np.testing.assert_allclose(signal_of_srgb(np.full((2, 3), 0.5)), decode_srgb(np.array(0.5)),
                               rtol=1e-12)


def test_the_spectra_of_a_picture_have_its_colours(png, tmp_path):
    code, facts = answer("uplift", png, "--encoded", "--side", "17", "--full", "-o",
                         tmp_path / "out")
    assert code == 0 and facts["white"] == [1, 1, 1] and facts["white_from"] == "white of sRGB"
    assert facts["caveat"] == texts.says(OF_SRGB) and facts["outside_0_to_1"] == 0
    file = oiio.ImageInput.open(facts["mean"])
    stored = np.asarray(file.read_image("float"))
    spectral = [index for index, name in enumerate(file.spec().channelnames)
                if name not in ("R", "G", "B")]
    mean, deviation = sb.uplift(png, encoded=True)
    # the command interpolates in a table of 17 points a side: 0.005 in reflectance
    np.testing.assert_allclose(stored[..., spectral], mean, atol=0.01)
    for spectrum, wanted in zip(mean.reshape(-1, 61), PICTURE.reshape(-1, 3) / 255, strict=True):
        # the mean of spectra whose signals err by 1 %: a step of 2 in 255
        np.testing.assert_allclose(reflectance_to_srgb(PRIOR_GRID.nm, spectrum), wanted, atol=0.012)
    _, one = answer("sample", "--srgb", "200,100,50", "--noise", "0.002")
    np.testing.assert_allclose(mean[0, 0], one["mean"], atol=0.02)
    assert deviation.min() > 0


def test_code_values_are_taken_of_8_and_16_bits_and_as_shares(png):
    wide = PICTURE.astype(np.uint16) * 257
    for image in (PICTURE, wide, PICTURE / 255):
        np.testing.assert_allclose(sb.uplift(image, encoded=True)[0],
                                   sb.uplift(png, encoded=True)[0], atol=1e-5)


def test_a_picture_in_srgb_is_no_camera_s(png, tmp_path):
    code, facts = answer("uplift", png, "--encoded", *NAMED, "-o", tmp_path / "out")
    assert code == 2 and "leave --sensitivity, --light and --white out" in facts["error"]
    code, facts = answer("uplift", png, "-o", tmp_path / "out")
    assert code == 2 and "--encoded of a PNG or JPEG in sRGB" in facts["error"]
    code, facts = answer("uplift", png, *NAMED, "-o", tmp_path / "out")
    assert code == 3 and "--encoded takes a picture in sRGB" in facts["error"]
    with pytest.raises(InputError, match="leave camera, light and white out"):
        sb.uplift(png, encoded=True, camera="Nikon 5100 (NPL)", light="D65")
    with pytest.raises(InputError, match="given with encoded=True"):
        sb.uplift(PICTURE / 255)
    with pytest.raises(InputError, match=r"0 to 1"):
        sb.uplift(PICTURE.astype(float), encoded=True)
    assert not (tmp_path / "out").exists()


def test_a_photo_decoded_from_srgb_is_no_camera_s_signal(tmp_path):
    noisy = 0.4 + 0.01 * np.random.default_rng(1).standard_normal((80, 90, 3))
    write_png(tmp_path / "processed.png", np.round(255 * encode_srgb(noisy)).astype(np.uint8))
    photo = sb.open_photo(tmp_path / "processed.png", not_linear=True)
    with pytest.raises(InputError, match=r"was decoded from sRGB.*encoded=True"):
        sb.uplift(photo, camera="Nikon 5100 (NPL)", light="D65")
    with pytest.raises(InputError, match="is open holds linear values"):
        sb.uplift(photo, encoded=True)


def layers_of(path):
    """Wavelengths (P,) and reflectances (H, W, P) of a spectral EXR."""
    picture = oiio.ImageInput.open(str(path))
    names, values = picture.spec().channelnames, np.array(picture.read_image("float"))
    picture.close()
    layers = sorted((float(name[2:-2].replace(",", ".")), index)
                    for index, name in enumerate(names) if name.startswith("T."))
    return np.array([nm for nm, _ in layers]), values[..., [index for _, index in layers]]


CORNERS = [(0, 0, 0), (0, 0, 255), (0, 255, 0), (255, 0, 0), (0, 255, 255), (255, 0, 255),
           (255, 255, 0), (255, 255, 255), (128, 128, 128), (30, 60, 90), (200, 100, 50)]


@pytest.mark.parametrize("options", [(), ("--side", "9", "--full"), ("--step", "20")])
def test_pixels_come_back_to_their_colours_or_are_counted(tmp_path, options):
    """Each colour of the picture, by the spectra of its file under D65."""
    picture = np.repeat(np.array(CORNERS, np.uint8)[None].repeat(8, axis=0), 16, axis=1)
    write_png(tmp_path / "a.png", picture)
    result = CliRunner().invoke(app, ["uplift", str(tmp_path / "a.png"), "--encoded", "-o",
                                      str(tmp_path / "out"), "--quiet", "--json", *options])
    facts = json.loads(result.stdout)
    assert result.exit_code == 0
    assert facts["delta_e00"] == str(tmp_path / "out" / "delta_e00.exr")
    written = oiio.ImageInput.open(facts["delta_e00"])
    assert written.spec().channelnames == ("delta_e00",)
    apart = np.asarray(written.read_image("float"))[0, ::16, 0]
    nm, mean = layers_of(tmp_path / "out" / "mean.exr")
    fine = np.array([np.interp(PRIOR_GRID.nm, nm, row) for row in mean[0, ::16].astype(float)])
    wanted = appearance.lab_from_xyz(signal_of_srgb(np.array(CORNERS) / 255), np.ones(3))
    off = appearance.ciede2000(appearance.reflectance_to_lab(PRIOR_GRID.nm, fine), wanted)
    # half floats, and an observer of 5 nm for one of 1 nm, add up to 0.2
    np.testing.assert_allclose(apart, off, atol=0.3 if "20" not in options else 1)
    assert np.mean(off > 0.7) <= facts["colours_off"] <= np.mean(off > 0.3)
    assert facts["colours_off"] < 0.2
    table = next(one for one in facts["findings"] if one["code"] == "uplift.table")
    assert (table["severity"] == "warn") == (facts["table_delta_e00"]["largest"] > 1) \
        == (facts["table_delta_e00"]["beyond"] > 0)
    assert len(facts["warnings"]) == sum(one["severity"] == "warn" for one in facts["findings"])
    if "9" in options:
        assert facts["table_delta_e00"]["largest"] > 1


def test_a_colour_that_no_reflectance_has_is_left_near():
    response = np.eye(3) @ np.repeat(np.eye(3), 3, axis=1) / 3
    mean = np.full((2, 9), 0.5)
    spectra = with_colours(mean, np.array([[0.4, 0.5, 0.6], [1.5, 0.5, 0.5]]), response)
    # eight digits are more than the colours need
    np.testing.assert_allclose(spectra[0] @ response.T, [0.4, 0.5, 0.6], atol=1e-6)
    assert np.all(spectra <= 1)


def test_how_far_a_spectrum_is_from_the_colour_of_its_pixel():
    """Next to none where a reflectance has it; of a screen's primaries, by the spectrum itself."""
    picture = np.array([[[128, 128, 128], [200, 100, 50]], [[0, 255, 0], [0, 0, 255]]], np.uint8)
    pixels = sb.uplift(picture, encoded=True)
    mean, deviation = pixels
    assert mean is pixels.mean and deviation is pixels.standard_deviation
    wanted = appearance.lab_from_xyz(signal_of_srgb(picture / 255), np.ones(3))
    off = appearance.ciede2000(appearance.reflectance_to_lab(PRIOR_GRID.nm, mean), wanted)
    # an observer of 5 nm for one of 1 nm
    np.testing.assert_allclose(pixels.delta_e00, off, atol=0.2)
    assert pixels.delta_e00[0].max() < 0.13      # nearer ones are left as they are


def test_how_far_a_spectrum_is_from_a_camera_s_signal():
    """Of signals of a smooth surface nothing is left; of one that no surface gives, as much as the
    signal of the spectrum is off, whatever the camera.
    """
    surface = np.interp(PRIOR_GRID.nm, [400, 500, 600, 700], [0.1, 0.2, 0.5, 0.6])
    for camera in ("Nikon 5100 (NPL)", "CIE 1931 2 Degree Standard Observer"):
        response = response_of_names(camera, "D65")
        image = np.array([[response @ surface, [0.02, 0.6, 0.02]]])
        pixels = sb.uplift(image, camera=camera, light="D65")
        assert pixels.delta_e00[0, 0] < 1 < 5 < pixels.delta_e00[0, 1]
    # the observer's signal is the colour
    wanted = appearance.lab_from_xyz(image, np.ones(3))
    off = appearance.ciede2000(appearance.reflectance_to_lab(PRIOR_GRID.nm, pixels.mean), wanted)
    np.testing.assert_allclose(pixels.delta_e00, off, rtol=0.02, atol=0.2)
