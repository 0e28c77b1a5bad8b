"""Camera, exposure, field and glare estimated together from photos of a chart, whatever is known of
the light, and patches that the others contradict.

The joint estimate of camera, exposure, field and glare, whatever is known of the light.

Under a stated light the curves of the camera are estimated. An unknown light is told from the
chart: products of curves and light are, by measured cameras under the lamps that it may be. Where
no camera is known, smoothness alone cannot tell a light from a camera, and products stay products.

Patches that the other patches of a chart contradict, left out of the fit one after the other.

A patch that is off makes the fit take all patches for worse than they are, and may bend the light
over its neighbours: of the two that are furthest off the one is left out that is further off by a
fit without it, and so on.
"""


from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spectrabox.calibrate import chart_equations, chart_photo, held_out_patches, sensitivity, trust
from spectrabox.calibrate.prior import camera_prior, prior_fit
from spectrabox.calibrate.products import lamps, product_fit, product_posterior
from spectrabox.radiometry import errors, findings
from spectrabox.radiometry.records import calibration, spectra

RARE_HAZE = 3.0             # log odds against a veil beforehand
DOUBTED_VEIL, MAX_VEIL = 0.04, 0.3      # of the brightest patch: a warning; no photo of a chart


def estimate_through_glare(
    photos: list[chart_equations.ChartEquations], light: Light, cameras: camera_prior.CameraPrior,
    grid: spectra.WavelengthGrid, excluded: chart_equations.ChartEquations | None
) -> tuple[sensitivity.PriorFit, calibration.LightPosterior | None]:
    """The joint estimate under usual glare or, where glare is large or the photos are not
    explained, under haze, if the evidence is for it.

    Parameters
    ----------
    photos, light, cameras, grid, excluded
        As of ``estimate_jointly``.
    """
    usual, usual_light = estimate_jointly(photos, light, cameras, grid, excluded)
    large = [veil > 2 * chart_equations.GLARE_SD for veil in _veils(usual, photos)]
    if not (usual.disagrees or any(large)):
        return usual, usual_light
    veiled = large if any(large) else [True] * len(photos)
    hazy, hazy_light = estimate_jointly(
        [replace(photo, glare_sd=chart_equations.HAZE_SD) if haze else photo
         for photo, haze in zip(photos, veiled, strict=True)], light, cameras, grid, excluded)
    gain = hazy.posterior.log_evidence - usual.posterior.log_evidence
    if gain > RARE_HAZE and max(_veils(hazy, photos)) <= MAX_VEIL:
        return hazy, hazy_light
    return usual, usual_light


def _veils(fit: sensitivity.PriorFit, photos: list[chart_equations.ChartEquations]) -> list[float]:
    """Largest glare of each photo, of its brightest patch."""
    return [float(np.max(np.abs(state.white.glare) / photo.signal.max(axis=0)))
            for photo, state in zip(photos, fit.photos, strict=True)]


def veiled(fit: sensitivity.PriorFit) -> list[findings.Finding]:
    """Whether glare beyond chance veils any photo of a fit; nothing where none is.

    Parameters
    ----------
    fit : PriorFit
    """
    veil = max(float(np.max(state.certain_glare / state.predicted.max(axis=0)))
               for state in fit.photos)
    return [findings.Finding("calibration.veil", findings.Severity.WARN, values={
        "veil": veil, "limit": DOUBTED_VEIL})] if veil > DOUBTED_VEIL else []


# ---- the joint estimate of camera, exposure, field and glare, whatever is known of the light -----

Light = spectra.Spectrum | spectra.UnknownLight


def estimate_jointly(
    photos: list[chart_equations.ChartEquations], light: Light, cameras: camera_prior.CameraPrior,
    grid: spectra.WavelengthGrid, excluded: chart_equations.ChartEquations | None = None
) -> tuple[sensitivity.PriorFit, calibration.LightPosterior | None]:
    """The joint estimate from photos, and the light where the chart tells it.

    Parameters
    ----------
    photos : list of ChartEquations
        By one camera.
    light : Spectrum or UnknownLight
        Of the first; all are under it where it is unknown.
    cameras : CameraPrior
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    excluded : ChartEquations or None
        Patches of the first photo that no fit is to use.

    Raises
    ------
    CalibrationError, InputError
        As ``fit_with_prior``.
    """
    if isinstance(light, spectra.UnknownLight) and cameras.source != camera_prior.SMOOTH_SOURCE:
        return product_fit.fit_products(photos, cameras, lamps.lamps_like(light), grid,
                                        light.words, excluded)
    return sensitivity.fit_with_prior(photos, cameras, grid, excluded=excluded), None


