"""A session's page on a free port of this machine, as ``spectrabox open`` serves it."""
import contextlib
import json
import socket
import threading
import time
import urllib.error
import urllib.request

import uvicorn

from spectrabox.session.page.server import page_app, page_config
from spectrabox.session.page.session_page import SessionPage

TOKEN = "a-token-of-the-tests"
MAX_WAIT_MS = 600_000        # a test waits for a state, and the machine may be busy
# what a browser says of a request that met the end of the server
ENDED = ("ERR_CONNECTION_REFUSED", "ERR_CONNECTION_RESET", "ERR_EMPTY_RESPONSE",
         "ERR_INCOMPLETE_CHUNKED_ENCODING", "ERR_CONTENT_LENGTH_MISMATCH")


@contextlib.contextmanager
def served(folder, watched=None, meter_ports=()):
    """Address of the page, and the page."""
    page = SessionPage(folder, watched, meter_ports=meter_ports)
    with served_by(page) as address:
        yield address, page


@contextlib.contextmanager
def served_by(page):
    """Address of a page."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        server = uvicorn.Server(page_config(page_app(page, TOKEN)))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        wait_for(lambda: server.started)
        try:
            yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join(30)


def wait_for(what, seconds=60.0):
    """What a function answers once that is true."""
    end = time.monotonic() + seconds
    while True:
        if found := what():
            return found
        assert time.monotonic() < end, f"{what} did not come true in {seconds} s"
        time.sleep(0.05)


def asked(address, body=None, token=TOKEN, **headers):
    """Status and answer (JSON, or bytes) of a request."""
    request = urllib.request.Request(address, headers={
        **({"Authorization": f"Bearer {token}"} if token else {}),
        **{name.title(): value for name, value in headers.items()}},
        data=None if body is None else json.dumps(body).encode())
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            status, said, kind = answer.status, answer.read(), answer.headers["content-type"]
    except urllib.error.HTTPError as error:
        status, said, kind = error.code, error.read(), error.headers["content-type"]
    return status, json.loads(said) if kind and "json" in kind else said


# ---- in a browser

@contextlib.contextmanager
def opened_in(browser, photo=True, **options):
    """A function that opens an address in a context of its own; at the end nothing may have
    complained, and nothing may have been asked of another server.
    """
    context = browser.new_context(**{"viewport": {"width": 1400, "height": 1000}} | options)
    context.set_default_timeout(MAX_WAIT_MS)
    page, said, wanted, cut = context.new_page(), [], [], []
    page.on("console", lambda line: said.append(line.text)
            if line.type in ("error", "warning") and "409" not in line.text
            and not any(word in line.text for word in ENDED) else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: wanted.append(request.url))
    page.on("requestfailed", lambda request: cut.append(request.url)
            if any(word in (request.failure or "") for word in ENDED) else None)

    def open_address(address):
        page.goto(f"{address}/?token={TOKEN}")
        if photo:
            page.wait_for_selector("body[data-photo]")
        return page
    yield open_address
    own = page.url.removesuffix("/page")
    context.close()
    # of a tile that met the end of the server, or another picture, the viewer complains too
    lost = tuple(url.removeprefix(own) for url in cut)
    said = [line for line in said if not line.startswith("Ignoring tile ")
            and not (line.startswith("Tile ") and any(tile in line for tile in lost))]
    assert said == [], said
    assert not [url for url in wanted if not url.startswith((own, "blob:", "data:"))]


def on_screen(page, x, y):
    """Where a pixel of the photo is shown."""
    box = page.locator("#canvas").bounding_box()
    left, top, scale = map(float, page.get_attribute("#canvas", "data-view").split())
    return box["x"] + left + (x + 0.5) * scale, box["y"] + top + (y + 0.5) * scale


def drag(page, x0, y0, x1, y1, by="left"):
    """Drag the mouse from one pixel of the photo to another, in steps."""
    (u0, v0), (u1, v1) = on_screen(page, x0, y0), on_screen(page, x1, y1)
    page.mouse.move(u0, v0)
    page.mouse.down(button=by)
    for step in (0.3, 0.7, 1.0):
        page.mouse.move(u0 + step * (u1 - u0), v0 + step * (v1 - v0))
    page.mouse.up(button=by)


def wait_ready(page):
    """Spectra can be shown from now on."""
    page.wait_for_selector("body[data-ready=true]")
