"""What a run would refuse, check says beforehand: a table of faulty sessions through both."""
from fractions import Fraction

import numpy as np
import pytest

from spectrabox.capture.photo.raw import read_raw
from spectrabox.fixtures.dng import write_dng
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.session.check import find_problems
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages


def rewrite_box(folder, exposure_s=None, black_added=0):
    """The object photo with another stated exposure, or black levels that are stated too high."""
    path = folder / "photos" / "box.dng"
    frame = read_raw(path)
    black = frame.black_level[[0, 0, 1, 1], [0, 1, 0, 1]]
    mosaic = np.array(frame.mosaic)
    if black_added:
        mosaic[:40] = np.random.default_rng(1).normal(black.mean(), 3, mosaic[:40].shape).round()
    path.unlink()
    stated = {} if exposure_s is None else {"exposure_s": exposure_s}
    write_dng(path, mosaic, black=tuple(black + black_added), white=int(frame.white_level),
              f_number=frame.f_number, iso=int(frame.iso), **stated)


def edit(folder, name, *changes):
    path = folder / name
    text = path.read_text(encoding="utf-8")
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path.write_text(text, encoding="utf-8")


def black_stated_too_high(folder):
    rewrite_box(folder, Fraction(1, 60), black_added=120)


def exposure_not_stated(folder):
    rewrite_box(folder)


def glossy_with_the_transport_engine(folder):
    path = folder / "scene" / "box.xml"
    before, after = path.read_text(encoding="utf-8").split('<bsdf type="diffuse" id="cube">')
    after = after.replace('name="reflectance"', 'name="diffuse_reflectance"', 1)
    path.write_text(f'{before}<bsdf type="roughplastic" id="cube">{after}', encoding="utf-8")
    edit(folder, "session.toml", ("[reconstruct]\n", '[reconstruct]\nengine = "transport"\n'))


def draws_through_a_transport_that_is_not_traced(folder):
    edit(folder, "session.toml", ("[reconstruct]\n", '[reconstruct]\nengine = "gradient"\n'),
         ("[sampling]\n", '[sampling]\nthrough = "transport"\n'))


def no_chart_in_the_chart_scene(folder):
    edit(folder, "scene/chart.xml", ('id="chart"', 'id="sheet"'))


def reference_outside_the_photo(folder):
    corners = "[[[10, 10], [9000, 10], [9000, 60], [10, 60]]]"
    with (folder / "session.toml").open("a", encoding="utf-8") as stream:
        stream.write(f"\n[drift]\nchart_px = {corners}\nobject_px = {corners}\n")


FAULTS = (black_stated_too_high, exposure_not_stated, glossy_with_the_transport_engine,
          draws_through_a_transport_that_is_not_traced, no_chart_in_the_chart_scene,
          reference_outside_the_photo)


@pytest.mark.parametrize("fault", FAULTS)
def test_check_says_what_run_would_refuse(captured, fault):
    fault(captured)
    said = [problem.sentence for problem in find_problems(captured)]
    with pytest.raises(SpectraboxError) as refused:
        run_stages(read_session(captured), device="cpu", only=None, force=False,
                   progress=lambda *_: None)
    assert set(str(refused.value).splitlines()) <= set(said)


def test_a_sound_session_is_ready_and_left_as_it_was(captured):
    before = sorted(path.relative_to(captured) for path in captured.rglob("*"))
    assert find_problems(captured) == []
    assert sorted(path.relative_to(captured) for path in captured.rglob("*")) == before
