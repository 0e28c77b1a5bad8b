"""Estimates as tables of other programs: CSV, and Datasets of xarray."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import in_folder, write_text_whole
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text

if TYPE_CHECKING:
    from xarray import Dataset

    from spectrabox.api.estimates.estimate import SpectrumEstimate


def estimates_to_csv(estimates: Mapping[str, SpectrumEstimate], path: str | Path) -> Path:
    """Write mean, standard deviation, band and bounds of every surface, a row a wavelength.

    Parameters
    ----------
    estimates : mapping of SpectrumEstimate
        On the same wavelengths.
    path : path

    Raises
    ------
    EnvironmentProblem
        If the file cannot be written; an older one is left as it was.
    InputError
        If there is no surface, or no such folder.
    """
    if not estimates:
        raise InputError("there is no surface to write")
    columns: dict[str, np.ndarray] = {}
    for name, one in estimates.items():
        (lower, upper), (lowest, highest) = one.band(), one.bounds()
        columns |= {f"{name} mean": one.mean,
                    f"{name} standard_deviation": one.standard_deviation,
                    f"{name} lower": lower, f"{name} upper": upper,
                    f"{name} bound_lower": lowest, f"{name} bound_upper": highest}
    target = in_folder(path)
    nm = next(iter(estimates.values())).nm
    write_text_whole(target, table_text(nm, columns, quantity=Quantity.REFLECTANCE,
                                        source="spectrabox"))
    return target


def estimates_to_xarray(estimates: Mapping[str, SpectrumEstimate], draws: int,
                        seed: int) -> Dataset:
    """Estimates on the same wavelengths as an xarray Dataset.

    Parameters
    ----------
    estimates : mapping of SpectrumEstimate
    draws : int
        How many of each to include.
    seed : int

    Returns
    -------
    xarray.Dataset
        Dimensions ``surface``, ``wavelength`` (nm), and ``draw`` where draws are asked for;
        variables are reflectances, 0 to 1.

    Raises
    ------
    EnvironmentProblem
        If xarray is not installed.
    """
    try:
        import xarray
    except ImportError:
        raise EnvironmentProblem("to_xarray needs xarray, which is not installed: pip install "
                                 "'spectrabox[xarray]'") from None
    each = list(estimates.values())
    columns: dict[str, Any] = {
        "mean": [one.mean for one in each],
        "standard_deviation": [one.standard_deviation for one in each],
        "lower": [one.band()[0] for one in each], "upper": [one.band()[1] for one in each],
        "bound_lower": [one.bounds()[0] for one in each],
        "bound_upper": [one.bounds()[1] for one in each]}
    reflectance: dict[str, Any] = {"units": "1", "long_name": "reflectance"}
    variables: dict[str, Any] = {name: (("surface", "wavelength"), np.array(values), reflectance)
                                 for name, values in columns.items()}
    if draws:
        variables["draws"] = (("surface", "draw", "wavelength"),
                              np.array([one.draws(draws, seed) for one in each]),
                              reflectance | {"seed": seed})
    nm = ("wavelength", each[0].nm, {"units": "nm"})
    return xarray.Dataset(variables, {"surface": list(estimates), "wavelength": nm},
                          {"title": "reflectance estimates", "band_level": 0.95,
                           "outcome": [one.outcome for one in each]})
