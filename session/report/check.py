"""Does a written report still agree with the stored results, and with the files behind it?

The page is drawn again from the stored results with the provenance it embeds: its text and its
numbers must be the ones that were written.
"""
from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import sha256_of
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.outputs.assemble import assemble
from spectrabox.session.pipeline import load_finished
from spectrabox.session.report.page import NUMBERS_NAME, PAGE_NAME, RenderedReport, render_report
from spectrabox.session.store.program import PACKAGES, versions

EMBEDDED = re.compile(r'<script type="application/json" id="spectrabox-results">(.*?)</script>',
                      re.DOTALL)
DRAWN = ("plots", "pictures")       # depend on the versions of the packages that draw
MAX_NAMED = 12
MAX_QUOTED = 80                     # characters of a line of the page


@dataclass(frozen=True)
class ReportCheck:
    """What was compared, and every fault as a sentence."""

    shown: int          # numbers and words embedded in the page
    files: int          # files whose digests were compared
    faults: tuple[str, ...]


def check_report(config: SessionConfig) -> ReportCheck:
    """Compare report.html and report.json with the files behind them and the stored results.

    Raises
    ------
    InputError
        If there is no report with its numbers, or no results.
    """
    page, text = (_read(config.folder / name) for name in (PAGE_NAME, NUMBERS_NAME))
    numbers = _parsed(text)
    embedded = EMBEDDED.search(page)
    faults = _first(differences(_json(embedded[1]) if embedded else None, numbers),
                    f"{PAGE_NAME} and {NUMBERS_NAME} hold different data at {{}}")
    digests = {name: digest for group in ("session", "files", "results")
               for name, digest in numbers["made_from"].get(group, {}).items()}
    changed = [name for name, digest in digests.items() if _changed(config, name, digest)]
    faults += [f"{name} is not as it was when the report was written: run 'spectrabox run' or "
               "'spectrabox report' again" for name in changed]
    if not changed:
        again = _rendered_again(config, numbers)
        same_packages = (numbers["provenance"].get("versions") or {}).items() \
            >= versions(PACKAGES).items()
        skipped = () if same_packages else DRAWN
        stored, written = ({key: value for key, value in each.items() if key not in skipped}
                           for each in (_parsed(again.numbers), numbers))
        wrong = _first(differences(stored, written),
                       f"the stored results give another value than {NUMBERS_NAME} at {{}}")
        if not wrong and same_packages:
            wrong = _first(_changed_lines(page, again.page), f"{PAGE_NAME}: {{}}")
        faults += wrong
    return ReportCheck(sum(1 for _ in _leaves(numbers)), len(digests), tuple(faults))


def differences(mine: Any, other: Any, pointer: str = "") -> Iterator[str]:
    """JSON pointers (RFC 6901) of everything in which two sets of data differ."""
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


def _changed_lines(page: str, again: str) -> Iterator[str]:
    """Where two pages of the same numbers differ, line by line."""
    written, drawn = page.splitlines(), again.splitlines()
    if len(written) != len(drawn):
        yield f"it has {len(written)} lines where the stored results make {len(drawn)}"
        return
    for number, (here, there) in enumerate(zip(written, drawn, strict=True), start=1):
        if here != there:
            at = next((index for index, (a, b) in enumerate(zip(here, there, strict=False))
                       if a != b), min(len(here), len(there)))
            near = slice(max(at - MAX_QUOTED // 2, 0), at + MAX_QUOTED // 2)
            yield (f"line {number} reads “{here[near].strip()}” where the stored results make "
                   f"“{there[near].strip()}”")


def _rendered_again(config: SessionConfig, numbers: dict[str, Any]) -> RenderedReport:
    """The report from the stored results, with the provenance of the one that was written."""
    finished = load_finished(config)
    results = assemble(config, finished, numbers["provenance"])
    return render_report(dataclasses.replace(results, stages=numbers["stages"]))


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): write it with 'spectrabox "
                         "report'") from None


def _json(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _parsed(text: str) -> dict[str, Any]:
    numbers = _json(text)
    if isinstance(numbers, dict) and {"plots", "pictures", "made_from", "provenance",
                                      "stages"} <= numbers.keys():
        return numbers
    raise InputError(f"{NUMBERS_NAME} does not hold the numbers of a report: write it again with "
                     "'spectrabox report'")


def _first(places: Iterator[str], sentence: str) -> list[str]:
    """A sentence for each of the first places, and how many more there are."""
    named = list(places)
    more = len(named) - MAX_NAMED
    return [sentence.format(place) for place in named[:MAX_NAMED]] + (
        [f"... and at {more} other places"] if more > 0 else [])


def _changed(config: SessionConfig, name: str, digest: str) -> bool:
    path = config.folder / name
    return not path.is_file() or sha256_of(path) != digest


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _leaves(item)
    else:
        yield value
