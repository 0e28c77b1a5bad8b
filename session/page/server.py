"""The page's server: what it answers, on this machine alone."""
from __future__ import annotations

import asyncio
import contextlib
import json
import re
import secrets
import shutil
import socket
import tempfile
import threading
import tomllib
from collections.abc import AsyncIterator, Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from spectrabox.capture.photo.linear import photo_size
from spectrabox.capture.photo.orientation import AS_READ, photo_orientation
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.radiometry.files import whole_file, writable
from spectrabox.radiometry.system.words import plain, shortened
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_file import session_of_text, text_of
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig
from spectrabox.session.flat.new_session import (
    FlatOrder,
    FurtherPhoto,
    folder_beside,
    session_of,
)
from spectrabox.session.kept_stages import stage_states
from spectrabox.session.page.access import Access, Receive, RedirectFile, Scope, Send
from spectrabox.session.page.live import LiveSample
from spectrabox.session.page.marks import (
    MAX_PX,
    MarkedSession,
    corner_names,
    marks_of,
    photos_of,
)
from spectrabox.session.page.photo_views import PhotoFile, PhotoViews
from spectrabox.session.page.run_control import RunControl
from spectrabox.session.page.shooting import PHOTO_SUFFIXES, Shooting

HERE = Path(__file__).parent / "static"
HOST = "127.0.0.1"
REPORT, NUMBERS = "report.html", "report.json"
MARKED = ("marked.csv", "marked.spdx")      # spectra of what is marked now
UNSAFE = re.compile(r"[^\w .()+-]+")
MAX_NAME = 100          # characters of a file's
PNG = b"\x89PNG"
MAX_BODY = 200_000      # bytes of a mark: a polygon of ten thousand corners
MAX_PHOTO = 1 << 29     # bytes of a photo that is dropped
DISCARD_S = 2.0         # for what comes of a request that has been refused
GRACE_S = 1             # for answers under way when the page ends


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
    run : RunControl, optional
        Of this session, where one has begun.
    """

    def __init__(self, folder: Path, watched: Path | None = None,
                 allow_outside: bool = False, run: RunControl | None = None) -> None:
        self.folder = folder.resolve()
        self.photos = PhotoViews()
        self.marks = MarkedSession(self.folder, self.photos, allow_outside)
        self.marks.read()
        self.run = run or RunControl(self.folder, ("--allow-outside",) if allow_outside else ())
        self.live = LiveSample(self.run, self.photos)
        self.shooting = None if watched is None else Shooting(watched.resolve(), self._chart())
        self._allow_outside = allow_outside
        self._states: tuple[Any, list[dict[str, Any]]] = (None, [])
        self._states_lock = threading.Lock()
        self._receiving: set[Path] = set()
        self._verdict: tuple[int | None, dict[str, str] | None] = None, None

    def start(self) -> None:
        """Begin what goes on beside the answers."""
        self.live.start()
        if self.shooting is not None:
            self.shooting.start()
        self.state()

    def stop(self) -> None:
        """Ask a run that goes on to end."""
        self.run.stop()

    def close(self) -> None:
        """Watch no longer, and stop a run that goes on."""
        self.live.end()
        if self.shooting is not None:
            self.shooting.end()
        self.run.end()

    def state(self) -> dict[str, Any]:
        """All that the page shows but for pixels."""
        config: SessionConfig | None = None
        try:
            text, digest = self.marks.read()
        except InputError as error:
            text, digest, problems = "", "", [str(error)]
        else:
            config, problems = session_of_text(text_of(text.encode()), self.folder,
                                               self._allow_outside)
        self.live.follow(config)
        written = _toml_of(text)
        photos = [{"role": role, "file": name, "there": path.is_file()}
                  for role, name in photos_of(written).items()
                  if (path := self._inside(name)) is not None]
        return {"name": _name(written, self.folder), "digest": digest, "problems": problems,
                "photos": photos, "undo": self.marks.can_undo(text), "marks": marks_of(written),
                "corner_names": corner_names(written), "facts": facts_of(written),
                "stages": self._stages(text, config), "run": self.run.state(),
                "live": self.live.state(), "report": self._report_stamp(),
                "exports": [*self._marked_files(written), *self.exports()],
                "reported": self._reported(),
                "shooting": None if self.shooting is None else self.shooting.state()}

    def photo_file(self, role: str) -> PhotoFile:
        """File of a photo by what it is, or of a new shot of the watched folder.

        Raises
        ------
        InputError
            If there is none, or it lies outside the session and the watched folder.
        """
        kind, _, name = role.partition(":")
        if kind == "shot" and self.shooting is not None:
            shot = self.shooting.path(name)
            return PhotoFile(shot, photo_orientation(shot))
        written = _toml_of(self.marks.read()[0])
        named = photos_of(written)
        path = self._inside(named[role]) if role in named else None
        if path is None:
            raise InputError(f"the session has no photo {shortened(role)}; it has "
                             f"{', '.join(named)}")
        return PhotoFile(path, _orientation(written))

    @contextlib.contextmanager
    def received(self, name: str) -> Iterator[tuple[IO[bytes], str]]:
        """A file for a photo or a spectrum that comes in, and its name in the session; it counts
        once it is whole, and none is written over.

        Parameters
        ----------
        name : str
            As a browser gives it.

        Raises
        ------
        InputError
            If it is no name of a file.
        """
        safe = safe_name(name)
        part = "photos" if Path(safe).suffix.lower() in PHOTO_SUFFIXES else "spectra"
        folder = self.folder / part
        with writable(folder):
            folder.mkdir(exist_ok=True)
        target = unused_path(folder / safe, self._receiving)
        self._receiving.add(target)         # of two that have one name each gets its own
        try:
            with writable(folder), whole_file(target) as unfinished, \
                    unfinished.open("wb") as file:
                yield file, f"{part}/{target.name}"
        finally:
            self._receiving.discard(target)

    def exports(self) -> dict[str, Path]:
        """Files with spectra that the last report left, by name in the session."""
        if self._report_stamp() is None:
            return {}
        found = [self.folder / "spectra.csv", *sorted((self.folder / "spdx").glob("*.spdx")),
                 *sorted((self.folder / "results" / "picture").glob("*.exr"))]
        return {path.relative_to(self.folder).as_posix(): path for path in found
                if path.is_file() and path.resolve().is_relative_to(self.folder)}

    def _marked_files(self, written: dict[str, Any]) -> Sequence[str]:
        """Files of what is marked now, which no report need hold."""
        live = self.live.state()
        return MARKED if live is not None and live["ready"] and marks_of(written)["regions"] else ()

    def _reported(self) -> dict[str, str] | None:
        """Verdict of the last report, with its reason; None where there is none that says so."""
        stamp = self._report_stamp()
        if self._verdict[0] != stamp:
            verdict = None
            with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
                numbers = json.loads((self.folder / NUMBERS).read_text(encoding="utf-8"))
                verdict = {name: str(numbers["verdict"][name]) for name in ("status", "says")}
            self._verdict = stamp, verdict
        return self._verdict[1]

    def _inside(self, name: str) -> Path | None:
        """Where a file of the session lies; None where it may not, or where no file can."""
        try:
            path = (self.folder / name).resolve()
            path.is_file()
        except (OSError, ValueError, RuntimeError):     # too long, with a NUL, a link to itself
            return None
        return path if self._allow_outside or path.is_relative_to(self.folder) else None

    def _chart(self) -> Chart:
        config, _ = session_of_text(text_of(self.marks.read()[0].encode()), self.folder)
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

    def _stages(self, text: str, config: SessionConfig | None) -> list[dict[str, Any]]:
        """States of the stages, looked at again where something may have changed."""
        now = (text, self._report_stamp(), self.run.running,
               tuple(self.run.state()["lines"][-1:]))
        with self._states_lock:
            if self._states[0] != now:
                states: list[dict[str, Any]] = []
                if config is not None:
                    with contextlib.suppress(SpectraboxError):
                        states = [{"name": one.name, "state": one.state,
                                   "reasons": list(one.reasons)} for one in stage_states(config)]
                self._states = (now, states)
            return self._states[1]


class StartPage:
    """Sessions of the working folder, and photos that are dropped to make one.

    Parameters
    ----------
    folder : Path
        In which sessions are listed and made.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.mount: Callable[[str, SessionPage], None] = lambda path, page: None
        self._pages: dict[Path, tuple[str, SessionPage]] = {}
        self._staging: Path | None = None
        self._lock = threading.Lock()

    def start(self) -> None:
        """Nothing goes on until a session is opened."""

    def stop(self) -> None:
        """Ask runs that go on to end."""
        for _, page in self._pages.values():
            page.stop()

    def close(self) -> None:
        """Close the sessions that were opened, and forget photos that were dropped in vain."""
        for _, page in self._pages.values():
            page.close()
        self._discard()

    def sessions(self) -> dict[str, Any]:
        """Names of the session folders, the last one first."""
        files = [path / FILE_NAME for path in self.folder.iterdir()
                 if not path.is_symlink() and (path / FILE_NAME).is_file()]
        files.sort(key=lambda path: -path.stat().st_mtime)
        return {"folder": plain(str(self.folder)), "sessions": [file.parent.name for file in files
                                                                if plain(file.parent.name)
                                                                == file.parent.name]}

    @contextlib.contextmanager
    def received(self, name: str) -> Iterator[tuple[IO[bytes], str]]:
        """A file for a photo that comes in, and its name; it counts once it is whole.

        Parameters
        ----------
        name : str
            As a browser gives it.

        Raises
        ------
        InputError
            If it is no name of a photo.
        """
        safe = safe_name(name)
        if Path(safe).suffix.lower() not in PHOTO_SUFFIXES:
            raise InputError(f"{shortened(name)} is no photo that can be measured; drop a camera "
                             "raw, or a linear EXR or TIFF")
        with self._lock:
            if self._staging is None:
                with writable(self.folder):
                    self._staging = Path(tempfile.mkdtemp(prefix=".dropped-", dir=self.folder))
        with writable(self._staging), whole_file(self._staging / safe) as unfinished, \
                unfinished.open("wb") as file:
            yield file, safe

    def make(self, names: list[str]) -> dict[str, str]:
        """Make a session of photos that were dropped, and open it.

        Parameters
        ----------
        names : list of str
            As the browser gave them, the first photo first.

        Raises
        ------
        InputError
            If one of them is no photo.
        """
        with self._lock:
            folder, self._staging = self._staging, None
        if folder is None:
            raise InputError("drop a photo first")
        try:
            photos = [folder / safe_name(name) for name in names]
            for photo in photos:
                photo_size(photo)       # refuses what is no photo
            target = unused_path(self.folder / folder_beside(photos[0]).name)
            with session_of(FlatOrder(photos[0], {}, further=[*map(FurtherPhoto, photos[1:])]),
                            target):
                return self.open(target.name)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def open(self, name: str) -> dict[str, str]:
        """Where the page of a session of the folder is.

        Parameters
        ----------
        name : str
            Of the session's folder.

        Raises
        ------
        InputError
            If there is no such session.
        """
        if name not in self.sessions()["sessions"]:
            raise InputError(f"there is no session {shortened(name)} here")
        with self._lock:
            folder = self.folder / name
            if folder not in self._pages:
                page, path = SessionPage(folder), f"/s/{len(self._pages) + 1}"
                self.mount(path, page)
                page.start()
                self._pages[folder] = path, page
            return {"address": f"{self._pages[folder][0]}/page"}

    def _discard(self) -> None:
        if self._staging is not None:
            shutil.rmtree(self._staging, ignore_errors=True)


