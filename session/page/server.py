"""The page's server, on this machine alone: what it answers, address by address, and connections
that cannot be held open for nothing.

Any program of this machine can connect, with no token yet. uvicorn waits for the rest of a request
as long as it takes, so that connections which say nothing would use up those that it can have.
"""
from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
import threading
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from uvicorn.protocols.http.h11_impl import H11Protocol

from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.session.page import access, answers, photo_views, session_page, start_page
from spectrabox.session.page.written_session import MAX_PX

HERE = Path(__file__).parent / "static"
RECTANGLE = ("x0", "y0", "x1", "y1")
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


# ---- what is answered, address by address -------------------------------------------------------

def start_routes(page: start_page.StartPage, when_opened: Callable[[], None]) -> list[BaseRoute]:
    """What the page answers from which sessions are opened and made."""
    return [*_shell("start.html", when_opened),
            _get("/api/sessions", lambda asked: page.sessions()),
            _taking("/api/photo", answers.receiving(page.received)),
            _post("/api/new", lambda asked: page.make(asked["names"])),
            _post("/api/open", lambda asked: page.open(asked["name"]))]


def session_routes(page: session_page.SessionPage,
                   when_opened: Callable[[], None] = lambda: None) -> list[BaseRoute]:
    """What the page of one session answers."""
    return [*_shell("index.html", when_opened), *_state_and_run(page), *_report(page),
            *_photos(page), *_spectra(page), *_marks(page), *_meter(page)]


def _shell(html: str, when_opened: Callable[[], None]) -> list[BaseRoute]:
    """The page itself: its address with the token, and the one without that it goes on to."""
    async def shell(request: Request) -> Response:
        return FileResponse(HERE / html)

    async def index(request: Request) -> Response:
        when_opened()
        return await shell(request)

    return [Route("/", index), Route("/page", shell)]


def _state_and_run(page: session_page.SessionPage) -> list[BaseRoute]:
    return [_get("/api/state", lambda asked: page.state()),
            _post("/api/run", _then_state(page, lambda asked: page.run.start())),
            _post("/api/stop", _then_state(page, lambda asked: page.run.stop()))]


def _report(page: session_page.SessionPage) -> list[BaseRoute]:
    """The report, and files of spectra: of the report, or of what is marked now."""
    async def report(request: Request) -> Response:
        path = page.report.path
        if path.is_symlink() or not path.is_file():
            return answers.refused("there is no report yet", 404)
        return FileResponse(path)

    async def export(request: Request) -> Response:
        name = request.query_params.get("file", "")
        if name in session_page.MARKED:
            try:
                text = await run_in_threadpool(page.live.export, Path(name).suffix)
            except SpectraboxError as error:
                return answers.refused(str(error), 409)
            return Response(text, headers={"content-disposition": f'attachment; filename="{name}"'},
                            media_type="text/plain; charset=utf-8")
        path = page.report.exports().get(name)
        if path is None:
            return answers.refused("there is no such file", 404)
        return FileResponse(path, filename=path.name)

    return [Route("/report", report), Route("/api/export", export)]


def _photos(page: session_page.SessionPage) -> list[BaseRoute]:
    """Photos for the eye, tile by tile, and signals under the pointer."""
    views = page.photos

    def of_photo(path: str, work: Callable[[photo_views.PhotoFile, Any], Any]) -> BaseRoute:
        return _get(path, lambda asked: work(page.photo_file(asked["role"]), asked))

    return [
        of_photo("/api/size", lambda file, asked: views.described(file)),
        of_photo("/api/tile", lambda file, asked: views.tile(
            file, int(asked["halvings"]), int(asked["column"]), int(asked["row"]),
            asked.get("look", photo_views.RAW))),
        of_photo("/api/unclipped", lambda file, asked: {
            "rect": views.unclipped(file, _pixels(asked, RECTANGLE))}),
        of_photo("/api/value", lambda file, asked: views.value(file, *_pixels(asked, ("x", "y")))),
        _taking("/api/file", answers.receiving(page.received))]


def _spectra(page: session_page.SessionPage) -> list[BaseRoute]:
    """Spectra of what is pointed at and of regions."""
    def picked(one: Mapping[str, Any]) -> Mapping[str, Any]:
        if "name" in one:
            return one
        return {"role": one["role"], "rect": _pixels(one, RECTANGLE)}

    return [
        _get("/api/spectrum", lambda asked: page.live.point(asked["role"],
                                                            _pixels(asked, RECTANGLE))),
        _get("/api/region", lambda asked: page.live.region(asked["name"])),
        _get("/api/advice", lambda asked: page.live.advice()),
        _post("/api/compare", lambda asked: page.live.compare(
            [picked(one) for one in asked["picked"]]))]


def _marks(page: session_page.SessionPage) -> list[BaseRoute]:
    return [_post("/api/mark", _then_state(
                page, lambda asked: page.marks.apply(asked["mark"], asked["digest"]))),
            _post("/api/undo", _then_state(
                page, lambda asked: page.marks.undo(asked["digest"])))]


def _meter(page: session_page.SessionPage) -> list[BaseRoute]:
    """An instrument that measures a marked colour."""
    return [_get("/api/meter", lambda asked: page.meter.state()),
            _post("/api/meter/step", lambda asked: page.meter.step(
                str(asked["port"]), str(asked["what"]), str(asked["name"])))]


def _get(path: str, work: Callable[[Any], Any]) -> BaseRoute:
    return Route(path, answers.answered(work))


def _post(path: str, work: Callable[[Any], Any]) -> BaseRoute:
    return _taking(path, answers.answered(work))


def _taking(path: str, answer: answers.Answer) -> BaseRoute:
    return Route(path, answer, methods=["POST"])


def _then_state(page: session_page.SessionPage,
                work: Callable[[Any], None]) -> Callable[[Any], Any]:
    """Work that changes the session; it is answered with what the page shows then."""
    def answer(asked: Any) -> Any:
        work(asked)
        return page.state()
    return answer


def _pixels(asked: Mapping[str, Any], names: tuple[str, ...]) -> list[float]:
    """Numbers of pixels of a request."""
    values = [float(asked[name]) for name in names]
    for name, value in zip(names, values, strict=True):
        if not abs(value) <= MAX_PX:
            raise ValueError(f"{name} is {value:g}; {-MAX_PX:g} to {MAX_PX:g} is possible")
    return values
