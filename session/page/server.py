"""The page's server, on this machine alone, and connections that cannot be held open for nothing.

Any program of this machine can connect, with no token yet. uvicorn waits for the rest of a request
as long as it takes, so that connections which say nothing would use up those that it can have.
"""
from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
import threading
from collections.abc import AsyncIterator, Callable
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.routing import Mount
from starlette.staticfiles import StaticFiles
from uvicorn.protocols.http.h11_impl import H11Protocol

from spectrabox.radiometry.errors import InputError
from spectrabox.session.page import access, session_page, start_page
from spectrabox.session.page.routes import HERE, session_routes, start_routes

HOST = "127.0.0.1"
PIECES = HERE.parent.parent / "pieces"      # parts that the report has too
HEAD_S = 10.0           # for the head of a request, from its first byte or that of the connection
MAX_CONNECTIONS = 100   # a browser has six
GRACE_S = 1             # for answers under way when the page ends


def page_app(page: session_page.SessionPage | start_page.StartPage, token: str,
             when_opened: Callable[[], None] = lambda: None) -> access.Access:
    """A page as an ASGI application.

    Parameters
    ----------
    page : SessionPage or StartPage
    token : str
        That every request must carry.
    when_opened : callable
        Called when a browser opens the address with the token.
    """
    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        await run_in_threadpool(page.start)
        yield
        await run_in_threadpool(page.close)

    application = Starlette(routes=[Mount("/static/pieces", StaticFiles(directory=PIECES)),
                                    Mount("/static", StaticFiles(directory=HERE))],
                            lifespan=lifespan)
    routes = application.router.routes
    application.router.redirect_slashes = False
    if isinstance(page, session_page.SessionPage):
        routes += session_routes(page, when_opened)
    else:
        routes += start_routes(page, when_opened)
        page.mount = lambda path, opened: routes.insert(0, Mount(path,
                                                                 routes=session_routes(opened)))
    # around all of it, so that answers to its own errors have the same headers
    return access.Access(application, token)


def serve(page: session_page.SessionPage | start_page.StartPage, port: int,
          say: Callable[[str], None], browse: Callable[[str], object] | None = None) -> None:
    """Serve the page until it is interrupted.

    Parameters
    ----------
    port : int
        0 takes a free one.
    say : callable
        Given the page's address once it can be opened.
    browse : callable, optional
        Given the address of a file that leads to the page.

    Raises
    ------
    InputError
        If the port is taken.
    """
    class Server(uvicorn.Server):
        async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
            page.stop()         # a run ends while answers under way do
            await super().shutdown(sockets)

    token = secrets.token_urlsafe(24)
    with contextlib.ExitStack() as at_end:
        listening = at_end.enter_context(socket.socket(socket.AF_INET, socket.SOCK_STREAM))
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((HOST, port))
        except OSError as error:
            raise InputError(f"port {port} cannot be used ({error.strerror}); give another with "
                             "--port, or none to take a free one") from None
        listening.listen()
        at_end.callback(page.close)     # also where no server closes it: SIGHUP
        address = f"http://{HOST}:{listening.getsockname()[1]}/?token={token}"
        say(address)
        app = page_app(page, token)
        if browse is not None:
            redirect = access.RedirectFile(address)
            at_end.callback(redirect.discard)
            app = page_app(page, token, redirect.discard)
            # some browsers return when they are closed
            threading.Thread(target=browse, args=(redirect.path.as_uri(),), daemon=True).start()
        Server(page_config(app)).run(sockets=[listening])


def page_config(app: Any) -> uvicorn.Config:
    """How uvicorn serves the page.

    Parameters
    ----------
    app : ASGI application
    """
    return uvicorn.Config(app, http=TimedConnection, ws="none", log_level="critical",
                          access_log=False, timeout_graceful_shutdown=GRACE_S)


class TimedConnection(H11Protocol):
    """A connection that is closed where no request comes, or not its whole head, within a time.

    Of more than a hundred the one that has waited longest for a request gives way.
    """

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a request."""
        super().connection_made(transport)
        self._watch()
        waiting = [each for each in self.connections
                   if isinstance(each, TimedConnection) and each._late is not None]
        if len(self.connections) > MAX_CONNECTIONS and waiting:
            min(waiting, key=TimedConnection._closing_at).transport.abort()

    def data_received(self, data: bytes) -> None:
        """Take what came, and wait on where it was no whole head."""
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        self._stop_waiting()
        super().connection_lost(exc)

    def _watch(self) -> None:
        """The time runs from the first byte; what dribbles in does not begin it anew."""
        if self.cycle is not None and not self.cycle.response_complete:
            self._stop_waiting()
        elif self._late is None:
            self._late = self.loop.call_later(HEAD_S, self.transport.close)

    def _stop_waiting(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None

    def _closing_at(self) -> float:
        return float("inf") if self._late is None else self._late.when()
