"""Commands about the camera's geometry: its lens, its pose, photos without distortion."""
from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spectrabox.radiometry.errors import InputError
from spectrabox.session.commands.lamp import beam, light
from spectrabox.session.terminal import command_help, command_line

if TYPE_CHECKING:
    import numpy as np

    from spectrabox.calibrate.geometry.lens import Lens, Pose
    from spectrabox.radiometry.records.photos import LinearImage

Photo = Annotated[Path, typer.Argument(metavar="PHOTO", show_default=False,
                                       help="Raw, DNG, EXR, TIFF, JPEG or PNG.")]
BoardFile = Annotated[Path | None, typer.Option("--board", metavar="board.toml", help="The ChArUco "
                                                "board: columns, rows, square, marker.")]
PrintedBoard = Annotated[Path, typer.Option(
    "--board", metavar="board.toml", show_default=False,
    help="The ChArUco board: columns, rows, square, marker.")]
LensFile = Annotated[Path | None, typer.Option("--lens", metavar="lens.json",
                                               help="From 'spectrabox geometry lens'.")]


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    group = command_help.Commands(
        help="Lens and position of the camera, photos without distortion, position "
        "and beam of the lamp.")
    for function in (board, lens, pose, box, undistort, light, beam):
        group.command()(function)
    app.add_typer(group, name="geometry")


@command_line.Command
def board(
    board_file: PrintedBoard,
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="PNG", show_default=False, help="Where to write the board.")],
    square_px: Annotated[int, typer.Option(min=40, max=4000,
                                           help="Width of a square in the picture.")] = 200,
    force: command_line.Force = False,
) -> command_line.Answer:
    """Draw a ChArUco board for printing; measure its squares on the print."""
    from spectrabox.calibrate.geometry.board import read_board
    from spectrabox.calibrate.geometry.projection import board_picture
    from spectrabox.capture.photo.image_writers import write_png
    from spectrabox.radiometry.files import writable
    command_line.check_ending(out, {".png": "a picture of the board"})
    command_line.require_new(out, force, board_file)
    picture = board_picture(read_board(board_file), square_px)
    with writable(out.parent):
        write_png(out, picture[..., None].repeat(3, axis=2))
    return command_line.Answer({"out": out, "size": picture.shape[::-1]},
                  f"wrote {out}: print it without scaling, glue it flat, then measure "
                  f"squares and markers and write their widths into {board_file.name}")


@command_line.Command
def lens(
    photos: Annotated[tuple[Path, ...], typer.Argument(
        metavar="PHOTO...", show_default=False, help="Of the board, tilted in different ways.")],
    board_file: PrintedBoard,
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="lens.json", show_default=False, help="Where to write the lens.")],
    overlay: Annotated[Path | None, typer.Option(
        metavar="DIR", help="Write each photo with its corners.")] = None,
    force: command_line.Force = False,
) -> command_line.Answer:
    """Measure focal length, principal point and distortion on photos of a ChArUco board, with
    standard errors.
    """
    from spectrabox.calibrate.geometry.board import read_board
    from spectrabox.calibrate.geometry.lens import lens_facts, write_lens
    from spectrabox.calibrate.geometry.projection import find_board, lens_from_views
    from spectrabox.radiometry.errors import CheckError
    command_line.check_ending(out, {".json": "the lens"})
    command_line.require_new(out, force, *photos, board_file)
    printed = read_board(board_file)
    views, names, skipped, sizes = [], [], [], {}
    for photo in photos:
        image = _open(photo)
        sizes[photo.name] = _whole_size(image)
        try:
            positions, points = find_board(printed, _grey(image))
        except CheckError as error:
            skipped.append(f"{photo.name} is left out: {error}")
            continue
        names.append(photo.name)
        views.append((positions, _whole_px(points, image)))
        if overlay is not None:
            _overlay(overlay / f"{photo.stem}.png", image, views[-1][1], views[-1][1][:0])
    if len(set(sizes.values())) > 1:
        raise InputError("the photos differ in size ("
                         + ", ".join(f"{name} {size[0]} x {size[1]}" for name,
                                     size in sizes.items())
                         + "); give whole photos of one camera")
    source = f"{len(views)} views of a board, {sum(len(view[1]) for view in views)} corners"
    if len(views) < len(photos) and len(views) < 3:
        raise CheckError(f"{len(views)} of {len(photos)} photos show the board, 3 or more "
                         f"are needed; {skipped[0]}")
    estimate, by_view = lens_from_views(views, *next(iter(sizes.values())), source)
    write_lens(out, estimate)
    facts = {**lens_facts(estimate), "out": out, "skipped": skipped,
             "views": [{"photo": name, "corners": len(view[1]), "rms_px": float(rms)}
                       for name, view, rms in zip(names, views, by_view, strict=True)]}
    return command_line.Answer(facts, "\n".join([
      *_lens_lines(estimate), *skipped,
      f"wrote {out}: it holds for this zoom, focus and size of photo"]))


