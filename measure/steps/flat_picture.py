"""The step that makes a picture of spectra of a flat sample."""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from spectrabox.capture.photo.registration import resampled, uncertain_edges
from spectrabox.measure.captured import FlatCapture
from spectrabox.measure.pictures.crop import Crop, crop_of, crop_photo, node_grid
from spectrabox.measure.pictures.lit_photo import LitPhoto
from spectrabox.measure.pictures.picture_files import write_picture
from spectrabox.measure.pictures.stacked_photos import PicturePhoto, stack_photos
from spectrabox.measure.records import CaptureRecords, PictureRecords
from spectrabox.measure.steps.signals import flat_errors, flat_photos
from spectrabox.measure.steps.work import Work
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import LinearImage, Registration
from spectrabox.sampling.prior.mixture import load_prior, of_families

COLUMNS = 24                # of the nodes at which white and its errors are computed
SHARE_OF_TIME = 0.1         # reading photos


def flat_picture(capture: FlatCapture, records: CaptureRecords, work: Work) -> PictureRecords:
    """Spectra of every pixel of the first photo, or of a part of it, in the bands of all photos
    that show the same regions.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of charts, photos and calibration.
    work : Work
        With a folder.

    Raises
    ------
    InputError
        If the picture's rectangle leaves the photo.
    """
    assert capture.picture is not None
    if work.folder is None:
        raise InputError("a picture of spectra is files: name a folder for them")
    lit = lit_photo(capture, records, work)
    written = write_picture(lit, capture.picture, work.folder, lambda share: work.progress(
        SHARE_OF_TIME + (1 - SHARE_OF_TIME) * share, ""))
    return replace(written, findings=tuple(_findings(capture, lit)))


def lit_photo(capture: FlatCapture, records: CaptureRecords, work: Work) -> LitPhoto:
    """All photos of the picture, in the pixels of the first, with white and its errors."""
    assert capture.picture is not None
    views = capture.picture_views
    photos = flat_photos(capture, records)
    shown: list[PicturePhoto] = []
    for number, view in enumerate(views):
        work.progress(SHARE_OF_TIME * number / len(views), f"reading {view.photo_names[0]}")
        image, _ = work.photos.developed(view.photo)
        if not number:
            crop = crop_of(image, capture.picture.rect)
            nodes_px, between = node_grid(crop, COLUMNS)
        motion = records.photo.registrations.get(view.name)
        shown.append(PicturePhoto(
            photos[capture.views.index(view)], _in_first(image, motion, crop),
            nodes_px if motion is None else motion.moved(nodes_px)))
    return stack_photos(shown, between, capture.known, flat_errors(capture, records),
                        capture.picture.surface,
                        of_families(load_prior(), capture.picture.families))


def _in_first(image: LinearImage, motion: Registration | None, crop: Crop) -> LinearImage:
    """A photo in the pixels of the first, the part of the picture alone; edges that may lie beside
    those of the first count as saturated.
    """
    off_px: np.ndarray | float
    if motion is None:
        return crop_photo(image, crop)
    if motion.still:
        shown = crop_photo(image, crop)
        off_px = motion.shift_px / crop.step
    else:
        shown, off_px = resampled(image, motion.matrix, crop.x_px, crop.y_px)
    uncertain = uncertain_edges(shown, np.hypot(off_px, (motion.residual_px or 0) / crop.step))
    return replace(shown, saturated=shown.saturated | uncertain[..., None])


def _findings(capture: FlatCapture, lit: LitPhoto) -> Iterator[Finding]:
    """What a reader of the picture has to know of its photos."""
    views = capture.picture_views
    for view in capture.views:
        if view not in views:
            yield Finding("picture.without-photo", Severity.NOTE, view.title)
    if len(views) > 1:
        yield Finding("picture.photos", Severity.INFO, values={
            "names": [view.title for view in views], "bands": int(lit.size[2])})
    if lit.shown is not None and len(lit.shown.sets) > 1:
        yield Finding("picture.fewer-photos", Severity.INFO, values={
            "share": float(np.mean((lit.shown.index > 0) & (lit.shown.flags == 0)))})
