"""The page's server: what it answers, on this machine alone."""
from __future__ import annotations

import contextlib
import secrets
import socket
import threading
import tomllib
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_file import session_of_text
from spectrabox.session.page.access import Access
from spectrabox.session.page.marks import MarkedSession, corner_names, photos_of
from spectrabox.session.page.photo_views import PhotoViews
from spectrabox.session.page.run_control import RunControl
from spectrabox.session.page.shooting import Shooting
from spectrabox.session.pipeline import stage_states

HERE = Path(__file__).parent / "static"
HOST = "127.0.0.1"
REPORT = "report.html"
PNG = b"\x89PNG"
MAX_BODY = 200_000      # bytes of a mark: a polygon of ten thousand corners


class SessionPage:
    """What the page of one session can do.

    Parameters
    ----------
    folder : Path
        With a session.toml.
    watched : Path, optional
        Folder of new photos.
    allow_outside : bool
        Whether the session may name files elsewhere.
    """

    def __init__(self, folder: Path, watched: Path | None = None,
                 allow_outside: bool = False) -> None:
        self.folder = folder.resolve()
        self.marks = MarkedSession(self.folder, allow_outside)
        self.marks.read()
        self.photos = PhotoViews()
        self.run = RunControl(self.folder, ("--allow-outside",) if allow_outside else ())
        self.shooting = None if watched is None else Shooting(watched.resolve(), self._chart())
        self._allow_outside = allow_outside
        self._states: tuple[Any, list[dict[str, Any]]] = (None, [])
        self._states_lock = threading.Lock()

    def close(self) -> None:
        """Watch no longer, and stop a run that goes on."""
        if self.shooting is not None:
            self.shooting.end()
        self.run.end()

    def state(self) -> dict[str, Any]:
        """All that the page shows but for pixels."""
        text, digest = self.marks.read()
        problems = session_of_text(text, self.folder, self._allow_outside)[1]
        try:
            written = tomllib.loads(text)
        except ValueError:
            written = {}
        photos = [{"role": role, "file": name, "there": self._inside(name).is_file()}
                  for role, name in photos_of(written).items()
                  if self._is_inside(name)]
        return {"name": _name(written, self.folder), "digest": digest, "problems": problems,
                "photos": photos, "undo": self.marks.can_undo,
                "marks": {"regions": _regions(written),
                          "chart_corners": _at(written, "chart", "corners_px"),
                          "box_corners": _at(written, "scene", "box", "camera", "corners_px"),
                          "references": {"chart": _at(written, "drift", "chart_px"),
                                         "object": _at(written, "drift", "object_px")}},
                "corner_names": corner_names(written),
                "stages": self._stages(text, bool(problems)), "run": self.run.state(),
                "report": self._report_stamp(),
                "shooting": None if self.shooting is None else self.shooting.state()}

    def photo_path(self, role: str) -> Path:
        """File of a photo by what it is, or of a new shot of the watched folder.

        Raises
        ------
        InputError
            If there is none, or it lies outside the session and the watched folder.
        """
        kind, _, name = role.partition(":")
        if kind == "shot" and self.shooting is not None:
            return self.shooting.path(name)
        named = photos_of(tomllib.loads(self.marks.read()[0]))
        if role not in named or not self._is_inside(named[role]):
            raise InputError(f"the session has no photo {role!r}; it has {', '.join(named)}")
        return self._inside(named[role])

    def _inside(self, name: str) -> Path:
        return (self.folder / name).resolve()

    def _is_inside(self, name: str) -> bool:
        return self._allow_outside or self._inside(name).is_relative_to(self.folder)

    def _chart(self) -> Chart:
        config, _ = session_of_text(self.marks.read()[0], self.folder)
        try:
            return CLASSIC if config is None else session_chart(config)
        except SpectraboxError:
            return CLASSIC

    def _report_stamp(self) -> int | None:
        """When the report was written, by which the page notices a new one."""
        try:
            return (self.folder / REPORT).stat().st_mtime_ns // 1_000_000
        except OSError:
            return None

    def _stages(self, text: str, faulty: bool) -> list[dict[str, Any]]:
        """States of the stages, looked at again where something may have changed."""
        now = (text, self._report_stamp(), self.run.running,
               tuple(self.run.state()["lines"][-1:]))
        with self._states_lock:
            if self._states[0] != now:
                states: list[dict[str, Any]] = []
                config = None if faulty else session_of_text(text, self.folder,
                                                             self._allow_outside)[0]
                if config is not None:
                    with contextlib.suppress(SpectraboxError):
                        states = [{"name": one.name, "state": one.state,
                                   "reasons": list(one.reasons)} for one in stage_states(config)]
                self._states = (now, states)
            return self._states[1]


