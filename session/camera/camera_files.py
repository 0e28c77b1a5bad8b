"""What the camera commands read and write: photos and patches of charts, corners, curves, draws."""


from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spectrabox.calibrate.prior.learnt_prior import SUFFIXES, cameras_of_file
from spectrabox.capture.chart.quality import ChartVerdict
from spectrabox.capture.develop.developed import develop_photos
from spectrabox.capture.photo.preview import photo_orientation
from spectrabox.measure import camera, captured, chart_patches
from spectrabox.measure.shoot import captures, inputs, shoot
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import read_text, whole_file, write_text_whole
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records import photos, spectra
from spectrabox.radiometry.spectra import cameras, spectrum_files
from spectrabox.radiometry.system.words import is_whole_number
from spectrabox.session.terminal.command_line import CORNERS, pixel_numbers

MAX_SIGNAL = 1e9        # white is near 1, or near 65535
ADVICE = "give a CSV of signals, a row for each patch"
# Relative, where a table states none: charts and photos of them agree to 0.3 to 0.5 %. Signals
# taken as exact are held against the last digit of how somebody integrated over wavelength.
ASSUMED_ERROR = 0.004
DARK = 0.03             # of the brightest patch: the error of darker ones is that of this


def read_patches(path: Path, chart: Chart = CLASSIC) -> camera.ChartSignals:
    """Signals of a chart's patches, in chart order, and the names of the bands.

    The first row may name the columns; a column ``standard_error NAME`` holds the standard errors
    of band NAME, and where such columns name no bands they stand in the bands' order. Of a table
    that ``spectrabox chart --out`` wrote, ``clipped NAME`` says which signals are none, and
    positions and spread are left out. Without names, every column is a band. A first column of
    words (patch names) is left out. Where no errors are stated, those that charts and photos have
    are assumed, and a finding says so.

    Parameters
    ----------
    path : Path
        Comma-separated text; lines that begin with # are left out.
    chart : Chart

    Raises
    ------
    InputError
        If the file is missing, does not hold a row for each patch, a cell is not a number up to
        1e9, two bands have one name, or a standard error is negative or of no band.
    """
    rows = _rows(path)
    header = rows.pop(0) if not any(_is_number(cell) for cell in rows[0]) else None
    if rows and not _is_number(rows[0][0]):
        rows = [row[1:] for row in rows]
        header = header[1:] if header is not None else None
    if len(rows) != len(chart.names):
        raise InputError(f"{path.name} holds {len(rows)} rows of signals; {len(chart.names)} are "
                         f"needed, one per patch, {chart.names[0]} first, {chart.names[-1]} last")
    if len({len(row) for row in rows}) != 1 or not all(_is_number(cell) for row in rows
                                                       for cell in row):
        raise InputError(f"{path.name}: some rows are shorter than others or hold words; give a "
                         f"number up to {MAX_SIGNAL:.0e} in every cell")
    values = np.array(rows, dtype=float)
    names = [name.strip() for name in header or (f"band {column + 1}"
                                                 for column in range(values.shape[1]))]
    further = [
        index for index, name in enumerate(names)
        if name in (*chart_patches.POSITIONS,
                    *chart_patches.COUNTS) or name.startswith((chart_patches.SPREAD_PREFIX,
                                                               chart_patches.CLIPPED_PREFIX))
    ]
    bands = [index for index, name in enumerate(names)
             if index not in further and not name.startswith(camera.ERROR_PREFIX)]
    errors = [index for index, name in enumerate(names) if name.startswith(camera.ERROR_PREFIX)]
    if errors and len(errors) != len(bands):
        raise InputError(f"{path.name} holds {len(bands)} bands and {len(errors)} standard errors; "
                         "give one for each band, or none")
    band_names = [names[index] for index in bands]
    if len(set(band_names)) < len(bands):
        raise InputError(f"{path.name} holds two bands of one name ({', '.join(band_names)}); name "
                         "each column once")
    error = _errors(values, names, band_names, errors, path.name) if errors else None
    clipped = np.column_stack([
        values[:, names.index(column)] if column in names else np.zeros(len(values))
        for column in (f"{chart_patches.CLIPPED_PREFIX} {band}" for band in band_names)
    ])
    return signals_of_patches(path.name, values[:, bands], error, tuple(band_names), clipped)


