"""What the page answers, address by address."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Route

from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.session.page import answers, photo_views, start_page
from spectrabox.session.page.session_page import MARKED, SessionPage
from spectrabox.session.page.written_session import MAX_PX

HERE = Path(__file__).parent / "static"
RECTANGLE = ("x0", "y0", "x1", "y1")


def start_routes(page: start_page.StartPage, when_opened: Callable[[], None]) -> list[BaseRoute]:
    """What the page answers from which sessions are opened and made."""
    return [*_shell("start.html", when_opened),
            _get("/api/sessions", lambda asked: page.sessions()),
            _taking("/api/photo", answers.receiving(page.received)),
            _post("/api/new", lambda asked: page.make(asked["names"])),
            _post("/api/open", lambda asked: page.open(asked["name"]))]


def session_routes(page: SessionPage,
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


def _state_and_run(page: SessionPage) -> list[BaseRoute]:
    return [_get("/api/state", lambda asked: page.state()),
            _post("/api/run", _then_state(page, lambda asked: page.run.start())),
            _post("/api/stop", _then_state(page, lambda asked: page.run.stop()))]


def _report(page: SessionPage) -> list[BaseRoute]:
    """The report, and files of spectra: of the report, or of what is marked now."""
    async def report(request: Request) -> Response:
        path = page.report.path
        if path.is_symlink() or not path.is_file():
            return answers.refused("there is no report yet", 404)
        return FileResponse(path)

    async def export(request: Request) -> Response:
        name = request.query_params.get("file", "")
        if name in MARKED:
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


def _photos(page: SessionPage) -> list[BaseRoute]:
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


def _spectra(page: SessionPage) -> list[BaseRoute]:
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


def _marks(page: SessionPage) -> list[BaseRoute]:
    return [_post("/api/mark", _then_state(
                page, lambda asked: page.marks.apply(asked["mark"], asked["digest"]))),
            _post("/api/undo", _then_state(
                page, lambda asked: page.marks.undo(asked["digest"])))]


def _meter(page: SessionPage) -> list[BaseRoute]:
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


def _then_state(page: SessionPage, work: Callable[[Any], None]) -> Callable[[Any], Any]:
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
