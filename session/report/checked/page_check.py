"""A written page against its own data, as its button does in the browser."""
from __future__ import annotations

import base64
import binascii
import hashlib
import html
import json
import re
from collections.abc import Iterator
from typing import Any

from spectrabox.session.report.checked.cells import shows, value_at
from spectrabox.session.report.checked.drawing import drawing_digest

EMBEDDED = re.compile(r'<script type="application/json" id="spectrabox-results">(.*?)</script>',
                      re.DOTALL)
CELL = re.compile(r'<(td|span|p|div)\b([^>]*)\sdata-of="([^"]*)"[^>]*>(.*?)</\1>', re.DOTALL)
STYLE = re.compile(r'style="(?:width|background): ([^"]*)"')     # of an element that holds no text
PICTURE = re.compile(r'<img src="data:image/png;base64,([^"]*)" data-of="([^"]*)"')
PLOT = re.compile(r'<div class="plot-box" id="([^"]*)">.*?</svg>(?:<script.*?</output>)?</div>',
                  re.DOTALL)


def embedded_numbers(page: str) -> Any:
    """The data that a page carries; None where it carries none that can be read."""
    found = EMBEDDED.search(page)
    try:
        return None if found is None else json.loads(found[1])
    except ValueError:
        return None


def page_faults(page: str, numbers: dict[str, Any]) -> tuple[int, list[str]]:
    """How many tables' entries, plots and pictures a page shows, and which are not its data.

    Parameters
    ----------
    page : str
    numbers : dict
        The data, as ``report.json`` holds them.
    """
    shown = [*_cells(page, numbers), *_plots(page, numbers), *_pictures(page, numbers)]
    return len(shown), [fault for fault in shown if fault]


def differences(mine: Any, other: Any, pointer: str = "") -> Iterator[str]:
    """JSON pointers of everything in which two sets of data differ."""
    if isinstance(mine, dict) and isinstance(other, dict):
        for key in [*mine, *(key for key in other if key not in mine)]:
            step = f"{pointer}/{str(key).replace('~', '~0').replace('/', '~1')}"
            if key in mine and key in other:
                yield from differences(mine[key], other[key], step)
            else:
                yield step
    elif isinstance(mine, list) and isinstance(other, list) and len(mine) == len(other):
        for index, pair in enumerate(zip(mine, other, strict=True)):
            yield from differences(*pair, f"{pointer}/{index}")
    elif mine != other:
        yield pointer or "/"


def _cells(page: str, numbers: dict[str, Any]) -> Iterator[str]:
    for _, tag, pointer, content in CELL.findall(page):
        text, at = html.unescape(re.sub("<[^>]+>", "", content)), html.unescape(pointer)
        if not content and (style := STYLE.search(tag)):
            text = style[1].replace("%", " %")
        try:
            value = value_at(numbers, at)
        except KeyError:
            yield f"report.html shows {at}, which the data have not"
            continue
        yield "" if shows(text, value) else (f"report.html says “{text.strip()}” where the data "
                                             f"say {json.dumps(value, ensure_ascii=False)} ({at})")


def _plots(page: str, numbers: dict[str, Any]) -> Iterator[str]:
    drawn = {found[1]: found[0] for found in PLOT.finditer(page)}
    for name, plot in numbers["plots"].items():
        if name not in drawn:
            yield f"report.html lacks the plot “{plot['title']}”"
        else:
            yield "" if drawing_digest(drawn[name]) == plot["sha256"] else (
                f"the plot “{plot['title']}” of report.html is not as it was written")
    yield from (f"the plot {name} of report.html is not of these data"
                for name in drawn if name not in numbers["plots"])


def _pictures(page: str, numbers: dict[str, Any]) -> Iterator[str]:
    for content, pointer in PICTURE.findall(page):
        at = html.unescape(pointer)
        try:
            wanted = value_at(numbers, at)
            found = hashlib.sha256(base64.b64decode(content, validate=True)).hexdigest()
        except (KeyError, binascii.Error):
            wanted, found = "", None
        yield "" if found == wanted else f"the picture {at} of report.html is not that written"
