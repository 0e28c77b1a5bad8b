"""What the page of a session answers, refuses and writes; how it judges new shots.

Requests go to the application itself, without a socket.
"""
import asyncio
import dataclasses
import json
import os
import shutil
import socket
import sys
import urllib.parse
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from compact_results import compact
from flat_example import picture
from served_page import wait_for
from typer.testing import CliRunner

from spectrabox.capture.photo.image_files import write_exr
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.records import LinearImage, PhotoKind
from spectrabox.session.cli import with_only
from spectrabox.session.config.template import TEMPLATES
from spectrabox.session.page import run_control, shooting
from spectrabox.session.page.marks import Mark, MarkedSession, corner_names, marked, photos_of
from spectrabox.session.page.photo_views import PhotoViews
from spectrabox.session.page.run_control import RunControl
from spectrabox.session.page.server import SessionPage, page_app, serve
from spectrabox.session.page.shooting import Shooting, judge_photo

TOKEN = "a-token"
SESSION = """[session]
name = "a painting"
[photos]
object = "photos/p.exr"     # the only photo
chart = "../outside.exr"
[views.warm]
photo = "photos/none.exr"
[light]
spectrum = "unknown"
[chart]
corners_px = [[1, 2], [30, 2], [30, 20], [1, 20]]
[regions.red]
rect = [1, 2, 9, 11]
photo = "warm"
[regions.blue]
polygon = [[3, 3], [9, 4], [5, 9.5]]
"""
HEADERS = ("content-security-policy", "x-content-type-options", "referrer-policy", "cache-control")


def ask(app, path, body=None, query="", token=TOKEN, host="127.0.0.1:80", method=None, **headers):
    """Status, headers that matter, and answer of a request."""
    sent = []
    content = body if isinstance(body, bytes) else b"" if body is None \
        else json.dumps(body).encode()
    named = {"host": host, **({} if token is None else {"authorization": f"Bearer {token}"}),
             **headers}

    parts = [{"type": "http.request", "body": content, "more_body": False}]

    async def receive():
        return parts.pop() if parts else {"type": "http.disconnect"}

    async def send(message):
        sent.append(message)
    scope = {"type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "root_path": "",
             "method": method or ("GET" if body is None else "POST"), "scheme": "http",
             "path": path, "raw_path": path.encode(), "query_string": query.encode(),
             "headers": [(key.encode(), value.encode()) for key, value in named.items()],
             "server": ("127.0.0.1", 80), "client": ("127.0.0.1", 5)}
    with ThreadPoolExecutor(1) as own:      # a browser's loop may run in this thread
        own.submit(asyncio.run, app(scope, receive, send)).result()
    answer = b"".join(message.get("body", b"") for message in sent[1:])
    kept = {name.decode(): value.decode() for name, value in sent[0]["headers"]
            if name.decode() in (*HEADERS, "content-type")}
    return sent[0]["status"], kept, answer


def told(asked):
    """Status and JSON of an answer."""
    return [asked[0], json.loads(asked[2])]


@pytest.fixture
def session(tmp_path):
    (tmp_path / "s" / "photos").mkdir(parents=True)
    rng = np.random.default_rng(4)
    pixels = rng.uniform(0.02, 0.7, (24, 34, 3)) * np.linspace(0.3, 1.3, 34)[:, None]
    write_exr(tmp_path / "s" / "photos" / "p.exr", pixels.astype(np.float32), ["R", "G", "B"], 0.1)
    (tmp_path / "s" / "session.toml").write_text(SESSION, encoding="utf-8")
    return tmp_path / "s"


@pytest.fixture
def app(session):
    return page_app(SessionPage(session), TOKEN)


