"""Names under which files that a browser sends are kept."""


from __future__ import annotations

import asyncio
import contextlib
import json
import re
from collections.abc import Callable, Collection
from pathlib import Path
from typing import IO, Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.radiometry.system.words import shortened
from spectrabox.session.page import access

UNSAFE = re.compile(r"[^\w .()+-]+")
MAX_NAME = 100          # characters of a file's


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


# ---- answers to requests -------------------------------------------------------------------------

PNG = b"\x89PNG"
MAX_BODY = 200_000      # bytes of a mark: a polygon of ten thousand corners
MAX_PHOTO = 1 << 29     # bytes of a photo that is dropped
MAX_RECEIVED = 1 << 34  # bytes of all that a page is given while it is open
DISCARD_S = 2.0         # for what comes of a request that has been refused
Answer = Callable[[Request], Any]
Received = contextlib.AbstractContextManager[tuple[IO[bytes], str]]


def answered(work: Callable[[Any], Any]) -> Answer:
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
                return refused("JSON is needed", 400)
        try:
            result = await run_in_threadpool(work, asked)
        except SpectraboxError as error:
            return refused(str(error), 409)
        except (KeyError, TypeError, ValueError) as error:
            return refused(f"not understood: {error}", 400)
        if not isinstance(result, bytes):
            return _json(result)
        kind = "png" if result.startswith(PNG) else "jpeg"
        return Response(result, media_type=f"image/{kind}")
    return answer


def receiving(received: Callable[[str], Received]) -> Answer:
    """A route that takes a file; it answers with its name.

    Parameters
    ----------
    received : function
        Of the name that a browser gives, to an open file and the name under which it is kept.
    """
    total = 0

    async def receive(request: Request) -> Response:
        nonlocal total
        size, kept = 0, False
        try:
            with received(request.query_params.get("name", "")) as (file, stored):
                async for part in request.stream():
                    size, total = size + len(part), total + len(part)
                    if size > MAX_PHOTO:
                        raise InputError(f"a file of more than {MAX_PHOTO >> 20} MiB; copy it "
                                         "into a folder, and give its name to 'spectrabox open'")
                    if total > MAX_RECEIVED:
                        raise InputError(f"this page was given {MAX_RECEIVED >> 30} GiB since it "
                                         "was opened; copy further files into the folder, or open "
                                         "the page again")
                    await run_in_threadpool(file.write, part)
            kept = True
        except ClientDisconnect:
            return refused("the file did not arrive whole", 400)
        except SpectraboxError as error:
            return refused(str(error), 409)
        finally:
            if not kept:        # nothing of it is left
                total -= size
        return _json({"file": stored})
    return receive


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

    async def __call__(self, scope: access.Scope, receive: access.Receive,
                       send: access.Send) -> None:
        """Answer at once, and end the answer later."""
        await send({"type": "http.response.start", "status": self.status_code,
                    "headers": self.raw_headers})
        await send({"type": "http.response.body", "body": self.body, "more_body": True})
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(DISCARD_S):
                while (await receive()).get("more_body"):
                    pass
        await send({"type": "http.response.body"})


def _json(content: Any, status: int = 200) -> Response:
    """An answer in ASCII: names of files may hold what UTF-8 cannot."""
    return Response(json.dumps(content, allow_nan=False), status, media_type="application/json")


def refused(sentence: str, status: int) -> Response:
    """A sentence that says why there is no answer."""
    return _json({"error": sentence}, status)