def page_app(page: SessionPage, token: str) -> Starlette:
    """The page as an ASGI application.

    Parameters
    ----------
    page : SessionPage
    token : str
        That every request must carry.
    """
    async def index(request: Request) -> Response:
        return FileResponse(HERE / "index.html")

    async def report(request: Request) -> Response:
        path = page.folder / REPORT
        if path.is_symlink() or not path.is_file():
            return JSONResponse({"error": "there is no report yet"}, status_code=404)
        return FileResponse(path)

    def answered(work: Callable[[Any], Any]) -> Callable[[Request], Any]:
        """A route whose work runs beside the others; what it refuses is a sentence."""
        async def answer(request: Request) -> Response:
            asked: Any = dict(request.query_params) | dict(request.path_params)
            if request.method == "POST":
                body = await request.body()
                if len(body) > MAX_BODY:
                    return JSONResponse({"error": "too long"}, status_code=413)
                try:
                    asked = await request.json()
                except ValueError:
                    return JSONResponse({"error": "JSON is needed"}, status_code=400)
            try:
                result = await run_in_threadpool(work, asked)
            except SpectraboxError as error:
                return JSONResponse({"error": str(error)}, status_code=409)
            except (KeyError, TypeError, ValueError) as error:
                return JSONResponse({"error": f"not understood: {error}"}, status_code=400)
            if isinstance(result, bytes):
                return Response(result, media_type="image/png" if result.startswith(PNG)
                                else "image/jpeg")
            return JSONResponse(result)
        return answer

    def changed(work: Callable[[Any], None]) -> Callable[[Any], Any]:
        def answer(asked: Any) -> Any:
            work(asked)
            return page.state()
        return answer

    def of_photo(work: Callable[[Path, Any], Any]) -> Callable[[Any], Any]:
        return lambda asked: work(page.photo_path(asked["role"]), asked)

    routes = [
        Route("/", index), Route("/report", report),
        Route("/api/state", answered(lambda asked: page.state())),
        Route("/api/photo", answered(of_photo(lambda path, asked: page.photos.whole(path)))),
        Route("/api/size", answered(of_photo(
            lambda path, asked: {"size": page.photos.photo(path).size,
                                 "bands": page.photos.photo(path).signal.shape[2]}))),
        Route("/api/part", answered(of_photo(lambda path, asked: page.photos.part(
            path, *(float(asked[name]) for name in ("left", "top", "side")))))),
        Route("/api/value", answered(of_photo(lambda path, asked: page.photos.value(
            path, float(asked["x"]), float(asked["y"]))))),
        Route("/api/mark", answered(changed(
            lambda asked: page.marks.apply(asked["mark"], asked["digest"]))), methods=["POST"]),
        Route("/api/undo", answered(changed(
            lambda asked: page.marks.undo(asked["digest"]))), methods=["POST"]),
        Route("/api/run", answered(changed(lambda asked: page.run.start())), methods=["POST"]),
        Route("/api/stop", answered(changed(lambda asked: page.run.stop())), methods=["POST"]),
        Mount("/static", StaticFiles(directory=HERE)),
    ]

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        if page.shooting is not None:
            page.shooting.start()
        yield
        await run_in_threadpool(page.close)

    return Starlette(routes=routes, lifespan=lifespan,
                     middleware=[Middleware(Access, token=token)])


def serve(page: SessionPage, port: int, say: Callable[[str], None]) -> None:
    """Serve the page until it is interrupted.

    Parameters
    ----------
    port : int
        0 takes a free one.
    say : callable
        Given the page's address once it can be opened.

    Raises
    ------
    InputError
        If the port is taken.
    """
    import uvicorn
    token = secrets.token_urlsafe(24)
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((HOST, port))
        except OSError as error:
            raise InputError(f"port {port} cannot be used ({error.strerror}); give another with "
                             "--port, or none to take a free one") from None
        listening.listen()
        say(f"http://{HOST}:{listening.getsockname()[1]}/?token={token}")
        config = uvicorn.Config(page_app(page, token), log_level="warning", access_log=False)
        uvicorn.Server(config).run(sockets=[listening])


def _name(written: dict[str, Any], folder: Path) -> str:
    name = _at(written, "session", "name")
    return name if isinstance(name, str) else folder.name


def _at(written: Any, *keys: str) -> Any:
    for key in keys:
        written = written.get(key) if isinstance(written, dict) else None
    return written


def _regions(written: dict[str, Any]) -> dict[str, Any]:
    """Outlines by name, with the photo that they lie in where one is said."""
    regions_by_name = {}
    regions = written.get("regions")
    for name, region in regions.items() if isinstance(regions, dict) else ():
        outline = _at(region, "polygon")
        if outline is None and isinstance(rect := _at(region, "rect"), list) and len(rect) == 4:
            x0, y0, x1, y1 = rect
            outline = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
        regions_by_name[name] = {"outline": outline or [], "photo": _at(region, "photo")}
    return regions_by_name


