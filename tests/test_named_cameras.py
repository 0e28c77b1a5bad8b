"""Cameras by name: published ones, others' measurements, and one's own fits."""
import json
import os
from pathlib import Path

import colour
import numpy as np
import pytest
from flat_example import write_flat

import spectrabox as sb
from spectrabox.calibrate.prior.camera_prior import shipped_prior
from spectrabox.capture.photo.raw import read_raw
from spectrabox.fixtures.dng import write_dng
from spectrabox.fixtures.spectral_files import NM
from spectrabox.measure.shoot.captures import read_sensitivities
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID, visible_grid
from spectrabox.radiometry.published.make_tables import tables_of_rawtoaces
from spectrabox.radiometry.published.published_tables import (
    CAMERAS,
    LIGHTS,
    OBSERVERS,
    published_curves,
    published_names,
)
from spectrabox.radiometry.spectra import cameras
from spectrabox.radiometry.spectra.named_spectra import (
    light,
    sensitivities,
    spectrum_of_name,
)
from spectrabox.radiometry.system.words import known_name, nearest_names
from spectrabox.session.config.session_file import read_session
from spectrabox.session.store.keys import InputFiles, step_keys

from tests.session_runs import call

GRID = visible_grid(5)
SIGNAL = ["--light", "D65", "--signal", "0.3,0.3,0.2", "--noise", "0.01,0.01,0.01"]


@pytest.fixture(autouse=True)
def own(tmp_path, monkeypatch):
    """The folder of one's own cameras, empty."""
    monkeypatch.setenv(cameras.FOLDER, str(tmp_path / "cameras"))
    return tmp_path / "cameras"


def rawtoaces_file(folder, model, curves, nm=NM):
    """A camera as rawtoaces-data stores it."""
    rows = {f"{wavelength:g}": list(map(float, row))
            for wavelength, row in zip(nm, np.transpose(curves), strict=True)}
    path = folder / f"{model}.json"
    path.write_text(json.dumps({
        "header": {"manufacturer": "Nikon", "model": model},
        "spectral_data": {"units": "relative", "index": {"main": ["R", "G", "B"]},
                          "data": {"main": rows}}}), encoding="utf-8")
    return path


def three(seed):
    """Curves (3, P) that peak in red, green and blue."""
    peaks = np.array([600.0, 540.0, 450.0])[:, None] + seed
    return np.exp(-((NM - peaks) / 40)**2) + 0.01


def test_a_camera_of_colour_science_has_its_numbers():
    name = "Nikon 5100 (NPL)"
    curves = colour.MSDS_CAMERA_SENSITIVITIES[name]
    shared = np.isin(GRID.nm, curves.wavelengths)
    found = sensitivities(name, GRID)[:, shared]
    # read at the wavelengths they are published at: nothing is interpolated
    np.testing.assert_allclose(found, curves.values[np.isin(curves.wavelengths, GRID.nm)].T,
                               rtol=1e-12)


def test_a_camera_in_the_form_of_rawtoaces_is_known_by_its_name(tmp_path):
    curves = three(1)
    answer = call("camera", "add", rawtoaces_file(tmp_path, "D950", curves), "--json")
    assert json.loads(answer.stdout)["cameras"] == ["Nikon D950"]
    shared = np.isin(NM, GRID.nm)
    np.testing.assert_allclose(sensitivities("Nikon D950", GRID)[:, np.isin(GRID.nm, NM)],
                               curves[:, shared], rtol=1e-8)    # nine significant digits
    assert call("sample", "--sensitivity", "Nikon D950", *SIGNAL).exit_code == 0
    assert "Nikon D950" in json.loads(call("camera", "list", "--json").stdout)["own"]