@command_line.Command
def pose(
    photo: Photo,
    scene: Annotated[Path, typer.Option(
        metavar="scene.xml", show_default=False, help="The Mitsuba scene to place the camera in.")],
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="scene.xml", show_default=False, help="Where to write its copy with "
        "this camera.")],
    points_file: Annotated[Path | None, typer.Option(
        "--points", metavar="points.toml", help="Known points: [points.NAME] scene = [x, y, z], px "
        "= [x, y] in the photo as the sensor read it.")] = None,
    board_file: BoardFile = None,
    lens_file: LensFile = None,
    overlay: Annotated[Path | None, typer.Option(
        metavar="PNG", help="Write the photo with the points given and reprojected.")] = None,
    force: command_line.Force = False,
) -> command_line.Answer:
    """Place the camera in the scene, from a ChArUco board or known points such as a box's
    corners.
    """
    import numpy as np

    from spectrabox.calibrate.geometry import lens as lenses
    from spectrabox.calibrate.geometry.pose import pose_and_focal_length, pose_from_points
    from spectrabox.calibrate.geometry.projection import FLAT, spread
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.reconstruct.scene.edit_scene import Refinement, rounded, scene_with_camera
    command_line.check_ending(out, {".xml": "the scene with this camera"})
    command_line.require_new(out, force, photo, points_file, board_file,
                lens_file)
    image = _open(photo)
    names, positions, points = _known_points(image, points_file, board_file)
    width, height = _whole_size(image)
    if lens_file is None:
        camera_pose, used = pose_and_focal_length(positions, points, width, height, names)
    else:
        used = lenses.read_lens(lens_file)
        _require_size(image, used)
        camera_pose = pose_from_points(positions, points, used, names)
    camera = lenses.mitsuba_sensor(used, camera_pose)
    refinement = Refinement(
        what="camera", name="of the photo", how=f"found from {len(names)} points of "
        f"{photo.name}, rms {camera_pose.rms_px:.2f} pixels; direction known to "
        f"{camera_pose.direction_standard_error_deg:.2f} degrees",
        place=rounded(camera_pose.position),
        standard_error=rounded(camera_pose.position_standard_error))
    write_text_whole(out, scene_with_camera(
        scene, camera, (width, height), out.parent, refinement))
    if overlay is not None:
        _overlay(overlay, image, points, points - camera_pose.residuals_px)
    flat = points_file is not None and spread(positions)[2] < FLAT
    misses = dict(zip(names, np.linalg.norm(camera_pose.residuals_px, axis=1).tolist(),
                      strict=True))
    facts = {"out": out, "position": camera_pose.position,
             "position_standard_error": camera_pose.position_standard_error,
             "direction": camera_pose.direction,
             "direction_standard_error_deg": camera_pose.direction_standard_error_deg,
             "rms_px": camera_pose.rms_px,
             "residuals_px": misses, "camera": camera, "lens": lenses.lens_facts(used),
             "in_one_plane": bool(flat)}
    return command_line.Answer(
        facts, "\n".join(
            _pose_lines(camera_pose, misses, used, out, lens_file is None, bool(flat))))


@command_line.Command
def box(folder: command_line.Folder,
        allow_outside: command_line.Outside = False) -> command_line.Answer:
    """Draw a session's measured box over its photos, and write the scenes made of it."""
    from spectrabox.measure.captured import FIRST_PHOTO
    from spectrabox.measure.scene.box_camera import box_camera
    from spectrabox.measure.shoot.captures import box_photo
    from spectrabox.session.box import box_overlay, scenes
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.store.locks import outputs_writer
    config = read_session(folder, allow_outside)
    if config.box is None:
        raise InputError(f"{folder} has no [scene.box]: 'spectrabox new --template box' "
                         "writes a session that has one")
    cameras = {view.title: box_camera(box_photo(config, config.inputs, view))
               for view in box_overlay.box_views(config)}
    with outputs_writer(config.folder):
        written = [*scenes.write_box_scenes(config, box_overlay.box_texts(config)),
                   *box_overlay.write_overlays(config)]
    by_view = {name: box_overlay.camera_facts(camera) for name, camera in cameras.items()}
    facts = {"files": written, **by_view[FIRST_PHOTO], "views": by_view}
    return command_line.Answer(facts, "\n".join([
      *(line for name, camera in cameras.items()
        for line in box_overlay.camera_text(name if len(cameras) > 1 else "", camera)),
      *(f"wrote {path}" for path in written)]))