def log_evidence(photos: Sequence[chart_photo.ChartPhoto], grid: spectra.WavelengthGrid,
                 prior: camera_prior.CameraPrior | None = None) -> float:
    """How well the joint estimate explains photos, in nats up to a constant of their signals.

    Parameters
    ----------
    photos : sequence of ChartPhoto
        By one camera.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    prior : CameraPrior or None
        None takes the default.

    Raises
    ------
    CalibrationError, InputError
        As ``fit_with_prior``.
    """
    used, _ = chart_photo.used_and_excluded(photos, grid)
    cameras = sensitivity.default_prior(used, grid) if prior is None else prior
    sensitivity.require_fit_for(used, cameras)
    light = photos[0].light
    if isinstance(light, spectra.UnknownLight) and cameras.source != camera_prior.SMOOTH_SOURCE:
        return product_posterior.evidence_of_products(
            used, lamps.product_prior(cameras, lamps.lamps_like(light), product_fit.SEED))
    return prior_fit.posterior_of_curves(used, cameras, grid).log_evidence


def require_explained(fit: sensitivity.PriorFit, light: calibration.LightPosterior | None,
                      photos: list[chart_equations.ChartEquations],
                      cameras: camera_prior.CameraPrior, grid: spectra.WavelengthGrid) -> None:
    """Refuse photos that no camera explains: say which photo, and which other reading of it would
    agree.

    Parameters
    ----------
    fit, light
        The joint estimate.
    photos, cameras, grid
        That it was made from.

    Raises
    ------
    CheckError
    """
    if not fit.disagrees:
        return
    if light is not None:
        chart_photo.refuse_disagreement("no camera under any lamp explains the chart photo",
                                        photos[0].signal, fit.held_out[0], fit.chi_square, None)
    if cameras.source == camera_prior.SMOOTH_SOURCE \
            and fit.chi_square <= chart_photo.WORST_CHI_SQUARE:
        return      # where no camera is known the error is what it is, and the spectra carry it
    for number, photo in enumerate(photos, start=1):
        which, alone = "the chart photo", fit
        if len(photos) > 1:
            which, alone = f"chart photo {number}", sensitivity.fit_with_prior([photo], cameras,
                                                                               grid)
        if alone.disagrees:
            chart_photo.refuse_disagreement(f"no camera explains {which}", photo.signal,
                                            alone.held_out[0], alone.chi_square,
                                            trust.other_reading(photo, cameras, grid))
    raise errors.CheckError(
        f"each of the {len(photos)} chart photos can be explained, but not all by one "
        f"camera (patches and model agree only within {fit.model_error:.1%}, "
        f"chi-square {fit.chi_square:.1f} per signal together); check that the "
        "camera and its settings were the same, and that each photo has the spectrum "
        "of its own light")


# ---- suspect patches -----------------------------------------------------------------------------

# Standard errors by which a patch is off, and the same over the rms of the other patches, beyond
# which it is a suspect; by chance in one chart of ten.
SUSPECT, SUSPECT_TO_OTHERS, MAX_SUSPECTS = 2.6, 3.5, 3


def without_suspects(photos: Sequence[chart_photo.ChartPhoto], cameras: camera_prior.CameraPrior,
                     grid: spectra.WavelengthGrid,
                     without: held_out_patches.PatchesWithout) -> held_out_patches.PatchesWithout:
    """The first photo's patches once suspects are out of the fit.

    Parameters
    ----------
    photos : sequence of ChartPhoto
    cameras : CameraPrior
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    without : PatchesWithout
        The first photo's patches by the fit that holds the suspects, in the order of the chart.
    """
    first = photos[0]
    suspects = np.zeros(len(first.reflectances), bool)
    for _ in range(MAX_SUSPECTS):
        brighter, error, _ = without.deviations(first.reflectances)
        off = np.where(first.used & ~suspects, np.abs(brighter / error), 0.0)
        others = np.sqrt((np.sum(off**2) - off**2) / (np.count_nonzero(off) - 1))
        furthest = np.argsort(-off)[:2].tolist()
        fits = []
        for patch in furthest:
            if off[patch] <= SUSPECT and off[patch] <= SUSPECT_TO_OTHERS * others[patch]:
                continue
            excluded = ~first.used | suspects
            excluded[patch] = True
            shown = replace(first, excluded=excluded)
            equations, left_out = chart_photo.used_and_excluded([shown, *photos[1:]], grid)
            fit, _ = estimate_through_glare(equations, first.light, cameras, grid, left_out)
            rest = held_out_patches.in_chart_order(fit.without, shown.used)
            level, spread, _ = rest.deviations(first.reflectances)
            fits.append((abs(level[patch] / spread[patch]), patch, rest))
        if not fits:
            break
        _, patch, without = max(fits, key=lambda fit: fit[0])
        suspects[patch] = True
    return without
