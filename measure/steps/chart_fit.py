"""From photos of a chart to a camera: the chart found, its patches taken, camera and lights fitted.

The steps of a measurement come here, and so does a camera that is fitted by itself.
"""
from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from spectrabox.calibrate import chart_calibration, chart_photo
from spectrabox.capture.chart import detection, patches
from spectrabox.measure import captured, held_out_spectra
from spectrabox.radiometry import error_model, errors
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.charts.references import editions
from spectrabox.radiometry.records import calibration, photos, spectra
from spectrabox.reconstruct.rendering import renderer
from spectrabox.reconstruct.scene.scene_file import SceneFile


def find(photo: photos.LinearImage, expected: np.ndarray, layout: Chart,
         corners_px: np.ndarray | None = None, before: photos.ChartDetection | None = None, *,
         filtered: bool = False, excluded: np.ndarray | None = None) -> photos.ChartDetection:
    """The chart in a photo: searched for by its colours or, through a filter or where its light
    leaves no colours, where another photo from the same tripod shows it.

    Parameters
    ----------
    photo : LinearImage
    expected : (I, 3) or (I, K) array
        Signals by which the chart is known.
    layout : Chart
    corners_px : (4, 2) array or None
        Of the chart, in pixels of the photo; None to search for it.
    before : ChartDetection or None
        In the other photo.
    filtered : bool
        Whether this photo is through a filter.
    excluded : (I,) bool array, optional
        As of ``find_chart``.

    Raises
    ------
    ChartNotFoundError, CheckError
        As ``find_chart``.
    """
    if before is not None and filtered:
        return detection.find_chart_again(photo, expected, before, layout, excluded)
    try:
        return detection.find_chart(photo, expected, corners_px, layout, excluded)
    except errors.ChartNotFoundError:
        if before is None:
            raise
        return detection.find_chart_again(photo, expected, before, layout, excluded)


def find_patches(photo: photos.LinearImage, expected: np.ndarray, layout: Chart,
                 corners_px: np.ndarray | None = None, before: photos.ChartDetection | None = None,
                 *, filtered: bool = False, excluded: np.ndarray | None = None
                 ) -> tuple[photos.ChartDetection, photos.PatchSamples]:
    """The chart in a photo, and the signals of its patches.

    Parameters
    ----------
    photo, expected, layout, corners_px, before, filtered, excluded
        As of ``find``.

    Raises
    ------
    ChartNotFoundError, CheckError
        As ``find_chart``.
    ClippedPhotoError
        If more than a few patches are saturated.
    """
    detection = find(photo, expected, layout, corners_px, before, filtered=filtered,
                     excluded=excluded)
    samples = patches.sample_patches(photo, detection)
    patches.require_unclipped(samples, layout.names, photo.source, layout.neutrals)
    return detection, samples


def as_fitted(
    samples: Sequence[photos.PatchSamples], charts: Iterable[captured.LitChart],
    lights: Iterable[spectra.Spectrum | spectra.UnknownLight], irradiance: np.ndarray | None = None,
    filters: Iterable[calibration.Filter | None] | None = None, bands: tuple[str, ...] = ()
) -> list[chart_photo.ChartPhoto]:
    """Charts in photos as their fits take them. One of which nobody stated the reflectances is a
    copy of an edition that was sold by the day of the first photo.

    Parameters
    ----------
    samples : sequence of PatchSamples
        One for each photo.
    charts, lights : iterables of LitChart, and of Spectrum or UnknownLight
        Likewise.
    irradiance : (I,) array or None
        On each patch for a light spectrum of 1; None where it is not known.
    filters : iterable of Filter or None, optional
        Before lens or lamp, one for each photo.
    bands : tuple of K str
        Their names.
    """
    taken_at, photos = chart_photo.first_date(list(samples)), []
    for one, chart, light, through in zip(samples, charts, lights,
                                          filters or [None] * len(samples), strict=True):
        of = () if chart.stated else editions(chart.layout, taken_at)
        photos.append(
            chart_photo.ChartPhoto(one, of[0].mean if of else chart.reflectances, light, irradiance,
                                   chart.excluded, chart.layout, through, bands, of))
    return photos


def fit(
    photos: Sequence[chart_photo.ChartPhoto], grid: spectra.WavelengthGrid,
    chosen: captured.Sensitivity
) -> tuple[chart_calibration.ChartCalibration, calibration.HeldOutPatches]:
    """One camera and the lights of its photos, with every patch of the first by a fit without it.

    Parameters
    ----------
    photos : sequence of ChartPhoto
    grid : WavelengthGrid
    chosen : Sensitivity

    Raises
    ------
    InputError, CheckError, CalibrationError
        As ``calibrate_chart``.
    """
    fitted = chart_calibration.calibrate_chart(photos, grid, chosen.method, chosen.prior,
                                               curves=chosen.curves)
    return fitted, held_out_spectra.held_out_patches(fitted, fitted.reflectances)


def irradiance_on(layout: Chart, scene: SceneFile, seed: int, device: str) -> np.ndarray:
    """On each patch (I,) of a chart in a scene, for a light spectrum of 1, as it is rendered."""
    renderer.start_mitsuba(device)
    return renderer.patch_irradiance(scene, layout.centres_uv, layout.sizes_uv, seed)


def lamp_error(layout: Chart, scene: SceneFile, position_error: float, seed: int) -> float:
    """Relative standard error of that irradiance by the lamp's position, which errs by a part of
    its distance from the chart.
    """
    return renderer.lamp_position_error(scene, layout.centres_uv, layout.sizes_uv, position_error,
                                        seed)


def with_lamp_error(calibration: calibration.Calibration, error: float) -> calibration.Calibration:
    """A calibration whose light scale errs by the lamp's position too."""
    scale = calibration.light_scale
    return calibration if scale is None else replace(
        calibration,
        light_scale=error_model.with_common_error(scale, error_model.LAMP_AT_CHART, error))
