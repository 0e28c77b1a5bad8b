"""Folders of measured cameras: two formats, and broken files that are named and skipped."""
import json

import numpy as np
import pytest
from calibrate_cameras import NODES, cameras

from spectrabox.calibrate.prior.learnt_prior import read_camera_database
from spectrabox.radiometry.errors import InputError
from spectrabox.session.camera.camera_files import read_patches


def write_rawtoaces(path, curves, model, nm=NODES):
    rows = {f"{wavelength:g}": list(values)
            for wavelength, values in zip(nm, curves.T, strict=True)}
    path.write_text(json.dumps({"header": {"manufacturer": "Maker", "model": model},
                                "spectral_data": {"data": {"main": rows}}}), encoding="utf-8")


def test_both_formats_give_the_same_curves(tmp_path):
    curves = cameras(1, 3)[0]
    write_rawtoaces(tmp_path / "a.json", curves, "A")
    lines = ["wavelength_nm,R,G,B", *(f"{nm:g},{r:.9g},{g:.9g},{b:.9g}"
                                      for nm, (r, g, b) in zip(NODES, curves.T, strict=True))]
    (tmp_path / "b.csv").write_text("\n".join(lines), encoding="utf-8")
    database = read_camera_database(tmp_path)
    assert set(database.names) == {"Maker A", "b"} and not database.skipped
    by_name = dict(zip(database.names, database.curves, strict=True))
    np.testing.assert_allclose(by_name["Maker A"], curves, rtol=1e-12)
    np.testing.assert_allclose(by_name["b"], curves, rtol=1e-8)  # nine digits in the file


def test_broken_files_are_named_and_skipped(tmp_path):
    write_rawtoaces(tmp_path / "good.json", cameras(1, 3)[0], "Good")
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")
    (tmp_path / "other.json").write_text('{"a": 1}', encoding="utf-8")
    write_rawtoaces(tmp_path / "short.json", cameras(1, 3)[0][:, 8:], "Short", NODES[8:])
    write_rawtoaces(tmp_path / "negative.json", -cameras(1, 3)[0], "Negative")
    (tmp_path / "words.csv").write_text("not a camera", encoding="utf-8")
    database = read_camera_database(tmp_path)
    assert database.names == ("Maker Good",)
    message = " ".join(database.skipped)
    for name in ("broken.json", "other.json", "short.json", "negative.json", "words.csv"):
        assert name in message
    assert len(database.skipped) == 5 and "covers 440-700 nm" in message


def test_a_folder_without_cameras_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds no camera that can be read"):
        read_camera_database(tmp_path)
    with pytest.raises(InputError, match="is not a folder"):
        read_camera_database(tmp_path / "missing")


def test_a_camera_can_be_left_out(tmp_path):
    for index, curves in enumerate(cameras(3, 4)):
        write_rawtoaces(tmp_path / f"{index}.json", curves, str(index))
    assert read_camera_database(tmp_path, leave_out=("Maker 1",)).names == ("Maker 0", "Maker 2")
    with pytest.raises(InputError, match="no camera 'Maker1' to leave out; nearest are Maker"):
        read_camera_database(tmp_path, leave_out=("Maker1",))


def test_a_camera_that_two_files_hold_is_taken_once_and_said(tmp_path):
    first, second = cameras(2, 4)
    write_rawtoaces(tmp_path / "a.json", first, "0")
    write_rawtoaces(tmp_path / "b.json", second, "0")
    write_rawtoaces(tmp_path / "c.json", second, "1")
    database = read_camera_database(tmp_path)
    assert database.names == ("Maker 0", "Maker 1")
    assert database.skipped == ("b.json holds Maker 0 once more; the first is kept",)
    # as many digits as the file holds
    np.testing.assert_allclose(database.curves[0], first, atol=1e-6)


@pytest.mark.parametrize("header", ["", "R,G,B\n", "patch,R,G,B\n"])
def test_patches_are_read_with_and_without_names(tmp_path, header):
    first = "p," if header.startswith("patch") else ""
    (tmp_path / "p.csv").write_text(header + "\n".join(f"{first}{i + 1},2,3" for i in range(24)),
                                    encoding="utf-8")
    read = read_patches(tmp_path / "p.csv")
    patches, (assumed,) = read.samples, read.findings
    assert patches.mean.shape == (24, 3) and patches.mean[23, 0] == 24 and len(read.bands) == 3
    np.testing.assert_allclose(patches.covariance_of_mean[[0, 23], 0, 0], [0.004**2, 0.096**2],
                               rtol=1e-12)
    assert assumed.code == "patches.errors-assumed"


@pytest.mark.parametrize("names, errors", [
                             ("standard_error R,standard_error G,standard_error B", "0.1,0.2,0.3"),
                             ("standard_error B,standard_error G,standard_error R", "0.3,0.2,0.1"),
                             ("standard_error,standard_error,standard_error", "0.1,0.2,0.3")],
                         ids=["in order", "in another order", "unnamed"])
def test_standard_errors_become_the_covariance(tmp_path, names, errors):
    (tmp_path / "p.csv").write_text(f"R,G,B,{names}\n" + f"1,2,3,{errors}\n" * 24, encoding="utf-8")
    read = read_patches(tmp_path / "p.csv")
    np.testing.assert_allclose(read.samples.covariance_of_mean[5], np.diag([0.01, 0.04, 0.09]),
                               rtol=1e-12)
    assert read.findings == ()


@pytest.mark.parametrize("text, message", [
                             ("1,2,3\n" * 18, "holds 18 rows of signals; 24 are needed"),
                             ("", "p.csv is empty"),
                             ("1,2,3\n" * 23 + "1,x,3\n", "in every cell"),
                             ("R,G,B,standard_error R\n" + "1,2,3,4\n" * 24,
                              "3 bands and 1 standard errors"),
                             ("R,R,B\n" + "1,2,3\n" * 24, "two bands of one name"),
                             ("R,G,B,standard_error R,standard_error G,standard_error X\n"
                              + "1,2,3,4,5,6\n" * 24, "no band of that name"),
                             ("R,G,standard_error R,standard_error G\n" + "1,2,4,-5\n" * 24,
                              "negative standard error")])
def test_a_bad_table_of_patches_is_refused(tmp_path, text, message):
    (tmp_path / "p.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_patches(tmp_path / "p.csv")
