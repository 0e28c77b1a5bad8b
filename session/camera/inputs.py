"""What the camera commands read and write: lights, chart reflectances, patches, curves, facts."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.chart_calibration import (
    LEVEL,
    CalibrationOptions,
    ChartPhoto,
    CurveBand,
)
from spectrabox.calibrate.prior.camera_prior import load_camera_prior
from spectrabox.capture.chart.detection import locate_chart
from spectrabox.capture.chart.quality import ChartVerdict, judge_chart
from spectrabox.capture.photo.linear import open_photo
from spectrabox.capture.photo.orientation import photo_orientation, turned
from spectrabox.measure.camera import CameraFit, chart_signals, fit_camera, measure_chart
from spectrabox.measure.chart_check import held_out_sentence
from spectrabox.radiometry.chart import CLASSIC, Chart, chart_reflectances, excluded_patches
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.files import whole_file, write_text_whole
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import (
    ChartDetection,
    LinearImage,
    PatchSamples,
    Quantity,
    SensitivityFit,
    Spectrum,
    UnknownLight,
    WavelengthGrid,
    default_band_names,
)
from spectrabox.radiometry.spectra.kept_cameras import keep_camera, require_new_name
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves, table_text
from spectrabox.radiometry.spectra.stated_light import stated_light
from spectrabox.radiometry.system.words import is_whole_number
from spectrabox.session.camera.patch_files import read_patches
from spectrabox.session.commands.requests import CameraFitRequest
from spectrabox.session.outputs.calibration_facts import (
    left_out_facts,
    posterior_facts,
)
from spectrabox.session.terminal.command_line import CORNERS, check_ending, pixel_numbers

CURVES = {".csv": "the curves and their standard errors"}
DRAWS = {".npz": "draws of the curves"}


def fit_answer(request: CameraFitRequest) -> tuple[dict[str, Any], str]:
    """JSON object and text of ``spectrabox camera fit``, which writes its files.

    Raises
    ------
    InputError
        If an input cannot be read, or an output would replace one.
    """
    photos = [*request.photos, *request.chart]
    given, grid = photos or [*request.patches], visible_grid()
    outputs = [path for path in (request.out, request.draws_file) if path is not None]
    require_outputs(outputs, [*given, *map(Path, request.light), *map(Path, request.reference),
                              *(path for path in (request.curves, request.prior_file)
                                if path is not None)])
    check_ending(request.out, CURVES)
    check_ending(request.draws_file, DRAWS, "--draws-file")
    if request.keep is not None:
        require_new_name(request.keep)
    charts, names, notes = read_photos(given, list(request.light), list(request.reference),
                                list(request.corners), bool(photos), grid,
                                numbers_of_patches(request.leave_out), request.layout)
    curves = None if request.curves is None \
        else read_measured_curves(request.curves, len(names), grid)
    prior = None if request.prior_file is None else load_camera_prior(request.prior_file)
    layout = charts[0].chart
    generations = None if request.reference else {
        name: chart_reflectances(name, grid, layout) for name in layout.generations}
    result = fit_camera(charts, grid, CalibrationOptions(request.method, prior, curves=curves),
                        generations=generations)
    light = ", ".join(light_words(chart.light) for chart in charts)
    facts = {**facts_of(result, charts[0].chart), "bands": list(names), "light": light}
    facts["checks"] += notes
    fit = result.sensitivity
    nm = fit.grid.nm
    columns, source = _columns(fit, names, light)
    lines = [f"bands {', '.join(names)}: {fit.method}",
             *(f"- {check}" for check in facts["checks"]), fit.outcome.value]
    if request.out is not None:
        write_text_whole(request.out, table_text(nm, columns, quantity=Quantity.RELATIVE,
                                                 source=source))
        facts["file"] = str(request.out)
        lines.append(f"wrote {request.out}")
    if request.keep is not None:
        facts["kept"] = str(keep_camera(request.keep, nm, columns, source))
    if request.draws_file is not None:
        write_draws(request.draws_file, result.band, grid)
        facts["samples"] = str(request.draws_file)
    return facts, "\n".join(lines)


def read_photos(photos: list[Path], lights: list[str], references: list[str], corners: list[str],
                decode: bool, grid: WavelengthGrid,
                leave_out: list[int],
                layout: str = ""
                ) -> tuple[tuple[ChartPhoto, ...], tuple[str, ...], tuple[str, ...]]:
    """Every photo with its light and chart, the names of the bands, and notes.

    Parameters
    ----------
    photos : list of Path
        Pictures if ``decode``, tables of patch signals otherwise.
    lights, references, corners : lists of str
        One for every photo, or one for all; ``references`` and ``corners`` may be empty.
    leave_out : list of int
        Numbers of patches, from 1, that no fit is to use.
    layout : str
        Of the chart, by name or file; a ColorChecker Classic where empty.

    Raises
    ------
    InputError
        If the photos are not of the same bands, or one of the files cannot be read.
    """
    known_lights = {name: stated_light(name, grid) for name in lights}
    layout_of = read_layout(layout)
    excluded = excluded_patches(leave_out, layout_of, "--leave-out")
    named_charts: list[str | None] = list(references) or [None]
    known_charts = {name: reference_reflectances(name, layout_of, grid)
                    for name in named_charts}
    chart_of = [known_charts[named_charts[index if len(named_charts) > 1 else 0]]
                for index in range(len(photos))]
    places = [corners[index if len(corners) > 1 else 0] if corners else None
              for index in range(len(photos))]
    measured_photos = [_patches_of_picture(photo, at, layout_of, reflectances, grid) if decode
             else read_patches(photo, layout_of)
             for photo, at, reflectances in zip(photos, places, chart_of, strict=True)]
    charts: list[ChartPhoto] = []
    names: list[tuple[str, ...]] = []
    for index, (photo, (measured, bands, _)) in enumerate(zip(photos, measured_photos,
                                                              strict=True)):
        light = lights[index if len(lights) > 1 else 0]
        charts.append(ChartPhoto(measured, chart_of[index], known_lights[light],
                                 excluded=excluded, chart=layout_of))
        names.append(bands)
        if any(np.array_equal(measured.mean, chart.samples.mean) for chart in charts[:-1]):
            raise InputError(f"{photo.name} holds the same signals as another of the photos; "
                             "counted twice, one photo would seem surer than it is: give each "
                             "photo once")
        if bands != names[0]:
            raise InputError(f"{photo.name} has the bands {', '.join(bands)}, {photos[0].name} has "
                             f"{', '.join(names[0])}; all photos must be of one camera, its bands "
                             "in the same order")
    return tuple(charts), names[0], tuple(note for *_, notes in measured_photos for note in notes)


def light_words(light: Spectrum | UnknownLight) -> str:
    """What is known of a light, in words."""
    return light.words if isinstance(light, UnknownLight) else light.source


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


def _patches_of_picture(path: Path, corners: str | None, chart: Chart, reflectances: np.ndarray,
                        grid: WavelengthGrid
                        ) -> tuple[PatchSamples, tuple[str, ...], tuple[str, ...]]:
    """Patch statistics and band names of a photo, and no notes."""
    photo = turned(open_photo(path), photo_orientation(path))
    corners_px = None if corners is None else corner_points(corners, chart)
    return (measure_chart(photo, chart, reflectances, grid, corners_px),
            default_band_names(photo.signal.shape[2]), ())


def judged_chart(image: LinearImage, layout: str, reference: str | None,
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
    grid, chart = visible_grid(), read_layout(layout)
    reflectances = None if chart.has_known_colours and reference is None else \
        reference_reflectances(reference, chart, grid)
    signals = chart_signals(chart, reflectances, grid)
    detection = locate_chart(image, signals,
                             None if corners is None else corner_points(corners, chart), chart)
    if detection.mirrored:
        raise CheckError(f"photo {image.source} shows the chart mirrored; give the photo as the "
                         "camera took it, without flipping or a mirror in the light path")
    return detection, judge_chart(image, detection, signals, chart)


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


def require_outputs(outputs: list[Path], inputs: list[Path]) -> None:
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


def facts_of(camera: CameraFit, chart: Chart) -> dict[str, Any]:
    """A camera as plain numbers for a script (docs/json.md, ``camera fit``); the first photo shows
    ``chart``.
    """
    result, band = camera.chart, camera.band
    fit, joint = camera.sensitivity, result.prior_fit
    facts: dict[str, Any] = {
        "wavelengths_nm": fit.grid.nm.tolist(), "sensitivities": fit.curves.tolist(),
        "lower": None if band is None else band.lower.tolist(),
        "upper": None if band is None else band.upper.tolist(),
        "level": LEVEL, "condition_number": fit.condition_number,
        "chart_delta_e00": float(result.delta_e.mean()),
        "held_out_delta_e00": float(result.held_out_delta_e.mean()),
        "chart_delta_e00_patches": result.delta_e.tolist(),
        "light_scale": result.scale.value,
        "light_scale_standard_error": result.scale.standard_error,
        "method": fit.method, "checks": list(result.calibration.checks),
        "outcome": fit.outcome.value}
    facts["left_out"] = left_out_facts(camera.held_out, chart.names)
    facts["checks"].append(held_out_sentence(camera.held_out))
    facts["doubts"] = [doubt.value for doubt in result.calibration.doubts]
    known = result.calibration.light_posterior
    if camera.generation is not None:
        facts["checks"].append(camera.generation.words)
    facts["chart_generation"] = None if camera.generation is None else {
        "reference": camera.generation.reference,
        "log_evidence": camera.generation.log_evidence}
    facts["stated_lights"] = [
        {"light": departure.source, "expected": departure.expected, "departs": departure.size,
         "standard_error": departure.size_error, "spectrum": departure.spectrum.tolist()}
        for departure in result.departures]
    facts["light_posterior"] = None if known is None else posterior_facts(known)
    if joint is not None:
        facts |= {"model_error": joint.model_error, "chi_square": joint.chi_square,
                  "prior_share": joint.prior_share.tolist(), "photos": len(joint.photos),
                  "field": joint.photos[0].field.tolist(), "glare": joint.photos[0].glare.tolist(),
                  "nearest_cameras": [{"cameras": members, "probability": share}
                                      for members, share in joint.families]}
    return facts


def _columns(fit: SensitivityFit, names: tuple[str, ...],
             light: str) -> tuple[dict[str, Any], str]:
    """Curves and standard errors by column, and where they are from."""
    columns: dict[str, Any] = dict(zip(names, fit.curves, strict=True))
    if fit.standard_error is not None:
        columns |= {f"standard_error {name}": values
                    for name, values in zip(names, fit.standard_error, strict=True)}
    return columns, f"{fit.method}, light {light}".replace("\n", " ")


def write_draws(path: Path, band: CurveBand | None, grid: WavelengthGrid) -> None:
    """Draws of all curves together as an NPZ."""
    if band is None or band.draws is None:
        raise InputError("draws come with the method prior only; leave --draws-file out")
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, wavelengths_nm=grid.nm, curves=band.draws)
