"""Hostile requests with a valid token, on sessions with any fault: answers and sentences alone."""
import contextlib
import http.client
import json
import random
import urllib.parse

from served_page import TOKEN, served

from spectrabox.session.config.session_file import try_read_session

CASES = 200
VALUES = [None, True, 0, -1, 1.5, 1e6 + 1, 1e300, 10**30, float("nan"), float("inf"), "", "a",
          "object", "\x00", "\ud800", "x" * 5000, "../..", "a\nb", "[x]", "a.b", [], {}, [[1, 2]],
          {"a": [[]]}, "__proto__"]
TOML = ["nan", "1979-05-27", "[]", "{}", "[[1,[2]],3]", "'" + "a" * 5000 + "'", "1e400", "9" * 400,
        "'/etc/passwd'", "'loop.dng'", '"a\\u0000b"', "[1,2,3,4]", "[[1,2],[3,4],[5,6]]", "['a']"]
KEYS = ["session.name", "photos", "photos.object", "photos.chart", "light.spectrum", "regions",
        "regions.cube", "regions.b.polygon", "regions.b.rect", "regions.b.photo", "chart",
        "chart.corners_px", "views.v", "views.v.photo",
        "scene", "scene.box", "scene.box.width_mm", "scene.box.camera", "materials", "picture.rect"]
PATHS = ["/", "/page", "/report", "/api/state", "/api/size", "/api/tile",
         "/api/value", "/static/..%2fserver.py", "/static/%00", "/api/none", "/api/state/"]
BODIES = [b"", b"[" * 50_000, b'{"a":' * 3000, b"\xff", b"9" * 6000, b'"\\ud800"', b"x" * 300_000]


def mark(chance):
    """A mark as the page writes it, perhaps with something else in place of one of its parts."""
    points = [[chance.uniform(-20, 500), chance.uniform(0, 320)]
              for _ in range(chance.choice([0, 2, 3, 4, 8]))]
    written = {"kind": chance.choice(["region", "chart corners", "box corners"]),
               "name": chance.choice(["cube", "a", "object"]), "points": points}
    return written | {chance.choice([*written, "photo"]): chance.choice(VALUES)
                      for _ in range(chance.choice([0, 0, 1]))}


def test_hostile_requests_are_answered_in_sentences_and_change_no_file(calibrated_flat):
    folder, chance = calibrated_flat, random.Random(29)
    file = folder / "session.toml"
    original = file.read_bytes()
    (folder / "loop.dng").symlink_to("loop.dng")
    with served(folder) as (address, _):
        def ask(method, path, body=None):
            connection = http.client.HTTPConnection(address.removeprefix("http://"), timeout=60)
            with contextlib.closing(connection):
                connection.request(method, path, body, {"Authorization": f"Bearer {TOKEN}"})
                answer = connection.getresponse()
                assert answer.headers["x-content-type-options"] == "nosniff"
                return answer.status, answer.read()

        for _ in range(CASES):
            lines = [f"{key} = {chance.choice(TOML)}" for key in chance.sample(KEYS, 2)]
            file.write_bytes(chance.choice([original, original, "\n".join(lines).encode() + b"\n"
                                            + chance.choice([b"", original])]))
            before, faults = file.read_bytes(), try_read_session(folder)[1]
            status, state = ask("GET", "/api/state")
            state = json.loads(state)
            assert status == 200 and state["problems"] == faults, before
            words = {name: chance.choice(["photo", "0", "-5", "1e400", "nan", "1e300", "", "\x00"])
                     for name in ("role", "halvings", "column", "row", "x", "y")}
            request = {"mark": chance.choice([mark(chance), mark(chance), chance.choice(VALUES)]),
                       "digest": chance.choice([state["digest"]] * 9 + VALUES)}
            body = chance.choice([json.dumps(request).encode()] * 5 + [chance.choice(BODIES)])
            for method, path, sent in (
                    ("GET", f"{chance.choice(PATHS)}?{urllib.parse.urlencode(words)}", None),
                    ("POST", chance.choice(["/api/mark"] * 4 + ["/api/undo", "/api/stop"]), body)):
                status, answer = ask(method, path, sent)
                assert status in (200, 400, 404, 409, 413), (path, sent, before)
                if status in (400, 409, 413):
                    assert len(json.loads(answer)["error"]) > 8
                if file.read_bytes() != before:     # only by a mark that adds no fault
                    new = set(try_read_session(folder)[1]) - set(faults)
                    assert status == 200 and not new
                    undo = json.dumps({"digest": json.loads(answer)["digest"]})
                    assert ask("POST", "/api/undo", undo)[0] == 200
                    assert file.read_bytes() == before