def test_who_is_refused(app, recorded):
    hosts = [told(ask(app, "/api/state", host=host))[0] for host in (
        "127.0.0.1:80", "localhost:9", "[::1]:80", "127.0.0.2", "example.org", "", "127.0.0.1")]
    origins = [told(ask(app, "/api/state", origin=origin))[0] for origin in (
        "http://127.0.0.1:80", "http://127.0.0.1:81", "http://evil.example", "null", "")]
    tokens = [ask(app, "/api/state", token=token, query=query)[0] for token, query in (
        (TOKEN, ""), ("other", ""), (None, ""), (None, f"token={TOKEN}"), (None, "token=other"))]
    posted = [ask(app, "/api/undo", {"digest": ""}, token=token, query=query)[0]
              for token, query in ((TOKEN, ""), (None, f"token={TOKEN}"))]
    paths = {path: ask(app, path, token=None)[0] for path in (
        "/", "/report", "/static/index.html", "/static/none.js", "/api/state")}
    recorded([hosts, origins, tokens, posted, paths])
    recorded([told(ask(app, "/api/state", host="example.org")),
              told(ask(app, "/api/state", origin="null")),
              told(ask(app, "/api/state", token=None))], case="sentences")


def test_what_answers_forbid(app, session, recorded):
    (session / "report.html").write_text("a report", encoding="utf-8")
    recorded({path: ask(app, path)[:2] for path in ("/", "/report", "/api/state", "/static/none.js",
                                                    "/none")})
    recorded(ask(app, "/report")[2].decode(), case="report")
    (session / "report.html").unlink()
    recorded(told(ask(app, "/report")), case="no report")


def state_of(answer):
    """A state without digest and times of files."""
    state = {name: value for name, value in answer[1].items() if name not in ("digest", "report")}
    state["shooting"] = state["shooting"] and "watched"
    return [answer[0], compact(state)]


def test_the_state_of_a_session(app, session, recorded):
    recorded(state_of(told(ask(app, "/api/state"))))
    (session / "session.toml").write_text("[photos\n", encoding="utf-8")
    recorded(state_of(told(ask(app, "/api/state"))), case="no TOML")
    (session / "session.toml").write_text(SESSION.replace('name = "a painting"', "name = 3"),
                                          encoding="utf-8")
    recorded(state_of(told(ask(app, "/api/state"))), case="a name that is none")
    (session / "session.toml").unlink()
    recorded(told(ask(app, "/api/state"))[0], case="no file")


def test_photos_of_the_session(app, recorded):
    found = {}
    for query in ("role=photo&x=0&y=0", "role=photo&x=33&y=23", "role=photo&x=33.4&y=-0.4",
                  "role=photo&x=33.6&y=2", "role=photo&x=3&y=-0.6", "role=photo&x=12&y=5",
                  "role=chart&x=1&y=1", "role=warm&x=1&y=1", "role=none&x=1&y=1", "x=1&y=1",
                  "role=photo&x=a&y=1", "role=shot:p.exr&x=1&y=1"):
        found[query] = told(ask(app, "/api/value", query=query))
        found[f"size {query}"] = told(ask(app, "/api/size", query=query))
    recorded(found)


@pytest.mark.parametrize("left, top, side", [(3, 5, 9), (-4, -2, 10), (28, 20, 12), (90, 90, 4),
                                             (2.4, 2.6, 0.2), (0, 0, 5000)])
def test_a_part_of_a_photo(left, top, side, app, tmp_path, recorded):
    status, headers, content = ask(app, "/api/part",
                                   query=f"role=photo&left={left}&top={top}&side={side}")
    (tmp_path / "part.png").write_bytes(content)
    pixels = oiio.ImageBuf(str(tmp_path / "part.png")).get_pixels(oiio.UINT8)
    # 8 bits: the rounding of one pixel may differ
    recorded([status, headers["content-type"], pixels.shape])
    recorded(pixels, rtol=1e-3, case="pixels")