def unused_path(wanted: Path, taken: Collection[Path] = ()) -> Path:
    """A path that is not there yet, of a name or the same with a number."""
    number, path = 1, wanted
    while path.exists() or path.is_symlink() or path in taken:
        number += 1
        path = wanted.with_name(f"{wanted.stem}-{number}{wanted.suffix}")
    return path


def safe_name(name: str) -> str:
    """The name of a file as a browser gives it, without what may not stand in one.

    Raises
    ------
    InputError
        If nothing is left of it.
    """
    safe = UNSAFE.sub("_", name)[-MAX_NAME:].lstrip("._ ")
    if not Path(safe).stem:
        raise InputError(f"{shortened(name)} is no name of a file; rename it")
    return safe


def page_app(page: SessionPage | StartPage, token: str,
             when_opened: Callable[[], None] = lambda: None) -> Access:
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

    routes = session_routes(page, when_opened) if isinstance(page, SessionPage) \
        else start_routes(page, when_opened)
    application = Starlette(routes=[*routes, Mount("/static", StaticFiles(directory=HERE))],
                            lifespan=lifespan)
    application.router.redirect_slashes = False
    if isinstance(page, StartPage):
        page.mount = lambda path, opened: application.router.routes.insert(
            0, Mount(path, routes=session_routes(opened)))
    # around all of it, so that answers to its own errors have the same headers
    return Access(application, token)


