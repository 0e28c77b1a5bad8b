"""The files that a finished run leaves beside its results, and its answers."""
from __future__ import annotations

from pathlib import Path
from typing import Any

from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.kept_stages import FinishedRun
from spectrabox.session.outputs.assemble import assemble
from spectrabox.session.outputs.facts import run_facts, run_text
from spectrabox.session.outputs.results import SceneResults
from spectrabox.session.report.page import NUMBERS_NAME, write_report
from spectrabox.session.store.program import provenance
from spectrabox.session.store.surface_files import write_surface_files


def write_outputs(config: SessionConfig, finished: FinishedRun, command_line: list[str],
                  device: str) -> tuple[dict[str, Any], str, list[Path]]:
    """Write report, spectra, materials and pictures into the session folder.

    Parameters
    ----------
    config : SessionConfig
    finished : FinishedRun
    command_line : list of str
        As the operator could type it again, without paths.
    device : {"auto", "cpu", "cuda"}
        Where Mitsuba rendered.

    Returns
    -------
    facts : dict
        For scripts.
    text : str
        For a person.
    files : list of Path
        All that were written.
    """
    results = assemble(config, finished, provenance(command_line, config.session.seed, device))
    report = write_report(results)
    facts, text = run_facts(results, report), run_text(results)
    files = write_surface_files(results)
    if isinstance(results, SceneResults):
        # it loads what estimates cameras: OpenCV and SciPy's optimisers
        from spectrabox.session.box.scene_files import write_scene_files
        files += write_scene_files(config)
    return facts, text, [report, report.with_name(NUMBERS_NAME), *files]
