"""Colour profiles: laws of their transforms, and files as other programs read them."""
import io
import json
import os
import shutil
import subprocess
import tomllib

import colour
import numpy as np
import OpenImageIO as oiio
import pytest
from PIL import Image, ImageCms
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.calibrate.colour_profile import (
    D50,
    colour_errors,
    d50_weights,
    fit_transform,
    stated_transform,
)
from spectrabox.capture.photo.image_writers import write_tiff16
from spectrabox.measure.profiles import archive_quantities
from spectrabox.measure.profiles.colour_profile import (
    FRESH,
    MATRIX,
    STATED,
    TABLE,
    colour_profile,
    response_of_curves,
)
from spectrabox.radiometry import profile_files
from spectrabox.radiometry.appearance import BRADFORD, ciede2000, lab_from_xyz
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.profile_files import aces_from_d50, write_profile
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities
from spectrabox.radiometry.spectra.named_spectra import test_reflectances as published_sets
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum, spectrum_on_grid
from spectrabox.session.cli import app

GRID = visible_grid(5)
SURFACES = published_sets(GRID)
CAMERA = "Nikon D810"


def response_of(name=CAMERA, lamp="LED-B3"):
    return response_of_curves(sensitivities(name, GRID), light(lamp, GRID), GRID)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_white_stays_white_and_twice_the_light_gives_twice_the_colour(degree):
    transform = fit_transform(response_of(), SURFACES["CES99"], GRID, degree)
    np.testing.assert_allclose(transform.xyz(np.ones(3)), D50, rtol=1e-12)      # round-off
    signals = np.random.default_rng(1).uniform(size=(20, 3))
    np.testing.assert_allclose(transform.xyz(2 * signals), 2 * transform.xyz(signals), rtol=1e-12)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_camera_that_sees_as_the_eye_does_has_no_error(degree):
    seen = np.array([[0.8, 0.3, 0.1], [0.2, 0.9, 0.1], [0.05, 0.1, 0.7]]) @ d50_weights(GRID)
    response = seen / seen.sum(axis=1, keepdims=True)
    transform = fit_transform(response, SURFACES["BabelColor Average"], GRID, degree)
    # The colours are a matrix of the signals: only round-off of the least squares is left.
    assert colour_errors(transform, response, SURFACES["CES99"], GRID).max() < 1e-6


def test_the_matrix_of_a_raw_file_takes_daylight_white_to_white():
    camera_from_xyz = np.array([[0.9, -0.3, -0.1], [-0.4, 1.2, 0.2], [0.0, 0.1, 0.6]])
    for scale in (1.0, 7.0):        # of any scale
        transform = stated_transform(scale * camera_from_xyz)
        # the matrix of sRGB has four decimals
        np.testing.assert_allclose(transform.xyz(np.ones(3)), D50, atol=1e-12)


def test_held_colours_are_nearer_than_by_the_cameras_own_matrix():
    # by which LibRaw knows the Nikon D810 (Adobe's for D65)
    own = np.array([[0.9369, -0.3195, -0.0791], [-0.4488, 1.2430, 0.2301],
                    [-0.0893, 0.1796, 0.6872]])
    errors = colour_profile(response_of(), None, ["paint"], own).errors
    for of in errors[STATED]:
        by_table, by_matrix, by_own = (errors[by][of]["mean"].value
                                       for by in (TABLE, MATRIX, STATED))
        assert by_table < by_matrix < 0.6 * by_own
    assert FRESH in errors[TABLE] and errors[TABLE][FRESH]["mean"].standard_deviation is None