def test_a_typo_is_answered_with_the_nearest_names(tmp_path):
    rawtoaces_file(tmp_path, "D950", three(1))
    rawtoaces_file(tmp_path, "D910", three(2))
    assert call("camera", "add", tmp_path).exit_code == 0
    answer = call("sample", "--sensitivity", "nikon d95O", *SIGNAL)
    assert answer.exit_code == 3
    assert "nearest are Nikon D950, Nikon D910" in answer.stderr


def test_the_cameras_that_ship_are_those_of_the_prior_and_as_published():
    shipped, prior = published_names(CAMERAS), shipped_prior()
    families = {name for members, level in zip(prior.members, prior.level, strict=True)
                for name in members.split(", ") if level == 0}
    assert families < set(shipped) and len(shipped) == 39
    folder = Path(os.environ.get("SPECTRABOX_DATA", "nowhere")) / "cameras"
    if not folder.is_dir():
        pytest.skip("SPECTRABOX_DATA names no cameras of rawtoaces-data")
    for name, table in tables_of_rawtoaces(folder).items():
        nm, curves = published_curves(*name.split("/", 1))
        np.testing.assert_array_equal(table, np.vstack([nm, curves]))


@pytest.mark.parametrize("stated, known", [
    ("NIKON CORPORATION NIKON D810 3001234", "Nikon D810"), ("SONY ILCE-9", "Sony ILCE-9"),
    ("Canon EOS 5D Mark II 0320301234", "Canon EOS 5D Mark II"),
    ("Canon EOS 5D Mark III 0320301234", None), ("NIKON CORPORATION NIKON D8100", None),
    ("Spectrabox Synthetic 5100 DEMO-1", None), ("", None)])
def test_a_camera_is_known_by_what_its_photos_state(stated, known):
    assert cameras.known_camera(stated) == known


def test_check_offers_the_curves_of_a_known_camera(tmp_path):
    write_flat(tmp_path)
    photo = tmp_path / "photos" / "sample.dng"
    frame = read_raw(photo)
    black = frame.black_level[[0, 0, 1, 1], [0, 1, 0, 1]]
    photo.unlink()
    write_dng(photo, np.array(frame.mosaic), black=tuple(black), white=int(frame.white_level),
              f_number=frame.f_number, iso=int(frame.iso), make="NIKON CORPORATION",
              model="NIKON D810", serial="3001234")
    answer = call("check", tmp_path)
    assert "this camera's curves are known: Nikon D810" in answer.stdout
    with_name = tmp_path / "session.toml"
    with_name.write_text('[sensitivity]\nfrom = "Nikon D810"\n'
                         + with_name.read_text(encoding="utf-8"), encoding="utf-8")
    assert "curves are known" not in call("check", tmp_path).stdout


def test_what_is_no_camera_is_left_out_with_its_reason(tmp_path):
    rawtoaces_file(tmp_path, "D950", three(1))
    rawtoaces_file(tmp_path, "dark", np.zeros((3, NM.size)))
    (tmp_path / "notes.csv").write_text("not a camera", encoding="utf-8")
    facts = json.loads(call("camera", "add", tmp_path, "--json").stdout)
    assert facts["cameras"] == ["Nikon D950"]
    assert sorted(reason.split(" ")[0] for reason in facts["skipped"]) == ["dark.json,",
                                                                          "notes.csv"]


def test_a_camera_that_was_not_measured_to_700_nm_says_so():
    with pytest.raises(InputError, match="covers 400-680 nm; 400-700 nm is needed"):
        sensitivities("Sigma SDMerill (NPL)", GRID)


@pytest.mark.parametrize("source, said", [("missing", "is missing"),
                                          ("a.xls", "is no file of camera curves")])
def test_nothing_to_keep_is_an_error(tmp_path, own, source, said):
    (tmp_path / "a.xls").write_bytes(b"x")
    answer = call("camera", "add", tmp_path / source)
    assert answer.exit_code == 3 and said in answer.stderr and not own.exists()


