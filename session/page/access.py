"""Who may speak to the page: this machine alone, with the token of its address."""
from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import urlsplit

from starlette.requests import Request
from starlette.responses import JSONResponse

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
OPEN_PATHS = ("/static/",)      # code that anybody may read; it says nothing of a session
CONTENT_POLICY = ("default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
                  "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; "
                  "frame-ancestors 'self'")
# the report is one file with its own script and style, and nothing else
REPORT_POLICY = ("default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
                 "img-src data:; font-src data:; base-uri 'none'; form-action 'none'; "
                 "frame-ancestors 'self'; sandbox allow-scripts")


class Access:
    """Middleware that refuses what does not come from the page itself.

    Parameters
    ----------
    app : ASGI application
    token : str
        That every request but for static files must carry, as ``Authorization: Bearer`` or, where
        a browser sends no headers, as ``?token=``.
    """

    def __init__(self, app: Any, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or refuse it."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        request = Request(scope)
        if (refusal := self._refusal(request)) is not None:
            answer = JSONResponse({"error": refusal}, status_code=403)
            await answer(scope, receive, send)
            return

        async def with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                policy = REPORT_POLICY if request.url.path == "/report" else CONTENT_POLICY
                message["headers"] = [*message["headers"],
                                      (b"content-security-policy", policy.encode()),
                                      (b"x-content-type-options", b"nosniff"),
                                      (b"referrer-policy", b"no-referrer"),
                                      (b"cache-control", b"no-store")]
            await send(message)

        await self._app(scope, receive, with_headers)

    def _refusal(self, request: Request) -> str | None:
        host = request.headers.get("host", "")
        if host.rsplit(":", 1)[0] not in LOOPBACK:
            return f"this page is for this machine alone, not for {host[:100]!r}"
        origin = request.headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return "another page may not speak to this one"
        if request.url.path.startswith(OPEN_PATHS):
            return None
        scheme, _, given = request.headers.get("authorization", "").partition(" ")
        if scheme != "Bearer":
            # a form of another page can ask for an address, but knows no token
            given = request.query_params.get("token", "") if request.method == "GET" else ""
        if not hmac.compare_digest(given.encode(), self._token.encode()):
            return "the token is missing or wrong: open the address that 'spectrabox open' printed"
        return None