def answered(work: Callable[[Any], Any]) -> Callable[[Request], Any]:
    """A route whose work runs beside the others; what it refuses is a sentence.

    Parameters
    ----------
    work : function
        Of the query, or of the JSON that was posted.
    """
    async def answer(request: Request) -> Response:
        asked: Any = dict(request.query_params)
        if request.method == "POST":
            body = await _body(request)
            if body is None:
                return TooLong()
            try:
                asked = json.loads(body)
            except (ValueError, RecursionError):
                return _refused("JSON is needed", 400)
        try:
            result = await run_in_threadpool(work, asked)
        except SpectraboxError as error:
            return _refused(str(error), 409)
        except (KeyError, TypeError, ValueError) as error:
            return _refused(f"not understood: {error}", 400)
        if isinstance(result, bytes):
            return Response(result, media_type="image/png" if result.startswith(PNG)
                            else "image/jpeg")
        return _json(result)
    return answer


def receiving(page: StartPage | SessionPage) -> Callable[[Request], Any]:
    """A route that takes a file; it answers with its name."""
    async def receive(request: Request) -> Response:
        try:
            with page.received(request.query_params.get("name", "")) as (file, stored):
                size = 0
                async for part in request.stream():
                    size += len(part)
                    if size > MAX_PHOTO:
                        raise InputError(f"a file of more than {MAX_PHOTO >> 20} MiB; copy it "
                                         "into a folder, and give its name to 'spectrabox open'")
                    await run_in_threadpool(file.write, part)
        except ClientDisconnect:
            return _refused("the file did not arrive whole", 400)
        except SpectraboxError as error:
            return _refused(str(error), 409)
        return _json({"file": stored})
    return receive


