"""What a stage reads is what its key says, also where files change while a run goes on."""
import re
import shutil
import sys

import numpy as np
import pytest

from spectrabox.capture.develop import developed
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.fixtures.object_views import object_mesh, write_ply
from spectrabox.measure import opened_photos
from spectrabox.measure.captured import FlatCapture, InputFile, Sensitivity, View
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import UnknownLight
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import stage_states
from spectrabox.session.store import keys as keys_module
from spectrabox.session.store.keys import InputFiles, input_files, step_keys

from tests.session_runs import call, run


def keys_of(config, files=None):
    """Keys of a session's records."""
    return step_keys(config.capture(), files or InputFiles(config))


@pytest.mark.parametrize("put_back", [False, True], ids=["replaced", "replaced and put back"])
def test_results_of_a_photo_that_changed_while_it_was_read_are_refused(captured, monkeypatch,
                                                                      put_back):
    photo = captured / "photos" / "chart.dng"
    right, read = photo.read_bytes(), developed.develop_photos

    def read_another(*given):
        photo.write_bytes(right[:-1] + bytes([right[-1] ^ 1]))
        try:
            return read(*given)
        finally:
            if put_back:
                photo.write_bytes(right)

    monkeypatch.setattr(developed, "develop_photos", read_another)
    with pytest.raises(InputError, match=r"photos/chart\.dng was changed or replaced while"):
        run(captured)
    photo.write_bytes(right)
    assert stage_states(read_session(captured))["chart"] == ("missing", ())
    assert not list((captured / "results").glob(".*"))


def test_every_file_that_a_run_opens_is_an_input_of_the_session(captured):
    """Of what Python opens; pixels and meshes are opened by libraries, beside what it opens."""
    opened, config = set(), read_session(captured)
    watching = [True]

    def watch(event, arguments):
        if watching and event == "open" and isinstance(arguments[0], str):
            opened.add(arguments[0])

    sys.addaudithook(watch)
    for stage in ("chart", "photo", "calibrate"):
        run(captured, only=stage)
    watching.clear()
    seen = {path.removeprefix(f"{captured}/") for path in opened if path.startswith(str(captured))}
    read = {path for path in seen if path.split("/")[0] in ("photos", "spectra", "scene")}
    assert "spectra/light.csv" in read
    compared = {material.truth.file for material in config.materials.values() if material.truth}
    assert read <= {*input_files(config, config.capture()), *compared}


def test_both_files_of_a_spectral_library_are_inputs(captured):
    light = captured / "spectra" / "light.csv"
    assert call("spectrum", "convert", light, "--out", light.with_suffix(".sli")).exit_code == 0
    light.unlink()
    text = (captured / "session.toml").read_text(encoding="utf-8")
    (captured / "session.toml").write_text(text.replace("light.csv", "light.hdr"), encoding="utf-8")
    config = read_session(captured)
    before = keys_of(config)["calibrate"]
    values = bytearray(light.with_suffix(".sli").read_bytes())
    values[-1] ^= 1
    light.with_suffix(".sli").write_bytes(values)
    assert keys_of(config)["calibrate"] != before


def test_another_llvm_makes_what_it_rendered_stale(captured, monkeypatch):
    config = read_session(captured)
    before = keys_of(config)
    (captured / "libLLVM-19.so.1").write_bytes(b"another")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(captured / "libLLVM-19.so.1"))
    after = keys_of(config)
    assert after["reconstruct"]["versions"]["llvm"] == "libLLVM-19.so.1, 7 bytes"
    assert {stage for stage in before if before[stage] != after[stage]} \
        == {"calibrate", "reconstruct", "sample"}


def test_another_mesh_makes_another_reconstruction_and_leaves_the_chart(captured):
    config = read_session(captured)
    scene, mesh = captured / config.all_views[0].scene, captured / "scene" / "ball.ply"
    material = re.findall(r'<ref id="([^"]+)"', scene.read_text(encoding="utf-8"))[0]
    shape = ('<shape type="ply" id="ball"><string name="filename" value="ball.ply"/>'
             f'<ref id="{material}"/></shape></scene>')
    scene.write_text(scene.read_text(encoding="utf-8").replace("</scene>", shape),
                     encoding="utf-8")
    keys = []
    for size in (4, 5):
        write_ply(mesh, *object_mesh(size))
        keys.append(keys_of(config))
    one, other = keys
    name = "scene/ball.ply"
    assert one["reconstruct"]["files"][name] != other["reconstruct"]["files"][name]
    assert one["sample"]["stages"] != other["sample"]["stages"]
    assert one["chart"] == other["chart"]


