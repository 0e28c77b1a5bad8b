"""What every engine answers for one view."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.records import Outcome, RegionTransport


@dataclass(frozen=True, eq=False)
class EngineAnswer:
    """The solution for one view, before it is compared with the photo."""

    coefficients: np.ndarray        # (U, N)
    signals: np.ndarray             # (U, K) relative to white: what the photo says of them
    signal_covariance: np.ndarray   # (U, K, K)
    # (A, H, W, K) for a light scale of 1: independent renderings, whose mean is the picture
    renderings: np.ndarray
    loss_history: np.ndarray
    engine: str
    spp: int
    outcome: Outcome
    notes: tuple[str, ...] = ()     # sentences on what is measured and what assumed
    # light scale and its standard error, where no known material tells
    scale: tuple[float, float | None] = (1.0, None)
    regions: RegionTransport | None = None  # for the samplers, where light was traced
