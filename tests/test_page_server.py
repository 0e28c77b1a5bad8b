"""The page's server: this machine and its token alone, nothing outside the session."""
import contextlib
import http.client
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.parse
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from flat_example import rect_of, write_flat
from served_page import TOKEN, asked, served, wait_for

from spectrabox.capture.photo.preview import whites
from spectrabox.session.config.session_file import try_read_session
from spectrabox.session.page import photo_views
from spectrabox.session.page.run_control import RunControl


@pytest.fixture(scope="module")
def flat(tmp_path_factory):
    return write_flat(tmp_path_factory.mktemp("flat") / "s")


@pytest.fixture
def session(flat, tmp_path):
    return shutil.copytree(flat, tmp_path / "s")


@pytest.mark.parametrize(("path", "body"), [("/", None), ("/api/state", None),
                                            ("/api/size?role=photo", None), ("/report", None),
                                            ("/api/run", {}), ("/api/undo", {"digest": ""})])
def test_nothing_of_a_session_is_said_without_the_token(session, path, body):
    with served(session) as (address, page):
        for token in (None, "", "another"):
            status, said = asked(address + path, body, token)
            assert status == 403 and "token" in said["error"], (path, token)
        # a form of another page cannot say a token in a POST's address either
        if body is not None:
            status, _ = asked(f"{address}{path}?token=a-token-of-the-tests", body, None)
            assert status == 403
        assert not page.run.running or page.run.state()["until"]


@pytest.mark.parametrize("headers", [{"origin": "http://evil.example"}, {"origin": "null"},
                                     {"host": "evil.example"},
                                     {"origin": "http://127.0.0.1:1"}])
def test_another_page_cannot_speak_even_with_the_token(session, headers):
    with served(session) as (address, page):
        status, said = asked(address + "/api/run", {}, **headers)
        assert status == 403 and "error" in said
        assert not page.run.running or page.run.state()["until"]


@pytest.mark.parametrize(("path", "status", "headers", "body"), [
    ("/", 200, {}, None), ("/page", 200, {}, None), ("/static/page.js", 200, {}, None),
    ("/api/state", 403, {"authorization": ""}, None), ("/report", 404, {}, None),
    ("/static/report.html", 200, {}, None),
    ("/api/run", 405, {}, None), ("/api/mark", 400, {}, b"["), ("/api/mark", 413, {}, None),
    ("/api/mark", 400, {}, b"[" * 100_000), ("/api/state", 400, {"origin": "http://["}, None),
    ("/api/state", 403, {"host": "localhost:["}, None),
    *((f"/api/{what}?role=photo&{numbers}", 400, {}, None)
      for what, numbers in (("value", "x=1e400&y=1"), ("value", "x=nan&y=1"), ("value", "y=1"),
                            ("value", "x=1e300&y=1"), ("tile", "halvings=inf&column=0&row=0"),
                            ("tile", "halvings=0&column=1e400&row=9"),
                            ("tile", "halvings=a&column=&row=")))])
def test_every_answer_forbids_what_a_page_could_be_made_to_do(page_of_flat, path, status, headers,
                                                              body):
    """A wrong request is answered as such, one that is too long before it has ended."""
    host = page_of_flat.removeprefix("http://")
    connection = http.client.HTTPConnection(host, timeout=30)
    connection.putrequest("POST" if body or status == 413 else "GET", path, skip_host=True)
    headers = {"host": host, "authorization": f"Bearer {TOKEN}"} | headers
    length = 1_000_000_000 if status == 413 else len(body or b"")
    for name, value in (headers | {"content-length": length}).items():
        connection.putheader(name, value)
    connection.endheaders(bytes(1_000_000) if status == 413 else body)
    answer = connection.getresponse()
    assert answer.status == status
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy and ("unsafe" in policy) == (
        path in ("/report", "/static/report.html"))
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["cache-control"] == "no-store"
    assert answer.headers["referrer-policy"] == "no-referrer"
    connection.close()


@pytest.fixture(scope="module")
def page_of_flat(flat):
    with served(flat) as (address, _):
        yield address


