"""What makes a calibration doubtful although some camera explains its chart photos.

Unlike cameras: the prior's last component, of a camera unlike those measured, explains the photos
best.

Wrong light: the mixture of ``products`` is asked twice, with the stated lamps alone under every
camera (one spectrum, or all of a kind), and with all known lamps. A right statement explains the
photo better than the average lamp does; a wrong one has to be explained by a camera that no maker
built. Which kind of lamp the photo shows, whatever was stated, comes of the second.

Colour matrix: an alarm for a mistaken light. Makers and converters state a matrix from X, Y, Z to
the camera's R, G and B in daylight. The curves predict it as the least-squares map over the patches
of a ColorChecker under D65. Stated and predicted matrix are compared along the principal axes of
the patches' X, Y, Z, each band by its own brightness, so that the first column is the camera's
white balance.

Matrices are rough: those of 37 measured cameras depart from what the measured curves predict by
``TYPICAL`` in the mean and ``SPREAD`` about it (``benchmarks/bench_colour_matrix.py``), as much as
cameras differ. As evidence besides a chart photo a matrix therefore changes nothing. But it knows
the camera without the light that the photo was taken by: curves that were fitted under the spectrum
of another lamp contradict it by far.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spectrabox.calibrate import chart_photo, colour_drift, sensitivity
from spectrabox.calibrate.chart_equations import COLOURS, ChartEquations
from spectrabox.calibrate.prior import camera_prior, curve_posterior, learnt_prior
from spectrabox.calibrate.products import product_fit, product_posterior
from spectrabox.calibrate.products.lamps import Lamps, all_lamps, likeness, product_prior
from spectrabox.radiometry import appearance, chart, chart_causes
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.spectra import UnknownLight, WavelengthGrid
from spectrabox.radiometry.spectra import light_words, named_spectra

SURELY = 0.9                 # probability of an unlike camera above which something may be wrong
# nats for another lamp, of photos of lamps of the prior by cameras of makers outside it: exceeded
# by right spectra in 2 % of cases (benchmarks/bench_unknown_light.py --shipped --naming)
CONTRADICTS = 7.0
# the same of a stated kind or temperature, by ``EVIDENCE_POWER`` of the evidence: 1 to 3 % of right
# ones exceed it (benchmarks/bench_light_kinds.py --probabilities)
KIND_CONTRADICTS = 2.0
SAYS_LITTLE = 0.5            # nats, either way
UNDECIDED_CAUSE = "calibration.cause"
# of white: how far the curves of a fit, which give a cause its part, are from what a band holds of
# another
MIXING_SD = 0.05
NAMED_BANDS = 3              # at most, that disagree most
UNKNOWN_KIND = 0             # of the stated lamp: no kind is asked for
# Rows R, G, B; shares of each band's brightness.
TYPICAL = np.array([[0.030, 0.033, 0.041], [0.010, 0.016, -0.003], [-0.037, 0.003, 0.016]])
SPREAD = np.array([[0.059, 0.031, 0.044], [0.019, 0.013, 0.016], [0.038, 0.027, 0.009]])
FREEDOM = 8                  # nine entries less a common scale
DOUBTFUL = 4.5               # mean square in spreads; 1 in 20 cameras with the right light


def unlike_cameras(fit: sensitivity.PriorFit) -> Finding:
    """Whether the photos are explained by a camera unlike those measured alone.

    Parameters
    ----------
    fit : PriorFit
    """
    share = float(dict(fit.families).get(learnt_prior.UNLIKE, 0.0))
    if share > SURELY and len(fit.families) > 1:
        return Finding("calibration.unlike-cameras", Severity.WARN, values={"probability": share})
    return Finding("calibration.like-cameras", Severity.INFO, values={"probability": share})


def light_evidence(stated: str, against: float, limit: float,
                   kinds: np.ndarray) -> Finding:
    """Whether chart photos speak for the light that was stated of them or against it.

    Parameters
    ----------
    stated : str
        The statement, for sentences.
    against : float
        Nats: how much better all known lamps explain the photos.
    limit : float
        Nats: above it the statement is wrong all but certainly.
    kinds : (Q,) array
        Probabilities of ``light_words.LIGHT_KINDS``, whatever was stated.
    """
    code, severity = "light.agrees", Severity.INFO
    if against > limit:
        code, severity = "light.contradicted", Severity.WARN
    elif against > SAYS_LITTLE:
        code, severity = "light.leans", Severity.NOTE
    elif against > -SAYS_LITTLE:
        code = "light.hardly-tested"
    return Finding(code, severity, values={
        "stated": stated, "against": against, "limit": limit,
        "kinds": dict(zip(light_words.LIGHT_KINDS, kinds.tolist(), strict=True))})


def evidence_on_spectrum(stated: str, photo: ChartEquations, cameras: camera_prior.CameraPrior,
                         grid: WavelengthGrid) -> Finding:
    """The evidence of a chart photo on the spectrum that was stated of its light.

    Parameters
    ----------
    stated : str
        Of the light, for sentences.
    photo : ChartEquations
        With the stated spectrum in its ``power``.
    cameras : CameraPrior
    grid : WavelengthGrid
        Working grid, every nm from 400 to 700 nm.
    """
    spectrum, unlit = photo.power / grid.weights_nm, [replace(photo, power=grid.weights_nm)]
    alone = Lamps((spectrum / spectrum.mean())[None], np.array([UNKNOWN_KIND]), np.ones(1),
                  ("stated",))
    of_any = product_posterior.posterior_of_products(
        unlit, product_prior(cameras, all_lamps(), product_fit.SEED))
    of_stated = product_posterior.evidence_of_products(
        unlit, product_prior(cameras, alone, product_fit.SEED))
    return light_evidence(stated, of_any.log_evidence - of_stated, CONTRADICTS,
                          product_fit.kind_probabilities(of_any))


def evidence_on_kind(light: UnknownLight, photos: list[ChartEquations],
                     cameras: camera_prior.CameraPrior) -> Finding:
    """The evidence of chart photos on the kind or the temperature that was stated of their light.

    Parameters
    ----------
    light : UnknownLight
    photos : list of ChartEquations
        Of one camera under one light, see ``fit_products`` on their ``power``.
    cameras : CameraPrior
    """
    posterior = product_posterior.posterior_of_products(
        photos, product_prior(cameras, all_lamps(), product_fit.SEED))
    return light_evidence(light.stated, nats_against(posterior, light), KIND_CONTRADICTS,
                          product_fit.kind_probabilities(posterior))


def nats_against(posterior: product_posterior.ProductPosterior, light: UnknownLight) -> float:
    """How much less probable the lamps that a light may be are with a photo than without.

    Parameters
    ----------
    posterior : ProductPosterior
        Under all lamps.
    light : UnknownLight
        Whose kind or temperature is stated.
    """
    lamps = posterior.prior.lamps
    like = likeness(lamps, light)
    return float(np.log(lamps.weights @ like / product_fit.share_of_lamps(posterior, like)))


def matrix_deviation(camera_from_xyz: np.ndarray, curves: np.ndarray,
                     grid: WavelengthGrid) -> np.ndarray:
    """Stated less predicted matrix (3, 3), as shares of each band's brightness.

    Parameters
    ----------
    camera_from_xyz : (3, 3) array
        From X, Y, Z to R, G, B, of any scale.
    curves : (3, P) array
        Sensitivities R, G, B on ``grid``, of any scale.
    grid : WavelengthGrid
    """
    surfaces = chart.chart_reflectances("BabelColor Average", grid)
    xyz = np.array([appearance.tristimulus(grid.nm, surface) for surface in surfaces])
    signals = surfaces @ (curves * named_spectra.light("D65", grid) * grid.weights_nm).T
    predicted = np.linalg.lstsq(xyz, signals, rcond=None)[0].T
    _, sizes, axes = np.linalg.svd(xyz, full_matrices=False)
    scaled_axes = (axes * np.sign(axes[:, :1])).T * sizes / np.sqrt(len(xyz))
    stated, ours = camera_from_xyz @ scaled_axes, predicted @ scaled_axes
    scale = np.sum(stated * ours) / np.sum(ours**2)
    return (stated / scale - ours) / ours[:, :1]


def matrix_doubt(camera_from_xyz: np.ndarray, curves: np.ndarray, grid: WavelengthGrid) -> float:
    """Mean square of the deviation, in spreads about what is typical: of most cameras about 1.

    Parameters
    ----------
    camera_from_xyz : (3, 3) array
    curves : (3, P) array
    grid : WavelengthGrid
        As in ``matrix_deviation``.
    """
    deviation = matrix_deviation(camera_from_xyz, curves, grid)
    return float(np.sum(((deviation - TYPICAL) / SPREAD) ** 2) / FREEDOM)


def colour_matrix(camera_from_xyz: np.ndarray | None, curves: np.ndarray,
                  grid: WavelengthGrid) -> list[Finding]:
    """Whether a file's colour matrix speaks against the curves; nothing where there is none.

    Parameters
    ----------
    camera_from_xyz : (3, 3) array or None
        Of a raw file; None where it states none.
    curves : (K, P) array
    grid : WavelengthGrid
    """
    if camera_from_xyz is None or len(curves) != len(camera_from_xyz):
        return []
    doubt = matrix_doubt(camera_from_xyz, curves, grid)
    values = {"mean_square": doubt, "limit": DOUBTFUL}
    if doubt >= DOUBTFUL:
        return [Finding("calibration.matrix-contradicts", Severity.WARN, values=values)]
    return [Finding("calibration.matrix-agrees", Severity.INFO, values=values)]


def drifting_light(size: float, chance: float, photo_number: int | None) -> Finding:
    """Whether two kinds of light fall on the chart of a photo: a drift of its colour is beyond
    chance and large enough to matter.

    Parameters
    ----------
    size, chance : float
        Of ``colour_drift``.
    photo_number : int or None
        Of several photos, from 1.
    """
    code, severity = ("light.two-kinds", Severity.WARN) \
        if chance < colour_drift.FALSE_ALARM and size > colour_drift.MIN_DRIFT else (
                "light.one-kind", Severity.INFO)
    return Finding(code, severity, values={"photo_number": photo_number, "drift": size,
                                           "chance": chance})


def disagreeing_bands(signal: np.ndarray, held_out: np.ndarray,
                      band_names: Sequence[str]) -> Finding:
    """Which bands of the chart's patches disagree most with what the other patches predict.

    Parameters
    ----------
    signal, held_out : (I, K) arrays
        As of ``disagreement_of_bands``.
    band_names : sequence of K str
    """
    off = chart_photo.disagreement_of_bands(signal, held_out)
    return Finding("calibration.bands-disagree", Severity.WARN, values={
        "bands": {band_names[band]: float(off[band]) for band in np.argsort(-off)[:NAMED_BANDS]},
        "median": float(np.median(off))})


# ---- causes that compete -------------------------------------------------------------------------

def told_apart(findings: Sequence[Finding], photo: ChartEquations,
               state: curve_posterior.PhotoState,
               evidence: Sequence[Finding]) -> list[Finding]:
    """Findings of a fit, of which those that name a cause stay where its rivals are excluded.

    In place of the others comes one with the causes that are not.

    Parameters
    ----------
    findings : sequence of Finding
    photo : ChartEquations
        That they are about.
    state : PhotoState
        Of that photo in the fit.
    evidence : sequence of Finding
        Of ``light_evidence``, on the lights of photos, as far as something is stated of them.
    """
    ranking = ranked(photo, state, evidence) if chart_causes.claims(findings) else None
    return list(findings) if ranking is None else chart_causes.settled(findings, ranking,
                                                                       UNDECIDED_CAUSE)


def ranked(photo: ChartEquations, state: curve_posterior.PhotoState,
           evidence: Sequence[Finding]) -> dict[str, float] | None:
    """How well each cause explains a chart photo by what a fit makes of it, as of
    ``chart_causes.ranked``.

    None where the causes are no model of it: photos through a filter, in other bands than three, or
    of a chart under known irradiance say too little or another thing.

    Parameters
    ----------
    photo, state, evidence
        As of ``told_apart``.
    """
    if photo.filter is not None or photo.signal.shape[1] != COLOURS \
            or photo.field_terms.shape[1] < 2:
        return None
    against = max((one.values["against"] for one in evidence), default=0.0)
    return chart_causes.ranked(
        np.where(photo.readable, photo.signal, np.nan),
        (state.predicted - state.white.glare) / state.field[:, None],
        np.sqrt(np.einsum("ikk->ik", photo.covariance)), photo.field_terms[:, :2], MIXING_SD,
        {chart_causes.LIGHT: max(against, 0.0)})


def worst_explained(fit: sensitivity.PriorFit, photos: Sequence[ChartEquations]) -> int:
    """Number of the photo that a fit explains worst.

    Parameters
    ----------
    fit : PriorFit
    photos : sequence of ChartEquations
        That it was made from.
    """
    return int(np.argmax([np.sqrt(np.mean((1 - state.predicted / photo.signal) ** 2))
                          for photo, state in zip(photos, fit.photos, strict=True)]))