@pytest.mark.parametrize("name, said", [
    ("Nikon 5100 (NPL)", "is already the name of a published camera"),
    ("../evil", "begins with a letter or a digit")])
def test_a_name_that_would_mislead_is_refused(own, name, said):
    with pytest.raises(InputError, match=said):
        cameras.keep_camera(name, NM, {"R": three(1)[0]}, "me")
    assert not own.exists()


def test_a_fit_is_kept_with_its_errors_and_used_by_its_name(captured, own):
    answer = call("camera", "fit", "--chart", captured / "photos" / "chart.dng", "--light",
                  captured / "spectra" / "light.csv", "--keep", "my camera", "--json")
    assert answer.exit_code == 0, answer.output
    facts = json.loads(answer.stdout)
    assert facts["kept"] == str(own / "my camera.csv")
    fitted = np.array(facts["sensitivities"])
    np.testing.assert_allclose(sensitivities("my camera", visible_grid(1)), fitted,
                               rtol=1e-8, atol=1e-12)       # nine significant digits
    assert "standard_error R" in (own / "my camera.csv").read_text(encoding="utf-8")


def with_camera(captured, name):
    path = captured / "session.toml"
    text = path.read_text(encoding="utf-8")
    before, after = text.split('[sensitivity]\nfrom = "chart"')
    path.write_text(f'{before}[sensitivity]\nfrom = "{name}"{after}', encoding="utf-8")
    return read_session(captured)


def test_a_session_names_a_published_camera(captured):
    config = with_camera(captured, "Nikon 5100 (NPL)")
    assert not config.sensitivity.from_chart
    names, curves = read_sensitivities(config, config.inputs)
    published = sensitivities("Nikon 5100 (NPL)", FINE_GRID)
    assert names == ()              # no file names them: they are called as the photo's
    np.testing.assert_allclose(curves, np.maximum(published, 0) / published.max())


def test_a_session_names_a_camera_of_ones_own_and_notices_another(captured, tmp_path, own):
    curves = sensitivities("Nikon 5100 (NPL)", visible_grid(5))
    nm = visible_grid(5).nm
    assert call("camera", "add", rawtoaces_file(tmp_path, "Mine", curves, nm)).exit_code == 0
    [kept] = cameras.own_cameras()
    config = with_camera(captured, kept)

    def key():
        return step_keys(config.capture(), InputFiles(config))["calibrate"]
    before = key()
    path = cameras.own_cameras()[kept]
    text = path.read_text(encoding="utf-8")
    path.write_text(text + "\n", encoding="utf-8")
    assert key() == before          # the same curves
    *rows, last = text.splitlines()
    path.write_text("\n".join([*rows, last + "5"]) + "\n", encoding="utf-8")    # of a digit more
    assert key() != before


def test_a_session_that_names_no_camera_is_told_the_nearest(captured):
    config = with_camera(captured, "Nikon 5100 NPL")
    with pytest.raises(InputError, match=r"Nikon 5100 \(NPL\)"):
        read_sensitivities(config, config.inputs)


@pytest.mark.parametrize("written, meant", [
    ("nikon d810", "Nikon D810"), ("NIKON D810", "Nikon D810"), ("Nikon D5100", "Nikon 5100 (NPL)"),
    ("canon eos-5d", "Canon EOS 5D"), ("sony ilce-9", "Sony ILCE-9")])
def test_a_camera_is_known_whatever_its_capitals(written, meant):
    np.testing.assert_array_equal(sensitivities(written, GRID), sensitivities(meant, GRID))


def test_a_light_is_known_whatever_its_capitals_and_keeps_its_name():
    np.testing.assert_array_equal(light("d65", GRID), light("D65", GRID))
    # the kind of light behind it is told by that name
    assert spectrum_of_name("d65", GRID).source == "CIE D65"
    assert spectrum_of_name("led-b3", GRID).source == "CIE LED-B3"


