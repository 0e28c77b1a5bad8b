"""What a run would refuse, check says beforehand: a table of faulty sessions through both."""
import copy
import json
from fractions import Fraction

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.capture.develop import developed
from spectrabox.capture.photo.raw import read_raw
from spectrabox.fixtures.dng import write_dng
from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.radiometry.system import archives as memory
from spectrabox.reconstruct.tracer import transport
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import stage_states
from spectrabox.session.pipeline import run_stages
from spectrabox.session.problems import check_session


def rewrite_box(folder, change=lambda mosaic, frame: None, black_added=0, **stated):
    """The object photo of the same camera with other pixels, black levels stated too high, or
    another exposure.
    """
    path = folder / "photos" / "box.dng"
    frame = read_raw(path)
    black = frame.black_level[[0, 0, 1, 1], [0, 1, 0, 1]]
    mosaic = np.array(frame.mosaic)
    change(mosaic, frame)
    path.unlink()
    write_dng(path, mosaic, black=tuple(black + black_added), white=int(frame.white_level),
              f_number=frame.f_number, iso=int(frame.iso), make="Spectrabox",
              model="Synthetic 5100", serial="DEMO-1", **stated)


def edit(folder, name, *changes):
    path = folder / name
    text = path.read_text(encoding="utf-8")
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")


def black_stated_too_high(folder):
    def darken(mosaic, frame):
        mosaic[:40] = np.random.default_rng(1).normal(frame.black_level.mean(), 3,
                                                      mosaic[:40].shape).round()
    rewrite_box(folder, darken, black_added=120)


def exposure_not_stated(folder):
    rewrite_box(folder, exposure_s=Fraction(0))


def glossy_with_the_transport_engine(folder):
    path = folder / "scene" / "box.xml"
    before, after = path.read_text(encoding="utf-8").split('<bsdf type="diffuse" id="cube">')
    after = after.replace('name="reflectance"', 'name="diffuse_reflectance"', 1)
    path.write_text(f'{before}<bsdf type="roughplastic" id="cube">{after}', encoding="utf-8")
    edit(folder, "session.toml", ("[reconstruct]\n", '[reconstruct]\nengine = "transport"\n'))


def draws_through_a_transport_that_is_not_traced(folder):
    edit(folder, "session.toml", ("[reconstruct]\n", '[reconstruct]\nengine = "gradient"\n'),
         ("steps = 80", "steps = 20"),    # until sampling refuses
         ("[sampling]\n", '[sampling]\nthrough = "transport"\n'))


def no_chart_in_the_chart_scene(folder):
    edit(folder, "scene/chart.xml", ('id="chart"', 'id="sheet"'))


def a_material_that_no_pixel_sees(folder):
    edit(folder, "scene/box.xml", ('<translate x="-5" y="6" z="-20"/>',
                                   '<translate x="-5" y="6" z="200"/>'))


def a_material_that_no_light_reaches(folder):
    edit(folder, "scene/box.xml", ('<rotate y="1" angle="-90"/>', '<rotate y="1" angle="90"/>'))


