"""Profiles of a camera: laws of their matrices, and files that other programs read."""
import io
import json
import os
import shutil
import subprocess
from pathlib import Path

import colour
import exifread
import numpy as np
import pytest
from PIL import TiffImagePlugin
from typer.testing import CliRunner

from spectrabox.calibrate.colour_profile import D50, ILLUMINANTS, matrices
from spectrabox.calibrate.prior.learnt_prior import cameras_of_file
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.colour_science import aces_idt
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.published.published_tables import LIGHTS, published_curves
from spectrabox.radiometry.spectra.named_spectra import sensitivities
from spectrabox.session.cli import app

GRID = visible_grid(5)
CAMERA, OBSERVER = "Nikon 5100 (NPL)", "CIE 1931 2 Degree Standard Observer"
MIX = np.array([[0.8, 0.3, 0.1], [0.2, 0.9, 0.1], [0.05, 0.1, 0.7]])
TAGS = {"color_matrix": (50721, 50722), "forward_matrix": (50964, 50965)}
TEN_THOUSANDTH = 5.1e-5     # half of what a profile's matrices are rounded to


def matrices_of(curves, name):
    """Colour and forward matrix of one camera, fitted to a chart, and its error on that chart."""
    chart = chart_reflectances("BabelColor Average", GRID)
    return (each[0] for each in matrices([curves], name, GRID, chart, (chart,)))


def profile(tmp_path, *words, name=CAMERA):
    result = CliRunner().invoke(app, ["camera", "profile", name, "--camera", "Nikon D5100",
                                      "--json", *map(str, words)])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def draws_file(folder, relative, count=6):
    """Draws of the camera's curves, each band off by a factor and a slope."""
    curves, rng = sensitivities(CAMERA, GRID), np.random.default_rng(2)
    slope = 1 + relative * rng.standard_normal((count, 3, 1)) * (GRID.nm - 550) / 100
    np.savez(folder / "draws.npz", wavelengths_nm=GRID.nm, curves=curves * slope)
    return folder / "draws.npz"


@pytest.mark.parametrize("light", ILLUMINANTS)
def test_a_camera_that_sees_as_the_eye_does_has_exact_matrices(light):
    matrix, _, errors = matrices_of(MIX @ sensitivities(OBSERVER, GRID), light)
    # Of what the eye sees in red under A, nearly 2 % lie beyond 700 nm, where the camera is blind.
    np.testing.assert_allclose(matrix / matrix[0, 0], MIX / MIX[0, 0], atol=0.02)
    assert errors[0] < 0.1


@pytest.mark.parametrize("light", ILLUMINANTS)
def test_white_goes_to_d50_and_scales_of_curves_do_not_matter(light):
    curves = sensitivities(CAMERA, GRID)
    matrix, forward, _ = matrices_of(curves, light)
    np.testing.assert_allclose(forward.sum(axis=1), D50, rtol=1e-12)       # round-off
    again, _, _ = matrices_of(7 * curves, light)
    np.testing.assert_allclose(again, matrix, rtol=1e-9)
    bands = np.array([[2.0], [1.0], [0.3]])         # white balance takes them out
    _, balanced, _ = matrices_of(bands * curves, light)
    np.testing.assert_allclose(balanced, forward, rtol=1e-9)


def test_the_aces_matrix_is_that_of_raw_to_aces():
    folder = Path(colour.__file__).parent / "characterisation" / "datasets" / "rawtoaces"
    file = next(folder.rglob("CANON_EOS_5DMark_II_RGB_Sensitivities.csv"), None)
    if file is None:
        file = next(Path(colour.__file__).parent.rglob("CANON_EOS_5DMark_II_RGB_*.csv"))
    spectra = colour.read_sds_from_csv_file(str(file))
    nm = next(iter(spectra.values())).wavelengths
    matrix, _ = aces_idt(nm, np.array([each.values for each in spectra.values()]), "D55")
    # by RAW to ACES v1 with the Ceres solver, as colour-science's documentation prints it
    np.testing.assert_allclose(matrix, [[0.864994, -0.026302, 0.161308],
                                        [0.056527, 1.122997, -0.179524],
                                        [0.023683, -0.202547, 1.178864]], atol=1e-3)


