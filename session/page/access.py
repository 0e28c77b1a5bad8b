"""Who may speak to the page: this machine alone, with the token of its address; and how a browser
learns it.
"""
from __future__ import annotations

import asyncio
import hmac
import re
import shutil
import tempfile
from collections.abc import Awaitable, Callable, MutableMapping
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from starlette.requests import Request
from starlette.responses import JSONResponse

from spectrabox.radiometry.files import write_text_whole

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
PART_S = 20.0           # for the next part of a body
LOOPBACK = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d{1,5})?")
# code that anybody may read; it says nothing of a session
REPORT_PATHS = re.compile(r"(/s/\d+)?/report|/static/report\.html")
# what a browser asks for without headers: the page when it is opened, and a file to be saved
QUERY_PATHS = re.compile(r"/|(/s/\d+)?/api/export")
OPEN_PATHS = re.compile(r"/static/.*|(/s/\d+)?/page")
# an empty <style> is let in: OpenSeadragon writes none of its own where the page has one
EMPTY_STYLE = "'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU='"
CONTENT_POLICY = (f"default-src 'none'; script-src 'self'; style-src 'self' {EMPTY_STYLE}; "
                  "img-src 'self' blob:; "
                  "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; "
                  "frame-ancestors 'self'")
# The report is one file with its own script and style; a stranger may have written it. Fetched with
# the token in a header, it is handed to a document that is served with this policy: a blob would
# have that of the page, under which no script of a report runs.
REPORT_POLICY = ("default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
                 "img-src data:; font-src data:; base-uri 'none'; form-action 'none'; "
                 "frame-ancestors 'self'; sandbox allow-scripts")


class Access:
    """Middleware that refuses what does not come from the page itself.

    Parameters
    ----------
    app : ASGI application
    token : str
        That every request but for static files must carry, as ``Authorization: Bearer`` or, of
        what a browser asks for without headers, as ``?token=``.
    """

    def __init__(self, app: Any, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or refuse it."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        async def with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                policy = REPORT_POLICY if REPORT_PATHS.fullmatch(scope["path"]) \
                    else CONTENT_POLICY
                message["headers"] = [*message["headers"],
                                      (b"content-security-policy", policy.encode()),
                                      (b"x-content-type-options", b"nosniff"),
                                      (b"referrer-policy", b"no-referrer"),
                                      (b"cache-control", b"no-store")]
            await send(message)

        refusal = self._refusal(Request(scope))
        answer = self._app if refusal is None else JSONResponse({"error": refusal[0]}, refusal[1])
        await answer(scope, _in_time(receive), with_headers)

    def _refusal(self, request: Request) -> tuple[str, int] | None:
        """Sentence and status; None where the request may be answered."""
        host = request.headers.get("host", "")
        if LOOPBACK.fullmatch(host) is None:
            return f"this page is for this machine alone, not for {host[:100]!r}", 403
        origin = request.headers.get("origin")
        try:
            of_itself = origin is None or urlsplit(origin).netloc == host
        except ValueError:
            return f"{origin!r:.100} is no origin", 400
        if not of_itself:
            return "another page may not speak to this one", 403
        if OPEN_PATHS.fullmatch(request.scope["path"]):
            return None
        scheme, _, given = request.headers.get("authorization", "").partition(" ")
        if scheme != "Bearer":
            # a form of another page can ask for an address, but knows no token
            given = request.query_params.get("token", "") if request.method == "GET" \
                and QUERY_PATHS.fullmatch(request.scope["path"]) else ""
        if not hmac.compare_digest(given.encode(), self._token.encode()):
            return ("the token is missing or wrong: open the address that 'spectrabox open' "
                    "printed"), 403
        return None


def _in_time(receive: Receive) -> Receive:
    """A request whose body may pause, but not for long: it then counts as broken off."""
    awaited = True

    async def part() -> MutableMapping[str, Any]:
        nonlocal awaited
        if not awaited:         # what comes after the body is the end of the connection
            return await receive()
        try:
            async with asyncio.timeout(PART_S):
                message = await receive()
        except TimeoutError:
            message = {"type": "http.disconnect"}
        awaited = message.get("more_body", False)
        return message

    return part


class RedirectFile:
    """A page on disk that leads a browser to an address, so that the address stands on no command
    line; for its user alone.

    Parameters
    ----------
    address : str
    """

    def __init__(self, address: str) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="spectrabox-"))
        self.path = self._folder / "open.html"
        write_text_whole(
            self.path, '<!doctype html><meta charset="utf-8"><title>spectrabox</title>'
            f'<meta http-equiv="refresh" content="0;url={escape(address)}">')
        self.path.chmod(0o600)      # as its folder, which nobody else can enter

    def discard(self) -> None:
        """Delete it, once the browser has followed it."""
        shutil.rmtree(self._folder, ignore_errors=True)