def test_the_spread_of_an_error_follows_that_of_the_curves():
    tilt = np.random.default_rng(3).standard_normal((40, 3, 1)) * (GRID.nm - 550) / 150
    spreads = [colour_profile(response_of(), response_of_curves(
        sensitivities(CAMERA, GRID) * (1 + size * tilt), light("LED-B3", GRID),
        GRID)).errors[MATRIX][FRESH]["mean"].standard_deviation for size in (0.005, 0.02)]
    assert 0 < spreads[0] < spreads[1]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Matrix, table's transform, and a folder with every form of a camera's profile."""
    matrix, table = (fit_transform(response_of(), SURFACES["CES99"], GRID, degree)
                     for degree in (1, 3))
    folder = tmp_path_factory.mktemp("profiles")
    for name in ("a.icc", "a.ocio"):
        write_profile(folder / name, 'Camera "A" & <B>', matrix.coefficients, table.xyz)
    return matrix, table, folder


def through_littlecms(profile, rgb8):
    """L*, a*, b* (n, 3) of code values (n, 3) by LittleCMS, in steps of 0.39 and 1."""
    # Not optimised: of 8 bits LittleCMS would make a coarser table of its own, even in the signals.
    convert = ImageCms.buildTransform(profile, ImageCms.createProfile("LAB"), "RGB", "LAB",
                                      ImageCms.Intent.RELATIVE_COLORIMETRIC,
                                      ImageCms.Flags.NOOPTIMIZE)
    picture = ImageCms.applyTransform(Image.fromarray(rgb8[None]), convert)
    stored = np.array(picture)[0]
    return np.column_stack([stored[:, 0] * (100 / 255), stored[:, 1:].view(np.int8)])


def test_littlecms_reads_the_table_of_an_icc_profile(written):
    _, table, folder = written
    profile = ImageCms.ImageCmsProfile(str(folder / "a.icc"))
    assert profile.profile.version == 4.4 and profile.profile.device_class == "scnr"
    assert ImageCms.getProfileDescription(profile).strip() == 'Camera "A" & <B>'
    seen = np.round(SURFACES["CES99"] @ response_of().T * 255).astype(np.uint8)
    difference = ciede2000(through_littlecms(profile, seen), table.lab(seen / 255))
    # Answers are rounded to 0.2 in L* and 0.5 in a* and b*; interpolation adds up to 0.2.
    assert difference.mean() < 0.4 and difference.max() < 1.2
    white = through_littlecms(profile, np.full((1, 3), 255, np.uint8))
    np.testing.assert_array_equal(white, [[100, 0, 0]])


@pytest.mark.parametrize("name", ["prophoto", "p3"])
def test_littlecms_reads_the_spaces_of_pictures(name):
    profile = ImageCms.ImageCmsProfile(io.BytesIO(profile_files.picture_profile(name)))
    code = np.random.default_rng(2).integers(0, 256, (200, 3)).astype(np.uint8)
    gamma, *rest = profile_files.CURVES[name]
    values = code / 255
    linear = values ** gamma if not rest else np.where(
        values < 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(profile_files.encode(name, linear), values, atol=1e-9)
    lab = lab_from_xyz(linear @ profile_files.TO_XYZ[name].T, D50)
    shown = (np.abs(lab[:, 1:]) < 127).all(axis=1)
    # rounding of 8 bits
    np.testing.assert_allclose(through_littlecms(profile, code)[shown], lab[shown], atol=0.8)


@pytest.mark.parametrize("name, theirs", [("p3", "P3-D65"), ("prophoto", "ProPhoto RGB")])
def test_the_spaces_of_pictures_have_their_published_primaries(name, theirs):
    space = colour.RGB_COLOURSPACES[theirs]
    matrix = colour.normalised_primary_matrix(space.primaries, space.whitepoint)
    gains = (BRADFORD @ D50) / (BRADFORD @ matrix.sum(axis=1))
    # both whites are stated to four decimals
    np.testing.assert_allclose(profile_files.TO_XYZ[name], np.linalg.solve(
        BRADFORD, gains[:, None] * (BRADFORD @ matrix)), atol=1e-4)


def test_display_p3_is_the_srgb_of_wider_primaries():
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB"))
    grey = np.repeat(np.arange(0, 256, 5, np.uint8)[:, None], 3, axis=1)
    ours = ImageCms.ImageCmsProfile(io.BytesIO(profile_files.picture_profile("p3")))
    # one curve: greys are the same, within the steps of 8 bits
    np.testing.assert_allclose(through_littlecms(ours, grey), through_littlecms(srgb, grey),
                               atol=1)


@pytest.mark.parametrize("form, tolerance", [
    ("", 0.3),              # interpolation in the table, in CIEDE2000
    (" by matrix", 1e-3)])  # single precision
def test_opencolorio_reads_the_configuration(written, form, tolerance):
    matrix, table, folder = written
    config = str(folder / "a.ocio")
    seen = (SURFACES["CES99"] @ response_of().T).astype(np.float32)
    aces = oiio.ImageBufAlgo.colorconvert(oiio.ImageBuf(seen[None]), f'Camera "A" & <B>{form}',
                                          "ACES2065-1", colorconfig=config)
    assert not aces.has_error, aces.geterror()
    xyz = np.linalg.solve(aces_from_d50(), aces.get_pixels()[0].T.astype(float)).T
    expected = (table if not form else matrix).lab(seen)
    assert np.percentile(ciede2000(lab_from_xyz(xyz, D50), expected), 95) < tolerance


def test_opencolorio_shows_white_as_white(written):
    *_, folder = written
    grey = oiio.ImageBuf(np.full((1, 1, 3), 0.5, np.float32))
    shown = oiio.ImageBufAlgo.colorconvert(grey, 'Camera "A" & <B>', "sRGB",
                                           colorconfig=str(folder / "a.ocio")).get_pixels()
    # sRGB of half the light; matrices have six decimals
    np.testing.assert_allclose(shown, 0.7354, atol=2e-4)


def test_exiftool_reads_an_icc_profile(written):
    program = os.environ.get("EXIFTOOL") or shutil.which("exiftool")
    if program is None:
        pytest.skip("exiftool is not installed: apt install libimage-exiftool-perl")
    *_, folder = written
    tags = json.loads(subprocess.run([program, "-json", folder / "a.icc"], capture_output=True,
                                     check=True).stdout)[0]
    assert tags["ProfileVersion"] == "4.4.0" and tags["ColorSpaceData"].strip() == "RGB"


def test_a_fitted_camera_gives_its_profile_with_spreads(_captured, tmp_path):
    camera = sb.fit_camera(_captured / "photos" / "chart.dng",
                           light=_captured / "spectra" / "light.csv")
    profile = camera.colour_profile("paint")
    for one in profile.errors[TABLE].values():
        mean = one["mean"]
        assert 0 < mean.standard_deviation < mean.value < one["percentile_95"].value
    np.testing.assert_allclose(profile.lab(np.ones(3)), [100, 0, 0], atol=1e-9)
    assert profile.save(tmp_path / "a.icc", "demo") == (tmp_path / "a.icc",)
    with pytest.raises(sb.InputError, match=r"ends in \.icc, \.clf, \.ocio"):
        profile.save(tmp_path / "a.pdf", "demo")


LAB = np.array([[[50.0, 0, 0], [100, 0, 0], [60, 40.5, -30], [30, -40, 20]]])


def test_lab_is_encoded_as_tiff_has_it_and_colours_beyond_are_clipped():
    root = np.stack([LAB[..., 0] + 16 + 116 / 500 * LAB[..., 1], LAB[..., 0] + 16,
                     LAB[..., 0] + 16 - 116 / 200 * LAB[..., 2]], axis=-1) / 116
    code, clipped = profile_files.code_values("lab", root**3 * D50)       # CIE 15: L* above 8
    decoded = np.concatenate([code[..., :1] / 655.35,
                              code[..., 1:].view(np.int16) / 256], axis=-1)
    np.testing.assert_allclose(decoded, LAB, atol=0.5 / 256 + 1e-9)     # half a step of a*, b*
    assert not clipped.any()
    brighter, clipped = profile_files.code_values("lab", 1.1 * D50)
    assert clipped and brighter.tolist() == [65535, 0, 0]


def test_libtiff_and_exiftool_take_it_for_lab(tmp_path):
    code = np.stack([np.round(LAB[..., 0] / 100 * 65535), *(LAB[..., i] * 256 % 65536
                                                            for i in (1, 2))], axis=-1)
    write_tiff16(tmp_path / "lab.tif", code.astype(np.uint16), None)
    shown = oiio.ImageBuf(str(tmp_path / "lab.tif")).get_pixels(oiio.FLOAT)     # as RGB
    red, green, blue = np.moveaxis(shown[0], -1, 0)
    assert shown[0, 1].min() > shown[0, 0].max()                # white above grey
    assert red[2] > blue[2] > green[2] and green[3] > max(red[3], blue[3])  # purple and green
    if (program := shutil.which("exiftool")) is None:
        pytest.skip("exiftool is not installed")
    tags = json.loads(subprocess.run([program, "-json", tmp_path / "lab.tif"], check=True,
                                     capture_output=True).stdout)[0]
    assert tags["PhotometricInterpretation"] == "CIELab" and tags["BitsPerSample"] == "16 16 16"


@pytest.fixture(scope="module")
def painting(finished_painting):
    """A finished session of the flat demo, with what ``spectrabox colour`` wrote and answered."""
    result = CliRunner().invoke(app, ["colour", str(finished_painting), "--json"])
    assert result.exit_code == 0, result.output
    return finished_painting, json.loads(result.stdout)


def test_the_photo_shows_the_colours_that_its_surfaces_have(painting):
    folder, facts = painting
    with Image.open(folder / "colour" / "photo.tif") as small:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(small.info["icc_profile"]))
    assert ImageCms.getProfileDescription(profile).strip() == facts["space"] == "ProPhoto RGB"
    photo = oiio.ImageBuf(str(folder / "colour" / "photo.tif"))
    assert photo.spec().format == oiio.UINT16
    code = photo.get_pixels(oiio.FLOAT)
    session = tomllib.loads((folder / "session.toml").read_text(encoding="utf-8"))
    differences = []
    for region in session["regions"].values():
        if "truth" not in region:
            continue
        spectrum = spectrum_on_grid(read_spectrum(folder / region["truth"],
                                                  role=Quantity.REFLECTANCE), GRID)
        x0, y0, x1, y1 = (round(edge / 2) for edge in region["rect"])       # tiles of 2 x 2
        linear = np.mean(code[y0:y1, x0:x1].astype(float) ** 1.8, axis=(0, 1))
        shown = lab_from_xyz(profile_files.TO_XYZ["prophoto"] @ linear, D50)
        differences.append(ciede2000(shown, lab_from_xyz(d50_weights(GRID) @ spectrum, D50)))
    assert len(differences) >= 4
    # the table's own error on paint, and that of the light in the samples' plane (3 % of Y)
    expected = facts["delta_e00"][TABLE]["1000 surfaces of paint"]
    assert np.mean(differences) < expected["mean"]["value"] + 1.0
    assert max(differences) < expected["percentile_95"]["value"] + 1.5


def test_the_photo_in_lab_clips_nothing_that_wider_spaces_hold(painting, tmp_path):
    folder, facts = painting
    result = CliRunner().invoke(app, ["colour", str(folder), "--space", "lab", "--json", "--out",
                                      str(tmp_path)])
    assert result.exit_code == 0, result.output
    lab = json.loads(result.stdout)
    # a* and b* end at 128 in 16 bits, and greens of the wider space go beyond
    as_stored = oiio.ImageSpec()
    as_stored.attribute("oiio:RawColor", 1)
    file = oiio.ImageInput.open(str(tmp_path / "photo.tif"), as_stored)
    codes = file.read_image(oiio.UINT16).view(np.int16)
    file.close()
    at_the_end = np.isin(codes[..., 1:], [-(1 << 15), (1 << 15) - 1]).any(axis=-1).mean()
    assert lab["space"] == "CIE L*a*b* (D50)"
    assert facts["clipped"] > 0 and lab["clipped"] <= facts["clipped"] + at_the_end < 1e-3
    assert (tmp_path / "photo.tif").stat().st_size > 100_000


def test_flat_samples_in_python_give_the_profile_of_the_command(painting):
    folder, facts = painting
    photo = next((folder / "photos").glob("*.dng"))
    result = sb.flat(photo, {"wall": (986, 462, 1073, 537)}, draws=1000)
    errors = result.colour_profile("paint").errors[TABLE]
    for of, stated in facts["delta_e00"][TABLE].items():
        # the same chart and prior; the session's white card has no part in the profile
        assert errors[of]["mean"].value == pytest.approx(stated["mean"]["value"], rel=1e-6)


def test_the_page_for_the_archive_states_limits_and_claims_no_more(painting):
    folder, facts = painting
    page = (folder / "colour" / "archive.html").read_text(encoding="utf-8")
    assert "It is no certificate" in page and "gain modulation" in page
    by_name = {one["name"]: one for one in facts["archive"]}
    mean = by_name["Colour accuracy, mean"]
    assert mean["value"] == facts["chart"]["mean"] and f"{mean['value']:.3g}" in page
    assert mean["limits"]["FADGI 2023"]["4 stars"] == 2
    assert not by_name["Noise"]["limits"] and by_name["Noise"]["value"] > 0


@pytest.mark.parametrize("value, grade", [(1.9, "4 stars"), (2.0, "4 stars"), (2.1, "3 stars"),
                                          (6.5, "1 star"), (6.6, "beyond 1 star")])
def test_a_grade_is_the_strictest_whose_limit_is_kept(value, grade):
    lab = np.full((24, 3), [50.0, 0, 0])
    mean, *_ = archive_quantities.archive_quantities(CLASSIC, lab, lab, np.zeros(24),
                                                     np.array([[[1.0]], [[0.0]]]))
    assert archive_quantities.grade(value, mean["limits"]["FADGI 2023"]) == grade


def test_clipped_patches_are_no_part_of_what_the_chart_tells():
    reference = np.column_stack([np.linspace(30, 90, 24), np.zeros((24, 2))])
    lab = reference + np.array([1.0, 0, 0])
    lab[[0, CLASSIC.neutrals[0]]] = np.nan
    quantities = archive_quantities.archive_quantities(CLASSIC, lab, reference, np.ones(24),
                                                       np.array([[[1.0]], [[0.0]]]))
    by_name = {one["name"]: one for one in quantities}
    assert by_name["Colour accuracy, mean"]["measured_on"].startswith("all 22 patches")
    assert np.isfinite([one["value"] for one in quantities]).all()
    assert by_name["Tone response"]["value"] == pytest.approx(1)
    assert f"{len(CLASSIC.neutrals) - 1} neutral" in by_name["Noise"]["measured_on"]


def test_noise_in_lightness_is_that_of_the_pixels():
    rng = np.random.default_rng(5)
    transform = fit_transform(response_of(), SURFACES["CES99"], GRID, 3)
    signal, pixels, sigma = np.array([0.3, 0.32, 0.28]), 400, 0.01
    cells = signal + sigma * rng.standard_normal((40_000, 3))
    samples = PatchSamples(signal[None], np.eye(3)[None] * sigma**2 / pixels, np.array([pixels]),
                           np.zeros((1, 3)), np.zeros((1, 3)))
    noise = archive_quantities.lightness_noise(samples, signal[None], np.ones((1, 3)), transform)
    # to first order; the standard deviation of 40,000 values is known to 0.4 %
    np.testing.assert_allclose(noise, transform.lab(cells)[:, 0].std(), rtol=0.03)


def test_a_scene_is_sent_to_camera_profile(_finished):
    result = CliRunner().invoke(app, ["colour", str(_finished)])
    assert result.exit_code == 3 and "spectrabox camera profile" in result.stderr


def test_camera_profile_writes_them_and_states_their_errors(tmp_path):
    files = [tmp_path / name for name in ("a.icc", "a.ocio")]
    result = CliRunner().invoke(app, [
        "camera", "profile", CAMERA, "--camera", CAMERA, "--light", "A", "--family", "paint",
        "--json", *(word for file in files for word in ("-o", str(file)))])
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)["colour"]
    assert facts["light"] == "A" and set(facts["delta_e00"]) == {MATRIX, TABLE}
    assert "1000 surfaces of paint" in facts["delta_e00"][TABLE]
    assert all(file.is_file() for file in (*files, tmp_path / "a.clf"))
