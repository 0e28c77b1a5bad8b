"""Spectra and draws of a finished session as files for other programs.

Spectra of a finished session for other programs: tables, IES TM-27 files, colours, Mitsuba
materials, and of a scene the pictures that compare photo and rendering.
"""


from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.photo.image_writers import write_exr, write_png
from spectrabox.measure.pictures import texture_files
from spectrabox.measure.results import capture_result, scene_result, surface_result
from spectrabox.radiometry import appearance, errors, files, grid
from spectrabox.radiometry.records import scenes, spectra
from spectrabox.radiometry.spectra.formats import delimited, tm27
from spectrabox.radiometry.system.words import cell, file_stem
from spectrabox.reconstruct.scene import scene_file, scene_xml
from spectrabox.session.report.maps import comparison_rgb8

FORMS = {".npz": "wavelengths and one array of draws a surface",
         ".csv": "a row for each surface, draw and wavelength",
         ".parquet": "the same as a Parquet table"}
COLUMNS = ("surface", "draw", "wavelength_nm", "reflectance")
MAX_ROWS = 50_000_000       # of a long form


def stored_draws(summaries: Mapping[str, spectra.SpectrumSummary], step_nm: int,
                 draws: int | None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Wavelengths (P,) and draws (n, P) of every surface whose spectrum was not given.

    Parameters
    ----------
    summaries : mapping
        Of a finished session, by surface.
    step_nm : int
        Between wavelengths: those that are whole steps from the first are kept.
    draws : int or None
        Of each surface, the first so many; None for all.

    Raises
    ------
    InputError
        If there are none.
    """
    if not summaries:
        raise errors.InputError(
            "every spectrum of this session was given; there are no draws to write")
    draws_of = {}
    for name, summary in summaries.items():
        nm = summary.draws.grid.nm
        kept = grid.at_whole_steps(nm, step_nm)
        draws_of[name] = nm[kept], summary.draws.spectra[:draws, kept]
    return draws_of


def write_draws(path: Path, draws: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Write draws as the path's ending says, whole or not at all.

    Parameters
    ----------
    path : Path
    draws : dict
        As ``stored_draws`` gives them.

    Raises
    ------
    InputError
        If a long form would have more rows than any program reads.
    EnvironmentProblem
        If a Parquet table is asked for and pyarrow is not installed.
    """
    rows = sum(values.size for _, values in draws.values())
    if path.suffix.lower() != ".npz" and rows > MAX_ROWS:
        raise errors.InputError(
            f"{path.name} would have {rows} rows; take fewer --samples, a wider "
            "--step, "
            "or .npz")
    with files.whole_file(path) as unfinished:
        {".npz": _npz, ".csv": _csv, ".parquet": _parquet}[path.suffix.lower()](unfinished, draws)


def _npz(path: Path, draws: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    nm, _ = next(iter(draws.values()))
    arrays: dict[str, Any] = {f"draws_{index}": values.astype(np.float32)
                              for index, (_, values) in enumerate(draws.values())}
    with path.open("wb") as file:
        np.savez_compressed(file, wavelengths_nm=nm, surfaces=np.array(list(draws)), **arrays)


def _csv(path: Path, draws: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(COLUMNS) + "\n")
        for name, (nm, values) in draws.items():
            word = '"' + cell(name).replace('"', '""') + '"'
            points = [f"{wavelength:g}" for wavelength in nm]
            for number, spectrum in enumerate(values):
                file.write("".join(f"{word},{number},{point},{value:.7g}\n"
                                   for point, value in zip(points, spectrum, strict=True)))


def _parquet(path: Path, draws: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    try:
        arrow = importlib.import_module("pyarrow")      # optional: no other format needs it
        parquet = importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError:
        raise errors.EnvironmentProblem(
            "a Parquet table is written by pyarrow, which is not installed: "
            "pip install pyarrow, or give --out NAME.csv or NAME.npz") from None
    tables = []
    for name, (nm, values) in draws.items():
        count, width = values.shape
        tables.append(arrow.table(dict(zip(COLUMNS, (
            [name] * values.size, np.repeat(np.arange(count, dtype=np.int32), width),
            np.tile(nm, count), values.astype(np.float32).ravel()), strict=True))))
    parquet.write_table(arrow.concat_tables(tables), path)


# ---- spectra of a finished session for other programs --------------------------------------------

MIN_SIGNAL = 1e-6  # signal under which a relative residual is not formed
TABLE_COLUMNS = ("X", "Y", "Z", "ACEScg R", "ACEScg G", "ACEScg B")


def write_surface_files(result: capture_result.CaptureResult, folder: Path,
                        title: str) -> list[Path]:
    """Write spectra.csv, materials.csv and spdx/ into a folder, each file whole or not at all.

    Parameters
    ----------
    result : CaptureResult
    folder : Path
    title : str
        Of the session, which the files name as their source.

    Returns
    -------
    list of Path
        Every file.
    """
    texts = _texts(result, folder, title)
    with files.writable(folder):
        (folder / "spdx").mkdir(exist_ok=True)
    for path, text in texts.items():
        files.write_text_whole(path, text)
    return [*texts]


def write_materials(result: scene_result.SceneResult, folder: Path, bsdfs: Mapping[str, str],
                    scene: scene_file.SceneFile | None, pictures: Path) -> Path:
    """Write materials.xml of a scene, for Mitsuba.

    Parameters
    ----------
    result : SceneResult
    folder : Path
    bsdfs : mapping
        From names of materials to ids in the scene.
    scene : SceneFile or None
        Whose BSDFs the materials are; None of a measured box, where all are diffuse.
    pictures : Path
        Folder of the picture of spectra, whose textures are materials too.

    Returns
    -------
    Path
        The file.
    """
    file = folder / "materials.xml"
    textures = {} if scene is None or result.picture is None else texture_files.textures_of(
        result.picture.files, scene.surfaces, pictures)
    files.write_text_whole(
        file, scene_xml.materials_xml(*scene_result.bsdf_reflectances(result, bsdfs), scene,
                                      folder, textures))
    return file


def write_comparisons(result: scene_result.SceneResult, folder: Path) -> list[Path]:
    """Write photo, rendering and residual of every view of a scene: as EXR, and a PNG to look at.

    Parameters
    ----------
    result : SceneResult
    folder : Path

    Returns
    -------
    list of Path
        Every file.
    """
    files = []
    views = {"comparison": (result.calibration, result.reconstruction)}
    views |= {f"comparison {file_stem(name)}": view for name, view in result.views.items()}
    for name, (calibration, reconstruction) in views.items():
        files += [folder / f"{name}.exr", folder / f"{name}.png"]
        _write_comparison(files[-2], reconstruction, result.bands)
        write_png(files[-1], comparison_rgb8(reconstruction, calibration.sensitivity))
    return files


def _write_comparison(path: Path, of: scenes.Reconstruction, bands: tuple[str, ...]) -> None:
    pictures = {"photo": of.measured, "rendering": of.rendered,
                "residual": (of.measured - of.rendered) / np.maximum(of.measured, MIN_SIGNAL)}
    names = [f"{picture}.{band}" for picture in pictures for band in bands]
    write_exr(path, np.concatenate(list(pictures.values()), axis=2), names)


def _texts(result: capture_result.CaptureResult, folder: Path, title: str) -> dict[Path, str]:
    """Texts of spectra.csv, its metadata, materials.csv and each surface's spdx/NAME.spdx, by path.
    """
    nm, table = result.grid.nm, folder / "spectra.csv"
    columns = spectra_columns(result)
    stated = delimited.metadata_text(table.name, columns, quantity=spectra.Quantity.REFLECTANCE,
                           source=f"spectrabox, {title}")
    files = {table: delimited.plain_text(nm, columns), delimited.metadata_path(table): stated,
             folder / "materials.csv": colours_text(result.surfaces)}
    return files | {folder / "spdx" / f"{file_stem(surface.name)}.spdx": tm27.spdx_text(
        nm, {surface.name: surface.mean}, quantity=spectra.Quantity.REFLECTANCE,
        source=f"{surface.name}, {title}") for surface in result.surfaces}


def spectra_columns(result: capture_result.CaptureResult) -> dict[str, np.ndarray]:
    """Mean, deviation, band and bounds (P,) of all recovered spectra, by the titles they get."""
    columns: dict[str, np.ndarray] = {}
    for surface in result.surfaces:
        name, summary = surface.name, surface.summary
        if surface.spectrum is not None:
            columns[f"{name} inverse rendering"] = surface.spectrum
        if summary is not None:
            columns |= {f"{name} mean": summary.mean,
                        f"{name} standard deviation": summary.standard_deviation,
                        f"{name} lower {summary.level:g}": summary.lower,
                        f"{name} upper {summary.level:g}": summary.upper,
                        f"{name} bound lower": summary.bound_lower,
                        f"{name} bound upper": summary.bound_upper}
    return columns


def colours_text(surfaces: Sequence[surface_result.SurfaceResult]) -> str:
    """A CSV with a row for each material: its colours under D65, and their standard deviations over
    the draws; 0 where the spectrum was given.

    Parameters
    ----------
    surfaces : sequence of SurfaceResult
    """
    rows = [["material", *TABLE_COLUMNS, *(f"standard deviation {name}" for name in TABLE_COLUMNS)]]
    for surface in surfaces:
        drawn, drawn_nm = surface.mean[None], surface.nm
        if surface.samples is not None:
            drawn, drawn_nm = surface.samples.spectra, surface.samples.grid.nm
        colours = drawn @ np.vstack([appearance.tristimulus_weights(drawn_nm, "D65"),
                                     appearance.acescg_weights(drawn_nm)]).T
        deviation = colours.std(axis=0, ddof=1) if len(colours) > 1 else np.zeros(
            len(TABLE_COLUMNS))
        rows.append(['"' + cell(surface.name).replace('"', '""') + '"',
                     *(f"{value:.6f}" for value in (*colours.mean(axis=0), *deviation))])
    return "".join(",".join(row) + "\n" for row in rows)
