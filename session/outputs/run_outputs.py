"""Report, spectra and pictures of a finished run, written again only where something has changed.

Their inputs and the digest of every file are stored with the stages' results. The files are kept
while the inputs are unchanged and no file has been edited.
"""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from spectrabox.radiometry import errors, files, findings
from spectrabox.session.config.session_file import SessionConfig
from spectrabox.session.kept_stages import FinishedRun
from spectrabox.session.store import keys, locks, record_files, rehearsals
from spectrabox.session.terminal.progress_display import StageProgress


def write_outputs(config: SessionConfig, finished: FinishedRun, command_line: list[str],
                  device: str, advice: dict[str, Any] | None = None
                  ) -> tuple[dict[str, Any], str, str, list[Path], tuple[findings.Finding, ...]]:
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
    brief, text : str
        For a person: in short, and with all tables.
    files : list of Path
        All that were written.
    failed : tuple of Finding
        What could not be made beside the answer; facts and text name it.
    """
    # what makes a report takes seconds to import, and a run that finds all up to date makes none
    from spectrabox.measure import captured, extras, texts
    from spectrabox.measure.advice.advice import advised_of_facts
    from spectrabox.measure.extras import attempt
    from spectrabox.measure.results.scene_result import SceneResult
    from spectrabox.reconstruct.scene.scene_file import SceneFile
    from spectrabox.session.box.scenes import write_box_scenes
    from spectrabox.session.outputs.session_results import session_results
    from spectrabox.session.report import page
    from spectrabox.session.store import surface_files
    results = session_results(config, finished,
                              keys.provenance(command_line, config.session.seed, device))
    if advice is not None:
        kept = advised_of_facts(advice)
        results = replace(results, found=replace(results.found, advise=lambda: kept))
    result = results.found
    rendered, numbers, failed = page.rendered_report(results)
    report = page.store_report(rendered, numbers, results.folder)
    files = [report, report.with_name(page.NUMBERS_NAME),
             *surface_files.write_surface_files(result, results.folder, results.name)]
    if isinstance(result, SceneResult) and isinstance(finished.capture, captured.SceneCapture):
        scene = finished.capture.views[0].scene
        files += [surface_files.write_materials(result, results.folder, finished.capture.bsdfs,
                                                scene if isinstance(scene, SceneFile) else None,
                                                config.folder / result.picture_folder),
                  *write_box_scenes(config, finished.records.reconstruct.box_scenes)]
        pictures, fault = attempt("comparison of photo and rendering",
                                  lambda: surface_files.write_comparisons(result, results.folder),
                                  [])
        files += pictures
        failed += () if fault is None else (fault,)
    named = [extras.facts(one) for one in result.failed_extras]
    notes = [f"note: {texts.says(one)}" for one in failed if extras.facts(one) not in named]
    facts = results.facts() | {"failed_extras": [extras.facts(one) for one in failed]}
    return (facts, "\n".join([results.found.brief(), *notes]),
            "\n".join([results.text(), *notes]), files, failed)


# ---- run outputs ---------------------------------------------------------------------------------

STAGE = "report"


# Facts for scripts, a text for a person in short and with all tables, and what could not be made
# beside them, which all name.
Outputs = tuple[dict[str, Any], str, str, tuple[findings.Finding, ...]]


def kept_outputs(config: SessionConfig, finished: FinishedRun) -> Outputs | None:
    """Answers of the files beside the results; None unless all of them are those of this run, and
    no extra failed in it, which is tried again.
    """
    stored = record_files.load_stage(config.results_folder, STAGE)
    if stored is None or stored.fault or set(finished.states.values()) != {"kept"} \
            or stored.facts["facts"]["failed_extras"] \
            or stored.key != _key(config, finished, keys.InputFiles(config)):
        return None
    if not all((config.folder / name).is_file() for name in stored.facts["outputs"]):
        return None
    stages = [{"name": name, "seconds": stage.seconds, "state": "kept"}
              for name, stage in finished.stored.items()]
    report = {name: str(config.folder / stored.facts["facts"][name])
              for name in ("report", "spectra")}
    end = f"report: {report['report']}"
    return ({**stored.facts["facts"], **report, "stages": stages},
            f"{stored.facts['brief']}\n{end}", f"{stored.facts['text']}\n{end}", ())


def outputs_of_run(config: SessionConfig, finished: FinishedRun, command_line: list[str],
                   device: str, progress: StageProgress) -> Outputs:
    """Answers of a run that has just ended; its files are written where they are not up to date.

    Parameters
    ----------
    command_line, device
        As of ``rewritten_outputs``.
    """
    outputs = kept_outputs(config, finished)
    if outputs is not None:
        progress("report", 1.0, "up to date")
        return outputs
    progress("report", 0.0, "")
    outputs = rewritten_outputs(config, finished, command_line, device)
    progress("report", 1.0, outputs[0]["report"])
    return outputs


def rewritten_outputs(config: SessionConfig, finished: FinishedRun, command_line: list[str],
                      device: str) -> Outputs:
    """Write report, spectra, materials and pictures into the session folder.

    Parameters
    ----------
    command_line : list of str
        For the report, as the operator could type it again, without paths.
    device : {"auto", "cpu", "cuda"} or "stored results"
        For the report: where Mitsuba rendered.
    """
    inputs = keys.InputFiles(config)
    key = _key(config, finished, inputs)
    with locks.outputs_writer(config.folder):
        facts, brief, text, files, failed = write_outputs(config, finished, command_line, device,
                                                   _kept_advice(config, key))
        inputs.require_unchanged(key["files"])
        require_results(finished, "spectrabox report")
        written = [path.relative_to(config.folder).as_posix() for path in files]
        names = {name: Path(facts[name]).name for name in ("report", "spectra")}
        with record_files.stage_folder(config.results_folder, STAGE) as folder:
            record_files.save_stage(folder, key, {}, 0.0,
                       {"outputs": written, "facts": {**facts, **names}, "brief": brief,
                        "text": text})
    end = f"report: {facts['report']}"
    return facts, f"{brief}\n{end}", f"{text}\n{end}", failed


def _kept_advice(config: SessionConfig, key: dict[str, Any]) -> dict[str, Any] | None:
    """What to do next as it was forecast, which takes as long as a fit; None unless it is of the
    same results and by the same library, and did not fail.
    """
    stored = record_files.load_stage(config.results_folder, STAGE)
    if stored is None or stored.fault or stored.key.get("stages") != key["stages"] \
            or any(stored.key["code"].get(room) != key["code"][room] for room in keys.LIBRARY) \
            or any(one["extra"] == "advice" for one in stored.facts["facts"]["failed_extras"]):
        return None
    return stored.facts["facts"]["advice"]


def require_results(finished: FinishedRun, command: str) -> None:
    """Refuse to write files of results that a run has replaced since.

    Parameters
    ----------
    command : str
        What to run again.

    Raises
    ------
    InputError
    """
    now = {
        name: record_files.load_stage(stage.folder.parent, name)
        for name, stage in finished.stored.items()
    }
    if any(stage is None or stage.key != finished.stored[name].key for name, stage in now.items()):
        raise errors.InputError(
            f"results changed while they were used; run '{command}' again once the "
            "run has ended")


def _key(config: SessionConfig, finished: FinishedRun, inputs: keys.InputFiles) -> dict[str, Any]:
    """Inputs of the files: session.toml, spectra to compare with, results, the last rehearsal, and
    the program.
    """
    rehearsal = config.results_folder / rehearsals.FILE
    curves = config.sensitivity.truth
    # as they were read: the files may have been edited since
    truths = {name: surface.truth for name, surface in finished.capture.surfaces.items()}
    settings = config.model_dump(mode="json", exclude={"folder", "allow_outside"})
    return {"settings": settings, "truths": keys.digest_of_parts(truths),
            "files": inputs.digests(None if curves is None else curves.file),
            "stages": finished.fingerprints(),
            "rehearsal": files.sha256_of(rehearsal) if rehearsal.is_file() else "",
            "versions": keys.versions(), "code": keys.room_digests((*keys.LIBRARY, "session"))}
