"""What the camera commands read and write: photos of charts as a capture, corners, curves, draws,
measured cameras.
"""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spectrabox.calibrate.prior.learnt_prior import SUFFIXES, cameras_of_file
from spectrabox.capture.chart.quality import ChartVerdict
from spectrabox.capture.develop.developed import develop_photos
from spectrabox.capture.photo.orientation import photo_orientation
from spectrabox.measure.camera import (
    CameraCapture,
    CameraFit,
    ChartSignals,
    chart_in_photo,
    judged_chart,
    own_or_common,
)
from spectrabox.measure.captured import LitChart
from spectrabox.radiometry.chart import CLASSIC, Chart, excluded_patches
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import whole_file, write_text_whole
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.photos import ChartDetection, LinearImage
from spectrabox.radiometry.records.spectra import Quantity, WavelengthGrid, default_band_names
from spectrabox.radiometry.spectra.kept_cameras import cameras_folder, keep_camera
from spectrabox.radiometry.spectra.named_spectra import stated_light
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves, table_text
from spectrabox.radiometry.system.words import is_whole_number
from spectrabox.session.camera.patch_files import read_patches
from spectrabox.session.terminal.command_line import CORNERS, pixel_numbers


def camera_capture(chart: Chart, photos: Sequence[Path], tables: Sequence[Path],
                   lights: Sequence[str], references: Sequence[str], corners: Sequence[str],
                   leave_out: str) -> CameraCapture:
    """The photos of a chart, or the tables of its signals, with what is stated of them.

    Parameters
    ----------
    chart : Chart
    photos, tables : sequences of Path
    lights, references, corners : sequences of str
        As of ``--light``, ``--reference`` and ``--corners``: one for each photo, or one for all.
    leave_out : str
        Numbers of patches such as 5,10.

    Raises
    ------
    InputError
        If one of the files cannot be read.
    """
    stated = {name: stated_light(name, FINE_GRID) for name in lights}
    excluded = excluded_patches(numbers_of_patches(leave_out), chart, "--leave-out")
    reflectances = tuple(reference_reflectances(name, chart, FINE_GRID)
                         for name in references or (None,))
    shown = [_signals_of_picture(photo, chart, own_or_common(reflectances, index),
                                 own_or_common(corners or (None,), index))
             for index, photo in enumerate(photos)]
    shown += [read_patches(table, chart) for table in tables]
    charts = tuple(LitChart(chart, each, excluded, stated=bool(references))
                   for each in reflectances)
    return CameraCapture(tuple(shown), tuple(stated[name] for name in lights), charts)


def numbers_of_patches(written: str) -> list[int]:
    """Numbers of patches such as 5,10; none where nothing is written.

    Raises
    ------
    InputError
        If they are not whole numbers.
    """
    words = [word.strip() for word in written.split(",") if word.strip()]
    wrong = [word for word in words if not is_whole_number(word)]
    if wrong:
        raise InputError(f"--leave-out {written}: {wrong[0]!r} is no patch; they are numbered "
                         "from 1, the first patch of the chart first")
    return sorted({int(word) for word in words})


def read_layout(layout: str) -> Chart:
    """The chart of a name or a layout file; a ColorChecker Classic where nothing is named."""
    return chart_layout(layout) if layout else CLASSIC


def _signals_of_picture(path: Path, chart: Chart, reflectances: np.ndarray,
                        corners: str | None) -> ChartSignals:
    photo, _ = develop_photos([path], [], None, orientation=photo_orientation(path))
    return chart_in_photo(photo, chart, reflectances,
                          None if corners is None else corner_points(corners, chart))


