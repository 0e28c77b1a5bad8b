"""Stored results of a finished run to what the report shows."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.measure.captured import FlatCapture
from spectrabox.measure.verdict.evidence_of_records import (
    flat_evidence,
    scene_evidence,
    warnings_of,
)
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.kept_stages import FinishedRun
from spectrabox.session.outputs.results import FlatResults, SceneResults, SessionResults
from spectrabox.session.pictures.picture_results import picture_of
from spectrabox.session.store.input_files import InputFiles
from spectrabox.session.store.input_roles import input_roles
from spectrabox.session.store.rehearsals import stored_rehearsal


def assemble(config: SessionConfig, run: FinishedRun,
             provenance: dict[str, Any]) -> SessionResults:
    """Everything the report shows.

    Parameters
    ----------
    config : SessionConfig
    run : FinishedRun
    provenance : dict
        As of ``store.program.provenance``.
    """
    capture, records, folder = run.capture, run.records, config.results_folder
    evidence = flat_evidence(capture, records) if isinstance(capture, FlatCapture) else \
        scene_evidence(capture, records, stored_rehearsal(config))
    signals = records.signals
    shown: dict[str, Any] = {
        **vars(evidence), "folder": config.folder, "name": config.session.name,
        "operator": config.session.operator, "notes": config.session.notes, "grid": signals.grid,
        "inputs": _input_files(config, run), "sensitivity_truth": _sensitivity_truth(config),
        "previews": {view.name: folder / "photo" / f"{view.label('preview')}.png"
                     for view in capture.views},
        "chart_overlay": folder / "chart" / "overlay.png",
        "signal_bands": signals.bands if capture.flat or len(capture.views) > 1
        else evidence.bands,
        "provenance": provenance, "input_digests": run.input_digests(config),
        "warnings": warnings_of(capture, records, evidence.materials),
        "stages": [{"name": name, "seconds": stage.seconds, "state": run.states[name]}
                   for name, stage in run.stored.items()],
        "picture": picture_of(config, records.picture), "swatches": records.sample.swatches}
    if isinstance(capture, FlatCapture):
        return FlatResults(**shown)
    geometry = records.reconstruct.geometry
    return SceneResults(**shown, geometry=geometry if geometry.placements else None)


def _sensitivity_truth(config: SessionConfig) -> tuple[np.ndarray, np.ndarray] | None:
    truth = config.sensitivity.truth
    if truth is None or not config.light.spectrum.stated:   # products are no sensitivities
        return None
    nm, _, curves = read_curves(config.path(truth.file), truth.columns, truth.wavelength_column)
    values = on_grid(nm, curves, FINE_GRID, truth.file)
    return FINE_GRID.nm, values / values.max()


def _input_files(config: SessionConfig, run: FinishedRun) -> list[dict[str, Any]]:
    """Every input file once, with its role, hash, size and what is known of it."""
    roles = input_roles(config)
    hashes = InputFiles(config).digests(*roles)
    charts, photos = run.records.chart.charts, run.records.photo.photos
    facts = {view.photo_names[0]: photos[view.name] for view in run.capture.views}
    facts |= {view.chart_names[0]: charts[view.name].thumbnail
              for view in run.capture.views_with_chart}
    return [{"role": role, "file": name, "sha256": hashes[name],
             "bytes": config.path(name).stat().st_size}
            | ({} if (image := facts.get(name)) is None else
               {"exposure_s": image.exposure_s, "iso": image.iso, "f_number": image.f_number,
                "camera": image.camera, "kind": image.kind.value,
                "clipped": float(image.saturated.any(axis=2).mean())})
            for name, role in roles.items()]
