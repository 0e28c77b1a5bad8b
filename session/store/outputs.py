"""What an operator takes away from a session besides the report: spectra, Mitsuba materials,
pictures as numbers.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.capture.photo.image_files import write_exr, write_png
from spectrabox.radiometry.files import writable, write_text_whole
from spectrabox.radiometry.records import Reconstruction
from spectrabox.radiometry.system.names import file_stem
from spectrabox.reconstruct.scene.scene_xml import materials_xml
from spectrabox.session.report.maps import comparison_rgb8
from spectrabox.session.store.results import SessionResults
from spectrabox.session.store.spectra_table import best_spectrum, spectra_files

MIN_SIGNAL = 1e-6  # signal under which a relative residual is not formed


def write_outputs(results: SessionResults) -> list[Path]:
    """Spectra, materials and pictures beside the report, each file whole or not at all.

    Returns
    -------
    list of Path
        Every file.
    """
    texts = {**spectra_files(results, results.reconstruction.grid.nm),
             results.folder / "materials.xml": materials_text(results)}
    with writable(results.folder):
        (results.folder / "spdx").mkdir(exist_ok=True)
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
