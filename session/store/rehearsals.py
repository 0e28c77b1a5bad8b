"""The last rehearsal of a session, kept among its results as JSON."""
from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.radiometry.files import write_text_whole
from spectrabox.session.config.session_file import SessionConfig
from spectrabox.session.store.record_files import fingerprint, load_stage

if TYPE_CHECKING:
    from spectrabox.measure.scene.rehearsal import Rehearsed

FILE = "rehearsal.json"


def save_rehearsal(config: SessionConfig, rehearsed: Rehearsed) -> Path:
    """Keep a rehearsal among the results, with what it is of."""
    path = config.results_folder / FILE
    write_text_whole(path, json.dumps(rehearsed.facts | {"of": _what(config)}, indent=1))
    return path


def stored_rehearsal(config: SessionConfig) -> Rehearsed | None:
    """The last rehearsal of these results; None where there is none, or of others."""
    try:
        stored = json.loads((config.results_folder / FILE).read_text(encoding="utf-8"))
        if stored.pop("of") != _what(config):
            return None
        from spectrabox.measure.scene.rehearsal import FIGURES, Rehearsed
        materials = stored.pop("materials")
        stored |= {figure: np.array([each[figure] for each in materials]) for figure in FIGURES}
        return Rehearsed(**stored, names=tuple(each["name"] for each in materials))
    except (FileNotFoundError, ValueError, TypeError, AttributeError, KeyError, RecursionError):
        return None


def _what(config: SessionConfig) -> str:
    stored = load_stage(config.results_folder, "sample")
    return "" if stored is None else fingerprint(stored.key)