@pytest.mark.parametrize("content", [
    b"[photos]\nobject = nan", b"[regions.a]\nrect = [1, 2, inf, nan]", b"[regions.a]\nrect = 5",
    b"[session]\nname = 1979-05-27", b"[regions.a]\npolygon = [[1, [2]], 3]", b"regions = 3",
    b"[photos]\nobject = '" + b"a" * 5000 + b"'", b"a = " + b"[" * 5000, b"a = 1" + b"0" * 5000,
    b"[photos]\nobject = \"a\\u0000b\"", b"[photos]\nobject = 'loop.dng'", b"caf\xe9 = 1",
    b"[drift]\nchart_px = 3", b"[chart]\ncorners_px = [1979-05-27]", None])
def test_the_page_lists_the_faults_of_a_session_as_check_does(session, content):
    (session / "loop.dng").symlink_to("loop.dng")
    with served(session) as (address, _):
        (session / "session.toml").unlink()
        if content is not None:
            (session / "session.toml").write_bytes(content)
        status, state = asked(address + "/api/state")
        assert status == 200 and state["problems"] == try_read_session(session)[1] != []


def test_the_state_says_photos_marks_and_stages(session):
    with served(session) as (address, _):
        status, state = asked(address + "/api/state")
        assert status == 200 and state["problems"] == []
        assert state["photos"] == [{"role": "photo", "file": "photos/sample.dng", "there": True,
                                    "look": ""}]
        assert set(state["marks"]["regions"]) == {"white_wall", "green_wall", "red_wall", "cube"}
        # the first three are made in the background
        assert [stage["state"] for stage in state["stages"]][3:] == ["missing"] * 2
        assert state["report"] is None and state["shooting"] is None and not state["undo"]


def test_stages_are_looked_at_again_when_the_session_says_something_else(session):
    file = session / "session.toml"
    text = file.read_text(encoding="utf-8")
    with served(session) as (address, _):
        before = asked(address + "/api/state")[1]["stages"]
        file.write_text(text + "\n[nothing]\nsuch = 1\n", encoding="utf-8")
        state = asked(address + "/api/state")[1]
        assert before and state["problems"] and state["stages"] == []
        file.write_text(text, encoding="utf-8")
        assert asked(address + "/api/state")[1]["stages"] == before


def test_the_pixels_under_the_pointer_are_those_of_the_file(session, tmp_path, monkeypatch):
    from spectrabox.capture.photo.linear import open_photo
    from spectrabox.capture.photo.preview import signal_rgb8
    monkeypatch.setattr(photo_views, "TILE", 100)       # four tiles of 160 x 240 pixels
    image = open_photo(session / "photos" / "sample.dng")
    x0, y0, x1, y1 = rect_of("green_wall")
    x, y = (x0 + x1) // 2, (y0 + y1) // 2
    with served(session) as (address, _):
        status, said = asked(f"{address}/api/value?role=photo&x={x}&y={y}")
        step = image.sensor_step
        wanted = image.signal[int((y + 0.5) / step), int((x + 0.5) / step)]
        assert status == 200
        np.testing.assert_allclose(said["signal"], wanted, rtol=1e-6)
        assert asked(f"{address}/api/size?role=photo")[1] == {
            "size": [480, 320], "bands": 3, "tile": 100, "step": 2.0, "pixels": [240, 160],
            "camera": False}      # its file states a matrix of an unknown light
        status, said = asked(f"{address}/api/value?role=photo&x=480&y=5")
        assert status == 409 and "480 x 320" in said["error"]

        def tile(halvings, column, row):
            status, content = asked(f"{address}/api/tile?role=photo&halvings={halvings}"
                                    f"&column={column}&row={row}")
            return decoded(content, tmp_path / f"tile.{'jpg' if halvings else 'png'}") \
                if status == 200 else status

        preview = signal_rgb8(image.signal)
        joined = np.vstack([np.hstack([tile(0, column, row) for column in range(3)])
                            for row in range(2)])
        np.testing.assert_array_equal(joined, preview)      # as it is, nothing lost
        half = signal_rgb8(image.signal, 2, whites(image.signal))
        shown = np.hstack([tile(1, 0, 0), tile(1, 1, 0)])
        # of a picture with noise JPEG at this quality keeps a few code values
        assert shown.shape == half.shape
        assert np.sqrt(np.mean((shown.astype(float) - half) ** 2)) < 3
        assert tile(5, 0, 0).shape == (5, 8, 3)
        for none in ((0, 3, 0), (0, 0, 2), (1, -1, 0), (-1, 0, 0), (99, 0, 0)):
            assert tile(*none) == 409


