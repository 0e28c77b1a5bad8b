"""What an operator takes away from a session besides the report: spectra, Mitsuba materials, pictures as numbers."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from capture.image_files import write_exr
from radiometry.files import write_text_whole
from radiometry.records import Quantity, Reconstruction
from radiometry.spectrum_files import table_text
from reconstruct.scene_file import materials_xml
from session.results import SessionResults

DARKEST = 1e-6  # signal under which a relative residual is not formed


def write_outputs(results: SessionResults) -> None:
    """spectra.csv, materials.xml and comparison.exr beside the report, each whole or not at all."""
    write_text_whole(results.folder / "spectra.csv", spectra_text(results))
    write_text_whole(results.folder / "materials.xml", materials_text(results))
    _write_comparison(results.folder / "comparison.exr", results.reconstruction, results.bands)
    for view in results.views:
        _write_comparison(results.folder / f"comparison {view.name}.exr", view.reconstruction, view.bands)


def _write_comparison(path: Path, made: Reconstruction, bands: tuple[str, ...]) -> None:
    pictures = {"photo": made.measured, "rendering": made.rendered,
                "residual": (made.measured - made.rendered) / np.maximum(made.measured, DARKEST)}
    names = [f"{picture}.{band}" for picture in pictures for band in bands]
    write_exr(path, np.concatenate(list(pictures.values()), axis=2), names)


def materials_text(results: SessionResults) -> str:
    """Mitsuba BSDFs of all materials: the mean of the draws, or the given spectrum."""
    nm = results.reconstruction.grid.nm
    spectra = {material.name: material.spectrum if material.summary is None else material.summary.mean
               for material in results.materials}
    return materials_xml({name: np.clip(values, 0, 1) for name, values in spectra.items()},
                         (float(nm[0]), float(nm[-1])))


def spectra_text(results: SessionResults) -> str:
    """All recovered spectra as canonical CSV, every 1 nm."""
    columns: dict[str, np.ndarray] = {}
    for material in results.materials:
        columns[f"{material.name} inverse rendering"] = material.spectrum
        if material.summary is not None:
            columns |= {f"{material.name} mean": material.summary.mean,
                        f"{material.name} standard deviation": material.summary.standard_deviation,
                        f"{material.name} lower {material.summary.level:g}": material.summary.lower,
                        f"{material.name} upper {material.summary.level:g}": material.summary.upper,
                        f"{material.name} bound lower": material.summary.bound_lower,
                        f"{material.name} bound upper": material.summary.bound_upper}
    return table_text(results.reconstruction.grid.nm, columns, quantity=Quantity.REFLECTANCE,
                      source=f"spectrabox, {results.name}".replace("\n", " "))
