"""Command that measures a lamp's beam on a photo of a white wall."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spectrabox.session.command_line import (
    Answer,
    CommonOptions,
    Force,
    check_ending,
    command,
    require_new,
)
from spectrabox.session.json_values import to_json

if TYPE_CHECKING:
    from spectrabox.calibrate.beam.beam_fit import BeamProfile

WIDTH = 600             # pixels to which the photo is brought
# above these, one profile of the angle does not describe the lamp
MAX_ASYMMETRY, MAX_BAND_DIFFERENCE, MAX_OFF_AXIS_DEG = 0.05, 0.05, 3.0


@dataclass(frozen=True, kw_only=True)
class BeamRequest(CommonOptions):
    """Options of ``spectrabox geometry beam``."""

    photo: Annotated[Path, typer.Argument(
        metavar="PHOTO", show_default=False, help="Camera raw, DNG, or linear EXR or TIFF of the "
        "wall, lit by the lamp alone.")]
    wall_file: Annotated[Path, typer.Option(
        "--wall", metavar="wall.toml", show_default=False, help="Where a rectangle on the wall and "
        "the lamp are.")]
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="beam.csv", show_default=False, help="Where to write radiance by "
        "angle.")]
    dark: Annotated[tuple[Path, ...], typer.Option(
        help="The same with the lamp off, or dark frames, at the same exposure.")] = ()
    flat: Annotated[Path | None, typer.Option(
        help="Evenly lit white card: takes the lens's own fall-off out.")] = None
    lens_file: Annotated[Path | None, typer.Option(
        "--lens", metavar="lens.json", help="Undistort the photo with this lens first.")] = None
    force: Force = False


@command
def beam(request: BeamRequest) -> Answer:
    """Measure how a lamp's radiance falls off with the angle, on a photo of a white wall."""
    from spectrabox.calibrate.beam.beam_fit import fit_beam
    from spectrabox.calibrate.beam.wall import read_wall, wall_cells
    from spectrabox.capture.develop.developed import develop_photos
    from spectrabox.capture.photo.binning import bin_image, render_size
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.reconstruct.scene.light_profile import profile_text
    check_ending(request.out, {".csv": "radiance by angle"})
    require_new(request.out, request.force, request.photo, request.wall_file, request.flat,
                request.lens_file, *request.dark)
    wall, lens = read_wall(request.wall_file), None
    image, _ = develop_photos([request.photo], request.dark, request.flat)
    if request.lens_file is not None:
        from spectrabox.calibrate.geometry.lens_files import read_lens
        from spectrabox.calibrate.geometry.projection import undistorted
        lens = read_lens(request.lens_file)
        image = undistorted(image, lens)
    height, width = image.signal.shape[:2]
    if width > WIDTH:
        image = bin_image(image, *render_size(width, height, WIDTH))
    profile = fit_beam(wall_cells(image, wall, lens), wall)
    write_text_whole(request.out, profile_text(profile.angle_deg, profile.radiance,
                                       profile.standard_error))
    return Answer({"out": request.out, **to_json(profile)},
                  "\n".join(_lines(profile, request.out, request.flat is not None)))


def _facts(profile: BeamProfile, out: Path) -> dict[str, Any]:
    return {"out": str(out), "angle_deg": profile.angle_deg.tolist(),
            "radiance": profile.radiance.tolist(),
            "standard_error": profile.standard_error.tolist(),
            "axis_mm": profile.axis_mm.tolist(), "off_axis_deg": profile.off_axis_deg,
            "residual_rms": profile.residual_rms, "asymmetry": profile.asymmetry,
            "band_difference": profile.band_difference, "spacing_deg": profile.spacing_deg}


def _lines(profile: BeamProfile, out: Path, flat: bool) -> list[str]:
    import numpy as np
    top = profile.angle_deg[-1]
    shown = [angle for angle in (10, 20, 30, 45, 60) if angle < top]
    table = ", ".join(f"{np.interp(angle, profile.angle_deg, profile.radiance):.3f} "
                      f"({np.interp(angle, profile.angle_deg, profile.standard_error):.3f}) at "
                      f"{angle}" for angle in (*shown, round(float(top))))
    lines = [f"radiance {table} degrees, of 1 straight ahead (standard errors in brackets)",
             f"the beam's axis meets the wall at ({profile.axis_mm[0]:.0f}, "
             f"{profile.axis_mm[1]:.0f}) mm, {profile.off_axis_deg:.1f} degrees from where the "
             f"lamp is aimed; readings scatter by {profile.residual_rms:.1%} about the fit"]
    if profile.off_axis_deg > MAX_OFF_AXIS_DEG:
        lines.append("in a scene, let look_at_mm of the lamp be a point on the beam's axis, not "
                     "where its housing points")
    if profile.asymmetry > MAX_ASYMMETRY:
        lines.append(f"the beam is not round, or the wall not even: a sector about the axis "
                     f"differs by {profile.asymmetry:.0%}; one profile does not describe this lamp")
    if profile.band_difference > MAX_BAND_DIFFERENCE:
        lines.append(f"the beam changes its colour with the angle: bands differ by "
                     f"{profile.band_difference:.2f} of the radiance ahead; one profile for all "
                     "wavelengths does not describe this lamp")
    if not flat:
        lines.append("without --flat the lens's own fall-off towards the corners counts as the "
                     "lamp's")
    return [*lines, f"wrote {out}: give it to a panel as beam in [scene.box.lamp]; beyond "
            f"{top:.0f} degrees its last value holds"]
