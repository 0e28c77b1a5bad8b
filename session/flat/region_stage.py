"""The stage that decodes photos of flat samples, to the signals of their regions."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.capture.photo.binning import bin_image
from spectrabox.capture.photo.image_files import write_png
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.capture.photo.regions import region_signals, sample_regions
from spectrabox.session.config.session_schema import (
    FIRST_PHOTO,
    RegionSection,
    SessionConfig,
    ViewInputs,
)
from spectrabox.session.stages.stage_task import StageTask

PREVIEW_WIDTH = 800          # pixels of the picture in the report, at most
THUMBNAIL_WIDTH = 96         # of what is kept as numbers, for exposure, clipping and mean signal
UNEVEN = 0.05                # scatter of pixels beyond noise, relative, above which to say so


def measure_regions(task: StageTask) -> dict[str, Any]:
    """Photos to the signals of the regions they show.

    Returns
    -------
    dict
        "notes", and of every photo its "regions" (RegionSamples; None where it shows none) and
        its thumbnail "photo"; of the first also the signals of the "references" where the
        session names some.

    Raises
    ------
    InputError
        If a region leaves the photo.
    ClippedPhotoError
        If a region is clipped.
    """
    config = task.config
    records: dict[str, Any] = {"notes": ()}
    for index, view in enumerate(config.all_views):
        name = view.photo_files[0]
        task.progress((index + 0.1) / len(config.all_views), f"reading {name}")
        photo, notes = task.photos.developed(config, view.photo)
        shown = {region: section.outline() for region, section in regions_of(config, view)}
        samples = sample_regions(photo, shown) if shown else None
        if samples is not None:
            notes += tuple(_uneven(region, float(scatter.max())) for region, scatter
                           in zip(samples.names, samples.scatter, strict=True)
                           if scatter.max() > UNEVEN)
        if config.drift.object_px and not view.name:
            records["references"] = region_signals(photo, np.array(config.drift.object_px))
        height, width = photo.signal.shape[:2]
        records[view.record("regions")] = samples
        records[view.record("photo")] = bin_image(
            photo, THUMBNAIL_WIDTH, max(round(THUMBNAIL_WIDTH * height / width), 1))
        write_png(task.folder / f"{view.record('preview')}.png",
                  signal_rgb8(photo.signal, -(-width // PREVIEW_WIDTH)))
        records["notes"] += notes
    return records


def regions_of(config: SessionConfig, view: ViewInputs) -> list[tuple[str, RegionSection]]:
    """The regions that a photo shows."""
    name = view.name or FIRST_PHOTO
    return [(region, section) for region, section in config.regions.items()
            if not section.photos or name in section.photos]


def _uneven(region: str, scatter: float) -> str:
    return (f"region {region!r} is uneven: its pixels scatter by {scatter:.0%} beyond noise and "
            "even light, and its spectrum is the mean of what lies in it; outline a smaller part "
            "for one paint")