def test_a_photo_as_a_whole(tmp_path, recorded, monkeypatch):
    """Of a raw photo a pixel of the signal has four of the sensor; it is shown within a limit."""
    path = tmp_path / "a.dng"
    write_photo(path, picture((64, 96)), Fraction(1, 60), np.random.default_rng(3))
    monkeypatch.setattr("spectrabox.session.page.photo_views.MAX_SIDE", 20)
    views = PhotoViews()
    (tmp_path / "whole.jpg").write_bytes(views.whole(path))
    shown = oiio.ImageBuf(str(tmp_path / "whole.jpg")).get_pixels(oiio.UINT8)
    photo = views.photo(path)
    recorded([photo.step, photo.size, photo.white, shown.shape])
    recorded(shown, rtol=0.02, case="as JPEG")
    recorded([[views.value(path, x, y) for x, y in ((0, 0), (1.4, 1.6), (50, 20), (95.4, 63.4))],
              [photo.cell(x, y) for x, y in ((-0.5, 0), (-0.4, -0.4), (1.4, 1.5), (95.5, 0),
                                             (95.4, 63.5), (96, 2))]], case="values")


def test_the_latest_photos_are_kept(session, tmp_path):
    views = PhotoViews()
    paths = [tmp_path / f"{at}.exr" for at in range(5)]
    for path in paths:
        shutil.copy(session / "photos" / "p.exr", path)
        views.photo(path)
    assert [key[0] for key in views._photos] == paths[-3:]
    first = views.photo(paths[-1])
    assert views.photo(paths[-1]) is first
    os.utime(paths[-1], ns=(1, 1))
    assert views.photo(paths[-1]) is not first


def test_marks_through_the_page(app, session, recorded):
    """Marking, marking again, undoing, and what is refused on the way."""
    digest = told(ask(app, "/api/state"))[1]["digest"]
    mark = {"kind": "region", "name": "new", "points": [[30, 20.26], [12.04, 2]]}
    said = [told(ask(app, "/api/mark", {"mark": mark, "digest": "old"}))]
    first = told(ask(app, "/api/mark", {"mark": mark, "digest": digest}))
    said += [state_of(first)[1] if first[0] == 200 else first]
    text = (session / "session.toml").read_text(encoding="utf-8")
    digest = told(ask(app, "/api/state"))[1]["digest"]
    for wrong in ({"kind": "region"}, {"kind": "none"}, {"kind": "chart corners",
                                                         "points": [[1, 2]]}, 3):
        said.append(told(ask(app, "/api/mark", {"mark": wrong, "digest": digest})))
    for body in (b"{", b"[]", b"x" * 200_001, b" " * 199_999 + b"3"):
        said.append(told(ask(app, "/api/mark", body)))
    undone = told(ask(app, "/api/undo", {"digest": digest}))
    said += [undone[0], told(ask(app, "/api/undo", {"digest": undone[1].get("digest", "")}))]
    assert (session / "session.toml").read_text(encoding="utf-8") == SESSION
    said += [ask(app, "/api/mark", None)[0], ask(app, "/api/state", {})[0]]
    recorded([text, said])


SQUARE = [[1, 1], [9.04, 1], [9, 9.06], [1, 9]]
BOX = (TEMPLATES / "box.toml").read_text(encoding="utf-8")
MARKS = [{"kind": "region", "name": name, "points": points, "photo": photo}
         for name, points, photo in (
             ("", SQUARE[:2], ""), ("red", [], ""), ("red", SQUARE[:1], ""),
             ("red", [[9, 4], [3, 12]], ""), ("red", [[3.14, 12], [9, 4.06]], "warm"),
             ("blue", SQUARE[:3], ""), ("green", SQUARE, "warm"), ("none", [], ""))]
MARKS += [{"kind": "chart corners", "points": SQUARE[:count]} for count in (0, 1, 3, 4)]
MARKS += [{"kind": "reference", "name": name, "points": SQUARE[:count]}
          for name, count in (("chart", 4), ("object", 4), ("chart", 0), ("chart", 3), ("it", 4))]
MARKS += [{"kind": "box corners", "points": SQUARE, "names": ["a", "b", "c"]},
          {"kind": "box corners", "points": SQUARE[:2], "names": ["a", "b"]}]


