"""Marks become session.toml: comments stay, faults are refused, every mark can be undone."""
import shutil
import time
import tomllib

import numpy as np
import pytest
import tomlkit
from flat_example import write_flat

from spectrabox.capture.photo.regions import region_pixels
from spectrabox.radiometry.errors import InputError
from spectrabox.session.page import marks
from spectrabox.session.page.marks import Mark, MarkedSession, marked
from spectrabox.session.page.photo_views import PhotoViews
from spectrabox.session.page.written_session import corner_names, photos_of, shown_tables
from spectrabox.session.problems import check_session

FLAT = """# what we photographed on Tuesday
[photos]
object = "photos/sample.dng"   # the only photo

[light]
spectrum = "unknown"

[regions.old]    # a card
rect = [1, 2, 30, 40]
known = "spectra/card.csv"     # measured
"""


WHITE = {"photos": {"object": ["a.dng", "b.dng"]}, "light": {"spectrum": "unknown"}}


def a_mark(kind="region", **rest):
    return Mark.model_validate({"kind": kind, **rest})


def test_a_rectangle_is_written_from_any_two_of_its_corners():
    text = marked(FLAT, a_mark(name="red", points=[[90, 10.04], [20.26, 60]]))
    assert tomllib.loads(text)["regions"]["red"] == {"rect": [20.3, 10, 90, 60]}
    assert text.startswith("# what we photographed on Tuesday\n")
    assert "# the only photo" in text and "# a card" in text and "# measured" in text


def test_a_region_that_is_marked_again_keeps_what_is_known_of_it():
    text = marked(FLAT, a_mark(name="old", points=[[0, 0], [9, 0], [0, 9]], photo="warm"))
    assert tomllib.loads(text)["regions"]["old"] == {
        "polygon": [[0, 0], [9, 0], [0, 9]], "known": "spectra/card.csv", "photo": "warm"}


def test_a_polygon_gives_way_to_a_rectangle():
    text = marked(FLAT, a_mark(name="old", points=[[0, 0], [9, 0], [0, 9]], photo="warm"))
    again = marked(text, a_mark(name="old", points=[[5, 6], [7, 9]]))
    assert tomllib.loads(again)["regions"]["old"] == {"rect": [5, 6, 7, 9],
                                                      "known": "spectra/card.csv"}


def test_a_region_can_be_taken_away_and_without_the_last_one_the_sample_is_still_flat():
    text = marked(FLAT, a_mark(name="old"))
    assert tomllib.loads(text)["regions"] == {} and "# the only photo" in text


def test_corners_of_the_chart():
    square = [[1, 1], [9, 1], [9, 9], [1, 9]]
    text = marked(FLAT, a_mark("chart corners", points=square))
    assert tomllib.loads(text)["chart"]["corners_px"] == square
    text = marked(text, a_mark("chart corners"))
    assert "corners_px" not in tomllib.loads(text)["chart"]


def test_corners_of_a_box_take_the_place_of_the_measured_camera():
    from spectrabox.session.config.template import TEMPLATES
    text = (TEMPLATES / "box.toml").read_text(encoding="utf-8")
    names = [f"{depth} {height} {side}" for depth in ("front", "back")
             for height in ("bottom", "top") for side in ("left", "right")]
    points = [[10.0 * number, 5.5] for number in range(8)]
    done = marked(text, a_mark("box corners", points=points, names=names))
    camera = tomllib.loads(done)["scene"]["box"]["camera"]
    assert camera == {"fov_deg": 37.3, "corners_px": dict(zip(names, points, strict=True))}
    comments = [line.split("#", 1)[1] for line in text.splitlines() if "#" in line]
    kept = [line.split("#", 1)[1] for line in done.splitlines() if "#" in line]
    assert set(comments) - set(kept) <= {" of the lens", " what is in the middle of the photo"}


