"""What the camera commands read: photos of charts as a capture, charts, corners, curves."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.capture.chart.quality import ChartVerdict
from spectrabox.capture.develop.developed import develop_photos
from spectrabox.capture.photo.orientation import photo_orientation
from spectrabox.measure.camera import (
    CameraCapture,
    ChartSignals,
    chart_in_photo,
    judged_chart,
    own_or_common,
)
from spectrabox.radiometry.chart import CLASSIC, Chart, excluded_patches
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import ChartDetection, LinearImage, WavelengthGrid
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves
from spectrabox.radiometry.spectra.stated_light import stated_light
from spectrabox.radiometry.system.words import is_whole_number
from spectrabox.session.camera.patch_files import read_patches
from spectrabox.session.commands.requests import CameraFitRequest
from spectrabox.session.terminal.command_line import CORNERS, pixel_numbers


def camera_capture(request: CameraFitRequest) -> CameraCapture:
    """The photos of a chart, or the tables of its signals, with what is stated of them.

    Raises
    ------
    InputError
        If one of the files cannot be read.
    """
    lights = {name: stated_light(name, FINE_GRID) for name in request.light}
    chart = read_layout(request.layout)
    excluded = excluded_patches(numbers_of_patches(request.leave_out), chart, "--leave-out")
    reflectances = tuple(reference_reflectances(name, chart, FINE_GRID)
                         for name in request.reference or (None,))
    shown = [_signals_of_picture(photo, chart, own_or_common(reflectances, index),
                                 own_or_common(request.corners or (None,), index))
             for index, photo in enumerate([*request.photos, *request.chart])]
    shown += [read_patches(table, chart) for table in request.patches]
    return CameraCapture(tuple(shown), tuple(lights[name] for name in request.light), reflectances,
                         chart, bool(request.reference), excluded)


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


