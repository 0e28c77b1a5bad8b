"""What an operator marks on a photo, written into session.toml without losing a comment."""
from __future__ import annotations

import hashlib
import json
import re
import threading
from collections.abc import MutableMapping, Sequence
from pathlib import Path
from typing import Any, Literal

import tomlkit
from pydantic import Field
from tomlkit.exceptions import TOMLKitError

from spectrabox.radiometry import checked_tables, files
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.given_spectra import typed_reflectance
from spectrabox.radiometry.system.words import shortened
from spectrabox.session.config import session_file
from spectrabox.session.flat.new_session import known_file
from spectrabox.session.page.photo_views import PhotoViews
from spectrabox.session.page.written_session import Pixel, mark_faults

MAX_UNDO = 200
RECEIVED = "spectra/"       # where spectra lie that the page was given
OF_SESSION = {"name": ("session", "name"), "light": ("light", "spectrum"),
              "surface": ("session", "surface")}
OF_VIEW = {"photo", "same_light_as", "light", "lamp", "filter"}
DECIMALS = 1            # of a pixel: no hand marks finer
STATED = ("family", "known", "surface", "truth")    # of a region
BYTE_ORDER_MARK = "\ufeff"
LINE_FEED_ALONE = re.compile(r"(?<!\r)\n")


class Mark(checked_tables.Table):
    """One mark, or its removal where it has no points.

    A region has two corners of a rectangle, or three or more of a polygon; the chart four corners
    in the order of its layout; a box six corners or more by name. A
    "rename" gives a region the one of ``names``; "stated" says what is known of it, "session" what
    is known of the session, "view" of a further photo, which is removed where nothing is stated.
    """

    kind: Literal["region", "rename", "stated", "session", "view", "chart corners", "box corners"]
    name: str = Field("", description="of a region or view")
    photo: str | checked_tables.ListOf[str] = Field(
        "", description="views that a region lies in; empty for every "
        "one")
    points: checked_tables.ListOf[Pixel] = Field((), description="in pixels of the whole photo")
    names: checked_tables.ListOf[str] = Field(
        (), description="of the points of a box; the new name of a region")
    stated: dict[str, str] = Field(
        default_factory=dict, description="of a region: family, surface, truth (a file), and "
        "known: its reflectance, a file or one number at all wavelengths; of the session: name, "
        "light, surface (\"unknown\" too), and picture, \"on\"; of a view: photo, light, "
        "same_light_as, lamp, filter. Nothing is stated by an empty text")


class MarkedSession:
    """The session.toml of a folder, changed one mark at a time; every change can be undone.

    Parameters
    ----------
    folder : Path
        With a session.toml.
    photos : PhotoViews
        In which marks are looked up.
    allow_outside : bool
        Whether it may name files elsewhere.
    """

    def __init__(self, folder: Path, photos: PhotoViews, allow_outside: bool = False) -> None:
        self.folder, self.allow_outside = folder, allow_outside
        self._photos = photos
        self._lock = threading.Lock()
        self._undo: list[tuple[str, str]] = []      # text before and after each mark

    def read(self) -> tuple[str, str]:
        """The text as it is now, to the byte, and its digest, by which a page says what it has
        seen.

        Raises
        ------
        InputError
            If it cannot be read.
        """
        content = session_file.session_content(self.folder)
        session_file.text_of(content)
        return content.decode(), hashlib.sha256(content).hexdigest()

    def can_undo(self, text: str) -> bool:
        """Whether the file, which holds a text, is as the last mark left it."""
        return bool(self._undo) and text == self._undo[-1][1]

    def apply(self, written: Any, seen: str) -> None:
        """Write a mark into the file.

        Parameters
        ----------
        written : dict
            A ``Mark``.
        seen : str
            Digest of the text that the page shows.

        Raises
        ------
        InputError
            If it is no mark, the file has changed since, or the session would have a fault that it
            does not have now.
        """
        mark = checked_tables.checked(Mark, written, "mark")
        before = self._require_seen(seen)
        mark = self._with_known_file(mark)
        after = marked(before, mark)
        # photos may have to be decoded: others need not wait for it
        faults = self._faults(after, mark)
        if faults:
            before_it = self._faults(before, mark)
            faults = [fault for fault in faults if fault not in before_it]
        if faults:
            raise InputError(*faults)
        if after != before:
            with self._lock:
                self._require_seen(seen)
                files.write_text_whole(self.folder / session_file.FILE_NAME, after)
                self._undo = [*self._undo, (before, after)][-MAX_UNDO:]

    def _with_known_file(self, mark: Mark) -> Mark:
        """The mark with a file for a known reflectance that is stated as a number."""
        known = mark.stated.get("known")
        if not known or (known.startswith(RECEIVED) and (self.folder / known).is_file()):
            return mark
        try:
            typed_reflectance(known)
        except ValueError:
            raise InputError("a known reflectance is a number such as 0.94, or 0.94 +- 0.01, not "
                             f"{shortened(known)}; or choose a file") from None
        file = known_file(known, mark.name, self.folder)
        return mark.model_copy(update={"stated": mark.stated | {"known": file}})

    def _faults(self, text: str, mark: Mark) -> list[str]:
        """What the session's file has wrong, and what the mark has on its photo."""
        config, faults = session_file.tables_of_text(text, self.folder, self.allow_outside)
        if config is None:
            return faults
        faults = session_file.inconsistencies(config)
        return faults + mark_faults(config, mark.kind, mark.name, self._photos)

    def undo(self, seen: str) -> None:
        """Take the last mark back.

        Raises
        ------
        InputError
            If there is none, or the file has changed since.
        """
        with self._lock:
            text = self._require_seen(seen)
            if not self._undo or text != self._undo[-1][1]:
                raise InputError(
                    f"nothing to undo: {session_file.FILE_NAME} was changed elsewhere since the "
                    "last mark")
            files.write_text_whole(self.folder / session_file.FILE_NAME, self._undo.pop()[0])

    def _require_seen(self, seen: str) -> str:
        text, digest = self.read()
        if digest != seen:
            raise InputError(
                f"{session_file.FILE_NAME} has changed since this page read it; look at it as it "
                "is now, and mark again")
        return text


