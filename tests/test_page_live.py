"""A photo that is opened: calibrated in the background, and its spectra are those of the report."""
import json
import urllib.error
import urllib.parse
import urllib.request
from fractions import Fraction

import numpy as np
import pytest
from flat_example import picture, rect_of, write_flat
from served_page import TOKEN, asked, served, served_by, wait_for
from typer.testing import CliRunner

from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.radiometry.errors import InputError
from spectrabox.session.cli import app
from spectrabox.session.commands.session import _folder_to_open
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import load_finished
from spectrabox.session.page.marks import Mark, marked
from spectrabox.session.page.start_page import StartPage

from tests.session_runs import call


def state_of(address):
    return asked(f"{address}/api/state")[1]


def wait_ready(address):
    def ready():
        live = state_of(address)["live"]
        assert not live["error"], live
        return live["ready"]
    wait_for(ready, 120)


def test_what_the_page_shows_of_a_region_is_what_a_run_finds(tmp_path):
    """Also beside a white card, whose known spectrum says how bright the light is."""
    session = write_flat(tmp_path / "s", "[stray_light]\nglare = 0.004\n")
    path = session / "session.toml"
    text = path.read_text(encoding="utf-8").replace(
        'truth = "spectra/white_wall.csv"', 'known = "spectra/white_wall.csv"')
    path.write_text(f'{text}family = "paint"\nsurface = "satin"\n', encoding="utf-8")    # the cube
    with served(session) as (address, _):
        wait_ready(address)
        shown = {name: asked(f"{address}/api/region?name={name}")[1]
                 for name in ("white_wall", "green_wall", "cube")}
        x0, y0, x1, y1 = rect_of("green_wall")
        pointed = asked(f"{address}/api/spectrum?role=photo&x0={x0}&y0={y0}&x1={x1}&y1={y1}")[1]
        clipped = asked(f"{address}/api/spectrum?role=photo&x0=-9&y0=0&x1=20&y1=20")[1]

        def compared(*picked):
            return asked(f"{address}/api/compare", {"picked": picked})
        part = {"role": "photo", "x0": x0, "y0": y0, "x1": x0 + 20, "y1": y1}
        halves = compared(part, part | {"x0": x0 + 21, "x1": x1})[1]
        different = compared({"name": "cube"}, {"name": "green_wall"})[1]
        assert compared({"name": "nobody"}, part)[0] == 409 and compared(part)[0] == 409
        assert compared(part, {"role": "photo"})[0] == 400
    assert not halves["distinct"] and different["distinct"]
    assert different["names"] == ["cube", "green_wall"]
    assert all(light["delta_e00"] < 1 for light in halves["lights"])    # one paint
    assert CliRunner().invoke(app, ["run", str(session), "--quiet"]).exit_code == 0
    spectra = load_finished(read_session(session)).records.spectra
    assert shown["white_wall"]["given"] and "leaves the photo" in clipped["refused"]
    for name in ("green_wall", "cube"):
        summary = spectra[name]
        # round-off of the least squares, and five decimals
        for curve in ("mean", "lower", "upper"):
            np.testing.assert_allclose(shown[name][curve], getattr(summary, curve), atol=2e-5)
        assert dict(shown[name]["causes"])["metamerism"] == pytest.approx(
            spectra[name].variance_shares["metamerism"], abs=1e-3)
    # closed form against 1000 draws: a standard error of the mean is a thirtieth of a deviation
    summary = spectra["green_wall"]
    mean = np.interp(summary.grid.nm, pointed["nm"], pointed["mean"])
    assert np.all(np.abs(mean - summary.mean) < 5 * summary.standard_deviation / 1000**0.5 + 2e-4)


