"""How good a recovered spectrum and its band are against the truth, whoever recovered it."""


from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from spectrabox.radiometry import grid as grids
from spectrabox.radiometry.appearance import ciede2000, lab_from_xyz
from spectrabox.radiometry.records.spectra import SpectralMeasurement, WavelengthGrid
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.sampling import spectral_measurement, summary
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.published.baselines import baseline_spectra, greedy_draws

TINY = 1e-12


def rmse(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Root-mean-square error (n,) of each spectrum (n, P).

    Parameters
    ----------
    estimate : (n, P) array
        Reflectances.
    truth : (n, P) array
        True reflectances.
    """
    return np.sqrt(np.mean((estimate - truth)**2, axis=-1))


def spectral_angle(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Angle (n,) in radians between spectra (n, P): 0 for equal shapes, whatever their level; a
    right one to black.

    Parameters
    ----------
    estimate : (n, P) array
        Reflectances.
    truth : (n, P) array
        True reflectances.
    """
    product = np.sum(estimate * truth, axis=-1)
    lengths = np.linalg.norm(estimate, axis=-1) * np.linalg.norm(truth, axis=-1)
    return np.arccos(np.clip(product / np.maximum(lengths, TINY), -1, 1))


def coverage(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray) -> float:
    """Fraction of wavelengths at which bands (n, P) hold the truth.

    Parameters
    ----------
    lower : (n, P) array
        Lower end of the bands.
    upper : (n, P) array
        Upper end of the bands.
    truth : (n, P) array
        True reflectances.
    """
    return float(np.mean((truth >= lower) & (truth <= upper)))


def curve_coverage(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray) -> float:
    """Fraction of curves that lie wholly within their bands (n, P).

    Parameters
    ----------
    lower : (n, P) array
        Lower end of the bands.
    upper : (n, P) array
        Upper end of the bands.
    truth : (n, P) array
        True reflectances.
    """
    return float(np.mean(np.all((truth >= lower) & (truth <= upper), axis=-1)))


def winkler_score(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray,
                  level: float = 0.95) -> float:
    """Mean width plus 2 / (1 - level) times what the truth lies outside (Gneiting and Raftery 2007,
    Eq. 43).

    Parameters
    ----------
    lower : (n, P) array
        Lower end of the bands.
    upper : (n, P) array
        Upper end of the bands.
    truth : (n, P) array
        True reflectances.
    level : float
        Probability of the band, 0 to 1.
    """
    outside = np.maximum(lower - truth, 0) + np.maximum(truth - upper, 0)
    return float(np.mean(upper - lower + 2 / (1 - level) * outside))


def coverage_error(inside: np.ndarray) -> float:
    """Standard error of a coverage from which curves (n, P) bool held the truth where: curves are
    independent.

    Parameters
    ----------
    inside : (n, P) bool array
        Whether each band held the truth.
    """
    per_curve = inside.mean(axis=1)
    if len(per_curve) < 2:
        return float("nan")
    return float(per_curve.std(ddof=1) / np.sqrt(len(per_curve)))


def sharpness(spectra: np.ndarray) -> float:
    """Mean width of the central 50 % band of draws (T, P), whatever the truth is (Gneiting et al.
    2007, Sec. 3.3).

    Parameters
    ----------
    spectra : (T, P) array
        Reflectances.
    """
    lower, upper = np.quantile(spectra, [0.25, 0.75], axis=0)
    return float(np.mean(upper - lower))


def curve_band(spectra: np.ndarray, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper (P,) of a band that holds that share of whole draws (T, P): the pointwise
    band, widened about the mean by one factor.

    Parameters
    ----------
    spectra : (T, P) array
        Reflectances.
    level : float
        Probability of the band, 0 to 1.
    """
    mean = spectra.mean(axis=0)
    lower, upper = np.quantile(spectra, [(1 - level) / 2, (1 + level) / 2], axis=0)
    below, above = np.maximum(mean - lower, TINY), np.maximum(upper - mean, TINY)
    factor = np.quantile(np.max(np.maximum((mean - spectra) / below, (spectra - mean) / above),
                                axis=1), level)
    return mean - factor * below, mean + factor * above


def best_scale(estimate: np.ndarray, truth: np.ndarray) -> float:
    """The one factor that brings an estimate (P,) nearest to the truth, as for a picture of unknown
    exposure.

    Parameters
    ----------
    estimate : (n, P) array
        Reflectances.
    truth : (n, P) array
        True reflectances.
    """
    return float(estimate @ truth / max(estimate @ estimate, TINY))


def delta_e00_under(lights: Sequence[str], grid: WavelengthGrid, estimate: np.ndarray,
                    truth: np.ndarray) -> dict[str, np.ndarray]:
    """CIEDE2000 differences (n,) of reflectances (n, P) under each light, by its name (CIE 1931 2
    degree observer).

    Integrated over the grid alone; white is a reflectance of 1, to whose colour the eye is taken to
    be adapted.

    Parameters
    ----------
    lights : sequence of str
        CIE names.
    grid : WavelengthGrid
        Of P wavelengths.
    estimate : (n, P) array
        Reflectances.
    truth : (n, P) array
        True reflectances.
    """
    fine = grids.visible_grid(1)
    differences = {}
    for name in lights:
        relative_response = named_spectra.relative_response(
            "CIE 1931 2 Degree Standard Observer", name, fine) \
            @ grids.interpolation_matrix(grid.nm, fine.nm)
        differences[name] = ciede2000(
            *(lab_from_xyz(np.maximum(spectra @ relative_response.T, 0), np.ones(3))
              for spectra in (estimate, truth)))
    return differences


# ---- recovered spectra judged against the truth by the same measures, whoever recovered them -----

LEVEL = 0.95
BAND_DRAWS = round(2 * summary.TAIL_DRAWS / (1 - LEVEL))  # fewer give no band, for us as for others
GREEDY = "Belcour-style greedy"
Estimate = tuple[np.ndarray, np.ndarray | None]      # mean (61,) and draws (T, 61), if any
POINT_SCORES = (("rmse", "RMSE"), ("rmse_best_scale", "scaled"), ("spectral_angle", "angle"))
BAND_SCORES = (("coverage", "95 % holds"), ("whole_curve", "whole"), ("width", "width"),
                 ("sharpness", "50 % w."), ("winkler", "Winkler"))


# signal or region, method, and its scores by name, as ``judged`` gives them
ScoredSpectrum = tuple[str, str, dict[str, Any]]


def judged(nm: np.ndarray, truth: np.ndarray, estimate: np.ndarray, lights: tuple[str, ...],
           draws: np.ndarray | None = None) -> dict[str, Any]:
    """Scores of one recovered spectrum: how near it is to the truth.

    Parameters
    ----------
    nm : (P,)
    truth, estimate : (P,)
    lights : names
        Of the colour differences.
    draws : (T, P), optional
        What the estimate is the mean of. Fewer than 1000 give no band.

    Returns
    -------
    dict
        ``rmse``, and ``rmse_best_scale`` after the one best factor; ``spectral_angle`` in radians;
        ``delta_e00``, CIEDE2000 by light. None without a band: ``coverage``, the share of
        wavelengths in the 95 % band; ``whole_curve``, whether the widened band that holds 95 % of
        whole draws holds the whole truth; ``width`` of the 95 % band and ``sharpness``, that of the
        50 % band; ``winkler``, the interval score.
    """
    differences = delta_e00_under(lights, grids.grid_from_nm(nm), estimate[None], truth[None])
    scores: dict[str, Any] = {
        "rmse": float(rmse(estimate, truth)),
        "spectral_angle": float(spectral_angle(estimate, truth)),
        "rmse_best_scale": float(rmse(best_scale(estimate, truth) * estimate, truth)),
        "delta_e00": {light: float(values[0]) for light, values in differences.items()},
        **dict.fromkeys(dict(BAND_SCORES))}
    if draws is None or len(draws) < BAND_DRAWS:
        return scores
    lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    widest = curve_band(draws, LEVEL)
    return scores | {
        "coverage": coverage(lower, upper, truth),
        "whole_curve": bool(np.all((truth >= widest[0]) & (truth <= widest[1]))),
        "width": float(np.mean(upper - lower)), "sharpness": sharpness(draws),
        "winkler": winkler_score(lower, upper, truth, LEVEL)}


def baselines(measurement: SpectralMeasurement, draws: int, seed: int,
              coefficients: int) -> dict[str, Estimate | None]:
    """Single spectra of other authors, and a greedy sampler's mean and draws; None if it has none.
    """
    c, _ = greedy_draws(spectral_measurement.spline_operator(measurement, coefficients), draws,
                        seed)
    spectra = c @ grids.basis_matrix(PRIOR_GRID.nm, coefficients).T
    greedy = (spectra.mean(axis=0), spectra) if len(spectra) else None
    singles = {name: (spectrum, None) for name, spectrum in baseline_spectra(measurement).items()}
    return {**singles, GREEDY: greedy}


def judgement_text(rows: Sequence[ScoredSpectrum]) -> str:
    """A table of judged spectra, one a row."""
    widths = [max(6, *(len(region) for region, _, _ in rows)),
              max(6, *(len(method) for _, method, _ in rows))]
    lights = tuple(rows[0][2]["delta_e00"])
    lines = [f"{'region':<{widths[0]}} {'method':<{widths[1]}} "
             + " ".join(f"{label:>7}" for _, label in POINT_SCORES)
             + "".join(f" {'dE ' + light:>9}" for light in lights)
             + "".join(f" {label:>10}" for _, label in BAND_SCORES)]
    for region, method, scores in rows:
        cells = [f"{region:<{widths[0]}} {method:<{widths[1]}}",
                 *(f"{scores[name]:7.4f}" for name, _ in POINT_SCORES),
                 *(f"{scores['delta_e00'][light]:9.2f}" for light in lights),
                 *(f"{_cell(scores[name]):>10}" for name, _ in BAND_SCORES)]
        lines.append(" ".join(cells))
    return "\n".join(lines)


def _cell(value: float | bool | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.3f}"
