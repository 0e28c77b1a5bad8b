"""The page's server: this machine and its token alone, nothing outside the session."""
import json
import shutil
import signal
import subprocess
import sys
import time
import urllib.parse

import numpy as np
import OpenImageIO as oiio
import pytest
from flat_example import rect_of, write_flat
from served_page import asked, served, wait_for

from spectrabox.session.page.run_control import RunControl


@pytest.fixture(scope="module")
def flat(tmp_path_factory):
    return write_flat(tmp_path_factory.mktemp("flat") / "s")


@pytest.fixture
def session(flat, tmp_path):
    return shutil.copytree(flat, tmp_path / "s")


@pytest.mark.parametrize(("path", "body"), [("/", None), ("/api/state", None),
                                            ("/api/photo?role=photo", None), ("/report", None),
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
        assert not page.run.running


@pytest.mark.parametrize("headers", [{"origin": "http://evil.example"}, {"origin": "null"},
                                     {"host": "evil.example"},
                                     {"origin": "http://127.0.0.1:1"}])
def test_another_page_cannot_speak_even_with_the_token(session, headers):
    with served(session) as (address, page):
        status, said = asked(address + "/api/run", {}, **headers)
        assert status == 403 and "error" in said
        assert not page.run.running


def test_answers_forbid_what_a_page_could_be_made_to_do(session):
    import urllib.request
    with served(session) as (address, _), \
            urllib.request.urlopen(f"{address}/?token=a-token-of-the-tests") as answer:
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy and "unsafe" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["cache-control"] == "no-store"
        assert answer.headers["referrer-policy"] == "no-referrer"


def test_the_state_says_photos_marks_and_stages(session):
    with served(session) as (address, _):
        status, state = asked(address + "/api/state")
        assert status == 200 and state["problems"] == []
        assert state["photos"] == [{"role": "photo", "file": "photos/sample.dng", "there": True}]
        assert set(state["marks"]["regions"]) == {"white_wall", "green_wall", "red_wall", "cube"}
        assert [stage["state"] for stage in state["stages"]][:4] == ["missing"] * 4
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


def test_the_pixels_under_the_pointer_are_those_of_the_file(session, tmp_path):
    from spectrabox.capture.photo.linear import open_photo
    from spectrabox.capture.photo.preview import signal_rgb8
    image = open_photo(session / "photos" / "sample.dng")
    x0, y0, x1, y1 = rect_of("green_wall")
    x, y = (x0 + x1) // 2, (y0 + y1) // 2
    with served(session) as (address, _):
        status, said = asked(f"{address}/api/value?role=photo&x={x}&y={y}")
        step = image.sensor_step
        wanted = image.signal[int((y + 0.5) / step), int((x + 0.5) / step)]
        assert status == 200
        np.testing.assert_allclose(said["signal"], wanted, rtol=1e-6)
        assert asked(f"{address}/api/size?role=photo")[1] == {"size": [480, 320], "bands": 3}
        status, said = asked(f"{address}/api/value?role=photo&x=480&y=5")
        assert status == 409 and "480 x 320" in said["error"]
        status, whole = asked(f"{address}/api/photo?role=photo")
        assert status == 200
        shown, preview = decoded(whole, tmp_path / "whole.jpg"), signal_rgb8(image.signal)
        # of a picture with noise JPEG at this quality keeps a few code values
        assert shown.shape == preview.shape
        assert np.sqrt(np.mean((shown.astype(float) - preview) ** 2)) < 3
        status, part = asked(f"{address}/api/part?role=photo&left=40&top=60&side=48")
        cut = decoded(part, tmp_path / "part.png")
        np.testing.assert_array_equal(cut, preview[30:54, 20:44])       # as it is, nothing lost
        status, part = asked(f"{address}/api/part?role=photo&left=-20&top=-20&side=48")
        cut = decoded(part, tmp_path / "edge.png")
        assert status == 200 and not cut[:10].any() and not cut[:, :10].any()
        np.testing.assert_array_equal(cut[10:, 10:], preview[:14, :14])


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
        for what in ("photo", "size", "value", "part"):
            status, said = asked(f"{address}/api/{what}?role=photo&x=1&y=1&left=0&top=0&side=9")
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


def test_a_run_is_followed_and_can_be_stopped(tmp_path):
    control = RunControl(tmp_path)
    script = ("import sys, time\nprint('stage started', file=sys.stderr, flush=True)\n"
              "try:\n time.sleep(60)\nexcept KeyboardInterrupt:\n"
              " print('{\"error\": \"interrupted\"}'); sys.exit(130)")
    control._command = [sys.executable, "-c", script]
    control.start()
    wait_for(lambda: control.state()["lines"] == ["stage started"])
    assert control.running
    with pytest.raises(Exception, match="going on"):
        control.start()
    control.stop()
    wait_for(lambda: not control.running)
    state = control.state()
    assert state["exit_code"] == 130 and state["error"] == "interrupted" and state["seconds"] < 60


def test_the_command_prints_its_address_and_ends_with_what_it_started(session):
    with subprocess.Popen([sys.executable, "-m", "spectrabox", "open", str(session),
                           "--no-browser"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                          text=True) as process:
        address = process.stdout.readline().strip()
        parts = urllib.parse.urlsplit(address)
        token = urllib.parse.parse_qs(parts.query)["token"][0]
        assert parts.hostname == "127.0.0.1" and len(token) >= 32
        base = f"{parts.scheme}://{parts.netloc}"
        wait_for(lambda: asked(base + "/api/state", token=token)[0] == 200)
        assert asked(base + "/api/run", {"digest": ""}, token=token)[1]["run"]["running"]
        wait_for(lambda: asked(base + "/api/state", token=token)[1]["run"]["lines"])
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) in (0, 143, -signal.SIGTERM, 130)
    # the run that it had started has let go of the session
    time.sleep(0.2)
    again = subprocess.run([sys.executable, "-m", "spectrabox", "status", str(session), "--json"],
                           capture_output=True, text=True, check=True)
    assert json.loads(again.stdout)["stages"]


@pytest.mark.parametrize("words", [["nowhere"], ["{session}", "--watch", "nowhere"]])
def test_a_folder_that_is_none_is_a_sentence(session, words):
    said = subprocess.run([sys.executable, "-m", "spectrabox", "open", "--no-browser",
                           *(word.format(session=session) for word in words)],
                          capture_output=True, text=True, cwd=session, check=False)
    assert said.returncode != 0 and "Traceback" not in said.stderr
    assert "nowhere" in said.stderr or "session.toml" in said.stderr