def test_what_marks_make_of_a_file(recorded):
    found = []
    for text in (SESSION, BOX):
        for mark in MARKS:
            try:
                after = marked(text, Mark.model_validate(mark)).splitlines()
                found.append([line for line in after if line not in text.splitlines()]
                             + [len(after) - len(text.splitlines())])
            except SpectraboxError as error:
                found.append(str(error))
    twice = Mark.model_validate({"kind": "reference", "name": "object", "points": SQUARE})
    found.append(marked(marked(SESSION, twice), twice).splitlines()[-3:])
    recorded(found)
    with pytest.raises(SpectraboxError, match="is not valid TOML"):
        marked("[x", Mark.model_validate(MARKS[3]))


def test_what_is_no_mark(session, recorded):
    marks, found = MarkedSession(session), []
    digest = marks.read()[1]
    for wrong in ({"kind": "region", "name": "a", "points": [[1], [2, 3]]},
                  {"kind": "region", "name": "a", "points": [[1, 2, 3], [2, 3]]},
                  {"kind": "region", "name": "a", "points": [[1, "x"], [2, 3]]},
                  {"kind": "region", "name": "a", "point": [[1, 2]]}, {"name": "a"}, [], None,
                  {"kind": "box corners", "points": [[1, 2]], "names": 3},
                  {"kind": "region", "name": "a", "points": [[1, 2], [3, 4]], "photo": "cold"}):
        with pytest.raises(SpectraboxError) as refused:
            marks.apply(wrong, digest)
        found.append(str(refused.value))
    recorded(found)
    assert not marks.can_undo and marks.read()[1] == digest
    # a mark that changes nothing is nothing to undo
    marks.apply({"kind": "region", "name": "red", "photo": "warm", "points": [[1, 2], [9, 11]]},
                digest)
    assert not marks.can_undo


def test_names_of_photos_and_corners(recorded):
    import tomllib
    written = [{}, {"photos": 3}, {"photos": {"object": 3}}, tomllib.loads(SESSION),
               {"photos": {"object": ["a.dng", "b.dng"], "chart": {"450": "c.exr", "550": "d.exr"}},
                "views": {"v": {"photo": "e.dng", "chart": ["f.dng"]}, "w": 3}}]
    box = tomllib.loads(BOX)
    recorded([[photos_of(each) for each in written],
              [corner_names(each) for each in (*written, box, {"scene": {"box": 3}},
                                               {"scene": {"box": {"size_mm": 3}}})]])


def image(brightest, clipped=0.0, size=(40, 50)):
    """A dim photo with a tenth of brighter pixels, some of them clipped in the second band."""
    signal = np.full((*size, 3), 0.05, np.float32)
    signal[:4] = np.array([0.8, 1.0, 0.6]) * brightest
    saturated = np.zeros(signal.shape, bool)
    saturated.reshape(-1, 3)[:round(clipped * size[0] * size[1]), 1] = True
    return LinearImage(signal, signal * 1e-4, saturated, 1.0, 0.1, 100.0, 8.0, PhotoKind.RAW, "x",
                       "x.dng", "")


def test_from_which_exposure_a_photo_is_good(recorded):
    unknown = dataclasses.replace(CLASSIC, references=(), colours=None)
    found = []
    for brightest in (0.0, 0.01, 0.1, 0.195, 0.2, 0.205, 0.5, 0.75, 0.9):
        for clipped in (0.0, 0.0015, 0.002, 0.0025, 0.3):
            photo = image(brightest, clipped)
            found.append([judge_photo(photo, unknown), shooting.clipped_share(photo),
                          shooting.brightest_signal(photo), shooting.exposure_stops(photo)])
    recorded([each[0] for each in found], case="judged")
    recorded(np.array([[*each[1], *each[2], each[3]] for each in found]), case="numbers")


def test_a_photo_with_a_chart_is_judged_by_it(tmp_path, recorded):
    from spectrabox.capture.develop.developed import open_any
    found = []
    for factor in (1.0, 0.12):
        path = tmp_path / f"{factor}.dng"
        write_photo(path, picture(), Fraction(1, 60), np.random.default_rng(3),
                    brightest=0.9 * factor)
        found.append(judge_photo(open_any(path)))
    mirrored = open_any(tmp_path / "1.0.dng")
    mirrored = dataclasses.replace(mirrored, **{name: getattr(mirrored, name)[:, ::-1].copy()
                                                for name in ("signal", "variance", "saturated")})
    recorded([*found, judge_photo(mirrored)])


