"""The cameras of a session's photos of a measured box, and the box's scene as XML."""
from __future__ import annotations

from spectrabox.calibrate.geometry.colmap_model import read_colmap
from spectrabox.calibrate.geometry.lens import Lens
from spectrabox.calibrate.geometry.lens_files import read_lens
from spectrabox.capture.photo.linear import photo_size
from spectrabox.measure.scene.box_camera import (
    BoxCamera,
    camera_from_corners,
    camera_from_model,
    measured_camera,
    require_in_front,
    visible_corners,
)
from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.reconstruct.scene.box_scene import box_xml
from spectrabox.reconstruct.scene.box_tables import BoxTable, CameraTable
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig, ViewInputs

COLMAP = f"{FILE_NAME}: scene.box.colmap"
SHOWN = 12              # names of pictures in an error


def box_text(config: SessionConfig, view: ViewInputs | None = None) -> str:
    """XML of the scene that [scene.box] describes.

    Parameters
    ----------
    config : SessionConfig
    view : ViewInputs, optional
        Of the photo; the first by default.

    Raises
    ------
    InputError
        If the photo's size cannot be read, or the marked corners are not of a box of these sizes.
    CheckError
        If no position of the camera explains the corners, or two do.
    """
    view = view or config.all_views[0]
    table = _camera_table(config, view)
    sensor = None if table.measured else box_camera(config, view).sensor
    return box_xml(_box(config).turned(view.turn_deg), size_of_photo(config, view), sensor, table)


def box_camera(config: SessionConfig, view: ViewInputs | None = None) -> BoxCamera:
    """The camera of a photo of the box, the first by default.

    Parameters
    ----------
    config : SessionConfig
        With ``[scene.box]``.
    view : ViewInputs, optional

    Raises
    ------
    InputError
        As ``box_text``; or if the COLMAP model cannot be read, or lacks a picture.
    CheckError
        As ``box_text``; or if the COLMAP model and the marked corners do not fit.
    """
    view = view or config.all_views[0]
    box, table, size = _box(config), _camera_table(config, view), size_of_photo(config, view)
    if table.image is not None:
        camera = _model_camera(config, table.image, size)
    else:
        lens = None if config.camera.lens is None else read_lens(config.path(config.camera.lens))
        if table.corners_px is None:
            camera = measured_camera(table, lens, size)
        else:
            # a view without a camera of its own was taken by the first photo's, which marked its
            # corners
            turn_deg = view.turn_deg if view.camera is not None else 0.0
            key = f"views.{view.name}.camera" if view.camera is not None else "scene.box.camera"
            try:
                camera = camera_from_corners(table, box.turned(turn_deg).corner_positions(), lens,
                                             size)
            except SpectraboxError as fault:
                raise type(fault)(f"{FILE_NAME}: {key}.corners_px: {fault}") from None
    try:
        require_in_front(box, camera)
    except SpectraboxError as fault:
        raise type(fault)(f"{FILE_NAME}: {fault}") from None
    return camera


def corners_in_photo(config: SessionConfig,
                     view: ViewInputs | None = None) -> dict[str, tuple[float, float]]:
    """Pixels of the photo, by name, at which the camera sees corners of the box and of boxes in it.

    Parameters
    ----------
    config : SessionConfig
    view : ViewInputs, optional
        The first by default.

    Raises
    ------
    InputError, CheckError
        As ``box_camera``.
    """
    view = view or config.all_views[0]
    return visible_corners(box_camera(config, view),
                           _box(config).turned(view.turn_deg).corner_positions())


def lens_of_view(config: SessionConfig, view: ViewInputs) -> Lens | None:
    """The lens by which a photo is undistorted, where one is known.

    Parameters
    ----------
    config : SessionConfig
    view : ViewInputs

    Raises
    ------
    InputError, CheckError
        If its file or the COLMAP model cannot be read, or does not fit.
    """
    if config.camera.lens is not None:
        return read_lens(config.path(config.camera.lens))
    if config.box is None or view.scene is not None:
        return None
    image = _camera_table(config, view).image
    if image is None:
        return None
    return _model_camera(config, image, size_of_photo(config, view)).lens


def size_of_photo(config: SessionConfig, view: ViewInputs | None = None) -> tuple[int, int]:
    """Width and height of the photo that a camera took, in pixels; the first by default.

    A view without a camera of its own is as large as the first photo, whose camera it shares.
    """
    own = view is not None and view.camera is not None
    taken = view if own and view is not None else config.all_views[0]
    return photo_size(config.path(taken.photo_files[0]))


def _model_camera(config: SessionConfig, image: str, size: tuple[int, int]) -> BoxCamera:
    """The camera of one picture of the session's COLMAP model."""
    table = _box(config).colmap
    assert table is not None
    images = read_colmap(config.path(table.folder))
    for name in (image, *table.corners_px):
        if name not in images:
            some = ", ".join([*images][:SHOWN]) + (", ..." if len(images) > SHOWN else "")
            raise InputError(f"{COLMAP}: the model has no picture {name!r}; it has {some}")
    marks = {name: {corner: (x, y) for corner, (x, y) in corners.items()}
             for name, corners in table.corners_px.items()}
    try:
        return camera_from_model(images, image, marks, _box(config).corner_positions(), size)
    except SpectraboxError as fault:
        raise type(fault)(f"{COLMAP}: {fault}") from None


def _camera_table(config: SessionConfig, view: ViewInputs) -> CameraTable:
    return view.camera or _box(config).camera


def _box(config: SessionConfig) -> BoxTable:
    assert config.box is not None
    return config.box