def marked(text: str, mark: Mark) -> str:
    """The text of a session.toml with a mark in it; comments and order stay.

    Raises
    ------
    InputError
        If the text is no TOML, or the mark has the wrong number of points.
    """
    try:
        if mark.kind == "rename":
            return _renamed(text, mark)
        document = tomlkit.parse(text.removeprefix(BYTE_ORDER_MARK))
        _write(document, mark)
        result = tomlkit.dumps(document)
    except (TOMLKitError, ValueError, RecursionError) as error:     # also a table that stands twice
        raise InputError(
            f"{session_file.FILE_NAME} is not valid TOML: {error}; correct it first") from None
    if "\r\n" in text and not LINE_FEED_ALONE.search(text):     # what is new ends as the rest does
        result = LINE_FEED_ALONE.sub("\r\n", result)
    return text[:text.startswith(BYTE_ORDER_MARK)] + result


def _write(document: tomlkit.TOMLDocument, mark: Mark) -> None:
    points = [_rounded(point) for point in mark.points]
    if mark.kind == "region":
        _mark_region(document, mark, points)
    elif mark.kind == "stated":
        _state_region(document, mark)
    elif mark.kind == "session":
        _state_session(document, mark)
    elif mark.kind == "view":
        _state_view(document, mark)
    elif mark.kind == "chart corners":
        _require_count(points, 4, "a chart")
        _put(_table(document, "chart"), "corners_px", points)
    else:
        _mark_box(document, mark, points)


def _mark_region(document: Any, mark: Mark, points: list[list[float]]) -> None:
    if not mark.name:
        raise InputError("a region needs a name")
    if not points:
        regions = _table(document, "regions")
        regions.pop(mark.name, None)
        if not regions:         # still a flat sample, where nothing else says what is measured
            document.pop("regions")
            if not ("scene" in document or "materials" in document):
                document["regions"] = tomlkit.table()
        return
    if len(points) < 2:
        raise InputError("a region needs two corners of a rectangle, or three and more of a "
                         "polygon")
    table = _table(_table(document, "regions", is_super_table=True), mark.name)
    for key in ("rect", "polygon", "photo"):
        table.pop(key, None)
    if len(points) == 2:
        (x0, y0), (x1, y1) = points
        _put(table, "rect", [min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)])
    else:
        _put(table, "polygon", points)
    if mark.photo:
        table["photo"] = mark.photo if isinstance(mark.photo, str) else list(mark.photo)


def _state_region(document: Any, mark: Mark) -> None:
    """What is known of a region, key by key."""
    regions = _table(document, "regions")
    if mark.name not in regions or not mark.stated.keys() <= {*STATED}:
        raise InputError(f"there is no region {shortened(mark.name)}, or something else is stated "
                         f"than {', '.join(STATED)}")
    table = _table(regions, mark.name)
    for key, value in mark.stated.items():
        if value:
            table[key] = value
        else:
            table.pop(key, None)