def test_when_a_new_file_is_looked_at(tmp_path, recorded, monkeypatch):
    """Still for half a second, and given up after ten where it cannot be read."""
    (tmp_path / "known.dng").write_bytes(b"x")
    watch = Shooting(tmp_path)
    now = [100.0]
    monkeypatch.setattr(shooting.time, "monotonic", lambda: now[0])
    (tmp_path / "cut.dng").write_bytes(b"not a photo")
    (tmp_path / "empty.exr").write_bytes(b"")
    write_exr(tmp_path / "good.exr", image(0.5).signal, ["R", "G", "B"], 0.1)
    (tmp_path / "notes.txt").write_bytes(b"x")
    found = []
    for at in (0.0, 0.45, 0.55, 5.0, 9.9, 10.1, 20.0):
        now[0] = 100.0 + at
        for name in sorted(set(watch._photos()) - watch._known):
            watch._look_at(name)
        state = watch.state()
        found.append([at, state["arriving"], state["shots"]])
    assert Path(watch.state()["folder"]) == tmp_path
    recorded(found)
    with pytest.raises(SpectraboxError, match="is no folder"):
        Shooting(tmp_path / "none")


SAYS = ("import sys; print(sys.argv[1]); print('a line ', file=sys.stderr); "
        "sys.exit(int(sys.argv[2]))")


@pytest.mark.parametrize("answer, code", [('{"verdict": "warn"}', 0), ('{"error": "no"}', 4),
                                          ("no JSON", 9)])
def test_a_run_is_told_as_it_ended(answer, code, tmp_path, recorded, monkeypatch):
    started = []
    popen = run_control.subprocess.Popen
    monkeypatch.setattr(run_control.subprocess, "Popen", lambda *words, **more: (
        started.append(more), popen(*words, **more))[1])
    control = RunControl(tmp_path, ("--allow-outside",))
    assert control._command[1:] == ["-m", "spectrabox", "run", str(tmp_path), "--json",
                                    "--allow-outside"]
    before = control.state()
    control._command = [sys.executable, "-c", SAYS, answer, str(code)]
    control.start()
    wait_for(lambda: not control.running and control.state()["lines"])
    after = control.state()
    assert 0 < after.pop("seconds") < 60 and before.pop("seconds") == 0
    recorded([before, after, started])


def test_the_page_is_served_at_a_free_port(session, tmp_path, recorded, monkeypatch):
    """Its address is told once, with a token of its own; a port in use is a sentence."""
    import uvicorn
    ran, told = [], []
    monkeypatch.setattr(uvicorn.Server, "run",
                        lambda server, sockets: ran.append((server, sockets[0].getsockname())))
    page = SessionPage(session, tmp_path)
    for _ in range(2):
        serve(page, 0, told.append)
    first, second = (urllib.parse.urlsplit(each) for each in told)
    tokens = [urllib.parse.parse_qs(each.query)["token"][0] for each in (first, second)]
    assert tokens[0] != tokens[1] and all(len(each) >= 32 for each in tokens)
    assert [(first.hostname, first.port), (second.hostname, second.port)] == [
        address for _, address in ran]
    assert page.shooting.folder == tmp_path.resolve()
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(SpectraboxError, match=r"cannot be used .*give another with --port"):
            serve(page, taken.getsockname()[1], told.append)
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    for words in (("open", str(session)), ("open", str(session), "--no-browser", "--watch",
                                           str(tmp_path))):
        result = CliRunner().invoke(with_only("open"), words)
        assert result.exit_code == 0 and result.stdout.startswith("http://127.0.0.1:")
        recorded(result.stderr, case=f"{len(words)} words")
    assert len(opened) == 1