def start_routes(page: StartPage, when_opened: Callable[[], None]) -> list[BaseRoute]:
    """What the page answers from which sessions are opened and made."""
    async def shell(request: Request) -> Response:
        return FileResponse(HERE / "start.html")

    async def index(request: Request) -> Response:
        when_opened()
        return await shell(request)

    return [Route("/", index), Route("/page", shell),
            Route("/api/sessions", answered(lambda asked: page.sessions())),
            Route("/api/photo", receiving(page), methods=["POST"]),
            Route("/api/new", answered(lambda asked: page.make(asked["names"])),
                  methods=["POST"]),
            Route("/api/open", answered(lambda asked: page.open(asked["name"])),
                  methods=["POST"])]


def session_routes(page: SessionPage,
                   when_opened: Callable[[], None] = lambda: None) -> list[BaseRoute]:
    """What the page of one session answers."""
    async def shell(request: Request) -> Response:
        return FileResponse(HERE / "index.html")

    async def index(request: Request) -> Response:
        when_opened()
        return await shell(request)

    async def report(request: Request) -> Response:
        path = page.folder / REPORT
        if path.is_symlink() or not path.is_file():
            return _refused("there is no report yet", 404)
        return FileResponse(path)

    async def export(request: Request) -> Response:
        name = request.query_params.get("file", "")
        if name in MARKED:
            try:
                text = await run_in_threadpool(page.live.export, Path(name).suffix)
            except SpectraboxError as error:
                return _refused(str(error), 409)
            return Response(text, headers={"content-disposition": f'attachment; filename="{name}"'},
                            media_type="text/plain; charset=utf-8")
        path = page.exports().get(name)
        if path is None:
            return _refused("there is no such file", 404)
        return FileResponse(path, filename=path.name)

    def changed(work: Callable[[Any], None]) -> Callable[[Any], Any]:
        def answer(asked: Any) -> Any:
            work(asked)
            return page.state()
        return answer

    def of_photo(work: Callable[[PhotoFile, Any], Any]) -> Callable[[Any], Any]:
        return lambda asked: work(page.photo_file(asked["role"]), asked)

    return [
        Route("/", index), Route("/page", shell), Route("/report", report),
        Route("/api/export", export),
        Route("/api/state", answered(lambda asked: page.state())),
        Route("/api/photo", answered(of_photo(lambda file, asked: page.photos.whole(file)))),
        Route("/api/size", answered(of_photo(
            lambda file, asked: {"size": page.photos.photo(file).size,
                                 "bands": page.photos.photo(file).signal.shape[2]}))),
        Route("/api/part", answered(of_photo(lambda file, asked: page.photos.part(
            file, *(_pixels(asked, name) for name in ("left", "top", "side")))))),
        Route("/api/value", answered(of_photo(lambda file, asked: page.photos.value(
            file, _pixels(asked, "x"), _pixels(asked, "y"))))),
        Route("/api/spectrum", answered(lambda asked: page.live.point(
            asked["role"], [_pixels(asked, name) for name in ("x0", "y0", "x1", "y1")]))),
        Route("/api/region", answered(lambda asked: page.live.region(asked["name"]))),
        Route("/api/compare", answered(lambda asked: page.live.compare([
            one if "name" in one else {"role": one["role"], "rect": [
                _pixels(one, name) for name in ("x0", "y0", "x1", "y1")]}
            for one in asked["picked"]])), methods=["POST"]),
        Route("/api/file", receiving(page), methods=["POST"]),
        Route("/api/mark", answered(changed(
            lambda asked: page.marks.apply(asked["mark"], asked["digest"]))), methods=["POST"]),
        Route("/api/undo", answered(changed(
            lambda asked: page.marks.undo(asked["digest"]))), methods=["POST"]),
        Route("/api/run", answered(changed(lambda asked: page.run.start())), methods=["POST"]),
        Route("/api/stop", answered(changed(lambda asked: page.run.stop())), methods=["POST"]),
    ]