def decoded(content, path):
    """Pixels of a picture in memory."""
    path.write_bytes(content)
    return oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)


@pytest.mark.parametrize("name", ["../secret.dng", "/etc/passwd", "photos/../../secret.dng",
                                  "linked.dng"])
def test_no_photo_from_outside_the_session_is_shown(session, name):
    shutil.copy(session / "photos" / "sample.dng", session.parent / "secret.dng")
    (session / "linked.dng").symlink_to(session.parent / "secret.dng")
    text = (session / "session.toml").read_text(encoding="utf-8")
    (session / "session.toml").write_text(text.replace("photos/sample.dng", name),
                                          encoding="utf-8")
    with served(session) as (address, _):
        assert asked(address + "/api/state")[1]["photos"] == []
        for what in ("tile", "size", "value"):
            status, said = asked(f"{address}/api/{what}?role=photo&x=1&y=1&halvings=0&column=0"
                                 "&row=0")
            assert status == 409 and "no photo" in said["error"]


@pytest.mark.parametrize("path", ["/static/../server.py", "/static/%2e%2e/server.py",
                                  "/static/..%2fserver.py", "/static//etc/passwd"])
def test_static_files_are_those_of_the_page_alone(session, path):
    with served(session) as (address, _):
        status, said = asked(address + path, token=None)
        assert status in (403, 404) and b"import" not in (said if isinstance(said, bytes) else b"")


def test_a_report_that_is_a_link_is_not_followed(session):
    (session.parent / "secret.html").write_text("secret", encoding="utf-8")
    (session / "report.html").symlink_to(session.parent / "secret.html")
    with served(session) as (address, _):
        assert asked(address + "/report")[0] == 404


@pytest.mark.parametrize("body", [[], {}, {"mark": 3, "digest": "x"}, {"mark": {}, "digest": 5},
                                  {"mark": {"kind": "region"}}, "text", None])
def test_what_is_no_mark_is_refused_in_a_sentence(session, body):
    before = (session / "session.toml").read_bytes()
    with served(session) as (address, _):
        status, said = asked(address + "/api/mark", body if body is not None else [None])
        assert status in (400, 409) and said["error"]
    assert (session / "session.toml").read_bytes() == before


def test_two_pages_on_one_session_do_not_write_over_each_other(session):
    with served(session) as (one, _), served(session) as (other, _):
        digest = asked(one + "/api/state")[1]["digest"]
        mark = {"kind": "region", "name": "a", "points": [[300, 100], [310, 110]]}
        assert asked(one + "/api/mark", {"mark": mark, "digest": digest})[0] == 200
        status, said = asked(other + "/api/mark", {"mark": {**mark, "name": "b"},
                                                   "digest": digest})
        assert status == 409 and "has changed" in said["error"]
        # nor does the other take back what the first one marked
        digest = asked(other + "/api/state")[1]["digest"]
        assert asked(other + "/api/undo", {"digest": digest})[0] == 409
        assert asked(one + "/api/undo", {"digest": digest})[0] == 200


@pytest.mark.parametrize(("ending", "code", "error"), [
    ("lambda *_: (print('{\"error\": \"interrupted\"}'), sys.exit(143))", 143, "interrupted"),
    ("signal.SIG_IGN", -signal.SIGKILL, None)])
def test_a_run_is_followed_and_can_be_stopped(tmp_path, ending, code, error):
    control = RunControl(tmp_path)
    script = (f"import signal, sys, time\nsignal.signal(signal.SIGTERM, {ending})\n"
              "print('stage started', file=sys.stderr, flush=True)\ntime.sleep(60)")
    control._command = [sys.executable, "-c", script]
    control.start()
    wait_for(lambda: control.state()["lines"] == ["stage started"])
    with pytest.raises(Exception, match="going on"):
        control.start()
    control.stop()
    wait_for(lambda: not control.running)
    state = control.state()
    assert state["exit_code"] == code and state["error"] == error and state["seconds"] < 30


