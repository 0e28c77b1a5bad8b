"""Whether to trust a fit: colour differences, what the light cannot see, where the curve comes from."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibrate.camera_prior import CameraPrior
from calibrate.chart_photo import ChartPhoto
from calibrate.colour_difference import ciede2000, lab_from_xyz
from calibrate.prior_fit import posterior_of_curves
from calibrate.sensitivity import PriorFit
from radiometry.appearance import tristimulus
from radiometry.chart import COLUMNS, ROWS
from radiometry.records import WavelengthGrid

FROM_PRIOR = 0.5             # share of the prior's uncertainty that is left: more, and the photo hardly spoke
MUCH_GLARE = 0.02            # of the brightest patch
PROBABLE = 0.05              # families below are not named


def chart_colour_differences(measured: np.ndarray, predicted: np.ndarray, reflectances: np.ndarray,
                             grid: WavelengthGrid) -> np.ndarray:
    """CIEDE2000 (I,) between what the photo shows and what the fit predicts, under D65.

    Signals (I, K) are turned into colours by the linear map that best takes the predicted signals to the tristimulus
    values of the reference reflectances (I, P).
    """
    true = np.array([tristimulus(grid.nm, reflectance) for reflectance in reflectances])
    white = tristimulus(grid.nm, np.ones(grid.nm.size))
    to_xyz, *_ = np.linalg.lstsq(predicted, true, rcond=None)
    return ciede2000(lab_from_xyz(measured @ to_xyz, white), lab_from_xyz(predicted @ to_xyz, white))


def other_readings(photo: ChartPhoto, prior: CameraPrior, grid: WavelengthGrid) -> dict[str, float]:
    """Gain of log evidence if the photo is read mirrored, turned, or with its encoding undone."""
    if len(photo.signal) != ROWS * COLUMNS:
        return {}
    order = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    readings: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "mirrored left to right": lambda signal: signal[order[:, ::-1].ravel()],
        "mirrored top to bottom": lambda signal: signal[order[::-1].ravel()],
        "turned by 180 degrees": lambda signal: signal[order[::-1, ::-1].ravel()],
        "bands in reverse order (BGR)": lambda signal: signal[:, ::-1],
        "an encoded (sRGB) picture instead of a linear one": _decoded}
    as_given = _evidence(photo, photo.signal, prior, grid)
    return {name: _evidence(photo, read(photo.signal), prior, grid) - as_given for name, read in readings.items()}


def sentences(found: PriorFit, grid: WavelengthGrid) -> tuple[str, ...]:
    """What the operator should know before trusting the curves."""
    said = [f"patches and model agree within {found.model_error:.1%} (chi-square {found.chi_square:.2f} per signal)"]
    likely = [(members, share) for members, share in found.families if share > PROBABLE][:3]
    said.append("most like " + "; ".join(f"{members} ({share:.0%})" for members, share in likely))
    held = found.prior_share > FROM_PRIOR
    for band in range(len(held)):
        if held[band].any():
            said.append(f"band {band + 1} rests on the prior over {_ranges(held[band], grid)}")
    state = found.photos[0]
    said.append(f"illumination over the chart found to run from {state.field.min() / state.field.mean():.2f} to "
                f"{state.field.max() / state.field.mean():.2f} of its mean")
    glare = float(np.max(np.abs(state.glare) / state.predicted.max(axis=0)))
    if glare > MUCH_GLARE:
        said.append(f"glare or a wrong black level of {glare:.0%} of the brightest patch was found and taken off: "
                    "shade the lens and check the dark frame")
    return tuple(said)


def _ranges(chosen: np.ndarray, grid: WavelengthGrid) -> str:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(int))).reshape(-1, 2)
    return ", ".join(f"{grid.nm[start]:g}-{grid.nm[stop - 1]:g} nm" for start, stop in edges)


def _evidence(photo: ChartPhoto, signal: np.ndarray, prior: CameraPrior, grid: WavelengthGrid) -> float:
    read = ChartPhoto(signal, photo.covariance, photo.reflectances, photo.power, photo.irradiance, photo.places,
                      photo.glare)
    logarithms = np.log(np.maximum(signal, 1e-12)).sum()  # of log signals, so that readings of any scale compare
    return posterior_of_curves([read], prior, grid).log_evidence + float(logarithms)


def _decoded(signal: np.ndarray) -> np.ndarray:
    """Signals scaled to a white of 0.9 and freed of the sRGB curve (IEC 61966-2-1)."""
    encoded = 0.95 * signal / signal.max()
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