def test_no_two_published_names_are_one_but_for_capitals():
    for kind in (CAMERAS, OBSERVERS, LIGHTS):
        for name in published_names(kind):
            assert known_name(name.swapcase(), published_names(kind)) == name, name


@pytest.mark.parametrize("written, meant", [
    ("hallogen", "halogen"), ("halojen", "halogen"), ("flurescent", "fluorescent"),
    ("phlourescent", "fluorescent"), ("tungstun", "tungsten"), ("dailight", "daylight"),
    ("incandessent", "incandescent"), ("LED-B33", "LED-B3"), ("FL-12x", "FL12")])
def test_a_light_that_is_misspelt_is_suggested(written, meant):
    with pytest.raises(InputError, match=f"nearest are {meant}"):
        spectrum_of_name(written, GRID)


@pytest.mark.parametrize("written, meant", [
    ("Cannon EOS 5D", "Canon EOS 5D"), ("Nikkon D810", "Nikon D810"),
    ("Kanon EOS R", "Canon EOS R"), ("Hasselblatt L1D", "Hasselblad L1D-20c"),
    ("phujifilm gfx100", "Fujifilm GFX 100"), ("Sonny ILCE-9", "Sony ILCE-9")])
def test_a_camera_that_is_misspelt_is_suggested_by_spelling_or_sound(written, meant):
    with pytest.raises(InputError, match=f"nearest are {meant}"):
        sensitivities(written, GRID)


def test_the_nearest_of_a_name_that_is_like_none_are_none():
    assert nearest_names("???", ["halogen", "led"]) == []


@pytest.mark.parametrize("written, name, bands", [
    ("nikon d810", "Nikon D810", ("R", "G", "B")),
    ("Nikon D5100", "Nikon 5100 (NPL)", ("R", "G", "B")),
    ("nikon5100 (npl)", "Nikon 5100 (NPL)", ("R", "G", "B")),
    ("cie 1931 2 degree standard observer", "CIE 1931 2 Degree Standard Observer",
     ("X", "Y", "Z"))])
def test_a_camera_of_python_is_that_of_its_name(written, name, bands, tmp_path):
    camera = sb.camera(written)
    assert (camera.name, camera.bands) == (name, bands) and camera.curves.max() == 1
    assert name in repr(camera) and "<svg" in camera._repr_html_()
    assert [line.get_label() for line in camera.plot().get_lines()][:3] == list(bands)
    signal = {"light": "D65", "noise": 0.01, "draws": 1000}
    known = sb.sample([0.4, 0.3, 0.2], camera=camera, **signal)
    np.testing.assert_allclose(known.mean, sb.sample([0.4, 0.3, 0.2], camera=name, **signal).mean,
                               atol=1e-9)
    again = sb.camera(str(camera.to_csv(tmp_path / "camera.csv")))
    # seven digits are written
    np.testing.assert_allclose(again.curves, camera.curves, atol=1e-6)
    assert again.bands == camera.bands


def test_a_camera_of_python_may_be_ones_own_and_a_typo_is_answered(own):
    cameras.keep_camera("Lab 2026", NM, dict(zip("RGB", three(0), strict=True)), "measured")
    assert sb.camera("lab 2026").name == "Lab 2026"
    with pytest.raises(InputError, match="nearest are Lab 2026"):
        sb.camera("Labb 2026")


def test_the_light_of_a_picture_is_known_whatever_its_capitals(captured):
    text = (captured / "session.toml").read_text(encoding="utf-8")
    (captured / "session.toml").write_text(text + '\n[picture]\nlight = "led-b3"\n',
                                           encoding="utf-8")
    assert read_session(captured).picture.light == "LED-B3"
    (captured / "session.toml").write_text(text + '\n[picture]\nlight = "LED-B33"\n',
                                           encoding="utf-8")
    with pytest.raises(InputError, match=r"picture\.light is 'LED-B33', .*nearest are LED-B3"):
        read_session(captured)
