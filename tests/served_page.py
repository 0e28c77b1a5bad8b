"""A session's page on a free port of this machine, as ``spectrabox open`` serves it."""
import contextlib
import json
import socket
import threading
import time
import urllib.error
import urllib.request

import uvicorn

from spectrabox.session.page.server import page_app
from spectrabox.session.page.session_page import SessionPage

TOKEN = "a-token-of-the-tests"


@contextlib.contextmanager
def served(folder, watched=None):
    """Address of the page, and the page."""
    page = SessionPage(folder, watched)
    with served_by(page) as address:
        yield address, page


@contextlib.contextmanager
def served_by(page):
    """Address of a page."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        server = uvicorn.Server(uvicorn.Config(page_app(page, TOKEN), log_level="error",
                                               access_log=False))
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
