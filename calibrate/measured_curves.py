"""Whether measured curves explain a chart photo of unknown exposure, illumination and glare."""
from __future__ import annotations

import numpy as np

from spectrabox.calibrate.chart_equations import ChartEquations
from spectrabox.calibrate.photo_checks import disagreement, refuse_disagreement
from spectrabox.calibrate.prior.plain_priors import prior_about
from spectrabox.calibrate.sensitivity import fit_with_prior
from spectrabox.calibrate.trust import other_reading
from spectrabox.radiometry.records import WavelengthGrid

DOUBTFUL = 1.5  # chi-square per signal, 72 of them: chance gives as much once in 200 photos
# What a measurement may be off by: two laboratories that measure one camera differ by about 8 %.
# Added to each band (of the largest value, nm), multiplied with each band, with all bands alike.
LABORATORY = (0.01, 20.0, 0.06, 60.0, 0.06, 120.0)


def check_measured_curves(photo: ChartEquations, curves: np.ndarray, grid: WavelengthGrid) -> str:
    """One sentence on how well measured curves (K, P) explain a chart photo.

    Parameters
    ----------
    photo : ChartEquations
    curves : (K, P) array
        Of any scale.
    grid : WavelengthGrid
        Working grid, of P wavelengths.

    Raises
    ------
    CheckError
        If they do not, but would if the photo were read in another way: mirrored, bands reversed,
        encoded.
    """
    # cameras that another laboratory would have measured so
    known = prior_about(grid, curves, LABORATORY, "measured curves")
    fit = fit_with_prior([photo], known, grid)
    if fit.chi_square < DOUBTFUL and not fit.disagrees:
        return (f"measured curves and photo agree within {fit.model_error:.1%} (chi-square "
                f"{fit.chi_square:.2f} per signal)")
    reading = other_reading(photo, known, grid) if fit.disagrees else None
    if reading is not None:
        refuse_disagreement("the measured curves do not explain the chart photo",
                            disagreement(photo.signal, fit.held_out[0]), fit.chi_square, reading)
    return ("the measured curves do not explain the chart photo (chi-square "
            f"{fit.chi_square:.1f} per signal): check that they are of this camera and their "
            "columns in the photo's order, and light, chart and glare")
