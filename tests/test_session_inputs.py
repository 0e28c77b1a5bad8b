"""What a stage reads is what its key says, also where files change while a run goes on."""
import re
import shutil
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.capture.photo.image_files import write_exr
from spectrabox.fixtures.object_views import object_mesh, write_ply
from spectrabox.radiometry.errors import InputError
from spectrabox.session import keys as keys_module
from spectrabox.session.config.session_file import read_session
from spectrabox.session.keys import stage_keys
from spectrabox.session.pipeline import stage_states
from spectrabox.session.stages import inputs
from spectrabox.session.store.input_files import InputFiles

from tests.session_runs import call, run


@pytest.mark.parametrize("put_back", [False, True], ids=["replaced", "replaced and put back"])
def test_results_of_a_photo_that_changed_while_it_was_read_are_refused(captured, monkeypatch,
                                                                      put_back):
    photo = captured / "photos" / "chart.dng"
    right, read = photo.read_bytes(), inputs.read_photo

    def read_another(*given):
        photo.write_bytes(right[:-1] + bytes([right[-1] ^ 1]))
        try:
            return read(*given)
        finally:
            if put_back:
                photo.write_bytes(right)

    monkeypatch.setattr(inputs, "read_photo", read_another)
    with pytest.raises(InputError, match=r"photos/chart\.dng was changed or replaced while"):
        run(captured)
    photo.write_bytes(right)
    states = {state.name: state.state for state in stage_states(read_session(captured))}
    assert states["chart"] == "missing"
    assert not list((captured / "results").glob(".*"))


def test_every_input_that_a_stage_opens_is_in_its_key(captured):
    """Of what Python opens; pixels and meshes are opened by libraries, beside what it opens."""
    opened, config = set(), read_session(captured)
    watching = [True]

    def watch(event, arguments):
        if watching and event == "open" and isinstance(arguments[0], str):
            opened.add(arguments[0])

    sys.addaudithook(watch)
    keys = stage_keys(config, InputFiles(config))
    for stage in ("chart", "photo", "calibrate"):
        run(captured, only=stage)
    watching.clear()
    seen = {path.removeprefix(f"{captured}/") for path in opened if path.startswith(str(captured))}
    read = {path for path in seen if path.split("/")[0] in ("photos", "spectra", "scene")}
    assert "spectra/light.csv" in read
    assert read <= {name for key in keys.values() for name in key.get("files", {})}


def test_both_files_of_a_spectral_library_are_inputs(captured):
    light = captured / "spectra" / "light.csv"
    assert call("spectrum", "convert", light, "--out", light.with_suffix(".sli")).exit_code == 0
    light.unlink()
    text = (captured / "session.toml").read_text(encoding="utf-8")
    (captured / "session.toml").write_text(text.replace("light.csv", "light.hdr"), encoding="utf-8")
    config = read_session(captured)
    before = stage_keys(config, InputFiles(config))["calibrate"]
    values = bytearray(light.with_suffix(".sli").read_bytes())
    values[0] ^= 1
    light.with_suffix(".sli").write_bytes(values)
    assert stage_keys(config, InputFiles(config))["calibrate"] != before


def test_another_llvm_makes_what_it_rendered_stale(captured, monkeypatch):
    config = read_session(captured)
    before = stage_keys(config, InputFiles(config))
    (captured / "libLLVM-19.so.1").write_bytes(b"another")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(captured / "libLLVM-19.so.1"))
    after = stage_keys(config, InputFiles(config))
    assert after["reconstruct"]["versions"]["llvm"] == "libLLVM-19.so.1, 7 bytes"
    assert all(before[stage] != after[stage] for stage in before)


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
        keys.append(stage_keys(config, InputFiles(config)))
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
        keys.append(stage_keys(config, InputFiles(config)))
    changed = {name for name in keys[0]
               if {**keys[0][name], "stages": {}} != {**keys[1][name], "stages": {}}}
    assert changed == {"reconstruct"}


SECTIONS = {"chart": {"chart", "calibrate"}, "sensitivity": {"calibrate"},
            "scale": {"reconstruct"}, "repeatability": {"calibrate", "reconstruct"},
            "stray_light": {"reconstruct"}, "reconstruct": {"reconstruct", "photo"},
            "sampling": {"sample"}, "drift": {"chart", "photo"}}
# files have digests in keys; these say nothing to a stage
NAMES = {"reference", "layout", "scene", "truth", "prior", "source"}
INSTEAD = {"corners_px": ((0.0, 0.0),) * 4, "method": "smooth", "leave_out": ("white 9.5",),
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
    before = stage_keys(config, files)
    for section, stages in SECTIONS.items():
        table = getattr(config, section)
        for name in type(table).model_fields:
            changed = otherwise(name, getattr(table, name))
            if changed is None or name in NAMES:
                continue
            after = stage_keys(config.model_copy(update={
                section: table.model_copy(update={name: changed})}), files)
            found = {stage for stage in before if {**before[stage], "stages": {}}
                     != {**after[stage], "stages": {}}}
            assert found and found <= stages, f"{section}.{name}: {found}"
            tried.add(f"{section}.{name}")
    assert {"chart.corners_px", "sensitivity.relative_error", "sampling.draws",
            "reconstruct.block_error"} <= tried


@pytest.mark.parametrize("channels, columns, refused", [
    ("RGB", "XYZ", True), ("RGB", "BGR", True), ("RGB", ("red", "green", "blue"), False),
    ("RGB", ("first", "second", "third"), False)])
def test_curves_named_after_other_bands_than_the_photo_has_are_refused(tmp_path, channels, columns,
                                                                       refused):
    write_exr(tmp_path / "a.exr", np.full((20, 20, 3), 0.5), tuple(channels))
    (tmp_path / "c.csv").write_text(
        "\n".join([",".join(("nm", *columns)), *(f"{nm},1,1,1" for nm in range(380, 721, 20))]))
    config = SimpleNamespace(
        sensitivity=SimpleNamespace(from_chart=False, source=SimpleNamespace(
            file="c.csv", words="c.csv", columns=None, wavelength_column=1)),
        all_views=[SimpleNamespace(photo={"": ("a.exr",)})], path=lambda name: tmp_path / name)
    if refused:
        with pytest.raises(InputError, match=r"a\.exr has the channels R, G, B, and the curves of"):
            inputs.require_curves_of_bands(config)
    else:
        inputs.require_curves_of_bands(config)
