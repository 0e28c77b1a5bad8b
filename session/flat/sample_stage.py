"""The stage that draws: every spectrum behind each region's signal."""
from __future__ import annotations

from typing import Any

from spectrabox.measure.surface_signals import measurement
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.session.stages.drawing import drawn_and_summarised
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import signals_of


def sample_regions(task: StageTask) -> dict[str, Any]:
    """Draws from all spectra behind each unknown region's signal, and their summary.

    Returns
    -------
    dict
        Of every unknown region its "samples NAME" and "summary NAME".
    """
    signals, config = signals_of(task.stored), task.config
    prior = load_prior()
    records: dict[str, Any] = {}
    for index, name in enumerate(signals.names):
        if not signals.known[index]:
            task.progress(index / len(signals.names), name)
            records |= drawn_and_summarised(config, name, measurement(signals, index),
                                            config.session.seed + index, prior)
    return records