def serve(page: SessionPage | StartPage, port: int, say: Callable[[str], None],
          browse: Callable[[str], object] | None = None) -> None:
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
    import uvicorn

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
            redirect = RedirectFile(address)
            at_end.callback(redirect.discard)
            app = page_app(page, token, redirect.discard)
            # some browsers return when they are closed
            threading.Thread(target=browse, args=(redirect.path.as_uri(),), daemon=True).start()
        Server(uvicorn.Config(app, log_level="critical", access_log=False,
                              timeout_graceful_shutdown=GRACE_S)).run(sockets=[listening])


async def _body(request: Request) -> bytes | None:
    """What a request holds; None where that is longer than ``MAX_BODY``, without reading on."""
    content = b""
    with contextlib.suppress(ClientDisconnect):
        async for part in request.stream():
            content += part
            if len(content) > MAX_BODY:
                return None
    return content


class TooLong(Response):
    """Refusal of a request that is longer than ``MAX_BODY``.

    What still comes is thrown away for a while: most clients read no answer before they have sent
    all, and a connection that is closed meanwhile loses it.
    """

    def __init__(self) -> None:
        sentence = f"more than {MAX_BODY} bytes; mark fewer points"
        super().__init__(json.dumps({"error": sentence}), 413, media_type="application/json")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer at once, and end the answer later."""
        await send({"type": "http.response.start", "status": self.status_code,
                    "headers": self.raw_headers})
        await send({"type": "http.response.body", "body": self.body, "more_body": True})
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(DISCARD_S):
                while (await receive()).get("more_body"):
                    pass
        await send({"type": "http.response.body"})


def _pixels(asked: dict[str, str], name: str) -> float:
    """A number of pixels of a request."""
    value = float(asked[name])
    if not abs(value) <= MAX_PX:
        raise ValueError(f"{name} is {value:g}; {-MAX_PX:g} to {MAX_PX:g} is possible")
    return value


def _json(content: Any, status: int = 200) -> Response:
    """An answer in ASCII: names of files may hold what UTF-8 cannot."""
    return Response(json.dumps(content, allow_nan=False), status, media_type="application/json")


def _refused(sentence: str, status: int) -> Response:
    return _json({"error": sentence}, status)


def _toml_of(text: str) -> dict[str, Any]:
    """What a session.toml says; nothing where it is no TOML."""
    try:
        return tomllib.loads(text_of(text.encode()))
    except (ValueError, RecursionError):
        return {}


def facts_of(written: dict[str, Any]) -> dict[str, Any]:
    """What a session.toml says of light, picture and further photos, as the page shows it.

    Parameters
    ----------
    written : dict
        As ``tomllib`` gives it; may have faults.
    """
    light, views = written.get("light"), written.get("views")
    spectrum = light.get("spectrum") if isinstance(light, dict) else None
    return {"light": spectrum if isinstance(spectrum, str) else "", "picture": "picture" in written,
            "views": list(views) if isinstance(views, dict) else []}


def _orientation(written: dict[str, Any]) -> int:
    photos = written.get("photos")
    stated = photos.get("orientation") if isinstance(photos, dict) else None
    return stated if isinstance(stated, int) and 1 <= stated <= 8 else AS_READ


def _name(written: dict[str, Any], folder: Path) -> str:
    session = written.get("session")
    name = session.get("name") if isinstance(session, dict) else None
    return name if isinstance(name, str) else plain(folder.name)