def test_a_photo_makes_a_session_that_is_calibrated_and_has_no_region_yet(tmp_path):
    photo = tmp_path / "_DSC 1.dng"
    write_photo(photo, picture(), Fraction(1, 60), np.random.default_rng(3))
    folder = _folder_to_open((photo,))
    assert folder == tmp_path / "_DSC 1-flat"
    with served(folder) as (address, page):
        wait_ready(address)
        state = state_of(address)
        assert state["problems"] == [] and state["live"]["charts"]["photo"]["verdict"] == "GOOD"
        assert np.shape(state["live"]["charts"]["photo"]["patches"]) == (24, 4, 2)
        assert [stage["state"] for stage in state["stages"]] == ["done"] * 3 + ["missing"] * 2
        mark = {"kind": "region", "name": "a", "points": [[300, 60], [330, 90]]}
        marked_state = asked(f"{address}/api/mark", {"mark": mark, "digest": state["digest"]})[1]
        assert list(marked_state["marks"]["regions"]) == ["a"]
        # at once, and no other run has to begin
        assert "mean" in asked(f"{address}/api/region?name=a")[1]
        wait_for(lambda: not page.run.running)
        assert state_of(address)["run"]["until"] == "calibrate"
    # opened again it is as it was left
    assert _folder_to_open((photo,)) == folder and "[regions.a]" in (
        folder / "session.toml").read_text(encoding="utf-8")


def test_a_photo_without_a_chart_says_so(tmp_path):
    photo = tmp_path / "grey.dng"
    write_photo(photo, picture(chart=None), Fraction(1, 60), np.random.default_rng(3))
    with served(_folder_to_open((photo,))) as (address, _):
        error = wait_for(lambda: state_of(address)["live"]["error"], 120)
        assert "chart" in error
        assert asked(f"{address}/api/region?name=a")[0] == 409


