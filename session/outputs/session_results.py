"""Everything that a finished session shows: what was found, and what is known of its folder."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.measure.captured import Capture, View
from spectrabox.measure.records import CALIBRATED, CaptureRecords
from spectrabox.measure.results import flat_result, result_of_records, scene_result
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves
from spectrabox.session.config.session_file import SessionConfig
from spectrabox.session.kept_stages import FinishedRun
from spectrabox.session.store import keys, rehearsals


@dataclass(frozen=True)
class UsedFile:
    """An input file of a session; of photos also what the camera says of itself."""

    role: str
    file: str                       # relative to the session folder
    sha256: str
    bytes: int
    exposure_s: float | None = None
    clipped: float | None = None    # share of pixels; None of what is no photo
    facts: Mapping[str, Any] = field(default_factory=dict)     # iso, f_number, camera, kind

    @property
    def numbers(self) -> dict[str, Any]:
        """For JSON."""
        file = {"role": self.role, "file": self.file, "sha256": self.sha256, "bytes": self.bytes}
        if self.clipped is None:
            return file
        return {**file, "exposure_s": self.exposure_s, **self.facts, "clipped": self.clipped}


@dataclass(frozen=True, kw_only=True)
class SessionResults:
    """What the report of a session shows; ``folder`` is the session folder."""

    found: flat_result.FlatResult | scene_result.SceneResult
    folder: Path
    name: str
    operator: str
    notes: str
    inputs: tuple[UsedFile, ...]
    # of the session's last run: name, seconds, and "run", "kept" or "copied"
    stages: tuple[tuple[str, float, str], ...]
    sensitivity_truth: tuple[np.ndarray, np.ndarray] | None  # nm (P,), curves (K, P)
    # PNG of each whole object photo as the camera saw it, by view, "" the first
    previews: Mapping[str, Path]
    chart_overlay: Path               # PNG of the chart, where it was detected
    # versions, command, seed, started, finished, machine facts without paths
    provenance: Mapping[str, Any]
    # the previews in the colours of the calibration, where there are
    calibrated: Mapping[str, Path] = field(default_factory=dict)
    # digests of session.toml, of input files and of stored results
    input_digests: Mapping[str, Any] = field(default_factory=dict)
    # titles of the picture's maps, and a reduced PNG of each
    picture_maps: tuple[tuple[str, Path], ...] = ()

    def facts(self) -> dict[str, Any]:
        """The ``--json`` object of ``run``, ``demo`` and ``flat``."""
        return {"report": str(self.folder / "report.html"),
                "spectra": str(self.folder / "spectra.csv"), **self.found.facts(),
                "stages": [{"name": name, "seconds": seconds, "state": state}
                           for name, seconds, state in self.stages],
                "seconds": float(sum(seconds for _, seconds, state in self.stages
                                     if state == "run"))}

    def text(self) -> str:
        """The same for a person, with all tables; ``found.brief`` is its beginning."""
        return self.found.text(self.name)


def session_results(config: SessionConfig, run: FinishedRun,
                    provenance: Mapping[str, Any]) -> SessionResults:
    """What the stored results of a finished run show.

    Parameters
    ----------
    config : SessionConfig
    run : FinishedRun
    provenance : mapping
        As of ``store.program.provenance``.
    """
    capture, records, folder = run.capture, run.records, config.results_folder
    pictures = config.folder / picture_folder(config)
    maps = () if records.picture is None else tuple(
        (title, pictures / name) for title, name
        in zip(records.picture.titles, records.picture.previews, strict=True))
    return SessionResults(
        found=result_of_records.result_of(capture, records, rehearsals.stored_rehearsal(config),
                        picture_folder(config)),
        folder=config.folder, name=config.session.name, operator=config.session.operator,
        notes=config.session.notes, inputs=_used_files(config, run),
        stages=tuple((name, stage.seconds, run.states[name])
                     for name, stage in run.stored.items()),
        sensitivity_truth=_sensitivity_truth(config),
        previews={view.name: raw_picture(folder, view) for view in capture.views},
        calibrated={view.name: path for view in capture.views
                    if (path := calibrated_picture(folder, view)).is_file()},
        chart_overlay=folder / "chart" / "overlay.png", provenance=provenance,
        input_digests=run.input_digests(config), picture_maps=maps)


def raw_picture(results: Path, view: View) -> Path:
    """PNG of a view's photo as the camera saw it, in a folder of results."""
    return results / "photo" / f"{view.label('preview')}.png"


def calibrated_picture(results: Path, view: View) -> Path:
    """PNG of a view's photo in the colours of its calibration; of a scene, and of a camera of other
    than three bands, there is none.
    """
    return results / "signals" / f"{view.label(CALIBRATED)}.png"


def picture_folder(config: SessionConfig) -> str:
    """Where a picture of spectra lies, relative to the session folder."""
    return (config.results_folder / "picture").relative_to(config.folder).as_posix()


def _sensitivity_truth(config: SessionConfig) -> tuple[np.ndarray, np.ndarray] | None:
    truth = config.sensitivity.truth
    if truth is None or not config.light.spectrum.stated:   # products are no sensitivities
        return None
    nm, _, curves = read_curves(config.path(truth.file), truth.columns)
    values = on_grid(nm, curves, FINE_GRID, truth.file)
    return FINE_GRID.nm, values / values.max()


def _used_files(config: SessionConfig, run: FinishedRun) -> tuple[UsedFile, ...]:
    """Every input file once, with its role, hash, size and what is known of it."""
    roles = keys.input_roles(config)
    hashes = keys.InputFiles(config).digests(*roles)
    photos = _photos_by_file(run.capture, run.records)
    used = []
    for name, role in roles.items():
        file = (role, name, hashes[name], config.path(name).stat().st_size)
        if name not in photos:
            used.append(UsedFile(*file))
            continue
        image = photos[name]
        used.append(UsedFile(*file, image.exposure_s, image.clipped_share,
                             {"iso": image.iso, "f_number": image.f_number,
                              "camera": image.camera, "kind": image.kind.value}))
    return tuple(used)


def _photos_by_file(capture: Capture, records: CaptureRecords) -> dict[str, LinearImage]:
    photos = {view.photo_names[0]: records.photo.photos[view.name] for view in capture.views}
    return photos | {view.chart_names[0]: records.charts[view.name].thumbnail
                     for view in capture.views_with_chart}
