"""The result of what is marked now, before any report: its verdict, and what it rests on."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from spectrabox.measure import conditions, texts
from spectrabox.measure.captured import FlatCapture, PhotoFiles
from spectrabox.measure.opened_photos import OpenPhotos
from spectrabox.measure.records import SampleRecords
from spectrabox.measure.regions.pointing import PointedSample
from spectrabox.measure.results.flat_result import FlatResult, flat_result
from spectrabox.measure.steps.declared_steps import FLAT_PHOTOS, FLAT_SPECTRA, SIGNALS
from spectrabox.measure.steps.measurement import InMemory, MemoryKeeper
from spectrabox.measure.steps.photos import measure_flat_photos
from spectrabox.measure.steps.signals import find_signals
from spectrabox.measure.steps.work import Work
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.records.spectra import SurfaceSpectrum


class PhotosAtHand(OpenPhotos):
    """Photos of a capture that are developed already.

    Parameters
    ----------
    capture : FlatCapture
    images : mapping
        By view.
    """

    def __init__(self, capture: FlatCapture, images: Mapping[str, LinearImage]) -> None:
        super().__init__(capture)
        self._images = [(view.photo, images[view.name]) for view in capture.views]

    def developed(self, photo: PhotoFiles) -> tuple[LinearImage, tuple[Finding, ...]]:
        """The photo; what else showed of it is the report's."""
        return next(image for files, image in self._images if files == photo), ()


def result_now(sample: PointedSample,
               drawn: Callable[[str], SurfaceSpectrum]) -> FlatResult:
    """What a run would find of the regions that are marked now, but for the picture.

    Parameters
    ----------
    sample : PointedSample
        With a region that is not known.
    drawn : callable
        The spectrum of a region by its name.

    Raises
    ------
    SpectraboxError
        As the steps.
    """
    capture, calibrated = sample.capture, sample.calibrated
    keeper = MemoryKeeper(kept={"chart": InMemory(calibrated.records.chart),
                                "calibrate": InMemory(calibrated.records.calibrate)})
    work = Work(PhotosAtHand(capture, calibrated.images), lambda share, message: None)
    keeper.keep(FLAT_PHOTOS, lambda progress, folder: measure_flat_photos(
        capture, keeper.records, work))
    keeper.keep(SIGNALS, lambda progress, folder: find_signals(capture, keeper.records, work))
    keeper.keep(FLAT_SPECTRA, lambda progress, folder: SampleRecords(
        {name: drawn(name) for name, region in capture.regions.items()
         if region.given is None}))
    return flat_result(capture, keeper.records)


def described_result(found: FlatResult) -> dict[str, Any]:
    """Verdict and conditions for the page, as the report has them."""
    return {"status": found.verdict.word, "condition": found.verdict.condition,
            "says": found.verdict.says,
            "findings": [texts.facts(one) for one in found.findings],
            "conditions": [conditions.facts(one) for one in found.conditions]}
