"""Numbers of finished sessions to follow over months, read from their folders."""
from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np

from spectrabox.measure.comparison import Quantity, SessionQuantities
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import LightScale, LinearImage, SpectrumSummary
from spectrabox.session.config.curve_sources import LightTable
from spectrabox.session.config.session_file import read_session
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.order import stages_of
from spectrabox.session.stages.records import ChartFit, MeasuredChart, SessionRecords
from spectrabox.session.store.store import FACTS, StoredStage, load_stage

MIN_PATCH = 0.03        # of the brightest patch: darker ones are glare and noise
BRIGHTNESS, RESIDUAL, LEFT_OUT, SCALE = ("brightness of the chart", "chart residual",
                                         "patches left out, RMSE", "light scale")


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
    stored = {name: stage for name in stages_of(config)
              if (stage := load_stage(config.results_folder, name)) is not None
              and not stage.fault}
    if not stored:
        raise InputError(f"{folder} has no results of this version: run 'spectrabox run {folder}' "
                         "first")
    records = SessionRecords(stored)
    chart = records.chart.charts.get("")
    quantities: dict[str, Quantity] = {}
    if chart is not None:
        fit = records.calibrate.chart if "calibrate" in stored else None
        quantities |= _of_chart(chart, fit, config)
    if chart is not None and "reconstruct" in stored:
        quantities |= _of_scale(records.reconstruct.joint.views[0].light_scale, chart, config)
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


def _of_chart(chart: MeasuredChart, fit: ChartFit | None,
              config: SessionConfig) -> dict[str, Quantity]:
    """Brightness and colour balance of the chart photo, at one exposure, and how well it fits."""
    samples, photo = chart.samples, chart.thumbnail
    logs, variance = np.log(np.maximum(samples.mean, 1e-12)), np.diagonal(
        samples.covariance_of_mean, axis1=1, axis2=2) / np.maximum(samples.mean, 1e-12) ** 2
    bright = samples.mean.min(axis=1) > MIN_PATCH * samples.mean.max()
    by_band = logs[bright].mean(axis=0) - np.log(_exposure(photo))
    errors = np.sqrt(variance[bright].sum(axis=0)) / max(np.count_nonzero(bright), 1)
    repeats = config.repeatability.relative_error
    found = {BRIGHTNESS: Quantity(float(by_band.mean()),
                                  float(np.linalg.norm(errors) / errors.size), repeats)}
    for band, (value, error) in enumerate(zip(by_band - by_band.mean(), errors, strict=True)):
        found[f"band {band + 1} against the others"] = Quantity(float(value), float(error),
                                                                 repeats / 3)
    if fit is not None:
        off = (samples.mean - fit.predicted) / samples.mean
        residual = float(np.sqrt(np.nanmean(off[bright] ** 2)))
        found[RESIDUAL] = Quantity(residual, 0.0, max(residual / 3, 0.002))
        found[LEFT_OUT] = Quantity(float(fit.left_out.rmse.mean()), 0.0, 0.005)
    return found


def _of_scale(scale: LightScale, chart: MeasuredChart,
              config: SessionConfig) -> dict[str, Quantity]:
    """The light's brightness that the scene was rendered with."""
    exposure = _exposure(chart.thumbnail)
    return {SCALE: Quantity(float(np.log(scale.value / exposure)),
                            float((scale.standard_error or 0.0) / scale.value),
                            config.repeatability.relative_error)}


def _exposure(photo: LinearImage) -> float:
    """Time x ISO / f-number squared, as far as the file says them."""
    exposure = (photo.exposure_s or 1.0) * (photo.iso or 100.0) / 100.0
    return exposure / (photo.f_number or 1.0) ** 2


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
