"""The paper's sampler from a least-squares start, one of the METHODS, for comparison."""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.errors import ConvergenceError
from spectrabox.radiometry.records import Outcome, SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.checks import check_draw_count, check_measurement
from spectrabox.sampling.polytope.tilt import check_operator
from spectrabox.sampling.prior.mixture import LogitMixture
from spectrabox.sampling.published.per_axis_box import METHOD, sample_per_axis
from spectrabox.sampling.spline_measurement import (
    MeasurementOperator,
    nearest_coefficients,
    spline_operator,
)
from spectrabox.sampling.uniform import as_spectra


def sample_published(measurement: SpectralMeasurement, draws: int, seed: int, coefficients: int,
                     prior: LogitMixture | None = None, *,
                     unbounded_start: bool = False) -> SpectrumSamples:
    """Draws as published (Sec. 3.2); see `sampling.draw_methods.draw_spectra`.

    ``prior`` is not used. The start is bounded least squares or, with ``unbounded_start`` and as
    printed, unbounded least squares.

    Raises
    ------
    ConvergenceError
        If the unbounded start leaves [0, 1].
    """
    check_measurement(measurement)
    check_draw_count(draws)
    operator = spline_operator(measurement, coefficients)
    check_operator(operator)
    start = _unbounded(operator) if unbounded_start else _bounded(operator)
    box = sample_per_axis(operator, start, draws, seed)
    sentence = Outcome.AS_PUBLISHED.value
    if box.outcome is not Outcome.CONVERGED:
        sentence += f" {box.outcome.value}"
    return as_spectra(box, METHOD, seed, Outcome.AS_PUBLISHED, sentence)


def _bounded(operator: MeasurementOperator) -> np.ndarray:
    return nearest_coefficients(operator.A, operator.y)


def _unbounded(operator: MeasurementOperator) -> np.ndarray:
    start = np.linalg.lstsq(operator.A, operator.y, rcond=None)[0]
    if np.any((start < 0) | (start > 1)):
        raise ConvergenceError(f"the unbounded least-squares start runs from {start.min():.3g} to "
                               f"{start.max():.3g}, outside 0 to 1, where the published sampler "
                               "has no draws; use the bounded start")
    return start