def chart_named(image: LinearImage, layout: str, reference: str | None,
                corners: str | None) -> tuple[ChartDetection, ChartVerdict]:
    """The chart in a photo and the verdict on it, as the options of a command name chart and
    corners.

    Parameters
    ----------
    image : LinearImage
    layout, reference : str
        As of ``--chart-layout`` and ``--reference``.
    corners : str, optional
        As of ``--corners``.

    Raises
    ------
    CheckError
        If there is no chart, or it is mirrored.
    InputError
        If a chart, a reference or corners cannot be read.
    """
    chart = read_layout(layout)
    return judged_chart(image, chart, reference,
                        None if corners is None else corner_points(corners, chart))


def corner_points(text: str, chart: Chart) -> np.ndarray:
    """Corners (4, 2) of a chart in pixels, of an option X,Y,X,Y,X,Y,X,Y.

    Raises
    ------
    InputError
        If they are not four points.
    """
    return np.array(pixel_numbers(text, 8, "--corners", f"{CORNERS} at {chart.corner_words}")
                    ).reshape(4, 2)


def read_measured_curves(path: Path, bands: int, grid: WavelengthGrid) -> np.ndarray:
    """Measured sensitivities (K, P) of largest value 1."""
    nm, names, curves = read_curves(path)
    if len(names) != bands:
        raise InputError(f"{path.name} holds {len(names)} curves, the photo has {bands} bands; "
                         "give a column per band")
    values = on_grid(nm, curves, grid, path.name)
    if values.max() <= 0 or values.min() < -0.05 * values.max():
        raise InputError(f"{path.name}: sensitivities must be positive; they run from "
                         f"{values.min():.3g} to {values.max():.3g}")
    return values.clip(0) / values.max()


def require_outputs(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Refuse outputs that are folders or would replace an input, before anything is computed.

    Raises
    ------
    InputError
    """
    for path in outputs:
        if path.is_dir():
            raise InputError(f"{path} is a folder; give the name of a file to write")
        if path.resolve() in {source.resolve() for source in inputs}:
            raise InputError(f"{path} is an input of this command and would be replaced; give "
                             "another name")


def write_curves(path: Path, camera: CameraFit) -> None:
    """Curves and their standard errors, a column each."""
    write_text_whole(path, table_text(camera.sensitivity.grid.nm, camera.columns(),
                                      quantity=Quantity.RELATIVE, source=camera.source))


def write_draws(path: Path, camera: CameraFit) -> None:
    """Draws of all curves together as an NPZ."""
    if camera.band is None or camera.band.draws is None:
        raise InputError("draws come with the method prior only; leave --draws-file out")
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, wavelengths_nm=camera.sensitivity.grid.nm,
                            curves=camera.band.draws)


def add_cameras(sources: Sequence[Path]) -> tuple[list[str], list[str], Path]:
    """Keep every camera of some files and folders.

    Parameters
    ----------
    sources : list of Path

    Returns
    -------
    kept : list of str
        Names, in the order of the files.
    skipped : list of str
        Sentences on what was not kept.
    folder : Path

    Raises
    ------
    InputError
        If one is missing, or nothing could be kept.
    """
    kept: list[str] = []
    skipped: list[str] = []
    for path in _camera_files(sources):
        try:
            for name, (nm, curves) in cameras_of_file(path).items():
                bands = default_band_names(len(curves))
                keep_camera(name, nm, dict(zip(bands, curves, strict=True)),
                            f"{name}, from {path.name}")
                kept.append(name)
        except InputError as error:
            skipped.append(str(error))
    if not kept:
        raise InputError(skipped[0] if skipped else "there are no files of camera curves there; "
                         ".json (rawtoaces) or .csv are needed")
    return kept, skipped, cameras_folder()


def _camera_files(sources: Sequence[Path]) -> Sequence[Path]:
    """The files, and those of the folders that end as camera files do."""
    files: list[Path] = []
    for source in sources:
        if not source.exists():
            raise InputError(f"{source} is missing; give a file or folder of camera curves")
        files += sorted(path for path in source.iterdir() if path.suffix.lower() in SUFFIXES) \
            if source.is_dir() else [source]
    return files