def signals_of_patches(source: str, signal: np.ndarray, error: np.ndarray | None,
                       bands: tuple[str, ...], clipped: np.ndarray) -> camera.ChartSignals:
    """Signals (I, K) of a chart's patches that somebody read elsewhere.

    Parameters
    ----------
    source : str
        What the signals are called.
    signal : (I, K) array
    error : (I, K) array or None
        Standard errors; those that charts and photos have where nothing is stated, as a finding
        says.
    bands : tuple of K str
    clipped : (I, K) array
        Share of saturated pixels.
    """
    assumed: tuple[Finding, ...] = ()
    if error is None:
        error = ASSUMED_ERROR * np.maximum(np.abs(signal), DARK * np.abs(signal).max(axis=0))
        assumed = (Finding("patches.errors-assumed", Severity.NOTE, source,
                           {"error": ASSUMED_ERROR}),)
    covariance = np.einsum("ik,kl->ikl", error**2, np.eye(signal.shape[1]))
    return camera.ChartSignals(source, photos.PatchSamples(signal, covariance, np.ones(len(signal)),
                                                           clipped, np.zeros(signal.shape)), bands,
                               assumed)


def _errors(values: np.ndarray, names: list[str], band_names: list[str], columns: list[int],
            file: str) -> np.ndarray:
    """Standard errors (I, K) in the order of the bands."""
    of_band = {names[column].removeprefix(camera.ERROR_PREFIX).strip(" _"): column
               for column in columns}
    if set(of_band) == set(band_names):
        columns = [of_band[name] for name in band_names]
    elif set(of_band) & set(band_names):
        stray = next(name for name in of_band if name not in band_names)
        raise InputError(
            f"{file} has the column {camera.ERROR_PREFIX} {stray!r} and no band of that "
                         f"name; the bands are {', '.join(band_names)}")
    if values[:, columns].min() < 0:
        raise InputError(f"{file} holds a negative standard error; they are 0 or greater, in the "
                         "unit of the signals")
    return values[:, columns]


def _rows(path: Path) -> list[list[str]]:
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise InputError(f"{path} is missing; {ADVICE}") from None
    except (UnicodeDecodeError, IsADirectoryError):
        raise InputError(
            f"{path.name} is not a text file; {ADVICE}") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    rows = [row for row in csv.reader(lines) if any(cell.strip() for cell in row)]
    if not rows:
        raise InputError(f"{path.name} is empty; {ADVICE}")
    return rows


def _is_number(cell: str) -> bool:
    try:
        return abs(float(cell)) <= MAX_SIGNAL
    except ValueError:
        return False


# ---- what the camera commands read and write -----------------------------------------------------


def stated_of_charts(photos: Sequence[Path], lights: Sequence[str], references: Sequence[str],
                     corners: Sequence[str], layout: str, leave_out: str, method: str | None,
                     prior: Path | None,
                     curves: Path | None) -> list[captured.FlatCapture | captured.SceneCapture]:
    """What is stated of each photo of a chart, its spectra and files read.

    Parameters
    ----------
    photos : sequence of Path
        Or tables of signals.
    lights, references, corners : sequences of str
        As of ``--light``, ``--reference`` and ``--corners``: one for each photo, or one for all.
    layout, leave_out : str
        As of ``--chart-layout`` and ``--leave-out``.
    method : str or None
        Of the fit; None takes the model's own.
    prior, curves : Path or None
        A prior on curves; measured curves, in place of a fit.

    Raises
    ------
    InputError
        If one of the files cannot be read.
    """
    chart = read_layout(layout)
    quads = [corner_points(text, chart).tolist() for text in corners]
    stated = []
    for index, photo in enumerate(photos):
        light, reference, quad = (
            None if not values else values[index if len(values) > 1 else 0]
            for values in (lights, references, quads))
        stated.append(captures.capture_of(shoot.Shoot.from_command({
            "photos": {"object": str(photo)}, "regions": {}, "light": {"spectrum": light},
            "chart": {"reference": reference, "corners_px": quad,
                      "leave_out": numbers_of_patches(leave_out)}
            | ({"layout": layout} if layout else {}),
            "sensitivity": {"prior": None if prior is None else str(prior)}
            | ({} if method is None else {"method": method})
            | ({} if curves is None else {"from": {"file": str(curves)}})}),
            inputs.Inputs(Path(), allow_outside=True)))
    return stated