@pytest.mark.parametrize("seconds", [0.0, 0.1, 0.3])
def test_a_run_that_is_stopped_while_it_begins_prints_no_traceback(session, seconds):
    control = RunControl(session)
    control.start()
    time.sleep(seconds)
    control.stop()
    wait_for(lambda: not control.running)
    state = control.state()
    assert state["stopped"] and "Traceback" not in "".join(state["lines"])


PAGE_OF_A_STUBBORN_RUN = """
import sys
from pathlib import Path
from spectrabox.session.terminal.progress_display import stop_on_signals
from spectrabox.session.page.server import serve
from spectrabox.session.page.session_page import SessionPage
stop_on_signals()
page = SessionPage(Path(sys.argv[1]))
page.run._command = [sys.executable, "-c", "import signal, sys, time\\n"
    "signal.signal(15, signal.SIG_IGN)\\nwhile True: open(sys.argv[1], 'w'); time.sleep(0.02)",
    sys.argv[2]]
serve(page, 0, lambda address: print(address, flush=True))
"""


@contextlib.contextmanager
def started(words, **how):
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                          **how) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGKILL"])
def test_page_and_run_end_within_three_seconds_whatever_a_client_does(session, tmp_path, name):
    alive = tmp_path / "alive"
    with started([sys.executable, "-c", PAGE_OF_A_STUBBORN_RUN, session, alive]) as process:
        parts = urllib.parse.urlsplit(process.stdout.readline().strip())
        token = urllib.parse.parse_qs(parts.query)["token"][0]
        assert asked(f"http://{parts.netloc}/api/run", {}, token)[1]["run"]["running"]
        wait_for(alive.exists)
        with socket.create_connection((parts.hostname, parts.port)) as stalled:
            stalled.sendall(f"POST /api/mark HTTP/1.1\r\nHost: {parts.netloc}\r\nAuthorization: "
                            f"Bearer {token}\r\nContent-Length: 99\r\n\r\n[".encode())
            time.sleep(0.2)
            end = time.monotonic() + 3
            process.send_signal(getattr(signal, name))
            process.wait(3)
        time.sleep(max(0, end - time.monotonic()))
        alive.unlink()
        time.sleep(0.2)
        assert not alive.exists()


def test_a_browser_learns_the_address_from_a_file_of_its_user_alone(session, tmp_path):
    script, notes = tmp_path / "browser", tmp_path / "notes"
    script.write_text(f'#!/bin/sh\necho "$@" > {notes}.new; mv {notes}.new {notes}\n')
    script.chmod(0o700)
    with started([sys.executable, "-m", "spectrabox", "open", session],
                 env=os.environ | {"BROWSER": f"{script} %s"}) as process:
        address = process.stdout.readline().strip()
        parts = urllib.parse.urlsplit(address)
        token = urllib.parse.parse_qs(parts.query)["token"][0]
        assert parts.hostname == "127.0.0.1" and len(token) >= 32
        wait_for(notes.exists)
        file = Path(urllib.parse.urlsplit(notes.read_text().strip()).path)
        assert token not in notes.read_text() and address in file.read_text(encoding="utf-8")
        assert file.stat().st_mode & 0o777 == 0o600 and file.parent.stat().st_mode & 0o777 == 0o700
        assert asked(address, token=None)[0] == 200
        assert not file.parent.exists()


@pytest.mark.parametrize("words", [["nowhere"], ["{session}", "--watch", "nowhere"]])
def test_a_folder_that_is_none_is_a_sentence(session, words):
    said = subprocess.run([sys.executable, "-m", "spectrabox", "open", "--no-browser",
                           *(word.format(session=session) for word in words)],
                          capture_output=True, text=True, cwd=session, check=False)
    assert said.returncode != 0 and "Traceback" not in said.stderr
    assert "nowhere" in said.stderr or "session.toml" in said.stderr
