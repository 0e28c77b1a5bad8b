"""Numbers of finished sessions to follow over months, read from their folders."""
from __future__ import annotations

import datetime
from pathlib import Path

from spectrabox.measure.chart_quantities import (
    SCALE,
    chart_quantities,
    fit_quantities,
    scale_quantity,
)
from spectrabox.measure.comparison import Quantity, SessionQuantities
from spectrabox.measure.records import CaptureRecords
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import SpectrumSummary
from spectrabox.session.config.curve_sources import LightTable
from spectrabox.session.config.session_file import read_session
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.pipeline import stage_names
from spectrabox.session.store.store import FACTS, StoredStage, load_stage


def session_quantities(folder: Path, allow_outside: bool = False) -> SessionQuantities:
    """The numbers of a session that has at least its chart stage.

    Parameters
    ----------
    folder : Path
        With a session.toml and results.

    Raises
    ------
    InputError
        If there is no session, or none of its stages has results that are whole.
    """
    config = read_session(folder, allow_outside)
    stored = {name: stage for name in stage_names(config)
              if (stage := load_stage(config.results_folder, name)) is not None
              and not stage.fault}
    if not stored:
        raise InputError(f"{folder} has no results of this version: run 'spectrabox run {folder}' "
                         "first")
    records = CaptureRecords(stored)
    chart = records.chart.charts.get("")
    quantities: dict[str, Quantity] = {}
    if chart is not None:
        repeats = config.repeatability.relative_error
        quantities |= chart_quantities(chart.samples, chart.thumbnail, repeats)
        if "calibrate" in stored and (fit := records.calibrate.chart) is not None:
            quantities |= fit_quantities(chart.samples, fit.predicted, fit.left_out.rmse)
        if "reconstruct" in stored:
            quantities[SCALE] = scale_quantity(records.reconstruct.joint.views[0].light_scale,
                                               chart.thumbnail, repeats)
    newest = max((stage.folder / FACTS).stat().st_mtime for stage in stored.values())
    finished = datetime.datetime.fromtimestamp(newest, datetime.UTC).isoformat(timespec="seconds")
    return SessionQuantities(folder, config.session.name,
                             "" if chart is None else chart.thumbnail.camera,
                             _light_words(config.light.spectrum), finished, quantities,
                             _spectra(config, stored))


def find_sessions(root: Path, depth: int = 4) -> list[Path]:
    """Folders under a root that hold a session.toml, in the order of their names.

    Parameters
    ----------
    root : Path
    depth : int
        How many folders deep to look; links are not followed.

    Raises
    ------
    InputError
        If the root is no folder.
    """
    if not root.is_dir():
        raise InputError(f"{root} is no folder; give the one that holds the sessions")
    found, level = [], [root]
    for _ in range(depth + 1):
        found += [folder for folder in level if (folder / "session.toml").is_file()]
        level = sorted(one for folder in level for one in _folders(folder)
                       if not (folder / "session.toml").is_file())
    return sorted(found)


def _folders(folder: Path) -> list[Path]:
    try:
        return [one for one in folder.iterdir() if one.is_dir() and not one.is_symlink()
                and not one.name.startswith(".")]
    except OSError:
        return []


def _spectra(config: SessionConfig, stored: dict[str, StoredStage]) -> dict[str, SpectrumSummary]:
    if "sample" not in stored:
        return {}
    drawn = stored["sample"].facts["records"]["spectra"]
    return {name: stored["sample"].read(SpectrumSummary, "spectra", name, "summary")
            for name in config.surfaces if name in drawn}


def _light_words(light: LightTable) -> str:
    if light.cct is not None:
        return f"{light.cct:g} K"
    return str(light.word or light.file)
