"""The stage that decodes object photos, to the render's size."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.calibrate.geometry.projection import undistorted
from spectrabox.capture.photo.binning import bin_image, render_size
from spectrabox.capture.photo.image_files import write_png
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.capture.photo.regions import region_signals
from spectrabox.reconstruct.scene.scene_file import require_same_shape
from spectrabox.session.box.box_camera import lens_of_view
from spectrabox.session.stages.inputs import read_photo, require_exposed
from spectrabox.session.stages.scenes import read_session_scene
from spectrabox.session.stages.stage_task import StageTask


def bin_object_photos(task: StageTask) -> dict[str, Any]:
    """Object photos to linear signal at the render's size.

    Returns
    -------
    dict
        "notes", and the "photo" of every view; of the first also the signals of the "references"
        where the session names some.

    Raises
    ------
    ClippedPhotoError
        If most of a photo is saturated.
    InputError
        If its shape is not that of its scene.
    """
    config = task.config
    records: dict[str, Any] = {"notes": ()}
    for index, view in enumerate(config.all_views):
        name = view.photo_files[0]
        task.progress((index + 0.1) / len(config.all_views), f"decoding {name}")
        photo, notes = read_photo(config, view.photo)
        require_exposed(photo, name)
        if config.drift.object_px and not view.name:
            records["references"] = region_signals(photo, np.array(config.drift.object_px))
        if (lens := lens_of_view(config, view)) is not None:
            photo = undistorted(photo, lens)
        require_same_shape(photo, read_session_scene(config, view), name)
        height, width = photo.signal.shape[:2]
        size = render_size(width, height, config.reconstruct.width)
        write_png(task.folder / f"{view.record('preview')}.png", signal_rgb8(photo.signal))
        records[view.record("photo")] = bin_image(photo, *size)
        records["notes"] += notes
    return records
