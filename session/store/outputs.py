"""What an operator takes away from a session besides the report: spectra, Mitsuba materials,
pictures as numbers.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.capture.photo.image_files import write_exr, write_png
from spectrabox.radiometry.files import writable, write_text_whole
from spectrabox.radiometry.outside.names import file_stem
from spectrabox.radiometry.records import Quantity, Reconstruction
from spectrabox.radiometry.spectra.formats.tm27 import spdx_text
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.reconstruct.scene.scene_xml import materials_xml
from spectrabox.session.report.maps import comparison_rgb8
from spectrabox.session.store.results import CommonResults, MaterialResult, SessionResults

MIN_SIGNAL = 1e-6  # signal under which a relative residual is not formed


def write_outputs(results: SessionResults) -> list[Path]:
    """Spectra, materials and pictures beside the report, each file whole or not at all.

    Returns
    -------
    list of Path
        Every file.
    """
    texts = {results.folder / "spectra.csv": spectra_text(results,
                                                            results.reconstruction.grid.nm),
             results.folder / "materials.xml": materials_text(results)}
    with writable(results.folder):
        (results.folder / "spdx").mkdir(exist_ok=True)
    for material in results.materials:
        texts[results.folder / "spdx" / f"{file_stem(material.name)}.spdx"] = spdx_text(
            results.reconstruction.grid.nm, {material.name: best_spectrum(material)},
            quantity=Quantity.REFLECTANCE, source=f"{material.name}, {results.name}")
    for path, text in texts.items():
        write_text_whole(path, text)
    views = [("comparison", results.reconstruction, results.calibration, results.bands)]
    views += [(f"comparison {file_stem(view.name)}", view.reconstruction, view.calibration,
               view.bands) for view in results.views]
    pictures = []
    for name, made, calibration, bands in views:
        pictures += [results.folder / f"{name}.exr", results.folder / f"{name}.png"]
        _write_comparison(pictures[-2], made, bands)
        write_png(pictures[-1], comparison_rgb8(made, calibration.sensitivity))
    return [*texts, *pictures]


def best_spectrum(material: MaterialResult) -> np.ndarray:
    """The mean (P,) of the draws, or the given spectrum."""
    if material.summary is not None:
        return material.summary.mean
    assert material.spectrum is not None
    return material.spectrum


def _write_comparison(path: Path, made: Reconstruction, bands: tuple[str, ...]) -> None:
    pictures = {"photo": made.measured, "rendering": made.rendered,
                "residual": (made.measured - made.rendered) / np.maximum(made.measured, MIN_SIGNAL)}
    names = [f"{picture}.{band}" for picture in pictures for band in bands]
    write_exr(path, np.concatenate(list(pictures.values()), axis=2), names)


def materials_text(results: SessionResults) -> str:
    """Mitsuba BSDFs of all materials: the mean of the draws, or the given spectrum."""
    nm = results.reconstruction.grid.nm
    return materials_xml({material.name: np.clip(best_spectrum(material), 0, 1)
                          for material in results.materials}, (float(nm[0]), float(nm[-1])))


def spectra_text(results: CommonResults, grid_nm: np.ndarray) -> str:
    """All recovered spectra as canonical CSV, every 1 nm.

    Parameters
    ----------
    grid_nm : (P,) array
        Of the spectra.
    """
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
    return table_text(grid_nm, columns, quantity=Quantity.REFLECTANCE,
                      source=f"spectrabox, {results.name}".replace("\n", " "))