def test_the_spread_of_every_number_follows_that_of_the_curves(tmp_path):
    wide = profile(tmp_path, "--draws-file", draws_file(tmp_path, 0.02))
    narrow = profile(tmp_path, "--draws-file", draws_file(tmp_path, 0.01))
    for light in ILLUMINANTS:
        for kind in TAGS:
            one, half = (np.array(facts["illuminants"][light][kind]["standard_deviation"])
                         for facts in (wide, narrow))
            # linear to first order; draws are off by up to 6 %
            np.testing.assert_allclose(half, one / 2, rtol=0.2, atol=1e-4)
        assert all(error["standard_deviation"] > 0
                   for error in wide["illuminants"][light]["delta_e00"].values())
    assert wide["draws"] == wide["aces_idt"]["draws"] == 6
    assert np.max(wide["aces_idt"]["matrix"]["standard_deviation"]) > 0


def test_without_draws_the_spread_is_not_known(tmp_path):
    facts = profile(tmp_path)
    assert facts["illuminants"]["A"]["color_matrix"]["standard_deviation"] is None
    assert facts["aces_idt"]["matrix"]["standard_deviation"] is None


@pytest.fixture(scope="module")
def dcp(tmp_path_factory):
    folder = tmp_path_factory.mktemp("profile")
    return folder / "a.dcp", profile(folder, "--out", folder / "a.dcp")["illuminants"]


def as_tiff(path):
    """A profile is a TIFF but for its second word."""
    content = path.read_bytes()
    assert content[:4] == b"IIRC"
    return io.BytesIO(b"II*\0" + content[4:])


def test_pillow_reads_the_matrices_of_a_dng_profile(dcp):
    path, result = dcp
    file = as_tiff(path)
    directory = TiffImagePlugin.ImageFileDirectory_v2(file.read(8))
    directory.load(file)
    for kind, tags in TAGS.items():
        for tag, light in zip(tags, ILLUMINANTS, strict=True):
            np.testing.assert_allclose(np.array(directory[tag], float).reshape(3, 3),
                                       result[light][kind]["value"], atol=TEN_THOUSANDTH)
    assert (directory[50778], directory[50779]) == (17, 21)
    assert directory[50708] == "Nikon D5100"


def test_exifread_reads_the_matrices_of_a_dng_profile(dcp):
    path, result = dcp
    tags = exifread.process_file(as_tiff(path), details=False)
    for kind, numbers in TAGS.items():
        for number, light in zip(numbers, ILLUMINANTS, strict=True):
            tag = next(value for value in tags.values() if value.tag == number)
            np.testing.assert_allclose([float(value) for value in tag.values],
                                       np.ravel(result[light][kind]["value"]), atol=TEN_THOUSANDTH)


def test_exiftool_reads_a_dng_profile_as_one(dcp):
    program = os.environ.get("EXIFTOOL") or shutil.which("exiftool")
    if program is None:
        pytest.skip("exiftool is not installed: apt install libimage-exiftool-perl")
    path, result = dcp
    tags = json.loads(subprocess.run([program, "-json", "-n", path], capture_output=True,
                                     check=True).stdout)[0]
    assert tags["FileType"] == "DCP" and tags["UniqueCameraModel"] == "Nikon D5100"
    assert (tags["CalibrationIlluminant1"], tags["CalibrationIlluminant2"]) == (17, 21)
    for number, light in enumerate(ILLUMINANTS, 1):
        for title, kind in ((f"ColorMatrix{number}", "color_matrix"),
                            (f"ForwardMatrix{number}", "forward_matrix")):
            np.testing.assert_allclose([float(word) for word in tags[title].split()],
                                       np.ravel(result[light][kind]["value"]), atol=TEN_THOUSANDTH)


def test_curves_come_back_from_the_form_of_rawtoaces(tmp_path):
    profile(tmp_path, "--out", tmp_path / "a.json", "--draws-file", draws_file(tmp_path, 0.01))
    (name, (nm, curves)), = cameras_of_file(tmp_path / "a.json").items()
    assert name == "Nikon D5100"
    np.testing.assert_array_equal(nm, np.arange(380, 781, 5))
    inside = (nm >= 400) & (nm <= 700)
    np.testing.assert_allclose(curves[:, inside], sensitivities(CAMERA, GRID), rtol=1e-8)
    assert not curves[:, ~inside].any()
    with np.load(tmp_path / "draws.npz") as draws:      # the scatter of one draw is the error
        error = draws["curves"].std(axis=0, ddof=1) / sensitivities(CAMERA, GRID).max()
    header = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))["header"]
    assert f"standard error {np.sqrt(np.mean(error**2)):.1%} of the" in header["comments"]


