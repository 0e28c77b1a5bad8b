"""A folder from a stranger: nothing that lies in it is run, and what it holds of too much is
refused before memory is taken for it.
"""
import contextlib
import json
import os
import shutil
import socket
import struct
import subprocess
import sys
import time
import tomllib
import tracemalloc
import urllib.error
import urllib.parse
import urllib.request
import zlib
from pathlib import Path

import numpy as np
import pytest
from batch_sessions import write_session
from served_page import TOKEN, asked, served, wait_for
from session_runs import call

from spectrabox.capture.photo import linear
from spectrabox.fixtures.dng import write_dng
from spectrabox.radiometry import checked_tables
from spectrabox.radiometry.errors import InputError
from spectrabox.session.config.session_file import try_read_session
from spectrabox.session.page import access, answers, server

COMMAND = Path(sys.executable).parent / "spectrabox"
# of ours, of others', of Python's own: whatever a child may ask for first
PLANTED = ("numpy.py", "spectrabox/__init__.py", "lazy_loader.py", "typer.py", "tomllib.py",
           "json/__init__.py", "multiprocessing/__init__.py", "mitsuba/__init__.py",
           "sitecustomize.py", "distributed/__init__.py", "cloudpickle.py", "uvicorn/__init__.py")
MARKING = "import os, sys\nopen(os.environ['MARK'], 'a').write(f'{__file__} {sys.argv}\\n')\n"
LIBRARY = r"""
#include <stdio.h>
#include <stdlib.h>
__attribute__((constructor)) static void mark(void) {
    FILE *file = fopen(getenv("MARK"), "a");
    if (file) { fputs("a library\n", file); fclose(file); }
}
"""
PLUGINS = ("path", "diffuse", "perspective", "independent", "specfilm", "rectangle", "scene")


def plant(folder):
    """Modules, and libraries named as plug-ins of Mitsuba where a compiler is there."""
    for name in PLANTED:
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(MARKING)
    compiler = shutil.which("cc")
    if compiler:
        (folder / "plugins").mkdir(exist_ok=True)
        source, library = folder / "mark.c", folder / "plugins" / "library.so"
        source.write_text(LIBRARY)
        subprocess.run([compiler, "-shared", "-fPIC", source, "-o", library], check=True)
        for name in PLUGINS:
            shutil.copyfile(library, library.with_stem(name))
    return folder


@pytest.fixture
def typed(tmp_path, monkeypatch):
    """A function that types words in a folder, as its user would, and says what came of it."""
    if not COMMAND.exists():
        pytest.skip("the command is not installed beside this Python")
    mark = tmp_path / "mark"
    monkeypatch.setenv("MARK", str(mark))
    for name in ("PYTHONPATH", "PYTHONSAFEPATH"):
        monkeypatch.delenv(name, raising=False)

    def type_in(folder, *words, command=(COMMAND,), code=0):
        done = subprocess.run([*map(str, (*command, *words))], cwd=folder, text=True, check=False,
                              capture_output=True, stdin=subprocess.DEVNULL, timeout=300)
        assert done.returncode == code, done.stdout + done.stderr
        assert not mark.exists(), mark.read_text()
        return done
    yield type_in
    assert not mark.exists(), mark.read_text()


def test_the_planted_files_would_leave_their_mark(tmp_path, monkeypatch):
    """Or the other tests here could not fail."""
    mark = tmp_path / "mark"
    monkeypatch.setenv("MARK", str(mark))
    folder = plant(tmp_path)
    subprocess.run([sys.executable, "-c", "import numpy, spectrabox"], cwd=folder, check=True)
    assert mark.read_text().count("\n") >= 2
    if (folder / "plugins").exists():
        import ctypes
        ctypes.CDLL(str(folder / "plugins" / "diffuse.so"))
        assert "a library" in mark.read_text()


@pytest.mark.parametrize("words", [("doctor",), ("check", "."), ("run", ".", "-q"),
                                   ("status", "."), ("report", ".")])
def test_a_command_in_a_strangers_folder_runs_nothing_of_it(captured, finished, typed, words):
    typed(plant(finished if words[0] == "report" else captured), *words)


def test_workers_run_nothing_of_the_folder_that_a_batch_is_started_in(typed, tmp_path,
                                                                      calibrated_flat):
    folders = [shutil.copytree(calibrated_flat, tmp_path / name) for name in ("a", "b")]
    typed(plant(tmp_path), "batch", *(each.name for each in folders), "--workers", "2")