@pytest.mark.parametrize(("mark", "said"), [
    ({"kind": "region", "points": [[1, 1], [2, 2]]}, "needs a name"),
    ({"kind": "region", "name": "a", "points": [[1, 1]]}, "two corners"),
    ({"kind": "chart corners", "points": [[1, 1]]}, "4 corners"),
    ({"kind": "box corners", "points": [[1, 1]], "names": ["a"]}, r"no \[scene.box\]"),
    ({"kind": "box corners", "points": [[1, 1]]}, "0 names"),
])
def test_marks_that_mean_nothing_are_refused(mark, said):
    with pytest.raises(InputError, match=said):
        marked(FLAT, Mark.model_validate(mark))


@pytest.fixture
def session(tmp_path):
    (tmp_path / "session.toml").write_text(FLAT, encoding="utf-8")
    return MarkedSession(tmp_path, PhotoViews())


def test_marks_are_undone_one_by_one_to_the_first_byte(session):
    texts = [session.read()[0]]
    for name in ("a", "b"):
        session.apply({"kind": "region", "name": name, "points": [[1, 1], [5, 5]]},
                      session.read()[1])
        texts.append(session.read()[0])
    assert session.can_undo(texts[-1]) and len(set(texts)) == 3
    for text in texts[1::-1]:
        session.undo(session.read()[1])
        assert session.read()[0] == text
    assert not session.can_undo(texts[0])
    with pytest.raises(InputError, match="nothing to undo"):
        session.undo(session.read()[1])


def test_a_mark_never_writes_over_what_somebody_else_wrote(session):
    seen = session.read()[1]
    path = session.folder / "session.toml"
    path.write_text(FLAT + "# by hand\n", encoding="utf-8")
    with pytest.raises(InputError, match="has changed since"):
        session.apply({"kind": "region", "name": "a", "points": [[1, 1], [5, 5]]}, seen)
    assert path.read_text(encoding="utf-8") == FLAT + "# by hand\n"


def test_an_undo_never_takes_back_what_somebody_else_wrote(session):
    session.apply({"kind": "region", "name": "a", "points": [[1, 1], [5, 5]]}, session.read()[1])
    path = session.folder / "session.toml"
    path.write_text(path.read_text(encoding="utf-8") + "# by hand\n", encoding="utf-8")
    assert not session.can_undo(session.read()[0])
    with pytest.raises(InputError, match="changed elsewhere"):
        session.undo(session.read()[1])
    assert path.read_text(encoding="utf-8").endswith("# by hand\n")


@pytest.mark.parametrize(("written", "said"), [
    ({"kind": "region", "name": " ", "points": [[1, 1], [5, 5]]}, "regions."),
    ({"kind": "region", "name": "a", "points": [[1, 1], [1, 5]]}, "enclose|corners"),
    ({"kind": "region", "name": "a", "points": [["x", 1], [1, 5]]}, "number"),
    ({"kind": "wall", "name": "a"}, "region, rename, stated, session"),
    ({"kind": "region", "name": "a", "pints": []}, "unknown key 'pints'"),
])
def test_a_mark_that_makes_a_faulty_session_changes_nothing(session, written, said):
    with pytest.raises(InputError, match=said):
        session.apply(written, session.read()[1])
    assert session.read()[0] == FLAT


def test_a_session_that_has_a_fault_already_can_still_be_marked(tmp_path):
    faulty = FLAT.replace('spectrum = "unknown"', 'spectrum = "unknown"\ncolour = 3')
    (tmp_path / "session.toml").write_text(faulty, encoding="utf-8")
    session = MarkedSession(tmp_path, PhotoViews())
    session.apply({"kind": "region", "name": "a", "points": [[1, 1], [5, 5]]}, session.read()[1])
    assert "a" in tomllib.loads(session.read()[0])["regions"]


@pytest.mark.parametrize("camera", [
    None, {}, {"at_mm": [0, 165, 690], "look_at_mm": [0, 165, 0]}, {"corners_px": {}}])