def a_surface_without_a_usable_signal(folder):
    def saturate(mosaic, frame):        # the red wall and more
        mosaic[:, -mosaic.shape[1] // 4:] = int(frame.white_level)
    rewrite_box(folder, saturate, exposure_s=Fraction(1, 60))


FAULTS = {black_stated_too_high: "the black level taken off is too high",
          exposure_not_stated: "states no exposure time",
          glossy_with_the_transport_engine: "cube of box.xml is coated or glossy",
          draws_through_a_transport_that_is_not_traced: "the engine kept no light transport",
          no_chart_in_the_chart_scene: "no shape with the id 'chart'",
          a_material_that_no_pixel_sees: "'cube' fills 0 pixels",
          a_material_that_no_light_reaches: "no light reaches material 'red'",
          a_surface_without_a_usable_signal: "'red' fills 128 pixels of the rendered view, 0 of"}


@pytest.mark.parametrize("fault, sentence", FAULTS.items())
def test_check_says_what_run_would_refuse(finished, fault, sentence):
    """What does not hang on the fault is kept, of a session that was run before it."""
    fault(finished)
    said = [*check_session(finished).problems]
    with pytest.raises(SpectraboxError) as refused:
        run_stages(read_session(finished), device="cpu", only=None, force=False,
                   progress=lambda *_: None)
    assert sentence in str(refused.value)
    assert set(str(refused.value).splitlines()) <= set(said)


def test_a_trace_for_which_memory_is_missing_is_refused_by_both(captured, monkeypatch):
    needed = check_session(captured).tracing_bytes
    assert needed is not None and 0 < needed < 1 << 30
    monkeypatch.setattr(transport, "free_memory", lambda: 1000)
    (said,) = check_session(captured).problems
    assert "of memory that are free; close other programs, or lower [reconstruct] width" \
        in said
    with pytest.raises(SpectraboxError) as refused:
        run_stages(read_session(captured), device="cpu", only=None, force=False,
                   progress=lambda *_: None)
    assert str(refused.value) == said


def test_check_says_what_tracing_will_take(captured):
    said = CliRunner().invoke(app, ["check", str(captured)])
    assert said.exit_code == 0, said.output
    assert "ready to run\ntracing light will take about" in said.output
    facts = json.loads(CliRunner().invoke(app, ["check", str(captured), "--json"]).stdout)
    assert facts["ready"] and facts["problems"] == []
    assert 0 < facts["memory"]["tracing_bytes"] < facts["memory"]["free_bytes"]


def test_nothing_is_left_to_trace_of_a_finished_session(finished):
    result = check_session(finished)
    assert result.tracing_bytes is None and result.sentence == ""


@pytest.mark.parametrize("files, expected", [
    ({"meminfo": "MemTotal:  900 kB\nMemAvailable:  500 kB\n"}, 500 * 1024),
    ({"meminfo": "MemAvailable:  500 kB\n", "max": "300000\n", "current": "100000\n"}, 200_000),
    ({"meminfo": "MemAvailable:  500 kB\n", "max": "max\n", "current": "100000\n"}, 500 * 1024),
    ({"meminfo": "MemAvailable:  500 kB\n", "max": "100\n", "current": "200\n"}, 0)])
def test_free_memory_is_that_of_the_machine_or_its_container(files, expected, tmp_path,
                                                             monkeypatch):
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "GROUPS", ((tmp_path / "max", tmp_path / "current"),))
    assert memory.free_memory() == expected


def test_a_system_that_does_not_say_has_the_memory_that_is_built_in(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "none")
    monkeypatch.setattr(memory, "GROUPS", ())
    found = memory.free_memory()
    assert found is None or found > 1 << 28


def test_a_run_keeps_what_a_check_of_a_sound_session_decoded(captured, monkeypatch):
    inputs = {path: path.read_bytes() for path in captured.rglob("*") if path.is_file()}
    assert not check_session(captured).problems
    assert all(path.read_bytes() == content for path, content in inputs.items())
    states = {name: state for name, (state, _) in stage_states(read_session(captured)).items()}
    assert states == {"chart": "done", "photo": "done", "calibrate": "done",
                      "reconstruct": "missing", "sample": "missing"}

    def decoded(*_):
        raise AssertionError("a photo was decoded again")
    monkeypatch.setattr(developed, "open_any", decoded)
    assert not check_session(captured).problems


def test_the_faults_of_every_photo_are_said_at_once(captured):
    for name in ("box", "chart", "flat"):
        (captured / "photos" / f"{name}.dng").write_bytes(b"no raw")
    said = [*check_session(captured).problems]
    assert len(said) == 3
    for name in ("box", "chart", "flat"):
        assert any(f"{name}.dng" in sentence for sentence in said)


def test_a_run_says_all_faults_that_a_check_lists_and_each_once(captured):
    for name in ("box", "chart"):
        (captured / "photos" / f"{name}.dng").write_bytes(b"no raw")
    (captured / "spectra" / "light.csv").unlink()
    listed = json.loads(CliRunner().invoke(app, ["check", str(captured), "--json"]).stdout)
    assert len(listed["problems"]) == 3
    ran = CliRunner().invoke(app, ["run", str(captured), "--json"])
    assert ran.exit_code == listed["exit_code"] == InputError.exit_code
    assert json.loads(ran.stdout)["error"].splitlines() == listed["problems"]


def test_a_fault_of_two_lines_is_one_fault():
    error = InputError("first\nwith another line", "second", "second")
    assert error.faults == ("first\nwith another line", "second")
    assert str(error) == "first\nwith another line\nsecond"
    assert copy.copy(error).faults == error.faults      # as from a worker of a batch


@pytest.mark.parametrize("flat", ["missing", "of another size"])
def test_a_flat_field_at_fault_hides_no_fault_of_the_photos(captured, flat):
    (captured / "photos" / "flat.dng").unlink()
    if flat != "missing":
        write_dng(captured / "photos" / "flat.dng", np.full((64, 96), 6000, np.uint16))
    write_dng(captured / "photos" / "chart.dng", np.full((208, 312), 6000, np.uint16))
    said = "\n".join(check_session(captured).problems)
    assert ("flat.dng is missing" if flat == "missing" else "the white card at the same size") \
        in said
    assert "no ColorChecker was found in photo chart.dng" in said
