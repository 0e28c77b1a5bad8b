"""Whether a written report still agrees with its data, its inputs and the stored results."""
from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import sha256_of
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.pipeline import load_finished
from spectrabox.session.report.checked.page_check import (
    differences,
    embedded_numbers,
    page_faults,
)
from spectrabox.session.report.page import NUMBERS_NAME, PAGE_NAME, RenderedReport
from spectrabox.session.store.provenance import PACKAGES, provenance, versions

NOT_OF_RESULTS = ("provenance", "stages", "schema")   # of when and where, not of what was found
MAX_NAMED = 12


@dataclass(frozen=True)
class ReportCheck:
    """What was compared, and every fault as a sentence."""

    shown: int          # entries of tables, plots and pictures of the page
    files: int          # whose digests were compared
    faults: tuple[str, ...]


def check_report(config: SessionConfig) -> ReportCheck:
    """Hold report.html against report.json, and both against files and stored results.

    Raises
    ------
    InputError
        If there is no report with its numbers, or no results.
    """
    page, text = (_read(config.folder / name) for name in (PAGE_NAME, NUMBERS_NAME))
    numbers = _parsed(text)
    count, faults = page_faults(page, numbers)
    faults += _named(differences(embedded_numbers(page), numbers),
                     f"{PAGE_NAME} and {NUMBERS_NAME} hold different data at {{}}")
    digests = {name: digest for group in ("session", "files", "results")
               for name, digest in numbers["made_from"].get(group, {}).items()}
    changed = [name for name, digest in digests.items() if _changed(config, name, digest)]
    faults += [f"{name} is not as it was when the report was written: run 'spectrabox run' or "
               "'spectrabox report' again" for name in changed]
    if not changed:
        faults += _named(differences(_comparable(_parsed(_made_again(config).numbers)),
                                     _comparable(numbers)),
                         f"the stored results give another value than {NUMBERS_NAME} at {{}}")
    return ReportCheck(count, len(digests), tuple(faults))


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): write it with 'spectrabox "
                         "report'") from None


def _parsed(text: str) -> dict[str, Any]:
    try:
        numbers = json.loads(text)
        if {"plots", "pictures", "made_from"} <= numbers.keys():
            return dict(numbers)
    except (ValueError, AttributeError, RecursionError):
        pass
    raise InputError(f"{NUMBERS_NAME} does not hold the numbers of a report: write it again with "
                     "'spectrabox report'")


def _named(found: Any, sentence: str) -> list[str]:
    pointers = list(found)
    more = len(pointers) - MAX_NAMED
    return [sentence.format(pointer) for pointer in pointers[:MAX_NAMED]] + (
        [f"... and at {more} other places"] if more > 0 else [])


def _changed(config: SessionConfig, name: str, digest: str) -> bool:
    path = config.folder / name
    return not path.is_file() or sha256_of(path) != digest


def _comparable(numbers: dict[str, Any]) -> dict[str, Any]:
    """What the results decide; digests of drawings only where the same packages drew them."""
    kept = {key: value for key, value in numbers.items() if key not in NOT_OF_RESULTS}
    if (numbers["provenance"].get("versions") or {}).items() >= versions(PACKAGES).items():
        return kept
    return kept | {"plots": {name: plot["axes"] for name, plot in numbers["plots"].items()}}


def _made_again(config: SessionConfig) -> RenderedReport:
    finished = load_finished(config)
    made_by = provenance(["spectrabox", "report"], config.session.seed, "stored results")
    if config.flat:
        from spectrabox.session.flat.assemble import assemble_flat
        from spectrabox.session.report.flat_page import render_flat_report
        return render_flat_report(assemble_flat(config, finished, made_by))
    from spectrabox.session.report.page import render_report
    from spectrabox.session.stages.assemble import assemble
    return render_report(assemble(config, finished, made_by))
