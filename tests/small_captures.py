"""Captures and records of a few fields, for tests of single steps."""
from pathlib import Path

import numpy as np

from spectrabox.measure.captured import (
    ONE_PHOTO,
    InputFile,
    LitChart,
    SceneCapture,
    SceneView,
)
from spectrabox.measure.opened_photos import OpenPhotos
from spectrabox.measure.records import CaptureRecords, MeasuredChart, PhotoRecords
from spectrabox.measure.steps.work import Work
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import ChartDetection, LinearImage, PhotoKind
from spectrabox.radiometry.records.spectra import UnknownLight

BANDS = ("R", "G", "B")
GIVEN_CORNERS = Finding("chart.corners-given", Severity.INFO)


def photo_of(name):
    """A photo's one file, without a folder."""
    return {ONE_PHOTO: (InputFile(name, Path(name)),)}


def image(signal=None, exposure_s=1 / 60):
    """A photo of a few pixels, of no noise and nothing clipped."""
    signal = np.full((4, 5, 3), 0.4) if signal is None else signal
    return LinearImage(signal, 1e-8 * np.ones(signal.shape), np.zeros(signal.shape, bool), 1.0,
                       exposure_s, 100.0, 8.0, PhotoKind.RAW, "camera", "photo.dng", "0" * 64)


def scene_view(name="", photo="box.dng", chart=None, light=None, words="lamp", **fields):
    """A view of a scene that nobody traces; its chart's file, or none."""
    fields = {"lamp": "photo", "scene": None} | fields
    return SceneView(name=name, photo=photo_of(photo),
                     chart={} if chart is None else photo_of(chart),
                     light=light or UnknownLight(), light_words=words, **fields)


def scene_capture(*views, reflectances=None, excluded=None, **fields):
    """A capture of these views, the chart with the given reflectances (I, P)."""
    chart = None if reflectances is None else LitChart(
        CLASSIC, reflectances, np.zeros(24, bool) if excluded is None else excluded)
    return SceneCapture(**{"views": views, "chart": chart, "materials": {}, "seed": 1} | fields)


def measured_chart(samples=None, thumbnail=None):
    """A chart of these patches in even light."""
    return MeasuredChart(ChartDetection(np.zeros((24, 4, 2)), 1.0, False, GIVEN_CORNERS), samples,
                         thumbnail or image(), np.ones(24))


def photo_records(*names, thumbnail=None):
    """Photos of the views of these names."""
    return PhotoRecords(dict.fromkeys(names, thumbnail or image()), {}, {}, BANDS, ())


def records_of(**steps):
    """Records by the names of their steps."""
    return CaptureRecords(steps)


def work(capture=None):
    """What a step is lent that shows nothing, keeps nothing and opens the photos of a capture."""
    return Work(OpenPhotos(capture), lambda *_: None, "cpu")


WHITE = np.array([0.5, 0.6, 0.4])


def photo(ratio=1.0, exposure_s=0.1, rng=None, step=1.0, **changes):
    """Two grey cards, the right one half as bright, on black; ``ratio`` is the light's."""
    signal = np.zeros((40, 80, 3))
    signal[8:33, 8:33], signal[8:33, 48:73] = WHITE, WHITE / 2
    signal *= np.asarray(ratio) * exposure_s / 0.1
    variance = np.full(signal.shape, 1e-6)
    if rng is not None:
        signal = signal + 1e-3 * rng.standard_normal(signal.shape)
    parts = {"signal": signal.astype(np.float32), "variance": variance.astype(np.float32),
             "saturated": np.zeros(signal.shape, bool), "sensor_step": step,
             "exposure_s": exposure_s, "iso": 100.0, "f_number": 8.0, "kind": PhotoKind.RAW,
             "camera": "", "source": "IMG.dng", "sha256": ""}
    return LinearImage(**(parts | changes))