def test_the_same_lamps_at_other_places_of_the_scene_make_another_reconstruction(captured):
    text = (captured / "session.toml").read_text(encoding="utf-8")
    shutil.copy(captured / "spectra" / "light.csv", captured / "spectra" / "lamp.csv")
    keys = []
    for emitter in ("left", "right"):
        (captured / "session.toml").write_text(text.replace(
            '[light]\n', f'[light]\nby_id = {{ {emitter} = "spectra/lamp.csv" }}\n'),
            encoding="utf-8")
        config = read_session(captured)
        keys.append(keys_of(config))
    changed = {name for name in keys[0]
               if {**keys[0][name], "stages": {}} != {**keys[1][name], "stages": {}}}
    assert changed == {"reconstruct"}


SECTIONS = {"chart": {"chart", "calibrate"}, "sensitivity": {"calibrate"},
            "scale": {"reconstruct"}, "repeatability": {"calibrate", "reconstruct"},
            "stray_light": {"reconstruct"}, "reconstruct": {"reconstruct", "photo"},
            "sampling": {"sample"}}
# files have digests in keys; these say nothing to a stage
NAMES = {"reference", "layout", "scene", "truth", "prior", "source"}
INSTEAD = {"corners_px": ((0.0, 0.0),) * 4, "method": "smooth", "leave_out": (3,),
           "object_px": (((0.0, 0.0),) * 4,), "chart_px": (((0.0, 0.0),) * 4,)}


def otherwise(name, value):
    """Another value of a setting; None where there is none to be had simply."""
    if name in INSTEAD:
        return INSTEAD[name]
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int | float) else None


def test_every_number_of_session_toml_that_a_stage_takes_makes_its_results_stale(captured,
                                                                                 monkeypatch):
    monkeypatch.setattr(keys_module, "room_digests", lambda rooms: {})
    config = read_session(captured)
    files, tried = InputFiles(config), set()
    before = keys_of(config, files)
    for section, stages in SECTIONS.items():
        table = getattr(config, section)
        for name in type(table).model_fields:
            changed = otherwise(name, getattr(table, name))
            if changed is None or name in NAMES:
                continue
            after = keys_of(config.model_copy(update={
                section: table.model_copy(update={name: changed})}), files)
            found = {stage for stage in before if {**before[stage], "stages": {}}
                     != {**after[stage], "stages": {}}}
            assert found and found <= stages, f"{section}.{name}: {found}"
            tried.add(f"{section}.{name}")
    assert {"chart.corners_px", "sensitivity.relative_error", "sampling.draws",
            "reconstruct.surface_error"} <= tried


@pytest.mark.parametrize("channels, columns, refused", [
    ("RGB", "XYZ", True), ("RGB", "BGR", True), ("RGB", ("red", "green", "blue"), False),
    ("RGB", ("first", "second", "third"), False)])
def test_curves_named_after_other_bands_than_the_photo_has_are_refused(tmp_path, channels, columns,
                                                                       refused):
    write_exr(tmp_path / "a.exr", np.full((20, 20, 3), 0.5), tuple(channels))
    photo = {"": (InputFile("a.exr", tmp_path / "a.exr"),)}
    capture = FlatCapture(views=(View("", photo, photo, UnknownLight(), "unknown"),), chart=None,
                          regions={}, seed=1,
                          sensitivity=Sensitivity(np.ones((3, 301)), tuple(columns), "c.csv"))
    if refused:
        with pytest.raises(InputError, match=r"a\.exr has the channels R, G, B, and the curves of"):
            opened_photos.require_curves_of_bands(capture)
    else:
        opened_photos.require_curves_of_bands(capture)