def test_workers_of_a_cluster_run_nothing_of_the_folder_that_it_is_started_in(typed, tmp_path,
                                                                              calibrated_flat):
    pytest.importorskip("distributed")
    shutil.copytree(calibrated_flat, tmp_path / "a")
    typed(plant(tmp_path), "batch", "a", "--cluster", "local", "--workers", "1")


def test_python_itself_looks_for_nothing_but_the_package_in_the_folder(typed, tmp_path):
    """``python -m``: a spectrabox/ in the folder is what was asked for, anything else is not."""
    plant(tmp_path)
    shutil.rmtree(tmp_path / "spectrabox")
    for words in ((sys.executable, "-m", "spectrabox"), (sys.executable, "-mspectrabox"),
                  (sys.executable, "-P", "-m", "spectrabox")):
        typed(tmp_path, "--version", command=words)
        typed(tmp_path, "doctor", command=words)


def test_the_commands_script_takes_no_module_from_the_folder_that_it_lies_in(typed, tmp_path):
    plant(tmp_path)
    shutil.rmtree(tmp_path / "spectrabox")
    shutil.copy(COMMAND, tmp_path / "spectrabox")
    typed(Path.home(), "doctor", command=(tmp_path / "spectrabox",))


def test_a_picture_is_drawn_by_no_program_of_the_folders_settings(typed, tmp_path, monkeypatch):
    """A matplotlibrc may have every word set by LaTeX, which reads files that it is told to."""
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\ntext.latex.preamble: stranger\n")
    programs = tmp_path / "programs"
    programs.mkdir()
    for name in ("latex", "dvipng", "kpsewhich"):
        (programs / name).write_text(f'#!/bin/sh\necho {name} >> "$MARK"; exit 1\n')
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    write_session(tmp_path / "s")
    typed(tmp_path, "sample", "--sensitivity", "CIE 1931 2 Degree Standard Observer", "--light",
          "D65", "--signal", "0.3,0.4,0.2", "--noise", "0.01,0.01,0.01", "--samples", "1000",
          "--plot", "plot.png")
    typed(tmp_path, "flat", "s/photos/sample.dng")
    assert (tmp_path / "plot.png").exists()
    assert (tmp_path / "s" / "photos" / "sample-pixels.png").exists()


def test_opening_a_folder_runs_nothing_of_it(typed, tmp_path):
    folder = plant(write_session(tmp_path / "s"))
    with open_page(folder) as (address, token):
        # the page begins to calibrate by itself
        wait_for(lambda: asked(address + "/api/state", None, token)[1]["live"]["ready"], 240)


@contextlib.contextmanager
def open_page(folder):
    """Address and token of ``spectrabox open .``, typed in a folder."""
    with subprocess.Popen([COMMAND, "open", ".", "--no-browser"], cwd=folder, text=True,
                          env=os.environ, stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL) as process:
        try:
            parts = urllib.parse.urlsplit(process.stdout.readline().strip())
            yield f"http://{parts.netloc}", urllib.parse.parse_qs(parts.query)["token"][0]
        finally:
            process.terminate()


# ---- TOML that is larger or nested deeper than people write

DEEP = {"a dotted key": ".".join("a" * 30_000) + " = 1",
        "a header": "[" + ".".join("a" * 30_000) + "]",
        "quoted parts": ".".join(["'a'", '"b"'] * 15_000) + " = 1",
        "parts with spaces": " . ".join("a" * 30_000) + " = 1",
        "a key in a table": "x = {" + ".".join("a" * 30_000) + " = 1}",
        "lists": "x = " + "[" * 30_000 + "]" * 30_000,
        "tables": "x = " + "{a = " * 15_000 + "1" + "}" * 15_000,
        "behind a string of five quotes": 'x = ["""a""""", ' + "[" * 30_000,
        "behind a string with a quote": "x = ['''a'''', " + "[" * 30_000,
        "behind brackets that close": "]" * 40_000 + "\nx = " + "[" * 30_000}
BIG = {"a comment": "# " + "x" * 1_100_000, "many keys": "a.b.c = 1\n" * 120_000}


