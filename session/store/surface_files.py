"""Spectra of a finished session for other programs: tables, IES TM-27 files, colours, Mitsuba
materials, and of a scene the pictures that compare photo and rendering.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.capture.photo.image_files import write_exr, write_png
from spectrabox.measure.verdict.evidence import MaterialResult
from spectrabox.radiometry.appearance import acescg_weights, tristimulus_weights
from spectrabox.radiometry.files import writable, write_text_whole
from spectrabox.radiometry.records import Quantity, Reconstruction
from spectrabox.radiometry.spectra.companion_files import metadata_path
from spectrabox.radiometry.spectra.formats.csvw import metadata_text, plain_text
from spectrabox.radiometry.spectra.formats.tm27 import spdx_text
from spectrabox.radiometry.system.names import file_stem
from spectrabox.radiometry.system.words import cell
from spectrabox.reconstruct.scene.scene_xml import materials_xml
from spectrabox.session.outputs.results import CommonResults, SceneResults
from spectrabox.session.report.maps import comparison_rgb8

MIN_SIGNAL = 1e-6  # signal under which a relative residual is not formed
COLUMNS = ("X", "Y", "Z", "ACEScg R", "ACEScg G", "ACEScg B")


def write_surface_files(results: CommonResults) -> list[Path]:
    """Write spectra.csv, materials.csv and spdx/ into the session folder, each file whole or not
    at all; of a scene also materials.xml and pictures that compare photo and rendering.

    Parameters
    ----------
    results : CommonResults

    Returns
    -------
    list of Path
        Every file.
    """
    texts = _texts(results)
    if isinstance(results, SceneResults):
        texts[results.folder / "materials.xml"] = materials_text(results)
    with writable(results.folder):
        (results.folder / "spdx").mkdir(exist_ok=True)
    for path, text in texts.items():
        write_text_whole(path, text)
    return [*texts, *(_comparisons(results) if isinstance(results, SceneResults) else ())]


def _comparisons(results: SceneResults) -> list[Path]:
    """Photo, rendering and residual of every view as EXR, and a PNG to look at."""
    views = [("comparison", results.reconstruction, results.calibration, results.bands)]
    views += [(f"comparison {file_stem(view.name)}", view.reconstruction, view.calibration,
               view.bands) for view in results.views]
    pictures = []
    for name, reconstruction, calibration, bands in views:
        pictures += [results.folder / f"{name}.exr", results.folder / f"{name}.png"]
        _write_comparison(pictures[-2], reconstruction, bands)
        write_png(pictures[-1], comparison_rgb8(reconstruction, calibration.sensitivity))
    return pictures


def _write_comparison(path: Path, of: Reconstruction, bands: tuple[str, ...]) -> None:
    pictures = {"photo": of.measured, "rendering": of.rendered,
                "residual": (of.measured - of.rendered) / np.maximum(of.measured, MIN_SIGNAL)}
    names = [f"{picture}.{band}" for picture in pictures for band in bands]
    write_exr(path, np.concatenate(list(pictures.values()), axis=2), names)


def materials_text(results: SceneResults) -> str:
    """Mitsuba BSDFs of all materials: the mean of the draws, or the given spectrum."""
    nm = results.grid.nm
    return materials_xml({material.name: np.clip(best_spectrum(material), 0, 1)
                          for material in results.materials}, (float(nm[0]), float(nm[-1])))


def _texts(results: CommonResults) -> dict[Path, str]:
    """Texts of spectra.csv, its metadata, materials.csv and each surface's spdx/NAME.spdx, by path.
    """
    grid_nm, columns = results.grid.nm, spectra_columns(results)
    table = results.folder / "spectra.csv"
    stated = metadata_text(table.name, columns, quantity=Quantity.REFLECTANCE,
                           source=f"spectrabox, {results.name}")
    files = {table: plain_text(grid_nm, columns), metadata_path(table): stated,
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


def colours_text(materials: list[MaterialResult], nm: np.ndarray) -> str:
    """A CSV with a row for each material: its colours under D65, and their standard deviations over
    the draws; 0 where the spectrum was given.

    Parameters
    ----------
    materials : list of MaterialResult
    nm : (P,) array
        Of the spectra that were given.
    """
    rows = [["material", *COLUMNS, *(f"standard deviation {name}" for name in COLUMNS)]]
    for material in materials:
        drawn, drawn_nm = best_spectrum(material)[None], nm
        if material.samples is not None:
            drawn, drawn_nm = material.samples.spectra, material.samples.grid.nm
        colours = drawn @ np.vstack([tristimulus_weights(drawn_nm, "D65"),
                                     acescg_weights(drawn_nm)]).T
        deviation = colours.std(axis=0, ddof=1) if len(colours) > 1 else np.zeros(len(COLUMNS))
        rows.append(['"' + cell(material.name).replace('"', '""') + '"',
                     *(f"{value:.6f}" for value in (*colours.mean(axis=0), *deviation))])
    return "".join(",".join(row) + "\n" for row in rows)