def _state_session(document: Any, mark: Mark) -> None:
    """What is known of the session; the picture of every pixel is on or off."""
    if not set(mark.stated) <= {*OF_SESSION, "picture"}:
        raise InputError(f"of a session {', '.join(OF_SESSION)} and picture can be stated here")
    for key, value in mark.stated.items():
        if key == "picture":
            if value:
                _table(document, "picture")
            else:
                document.pop("picture", None)
        elif not value:
            raise InputError(f"a session needs a {key}")
        else:
            section, name = OF_SESSION[key]
            _table(document, section)[name] = value


def _state_view(document: Any, mark: Mark) -> None:
    """A further photo, or none of this name any more."""
    if not mark.name or not set(mark.stated) <= OF_VIEW:
        raise InputError("a further photo needs a name, and has nothing but "
                         f"{', '.join(sorted(OF_VIEW))} here")
    views = _table(document, "views", is_super_table=True)
    if not mark.stated:
        views.pop(mark.name, None)
        if not views:
            document.pop("views")
        return
    if mark.name in views:
        raise InputError(f"there is a photo {shortened(mark.name)} already; rename the file")
    view = _table(views, mark.name)
    for key, value in mark.stated.items():
        if value:
            view[key] = value


def _renamed(text: str, mark: Mark) -> str:
    """The text with another name for a region, in the header of its table alone."""
    regions = session_file.toml_of(text).get("regions")
    if not isinstance(regions, dict) or mark.name not in regions or len(mark.names) != 1:
        raise InputError(f"there is no region {shortened(mark.name)} to rename")
    name, new = mark.name, mark.names[0]
    if new in regions:
        raise InputError(f"a region {shortened(new)} exists already; take another name")
    written = "|".join(re.escape(each) for each in (
        name, json.dumps(name), json.dumps(name, ensure_ascii=False), f"'{name}'"))
    header = re.compile(rf"^([ \t]*\[[ \t]*regions[ \t]*\.[ \t]*)(?:{written})([ \t]*[\].])",
                        re.MULTILINE)
    result = header.sub(lambda match: match[1] + tomlkit.key(new).as_string() + match[2], text)
    expected = {new if each == name else each: region for each, region in regions.items()}
    if session_file.toml_of(result).get("regions") != expected:
        raise InputError(f"region {shortened(name)} is written in a way that this page cannot "
                         f"rename; rename it in {session_file.FILE_NAME}")
    return result


def _mark_box(document: Any, mark: Mark, points: list[list[float]]) -> None:
    if len(mark.names) != len(points):
        raise InputError(f"{len(points)} corners of a box have {len(mark.names)} names")
    if "box" not in _table(document, "scene"):
        raise InputError(
            f"{session_file.FILE_NAME} has no [scene.box] whose corners could be marked")
    camera = _table(_table(document["scene"], "box"), "camera")
    for key in ("at_mm", "look_at_mm"):         # a camera is measured or found
        camera.pop(key, None)
    corners = tomlkit.inline_table()
    for name, point in zip(mark.names, points, strict=True):
        corners[name] = _array(point)
    camera["corners_px"] = corners


def _require_count(points: list[list[float]], wanted: int, what: str) -> None:
    if len(points) not in (0, wanted):
        raise InputError(f"{what} has {wanted} corners; {len(points)} are marked")


def _table(parent: Any, name: str, is_super_table: bool | None = None) -> Any:
    """A table of another, made where it is missing."""
    if name not in parent:
        parent[name] = tomlkit.table(is_super_table)
    if not isinstance(parent[name], MutableMapping):
        raise InputError(f"{session_file.FILE_NAME}: [{name}] must be a table; correct it first")
    return parent[name]


def _put(table: Any, key: str, values: list[Any]) -> None:
    """A list in place of what stood there, or nothing where it is empty."""
    if values:
        table[key] = _array(values)
    else:
        table.pop(key, None)


def _array(values: Sequence[Any]) -> Any:
    """An array of TOML. Read as a text: appending to one takes time by the square of its length."""
    return tomlkit.value(json.dumps(values))


def _rounded(point: tuple[float, ...]) -> list[float]:
    return [int(value) if value == int(value) else value
            for value in (round(one, DECIMALS) for one in point)]