def test_corners_can_be_marked_before_the_camera_is_known(camera):
    """The camera of such a session is a fault, and marks are what mends it."""
    box = {"width_mm": 480, "height_mm": 330, "depth_mm": 400, "walls": {"back": "white"},
           "objects": [{"name": "block", "shape": "box", "material": "cube",
                        "size_mm": [120, 120, 120], "at_mm": [-50, 0, -200]}],
           "lamp": {"at_mm": [50, 270, 380], "radius_mm": 8}}
    box |= {} if camera is None else {"camera": camera}
    tables = shown_tables(tomlkit.dumps({**WHITE, "scene": {"box": box}}))
    assert photos_of(tables) == {"photo": "a.dng"}
    names = corner_names(tables)
    assert len(names) == 16 and names[0] == "back bottom left"
    assert names[-4:] == [name for name in names if name.startswith("front ")]
    assert "block front top left" in names


@pytest.mark.parametrize("scene", [3, {"box": []}, {"box": {"width_mm": "wide"}},
                                   {"file": "scene/box.xml"}])
def test_without_a_measured_box_no_corner_can_be_named(scene):
    tables = shown_tables(tomlkit.dumps({**WHITE, "scene": scene}))
    assert corner_names(tables) == []
    assert photos_of(tables) == ({"photo": "a.dng"} if "file" in str(scene) else {})
    assert corner_names(shown_tables("[photos")) == []


@pytest.fixture(scope="module")
def flat(tmp_path_factory):
    return write_flat(tmp_path_factory.mktemp("flat") / "s")


@pytest.mark.parametrize("mark", [
    {"kind": "region", "name": "a", "points": [[400, 300], [600, 310]]},
    {"kind": "region", "name": "a", "points": [[50, 50]] * 5},
    {"kind": "region", "name": "a", "points": [[10, 10], [12, 12]]},
    {"kind": "chart corners", "points": [[10, 10], [90, 10], [90, 90], [10, 90]]}])
def test_what_check_says_of_a_mark_is_said_before_it_is_written(flat, tmp_path, mark):
    folder = shutil.copytree(flat, tmp_path / "s")
    session, before = MarkedSession(folder, PhotoViews()), (folder / "session.toml").read_bytes()
    with pytest.raises(InputError) as refused:
        session.apply(mark, session.read()[1])
    assert (folder / "session.toml").read_bytes() == before
    (folder / "session.toml").write_text(marked(session.read()[0], a_mark(**mark)))
    problems = check_session(folder).problems
    assert str(refused.value).splitlines() == [*problems]


@pytest.mark.parametrize("before", ["\ufeff", ""])
@pytest.mark.parametrize("end", ["\r\n", "\n"])
def test_lines_end_as_they_did_and_an_undo_restores_every_byte(tmp_path, before, end):
    content = (before + FLAT.replace("\n", end)).encode()
    (tmp_path / "session.toml").write_bytes(content)
    session = MarkedSession(tmp_path, PhotoViews())
    session.apply({"kind": "region", "name": "a", "points": [[1, 1], [5, 5]]}, session.read()[1])
    after = (tmp_path / "session.toml").read_bytes()
    assert after.startswith(content) and after.count(b"\n") == after.count(end.encode()) > 10
    session.undo(session.read()[1])
    assert (tmp_path / "session.toml").read_bytes() == content


def test_many_points_take_time_by_their_number_and_nobody_waits_for_them(session, monkeypatch):
    def seconds(count):
        turns = np.linspace(0, 6, count)
        points = np.column_stack([500 + 400 * np.cos(turns), 500 + 300 * np.sin(turns)])
        start = time.process_time()
        text = marked(FLAT, a_mark(name="a", points=points.tolist()))
        region_pixels(np.zeros((1000, 1000, 3), bool), 1.0, points, "a")
        assert not session._lock.locked() and len(text) > 10 * count
        return time.process_time() - start
    monkeypatch.setattr(marks, "marked", lambda text, mark: seconds(1000) and text)
    session.apply({"kind": "region", "name": "a"}, session.read()[1])
    # by their square, sixteen times the points take 256 times the time
    assert seconds(16_000) < 64 * max(seconds(1000), 0.01)