@command_line.Command
def undistort(
    photo: Annotated[Path, typer.Argument(
        metavar="PHOTO", show_default=False, help="Camera raw, DNG, or linear EXR or TIFF.")],
    lens_file: Annotated[Path, typer.Option(
        "--lens", metavar="lens.json", show_default=False,
        help="From 'spectrabox geometry lens'.")],
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="OUT.exr", show_default=False, help="Where to write the photo.")],
    force: command_line.Force = False,
) -> command_line.Answer:
    """Take the lens's distortion out of a photo: a linear EXR with its variance."""
    from spectrabox.calibrate.geometry.lens import read_lens
    from spectrabox.calibrate.geometry.projection import undistorted
    from spectrabox.capture.photo import image_writers, linear, preview
    from spectrabox.radiometry.files import writable
    command_line.check_ending(out, {".exr": "the signal in floating point"})
    command_line.require_new(out, force, photo)
    image = linear.open_photo(photo)
    straight = undistorted(image, read_lens(lens_file))
    with writable(out.parent):
        image_writers.write_linear_exr(out, straight, preview.photo_orientation(photo))
    lost = float(straight.saturated.all(axis=2).mean() - image.saturated.all(axis=2).mean())
    return command_line.Answer({"out": out,
                   "size": [straight.signal.shape[1], straight.signal.shape[0]],
                   "outside_fraction": max(lost, 0.0)},
                  f"wrote {out}: {straight.signal.shape[1]} x {straight.signal.shape[0]} "
                  f"pixels, {max(lost, 0.0):.1%} of which the photo does not show (marked as "
                  "saturated)")


# ---- what the commands share ---------------------------------------------------------------------

def _open(photo: Path) -> LinearImage:
    from spectrabox.capture.develop.developed import open_any
    return open_any(photo, not_linear=True)


def _whole_size(image: LinearImage) -> tuple[int, int]:
    height, width = image.signal.shape[:2]
    return round(width * image.sensor_step), round(height * image.sensor_step)


def _require_size(image: LinearImage, lens: Lens) -> None:
    if _whole_size(image) != (lens.width, lens.height):
        width, height = _whole_size(image)
        raise InputError(f"photo {image.source} has {width} x {height} pixels, the lens was "
                         f"calibrated at {lens.width} x {lens.height}; use whole photos of the "
                         "same camera, of one kind of file")


def _grey(image: LinearImage) -> np.ndarray:
    from spectrabox.capture.photo.preview import signal_rgb8
    return signal_rgb8(image.signal).mean(axis=2).astype("uint8")


def _whole_px(points: np.ndarray, image: LinearImage) -> np.ndarray:
    from spectrabox.capture.chart.patches import sensor_from_image
    return sensor_from_image(points, image.sensor_step)


def _known_points(image: LinearImage, points_file: Path | None,
                  board_file: Path | None) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names, positions in the scene and pixels of the whole photo."""
    from spectrabox.calibrate.geometry.board import in_scene, read_board, read_points
    from spectrabox.calibrate.geometry.projection import find_board
    if (points_file is None) == (board_file is None):
        raise typer.BadParameter("give either --points or --board", param_hint="--points / --board")
    if points_file is not None:
        return read_points(points_file)
    assert board_file is not None
    printed = read_board(board_file)
    positions, points = find_board(printed, _grey(image))
    numbers = tuple(f"corner {number}" for number in range(1, len(positions) + 1))
    return numbers, in_scene(printed, positions, board_file.name), _whole_px(points, image)


def _overlay(path: Path, image: LinearImage, given: np.ndarray, seen: np.ndarray) -> None:
    from spectrabox.calibrate.geometry.projection import points_overlay
    from spectrabox.capture.photo import image_writers, preview
    from spectrabox.radiometry.files import writable
    with writable(path.parent):
        image_writers.write_png(
            path, points_overlay(preview.signal_rgb8(image.signal), given, seen, image.sensor_step))


def _lens_lines(lens: Lens) -> list[str]:
    values = lens.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    lines = [f"{lens.source}, rms {lens.rms_px:.2f} pixels"]
    lines += [f"  {name:<3} {value:10.2f} pixels, standard error {error:.2f}"
              for name, value, error in zip(("fx", "fy", "cx", "cy"), values, lens.standard_error,
                                            strict=True)]
    lines += [f"  {name:<3} {value:10.5f}, standard error {error:.5f}"
              for name, value, error in zip(("k1", "k2", "p1", "p2", "k3"), lens.distortion,
                                            lens.distortion_error, strict=True)]
    return lines


def _pose_lines(camera: Pose, misses: dict[str, float], lens: Lens, out: Path, without_lens: bool,
                flat: bool) -> list[str]:
    worst = max(misses, key=lambda name: misses[name])
    position = ", ".join(f"{value:.4g} ({error:.2g})" for value, error in
                         zip(camera.position, camera.position_standard_error, strict=True))
    lines = [f"camera at {position} in the scene's unit (standard errors in brackets), its "
             f"direction known to {camera.direction_standard_error_deg:.2f} degrees",
             f"{len(misses)} points, rms {camera.rms_px:.2f} pixels, largest "
             f"{misses[worst]:.2f} at {worst}"]
    if without_lens:
        lines.append(f"focal length {lens.matrix[0, 0]:.1f} pixels (standard error "
                     f"{lens.standard_error[0]:.1f}); principal point in the middle and no "
                     "distortion are assumed: a lens file is better")
    elif lens.distortion.any():
        lines.append("the scene now shows the undistorted photo: undistort the photo with this "
                     "lens too")
    if flat:
        lines.append("all points lie in one plane: had left and right been exchanged, nothing "
                     "would show it; look at the position")
    return [*lines, f"wrote {out}"]