def charts_shown(photos: Sequence[Path], tables: Sequence[Path],
                 stated: Sequence[captured.Capture]) -> list[camera.ChartSignals]:
    """The patches of the chart in each photo, or of each table of signals.

    Parameters
    ----------
    photos, tables : sequences of Path
    stated : sequence of Capture
        One for each of them.

    Raises
    ------
    InputError, CheckError
        If a file cannot be read, or does not show the chart.
    """
    shown = [camera.chart_in_photo(develop_photos([path], [], None,
                                                  orientation=photo_orientation(path))[0], capture)
             for path, capture in zip(photos, stated, strict=False)]
    return shown + [read_patches(table, stated[0].layout) for table in tables]


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


def chart_named(image: photos.LinearImage, layout: str, reference: str | None, corners: str | None,
                excluded: np.ndarray | None = None) -> tuple[photos.ChartDetection, ChartVerdict]:
    """The chart in a photo and the verdict on it, as the options of a command name chart and
    corners.

    Parameters
    ----------
    image : LinearImage
    layout, reference : str
        As of ``--chart-layout`` and ``--reference``.
    corners : str, optional
        As of ``--corners``.
    excluded : (I,) bool array, optional
        Patches that the operator leaves out.

    Raises
    ------
    CheckError
        If there is no chart, or it is mirrored.
    InputError
        If a chart, a reference or corners cannot be read.
    """
    chart = read_layout(layout)
    return camera.judged_chart(image, chart, reference,
                               None if corners is None else corner_points(corners, chart), excluded)


def corner_points(text: str, chart: Chart) -> np.ndarray:
    """Corners (4, 2) of a chart in pixels, of an option X,Y,X,Y,X,Y,X,Y.

    Raises
    ------
    InputError
        If they are not four points.
    """
    return np.array(pixel_numbers(text, 8, "--corners", f"{CORNERS} at {chart.corner_words}")
                    ).reshape(4, 2)


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


def write_curves(path: Path, camera: camera.CameraFit) -> None:
    """Curves and their standard errors, a column each."""
    write_text_whole(path, spectrum_files.table_text(camera.sensitivity.grid.nm, camera.columns(),
                                      quantity=spectra.Quantity.RELATIVE, source=camera.source))


def write_draws(path: Path, camera: camera.CameraFit) -> None:
    """Draws of all curves together as an NPZ."""
    if camera.draws is None:
        raise InputError("draws come with the method prior only; leave --draws-file out")
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, wavelengths_nm=camera.sensitivity.grid.nm,
                            curves=camera.draws)


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
                bands = spectra.default_band_names(len(curves))
                cameras.keep_camera(name, nm, dict(zip(bands, curves, strict=True)),
                            f"{name}, from {path.name}")
                kept.append(name)
        except InputError as error:
            skipped.append(str(error))
    if not kept:
        raise InputError(skipped[0] if skipped else "there are no files of camera curves there; "
                         ".json (rawtoaces) or .csv are needed")
    return kept, skipped, cameras.cameras_folder()


def _camera_files(sources: Sequence[Path]) -> Sequence[Path]:
    """The files, and those of the folders that end as camera files do."""
    files: list[Path] = []
    for source in sources:
        if not source.exists():
            raise InputError(f"{source} is missing; give a file or folder of camera curves")
        files += sorted(path for path in source.iterdir() if path.suffix.lower() in SUFFIXES) \
            if source.is_dir() else [source]
    return files
