"""How large the standard errors are that a file states of a camera's curves."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.radiometry.files import names_a_file
from spectrabox.radiometry.spectra.kept_cameras import own_cameras
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.radiometry.system.known_names import known_name

ERRORS = "standard_error"       # what the names of their columns begin with


def stated_curve_error(name: str) -> float | None:
    """Standard error of the curves of a file, or of one's own camera by its name; None where none
    is stated, as of published cameras.

    Parameters
    ----------
    name : str
        As of ``named_spectra.sensitivities``.
    """
    kept = own_cameras()
    own = known_name(name, kept)
    if not names_a_file(name) and own is None:
        return None
    table = read_table(Path(name) if own is None else kept[own])
    of_errors = np.array([each.startswith(ERRORS) for each in table.names], bool)
    if not of_errors.any():
        return None
    return relative_curve_error(table.values[~of_errors], table.values[of_errors])


def relative_curve_error(curves: np.ndarray, standard_error: np.ndarray) -> float:
    """Standard error of curves, root mean square over wavelengths, of the highest peak.

    Parameters
    ----------
    curves, standard_error : (K, P) arrays
    """
    return float(np.sqrt(np.nanmean(standard_error**2)) / np.nanmax(curves))
