"""Everything that a finished session of flat samples leaves beside its results."""
from __future__ import annotations

from pathlib import Path
from typing import Any

from spectrabox.radiometry.files import writable, write_text_whole
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.flat.assemble import assemble_flat
from spectrabox.session.flat.facts import flat_facts, flat_text
from spectrabox.session.pipeline import FinishedRun
from spectrabox.session.report.page import NUMBERS_NAME, write_report
from spectrabox.session.store.program import provenance
from spectrabox.session.store.spectra_table import spectra_files


def write_flat_outputs(config: SessionConfig, finished: FinishedRun, command_line: list[str],
                       device: str) -> tuple[dict[str, Any], str, list[Path]]:
    """Write report and spectra into the session folder; as ``write_outputs.write_outputs_of``."""
    results = assemble_flat(config, finished,
                            provenance(command_line, config.session.seed, device))
    report = write_report(results)
    with writable(results.folder):
        (results.folder / "spdx").mkdir(exist_ok=True)
    texts = spectra_files(results, results.signals.grid.nm)
    for path, text in texts.items():
        write_text_whole(path, text)
    return flat_facts(results, report), flat_text(results), [
        report, report.with_name(NUMBERS_NAME), *texts]