def as_rawtoaces_reads(path):
    """Manufacturer, model and the channels (81,) of a file, by the rules of rawtoaces 2.

    Its src/rawtoaces_core/spectral_data.cpp takes texts or null in the header, wavelengths in the
    order of their keys, and one step for all data sets together: a second one that begins again at
    380 nm is refused as an inconsistent step.
    """
    document = json.loads(path.read_text(encoding="utf-8"))
    assert all(value is None or isinstance(value, str) for value in document["header"].values())
    assert isinstance(document["spectral_data"]["units"], str)
    sets = document["spectral_data"]["data"]
    nm = np.array([float(key) for name in sorted(sets) for key in sorted(sets[name])])
    assert len(set(np.diff(nm))) == 1, "Inconsistent wavelength step"
    names = document["spectral_data"]["index"]["main"]
    rows = np.array([sets["main"][key] for key in sorted(sets["main"])], float)
    assert rows.shape == (81, len(names)) and (nm[0], nm[-1]) == (380, 780)
    header = document["header"]
    return header["manufacturer"], header["model"], dict(zip(names, rows.T, strict=True))


@pytest.mark.parametrize("draws", [False, True])
def test_rawtoaces_reads_a_camera_with_and_without_its_errors(draws, tmp_path):
    words = ("--draws-file", draws_file(tmp_path, 0.01)) if draws else ()
    profile(tmp_path, "--out", tmp_path / "a.json", *words)
    maker, model, channels = as_rawtoaces_reads(tmp_path / "a.json")
    assert (maker, model) == ("Nikon", "D5100") and list(channels) == ["R", "G", "B"]
    inside = slice(4, 65)
    np.testing.assert_allclose([curve[inside] for curve in channels.values()],
                               sensitivities(CAMERA, GRID), rtol=1e-8)


def test_rawtoaces_reads_its_own_cameras_so():
    folder = Path(os.environ.get("SPECTRABOX_DATA", "nowhere")) / "cameras"
    if not folder.is_dir():
        pytest.skip("SPECTRABOX_DATA names no cameras of rawtoaces-data")
    assert as_rawtoaces_reads(folder / "Nikon_D810_380_780_5.json")[:2] == ("Nikon", "D810")


def test_an_aces_matrix_is_found_for_a_measured_light_too(tmp_path):
    nm, curves = published_curves(LIGHTS, "D55")
    lines = "\n".join(f"{at:g},{value:.9g}" for at, value in zip(nm, curves[0], strict=True))
    (tmp_path / "light.csv").write_text(f"wavelength_nm,value\n{lines}\n", encoding="utf-8")
    named, measured = (profile(tmp_path, "--idt-light", light)["aces_idt"]["matrix"]["value"]
                       for light in ("d55", tmp_path / "light.csv"))
    # nine digits are written
    np.testing.assert_allclose(measured, named, atol=1e-6)


def test_the_form_of_rawtoaces_is_that_of_its_own_data(tmp_path):
    folder = os.environ.get("SPECTRABOX_DATA", "")
    if not (Path(folder) / "cameras").is_dir() or not folder:
        pytest.skip("SPECTRABOX_DATA names no cameras of rawtoaces-data")
    profile(tmp_path, "--out", tmp_path / "a.json")
    theirs, ours = (json.loads(path.read_text(encoding="utf-8")) for path in (
        Path(folder) / "cameras" / "Nikon_D810_380_780_5.json", tmp_path / "a.json"))
    assert set(theirs["header"]) <= set(ours["header"])
    assert set(theirs["spectral_data"]) == set(ours["spectral_data"])
    assert list(theirs["spectral_data"]["data"]["main"]) == list(
        ours["spectral_data"]["data"]["main"])
    assert theirs["spectral_data"]["index"] == ours["spectral_data"]["index"]


def test_curves_for_vkdt_are_four_columns_of_numbers(tmp_path):
    profile(tmp_path, "--out", tmp_path / "a.txt")
    table = np.loadtxt(tmp_path / "a.txt")
    curves = sensitivities(CAMERA, GRID)
    np.testing.assert_array_equal(table[:, 0], np.arange(380, 781, 5))
    np.testing.assert_allclose(table[4:65, 1:].T, curves / curves.max(), atol=1e-12)


@pytest.mark.parametrize("spoil, message", [
    (lambda path: path.unlink(), "is missing"),
    (lambda path: path.write_bytes(b"PK"), "holds no draws of curves"),
    (lambda path: np.savez(path, wavelengths_nm=GRID.nm, curves=np.ones((4, 2, GRID.nm.size))),
     "two or more of three curves"),
    (lambda path: np.savez(path, other=np.ones(3)), "holds no draws of curves")])
def test_draws_that_are_none_are_refused(tmp_path, spoil, message):
    path = draws_file(tmp_path, 0.01)
    spoil(path)
    result = CliRunner().invoke(app, ["camera", "profile", CAMERA, "--camera", "a", "--draws-file",
                                      str(path)])
    assert result.exit_code == 3 and message in result.stderr
