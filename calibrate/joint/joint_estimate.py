"""The joint estimate of camera, exposure, field and glare, whatever is known of the light.

Under a stated light the curves of the camera are estimated. An unknown light is told from the
chart: products of curves and light are, by measured cameras under the lamps that it may be. Where
no camera is known, smoothness alone cannot tell a light from a camera, and products stay products.
"""
from __future__ import annotations

from collections.abc import Sequence

from spectrabox.calibrate.chart_consistency import WORST_CHI_SQUARE, refuse_disagreement
from spectrabox.calibrate.chart_equations import ChartEquations
from spectrabox.calibrate.chart_photo import ChartPhoto, used_and_excluded
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.plain_priors import SMOOTH_SOURCE
from spectrabox.calibrate.prior.prior_fit import posterior_of_curves
from spectrabox.calibrate.products.lamps import lamps_like
from spectrabox.calibrate.products.product_fit import SEED, fit_products
from spectrabox.calibrate.products.product_posterior import evidence_of_products
from spectrabox.calibrate.products.product_prior import product_prior
from spectrabox.calibrate.sensitivity import (
    PriorFit,
    default_prior,
    fit_with_prior,
    require_fit_for,
)
from spectrabox.calibrate.trust import other_reading
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.records.calibration import LightPosterior
from spectrabox.radiometry.records.spectra import Spectrum, UnknownLight, WavelengthGrid

Light = Spectrum | UnknownLight


def estimate_jointly(photos: list[ChartEquations], light: Light, cameras: CameraPrior,
                     grid: WavelengthGrid, excluded: ChartEquations | None = None
                     ) -> tuple[PriorFit, LightPosterior | None]:
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
    if isinstance(light, UnknownLight) and cameras.source != SMOOTH_SOURCE:
        products = fit_products(photos, cameras, lamps_like(light), grid, light.words, excluded)
        return products.fit, products.light
    return fit_with_prior(photos, cameras, grid, excluded=excluded), None


def log_evidence(photos: Sequence[ChartPhoto], grid: WavelengthGrid,
                 prior: CameraPrior | None = None) -> float:
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
    used, _ = used_and_excluded(photos, grid)
    cameras = default_prior(used, grid) if prior is None else prior
    require_fit_for(used, cameras)
    light = photos[0].light
    if isinstance(light, UnknownLight) and cameras.source != SMOOTH_SOURCE:
        return evidence_of_products(used, product_prior(cameras, lamps_like(light), SEED))
    return posterior_of_curves(used, cameras, grid).log_evidence


def require_explained(fit: PriorFit, light: LightPosterior | None, photos: list[ChartEquations],
                      cameras: CameraPrior, grid: WavelengthGrid) -> None:
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
        refuse_disagreement("no camera under any lamp explains the chart photo", photos[0].signal,
                            fit.held_out[0], fit.chi_square, None)
    if cameras.source == SMOOTH_SOURCE and fit.chi_square <= WORST_CHI_SQUARE:
        return      # where no camera is known the error is what it is, and the spectra carry it
    for number, photo in enumerate(photos, start=1):
        which, alone = "the chart photo", fit
        if len(photos) > 1:
            which, alone = f"chart photo {number}", fit_with_prior([photo], cameras, grid)
        if alone.disagrees:
            refuse_disagreement(f"no camera explains {which}", photo.signal, alone.held_out[0],
                                alone.chi_square, other_reading(photo, cameras, grid))
    raise CheckError(f"each of the {len(photos)} chart photos can be explained, but not all by one "
                     f"camera (patches and model agree only within {fit.model_error:.1%}, "
                     f"chi-square {fit.chi_square:.1f} per signal together); check that the "
                     "camera and its settings were the same, and that each photo has the spectrum "
                     "of its own light")
