"""The spectra of a finished session as tables and IES TM-27 files."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.beside import metadata_beside
from spectrabox.radiometry.spectra.formats.csvw import metadata_text, plain_text
from spectrabox.radiometry.spectra.formats.tm27 import spdx_text
from spectrabox.radiometry.system.names import file_stem
from spectrabox.session.store.colours_table import colours_text
from spectrabox.session.store.results import CommonResults, MaterialResult


def spectra_files(results: CommonResults, grid_nm: np.ndarray) -> dict[Path, str]:
    """Texts of spectra.csv, its metadata, materials.csv and each surface's spdx/NAME.spdx, by path.

    Parameters
    ----------
    grid_nm : (P,) array
        Of the spectra.
    """
    columns = spectra_columns(results)
    table = results.folder / "spectra.csv"
    stated = metadata_text(table.name, columns, quantity=Quantity.REFLECTANCE,
                           source=f"spectrabox, {results.name}")
    files = {table: plain_text(grid_nm, columns), metadata_beside(table): stated,
             results.folder / "materials.csv": colours_text(results.materials, grid_nm)}
    return files | {results.folder / "spdx" / f"{file_stem(material.name)}.spdx": spdx_text(
        grid_nm, {material.name: best_spectrum(material)}, quantity=Quantity.REFLECTANCE,
        source=f"{material.name}, {results.name}") for material in results.materials}


def best_spectrum(material: MaterialResult) -> np.ndarray:
    """The mean (P,) of the draws, or the given spectrum."""
    if material.summary is not None:
        return material.summary.mean
    assert material.spectrum is not None
    return material.spectrum


def spectra_columns(results: CommonResults) -> dict[str, np.ndarray]:
    """Mean, deviation, band and bounds (P,) of all recovered spectra, by the titles they get."""
    columns: dict[str, np.ndarray] = {}
    for material in results.materials:
        if material.spectrum is not None:
            columns[f"{material.name} inverse rendering"] = material.spectrum
        if material.summary is not None:
            columns |= {f"{material.name} mean": material.summary.mean,
                        f"{material.name} standard deviation": material.summary.standard_deviation,
                        f"{material.name} lower {material.summary.level:g}": material.summary.lower,
                        f"{material.name} upper {material.summary.level:g}": material.summary.upper,
                        f"{material.name} bound lower": material.summary.bound_lower,
                        f"{material.name} bound upper": material.summary.bound_upper}
    return columns
