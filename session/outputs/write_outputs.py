"""Writes what a finished run answers: report, spectra, materials and pictures."""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from spectrabox.measure import extras, texts
from spectrabox.measure.advice.advice import advised_of_facts
from spectrabox.measure.captured import SceneCapture
from spectrabox.measure.extras import attempt
from spectrabox.measure.results.scene_result import SceneResult
from spectrabox.radiometry.findings import Finding
from spectrabox.reconstruct.scene.scene_file import SceneFile
from spectrabox.session.box.scenes import write_box_scenes
from spectrabox.session.config.session_file import SessionConfig
from spectrabox.session.kept_stages import FinishedRun
from spectrabox.session.outputs.session_results import session_results
from spectrabox.session.report.page import NUMBERS_NAME, rendered_report, store_report
from spectrabox.session.store.program import provenance
from spectrabox.session.store.surface_files import (
    write_comparisons,
    write_materials,
    write_surface_files,
)


def write_outputs(config: SessionConfig, finished: FinishedRun, command_line: list[str],
                  device: str, advice: dict[str, Any] | None = None
                  ) -> tuple[dict[str, Any], str, list[Path], tuple[Finding, ...]]:
    """Write report, spectra, materials and pictures into the session folder.

    Parameters
    ----------
    config : SessionConfig
    finished : FinishedRun
    command_line : list of str
        As the operator could type it again, without paths.
    device : {"auto", "cpu", "cuda"}
        Where Mitsuba rendered.
    advice : dict, optional
        What to do next, as the facts of the same results had it; forecast anew where it is missing.

    Returns
    -------
    facts : dict
        For scripts.
    text : str
        For a person.
    files : list of Path
        All that were written.
    failed : tuple of Finding
        What could not be made beside the answer; facts and text name it.
    """
    results = session_results(config, finished,
                              provenance(command_line, config.session.seed, device))
    if advice is not None:
        kept = advised_of_facts(advice)
        results = replace(results, found=replace(results.found, advise=lambda: kept))
    found = results.found
    rendered = rendered_report(results)
    report = store_report(rendered, results.folder)
    failed = rendered.failed
    files = [report, report.with_name(NUMBERS_NAME),
             *write_surface_files(found, results.folder, results.name)]
    if isinstance(found, SceneResult) and isinstance(finished.capture, SceneCapture):
        scene = finished.capture.views[0].scene
        files += [write_materials(found, results.folder, finished.capture.bsdfs,
                                  scene if isinstance(scene, SceneFile) else None),
                  *write_box_scenes(config, finished.records.reconstruct.box_scenes)]
        pictures, fault = attempt("comparison of photo and rendering", lambda: write_comparisons(
            found, results.folder), [])
        files += pictures
        failed += () if fault is None else (fault,)
    named = [extras.facts(one) for one in found.failed_extras]
    notes = [f"note: {texts.says(one)}" for one in failed if extras.facts(one) not in named]
    facts = results.facts() | {"failed_extras": [extras.facts(one) for one in failed]}
    return facts, "\n".join([results.text(), *notes]), files, failed