def test_what_is_no_session_says_how_to_begin(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no session; to start from a photo: spectrabox open"):
        _folder_to_open((tmp_path / "empty",))
    with pytest.raises(InputError, match="is missing"):
        _folder_to_open((tmp_path / "nothing.dng",))


def test_a_flat_sample_without_regions_is_calibrated_but_not_measured(tmp_path):
    photo = tmp_path / "a.dng"
    write_photo(photo, picture(), Fraction(1, 60), np.random.default_rng(3))
    folder = _folder_to_open((photo,))

    def run(*options):
        return json.loads(call("run", folder, "--json", *options).stdout)
    assert [stage["name"] for stage in run("--until", "calibrate")["stages"]] == [
        "chart", "photo", "calibrate"]
    assert "no region is outlined yet" in run()["error"]
    assert "--until nowhere: one of the stages" in run("--until", "nowhere")["error"]


def test_a_region_is_renamed_where_it_stands():
    text = '[regions."a b"]\r\nrect = [1, 2, 3, 4]   # left\r\n[ regions.b ]\nrect = [5, 6]\n'
    renamed = marked(text, Mark(kind="rename", name="a b", names=("c",)))
    assert renamed == text.replace('"a b"', "c")
    assert marked(renamed, Mark(kind="rename", name="c", names=("a b",))) == text
    for name, new in (("a b", "b"), ("x", "y")):
        with pytest.raises(InputError):
            marked(text, Mark(kind="rename", name=name, names=(new,)))


def test_photos_that_are_dropped_become_a_session_in_the_working_folder_and_nothing_else(tmp_path):
    write_photo(tmp_path / "shot.dng", picture(), Fraction(1, 60), np.random.default_rng(3))
    content = (tmp_path / "shot.dng").read_bytes()
    home = tmp_path / "home"
    home.mkdir()

    def upload(address, name, sent):
        request = urllib.request.Request(
            f"{address}/api/photo?name={urllib.parse.quote(name)}", data=sent,
            headers={"Authorization": f"Bearer {TOKEN}"})
        try:
            return urllib.request.urlopen(request, timeout=60).status
        except urllib.error.HTTPError as error:
            return error.code

    with served_by(StartPage(home)) as address:
        assert asked(f"{address}/api/sessions")[1]["sessions"] == []
        assert asked(f"{address}/api/sessions", token=None)[0] == 403
        assert upload(address, "notes.txt", b"x") == 409
        assert upload(address, "../../evil<b>.dng", content) == 200
        assert asked(f"{address}/api/new", {"names": ["../../evil<b>.dng"]})[1] == {
            "address": "/s/1/page"}
        assert [path.name for path in home.iterdir()] == ["evil_b_-flat"]
        assert {path.name for path in tmp_path.iterdir()} == {"shot.dng", "home"}
        wait_ready(f"{address}/s/1")
        assert asked(f"{address}/s/1/api/state", token=None)[0] == 403
        # of what is no photo nothing is left
        assert upload(address, "broken.dng", b"no photo") == 200
        assert asked(f"{address}/api/new", {"names": ["broken.dng"]})[0] == 409
        assert [path.name for path in home.iterdir()] == ["evil_b_-flat"]
        # the same name again is another session
        assert upload(address, "evil_b_.dng", content) == 200
        assert asked(f"{address}/api/new", {"names": ["evil_b_.dng"]})[1]["address"] == "/s/2/page"
        assert set(asked(f"{address}/api/sessions")[1]["sessions"]) == {"evil_b_-flat",
                                                                       "evil_b_-flat-2"}
        assert asked(f"{address}/api/open", {"name": "evil_b_-flat"})[1]["address"] == "/s/1/page"
        for name in ("..", "home", "/"):
            assert asked(f"{address}/api/open", {"name": name})[0] == 409


def test_files_that_the_page_is_given_lie_in_the_session_and_overwrite_nothing(calibrated_flat):
    session = calibrated_flat
    before = {path: path.read_bytes() for path in session.rglob("*.*") if path.is_file()}

    def given(address, name, content, token=TOKEN):
        request = urllib.request.Request(f"{address}/api/file?name={urllib.parse.quote(name)}",
                                         data=content, headers={"Authorization": f"Bearer {token}"})
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return json.loads(answer.read())["file"]
        except urllib.error.HTTPError as error:
            return error.code

    with served(session) as (address, _):
        assert given(address, "../../session.toml", b"x") == "spectra/session.toml"
        assert given(address, "cube.csv", b"x") == "spectra/cube-2.csv"
        assert given(address, "sample.dng", b"x") == "photos/sample-2.dng"
        assert given(address, "..", b"x") == 409 and given(address, "a.csv", b"x", "wrong") == 403
        for mark in ({"kind": "stated", "name": "cube", "stated": {"truth": "spectra/cube-2.csv"}},
                     {"kind": "stated", "name": "cube", "stated": {"truth": "../../x.csv"}},
                     {"kind": "view", "name": "b", "stated": {"photo": "photos/sample-2.dng",
                                                              "light": "unknown"}},
                     {"kind": "view", "name": "b", "stated": {"light": "unknown"}},
                     {"kind": "session", "stated": {"light": "moonshine"}},
                     {"kind": "session", "stated": {"seed": "2"}}):
            assert asked(f"{address}/api/mark", {"digest": state_of(address)["digest"],
                                                 "mark": mark})[0] == 409, mark
    assert all(path.read_bytes() == content for path, content in before.items())


def test_what_is_stated_of_a_region_is_written_and_counts(calibrated_flat):
    session = calibrated_flat
    with served(session) as (address, _):
        wait_ready(address)
        before = asked(f"{address}/api/region?name=green_wall")[1]

        def state_that(name, **stated):
            return asked(f"{address}/api/mark", {
                "digest": state_of(address)["digest"],
                "mark": {"kind": "stated", "name": name, "stated": stated}})
        assert state_that("white_wall", known="0.87", surface="matt")[0] == 200
        written = read_session(session).regions["white_wall"]
        assert written.known.file == "spectra/white_wall 0.87.csv" and written.surface == "matt"
        assert asked(f"{address}/api/region?name=white_wall")[1]["given"]
        after = asked(f"{address}/api/region?name=green_wall")[1]
        assert after["light"][1] < before["light"][1]       # the card says how bright the light is
        assert state_that("white_wall", known="", surface="")[0] == 200
        assert read_session(session).regions["white_wall"].known is None
        for wrong in ({"known": "/etc/passwd"}, {"known": "1.7"}, {"family": "no such kind"},
                      {"truth": "a.csv"}):
            assert state_that("white_wall", **wrong)[0] == 409, wrong
        assert asked(f"{address}/api/region?name=green_wall")[1] == before