@pytest.mark.parametrize("kind", [*DEEP, *BIG])
def test_toml_of_a_stranger_takes_no_memory_and_one_sentence(tmp_path, kind):
    text = {**DEEP, **BIG}[kind]
    (tmp_path / "session.toml").write_text(text)
    tracemalloc.start()
    config, problems = try_read_session(tmp_path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert config is None and len(problems) == 1 and "limit" in problems[0], problems
    assert peak < 30e6      # a list of all its brackets and parts; parsed it takes gigabytes
    with pytest.raises(InputError, match="limit") as refused:
        checked_tables.read_toml(tmp_path / "session.toml", "give another")
    assert str(refused.value) == problems[0]


def test_depth_is_judged_where_the_parser_would_go():
    """What looks deep and is text, or is as deep as is read, is parsed as before."""
    depth = checked_tables.MAX_TOML_DEPTH
    text = "\n".join([
        "# a.b" + ".c" * 100 + "[" * 100, "'" + "a." * 100 + "' = 1",
        'b = "' + "[" * 100 + '\\" # [[["  # ]', "c = '''\n" + "[a.b]\n" * 100 + "'''",
        'd = """' + '\\""' * 100 + "{" * 100 + '"""""', "e = [" + "1.5, 2.5, " * 1000 + "]",
        "f = " + "[" * depth + "]" * depth, ".".join("g" * depth) + " = 1",
        "h = 1979-05-27T07:32:00.999"])
    checked_tables.require_plain_toml(text, "x.toml")
    assert set(tomllib.loads(text)) == {"a." * 100, *"bcdefgh"}
    for more in ("f = [" + "[" * depth + "]" * depth + "]", ".".join("g" * (depth + 1)) + " = 1"):
        with pytest.raises(InputError, match=rf"x\.toml has {depth + 1}"):
            checked_tables.require_plain_toml(more, "x.toml")


def test_a_page_answers_at_once_while_its_session_is_nested_too_deep(calibrated_flat):
    file = calibrated_flat / "session.toml"
    with served(calibrated_flat) as (address, _):
        good = file.read_text(encoding="utf-8")
        file.write_text(good + "\n[views]\n" + DEEP["a dotted key"])
        tracemalloc.start()
        state = asked(address + "/api/state")[1]
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert len(state["problems"]) == 1 and "30000 parts in a key" in state["problems"][0]
        assert peak < 100e6     # of the page, which may open its photo meanwhile
        file.write_text(good)
        assert not asked(address + "/api/state")[1]["problems"]


# ---- pictures that are small as files

BOMB = 20_000, 16_000       # width and height: 16 GB as three bands that are worked with
READ = """
import resource, sys
from spectrabox.capture.photo import image_files, image_rows, linear
from spectrabox.capture.develop.developed import open_any
from spectrabox.radiometry.errors import InputError
path = sys.argv[1]
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for read in (linear.open_photo, image_files.read_linear_file, image_files.read_encoded_file,
             image_files.read_encoded_values, image_rows.open_rows,
             image_rows.open_encoded, image_rows.open_channels,
             lambda path: open_any(path, not_linear=True)):
    try:
        read(image_rows.Path(path))
        print("READ")
    except InputError as error:
        print(error)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def png_chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content \
        + struct.pack(">I", zlib.crc32(kind + content))


def write_png_bomb(path):
    """Black, of three bands of 8 bits."""
    width, height = BOMB
    packing, row = zlib.compressobj(9), bytes(1 + 3 * width)
    packed = b"".join([packing.compress(row * 16) for _ in range(height // 16)]) + packing.flush()
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", struct.pack(
        ">IIBBBBB", width, height, 8, 2, 0, 0, 0)) + png_chunk(b"IDAT", packed)
        + png_chunk(b"IEND", b""))


def write_tiff_bomb(path):
    """Black, of three bands of 16 bits, all its strips one and the same."""
    width, height = BOMB
    strip = zlib.compress(bytes(6 * width), 9)
    head, entries, beyond = 8, 10, b""
    after = head + 2 + 12 * entries + 4

    def placed(content):
        nonlocal beyond
        beyond += content
        return after + len(beyond) - len(content)
    offset = placed(strip)
    fields = [(256, 4, 1, width), (257, 4, 1, height),
              (258, 3, 3, placed(struct.pack("<3H", 16, 16, 16))), (259, 3, 1, 8), (262, 3, 1, 2),
              (273, 4, height, placed(struct.pack("<I", offset) * height)), (277, 3, 1, 3),
              (278, 4, 1, 1), (279, 4, height, placed(struct.pack("<I", len(strip)) * height)),
              (284, 3, 1, 1)]
    path.write_bytes(b"II*\0" + struct.pack("<IH", head, entries)
                     + b"".join(struct.pack("<HHII", *field) for field in fields)
                     + bytes(4) + beyond + bytes(1_800_000))    # or no library would believe it


BOMBS = {"png": write_png_bomb, "tif": write_tiff_bomb}


@pytest.fixture(scope="module", params=BOMBS)
def bomb(request, tmp_path_factory):
    """A photo of 2 MB or less that states 20,000 x 16,000 pixels, and holds them."""
    path = tmp_path_factory.mktemp("bomb") / f"photo.{request.param}"
    BOMBS[request.param](path)
    assert path.stat().st_size < 2_000_000
    return path


def test_a_picture_that_unpacks_to_gigabytes_is_refused_by_its_header(bomb):
    done = subprocess.run([sys.executable, "-c", READ, bomb], capture_output=True, text=True,
                          check=True)
    *sentences, grown_kb = done.stdout.splitlines()
    by_size = [each for each in sentences if "GB of memory to decode; 6 GB is the limit" in each]
    assert len(sentences) == 8 and len(by_size) >= 4
    assert all("set the variable SPECTRABOX_PHOTO_GB to" in each for each in by_size)
    # a TIFF may be opened, of which a few rows are read at a time
    assert sentences.count("READ") == (2 if bomb.suffix == ".tif" else 0)
    assert int(grown_kb) < 100_000


def test_a_command_says_so_of_a_photo(bomb, tmp_path):
    outcome = call("flat", bomb, "--session", tmp_path / "s", "--not-linear")
    assert outcome.exit_code == 3 and "states 20000 x 16000 pixels" in outcome.output


def test_the_limit_of_decoding_is_that_of_the_environment(tmp_path, monkeypatch):
    write_dng(tmp_path / "a.dng", np.full((200, 300), 3000, np.uint16))
    linear.open_photo(tmp_path / "a.dng")
    monkeypatch.setenv("SPECTRABOX_PHOTO_GB", "0.0001")
    with pytest.raises(InputError, match=r"states 300 x 200 pixels.*; 0\.0001 GB is the limit"):
        linear.open_photo(tmp_path / "a.dng")
    monkeypatch.setenv("SPECTRABOX_PHOTO_GB", "much")
    with pytest.raises(InputError, match="a number of gigabytes is needed"):
        linear.open_photo(tmp_path / "a.dng")


# ---- a report that came with the folder

TRYING = """<!doctype html><title>A report</title><style>h1 { color: rgb(1, 2, 3) }</style>
<h1>begun</h1><script>
const token = "%s", seen = [];
const tries = {
  "address": () => location.href, "referrer": () => document.referrer,
  "parent": () => parent.document.documentElement.outerHTML, "top": () => top.location.href,
  "stored": () => sessionStorage.getItem("token"), "parent's": () => parent.sessionStorage.token,
  "cookie": () => document.cookie, "name": () => window.name,
  "moved": () => { top.location = "/?stolen"; }, "opened": () => open("/page").document.title };
for (const [name, attempt] of Object.entries(tries))
  try { const got = attempt(); if (String(got).includes(token)) seen.push(name); } catch { }
addEventListener("message", ({ data }) => { if (String(data).includes(token)) seen.push("told"); });
Promise.allSettled([fetch("/api/state"), fetch(`/api/state?token=${token}`),
                    fetch("/api/run", { method: "POST", body: "{}" })]).then((answers) => {
  document.querySelector("h1").textContent = "tried";
  document.body.dataset.seen = JSON.stringify(
    [...seen, ...answers.filter(({ status }) => status === "fulfilled")]);
  document.body.dataset.origin = origin;
});
</script>"""


def test_a_strangers_report_learns_no_token_and_asks_nothing(browser, calibrated_flat):
    (calibrated_flat / "report.html").write_text(TRYING % TOKEN)
    with served(calibrated_flat) as (address, page_of_it), browser.new_context() as context:
        page, wanted = context.new_page(), []
        page.on("request", lambda request: wanted.append(request.url))
        page.goto(f"{address}/?token={TOKEN}")
        frame = page.frame_locator("#report-frame")
        frame.locator("h1:has-text('tried')").wait_for(state="attached", timeout=60_000)
        body = frame.locator("body")
        assert body.get_attribute("data-seen") == "[]"
        assert body.get_attribute("data-origin") == "null"
        # its own script and style work
        assert frame.locator("h1").evaluate("one => getComputedStyle(one).color") == "rgb(1, 2, 3)"
        assert [url for url in wanted if TOKEN in url] == [f"{address}/?token={TOKEN}"]
        assert page.url == f"{address}/page" and len(context.pages) == 1
        assert not page_of_it.run.running or page_of_it.run.until       # its own calibration alone


def test_a_report_is_not_served_to_an_address_with_the_token(calibrated_flat):
    (calibrated_flat / "report.html").write_text("<h1>report</h1>")
    with served(calibrated_flat) as (address, _):
        assert asked(f"{address}/report?token={TOKEN}", token=None)[0] == 403
        assert asked(f"{address}/api/state?token={TOKEN}", token=None)[0] == 403
        assert asked(f"{address}/report")[1] == b"<h1>report</h1>"


# ---- any program of this machine can connect to a page

@pytest.fixture
def sockets():
    """A function that connects to a page and sends something; all are closed at the end."""
    with contextlib.ExitStack() as open_ones:
        def connect(address, sent=b""):
            parts = urllib.parse.urlsplit(address)
            connected = open_ones.enter_context(
                socket.create_connection((parts.hostname, parts.port), timeout=20))
            connected.sendall(sent)
            return connected
        yield connect


def ended(connected):
    """What comes until the other side closes the connection."""
    content = b""
    with contextlib.suppress(ConnectionResetError):
        while part := connected.recv(65536):
            content += part
    return content


def head_of(address, path, more=""):
    return (f"POST {path} HTTP/1.1\r\nHost: {urllib.parse.urlsplit(address).netloc}\r\n"
            f"Authorization: Bearer {TOKEN}\r\n{more}").encode()


def test_a_connection_that_sends_no_whole_request_is_closed(calibrated_flat, sockets, monkeypatch):
    monkeypatch.setattr(server, "HEAD_S", 0.5)
    with served(calibrated_flat) as (address, _):
        silent, half = sockets(address), sockets(address, b"GET /page HTTP/1.1\r\nHo")
        dribbling = sockets(address)
        # a refusal, after which more of a body that nobody waits for dribbles in
        refused = sockets(address, b"POST /api/run HTTP/1.1\r\nHost: localhost\r\n"
                                   b"Content-Length: 100000\r\n\r\n")
        end = time.monotonic() + 20
        with contextlib.suppress(ConnectionError):
            while True:
                for each in (dribbling, refused):
                    each.sendall(b"x")
                time.sleep(0.05)
                assert time.monotonic() < end
        assert ended(silent) == b"" and ended(half) == b""
        assert b"403" in ended(refused).split(b"\r\n")[0]
        ended(dribbling)
        assert asked(address + "/api/state")[0] == 200


def test_a_body_that_stops_coming_is_given_up_and_leaves_no_file(calibrated_flat, sockets,
                                                                 monkeypatch):
    monkeypatch.setattr(access, "PART_S", 0.5)
    before = {*calibrated_flat.rglob("*")}
    with served(calibrated_flat) as (address, _):
        for path in ("/api/mark", "/api/file?name=a.tif"):
            stalled = sockets(address, head_of(address, path, "Content-Length: 99\r\n\r\n") + b"[")
            assert b"400" in ended(stalled).split(b"\r\n")[0]
        time.sleep(1.0)
        # an answer that takes longer is none that stopped
        assert asked(address + "/api/state")[0] == 200
    assert not [path for path in {*calibrated_flat.rglob("*")} - before if "a.tif" in path.name
                or path.name.startswith(".spectrabox-")]


def test_a_page_answers_however_many_connections_stand_open(calibrated_flat, sockets, monkeypatch):
    monkeypatch.setattr(server, "MAX_CONNECTIONS", 10)
    with served(calibrated_flat) as (address, _):
        waiting = [sockets(address, b"GET /") for _ in range(30)]
        for _ in range(5):
            assert asked(address + "/api/state")[0] == 200
        for each in waiting[:15]:       # those that had waited longest
            assert ended(each) == b""


def test_all_that_a_page_is_given_has_a_limit(calibrated_flat, monkeypatch):
    monkeypatch.setattr(answers, "MAX_RECEIVED", 2500)

    def give(address, name, size):
        request = urllib.request.Request(f"{address}/api/file?name={name}", bytes(size),
                                         {"Authorization": f"Bearer {TOKEN}"})
        try:
            with urllib.request.urlopen(request, timeout=30) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            assert "was given" in json.loads(error.read())["error"]
            return error.code
    with served(calibrated_flat) as (address, _):
        # what is refused counts for nothing
        assert [give(address, f"{number}.tif", size) for number, size in enumerate(
            (1000, 2000, 1000, 600, 500, 1))] == [200, 409, 200, 409, 200, 409]
    names = sorted(path.name for path in (calibrated_flat / "photos").glob("?.tif"))
    assert names == ["0.tif", "2.tif", "4.tif"]
