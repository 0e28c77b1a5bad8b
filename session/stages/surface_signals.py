"""What any session says of its surfaces, as samplers and error budgets take it."""
from __future__ import annotations

from collections.abc import Mapping

from spectrabox.measure.surface_signals import scene_signals
from spectrabox.radiometry.records import SurfaceSignals
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.stored_records import calibrations_of, joint_of, signals_of
from spectrabox.session.store.store import StoredStage


def surface_signals(config: SessionConfig, stored: Mapping[str, StoredStage]) -> SurfaceSignals:
    """Signals of all surfaces of a session, of a flat sample or of a scene, with their errors."""
    if config.flat:
        return signals_of(stored)
    return scene_signals(joint_of(stored), calibrations_of(config, stored))
