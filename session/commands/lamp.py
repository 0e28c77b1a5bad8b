"""Commands that measure the lamp of a scene on photos: its position, its beam."""
from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.session.terminal import command_line

if TYPE_CHECKING:
    from spectrabox.calibrate.geometry.lens import Lens
    from spectrabox.calibrate.lamp_beam import BeamProfile
    from spectrabox.radiometry.records.photos import LinearImage
    from spectrabox.reconstruct.scene.light_position import LightPosition

# per degree of freedom: above it, the position depends on which errors the fit allows for
MAX_CHI_SQUARE = 2.0
WIDTH = 600             # pixels to which the photo is brought
# above these, one profile of the angle does not describe the lamp
MAX_ASYMMETRY, MAX_BAND_DIFFERENCE, MAX_OFF_AXIS_DEG = 0.05, 0.05, 3.0


UndistortLens = Annotated[Path | None, typer.Option(
    "--lens", metavar="lens.json", help="Undistort the photo with this lens first.")]


@command_line.Command
def light(
    photo: Annotated[Path, typer.Argument(
        metavar="PHOTO", show_default=False, help="Camera raw, DNG, or linear EXR or TIFF, as the "
        "scene shows it.")],
    scene: Annotated[Path, typer.Option(
        metavar="scene.xml", show_default=False, help="The Mitsuba scene.")],
    light_spectrum: Annotated[str, typer.Option(
        "--light", metavar="FILE|NAME", show_default=False,
        help="Spectrum of the light: a file or a CIE name.")],
    sensitivity: Annotated[str, typer.Option(
        metavar="FILE|NAME", show_default=False, help="Camera: a file of curves or a name.")],
    reflectances: Annotated[Path, typer.Option(
        metavar="paints.csv", show_default=False, help="One column per BSDF of the scene, named by "
        "its id.")],
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="scene.xml", show_default=False, help="Where to write its copy with "
        "the light moved.")],
    light_id: Annotated[str | None, typer.Option(
        metavar="ID", help="Which light, where the scene has several.")] = None,
    lens_file: UndistortLens = None,
    width: Annotated[int, typer.Option(
        min=16, max=1024, help="Width of the rendered view in pixels.")] = 96,
    spp: Annotated[int, typer.Option(min=1, help="Paths per pixel of each rendering.")] = 256,
    seed: Annotated[int, typer.Option(min=0, help="Random seed of the paths.")] = 1,
    force: command_line.Force = False,
    device: command_line.Device = "auto",
    as_json: command_line.Json = False,
) -> command_line.Answer:
    """Refine the position of a light, from a photo of surfaces of known reflectance."""
    from spectrabox.capture.photo import linear, preview
    from spectrabox.radiometry import files, interreflection
    from spectrabox.radiometry.grid import visible_grid
    from spectrabox.radiometry.records.spectra import Outcome
    from spectrabox.radiometry.spectra import named_spectra, spectrum_files
    from spectrabox.radiometry.spectra.named_spectra import light as spectrum_of_light
    from spectrabox.reconstruct.rendering.renderer import start_mitsuba
    from spectrabox.reconstruct.scene import box_scene, edit_scene, light_position, scene_file
    from spectrabox.session.terminal.progress_display import progress_display
    command_line.check_ending(out, {".xml": "the scene with the light moved"})
    command_line.require_new(out, force, photo, reflectances)
    grid = visible_grid()
    written = scene_file.read_scene(scene)
    number = edit_scene.light_number(written, light_id)
    response = interreflection.response_matrix(grid, named_spectra.sensitivities(sensitivity, grid),
                                               spectrum_of_light(light_spectrum, grid))
    paints = spectrum_files.read_reflectances(reflectances, grid)
    image, _ = _undistorted(linear.open_photo(photo), lens_file)
    if image.signal.shape[2] != len(response):
        raise InputError(f"photo {photo.name} has {image.signal.shape[2]} bands and "
                         f"{sensitivity} has {len(response)} curves; one curve per band is "
                         "needed")
    scene_file.require_same_shape(image, written, photo.name)
    size = preview.render_size(image.signal.shape[1], image.signal.shape[0], width)
    start_mitsuba(device)
    with progress_display(as_json) as show:
        estimate = light_position.refine_light_position(
            written, paints, response, preview.bin_image(image, *size), light_id,
            spp, seed, lambda done, message: show("light", done, message))
    refinement = edit_scene.Refinement(
        what="light", name=estimate.light,
        how="moved to explain the shading of surfaces of known reflectance in "
        f"{photo.name}; chi-square {estimate.chi_square:.2f} per degree of freedom, "
        f"{estimate.chi_square_before:.2f} before", moved=edit_scene.rounded(estimate.offset),
        standard_error=edit_scene.rounded(estimate.standard_error))
    files.write_text_whole(out, edit_scene.scene_with_light_moved(
        scene, number, estimate.offset, out.parent, refinement))
    facts = command_line.to_json(estimate)
    facts["steps"] = len(facts.pop("offsets")) - 1
    return command_line.Answer({**facts, "out": out},
                  _light_text(estimate, out, box_scene.is_of_box(scene)),
                  ConvergenceError.exit_code if estimate.outcome is Outcome.STEP_LIMIT else 0)


def _light_text(estimate: LightPosition, out: Path, of_box: bool) -> str:
    from spectrabox.measure import texts
    moved = ", ".join(f"{axis} {value:+.3g} ({error:.2g})" for axis, value, error in
                      zip("xyz", estimate.offset, estimate.standard_error, strict=True))
    lines = [f"light {estimate.light!r} moved by {moved} in the scene's unit (standard errors in "
             "brackets)",
             f"chi-square per degree of freedom {estimate.chi_square:.2f}, "
             f"{estimate.chi_square_before:.2f} with the light as given"]
    if estimate.chi_square >= MAX_CHI_SQUARE:
        lines.append("something besides the light's position is wrong too (a lamp with a beam, a "
                     "photo that is not linear, geometry): do not rely on this position")
    if of_box:
        by, within = ([round(float(value), 2) for value in values] for values in
                      (estimate.offset, estimate.standard_error))
        lines.append("to keep [scene.box] in session.toml, write into [scene.box.lamp] in place of "
                     f"the copy:\nmoved_mm = {by}\nmoved_error_mm = {within}")
    return "\n".join([*lines, texts.sentence(estimate.outcome.finding()), f"wrote {out}"])


@command_line.Command
def beam(
    photo: Annotated[Path, typer.Argument(
        metavar="PHOTO", show_default=False, help="Camera raw, DNG, or linear EXR or TIFF of the "
        "wall, lit by the lamp alone.")],
    wall_file: Annotated[Path, typer.Option(
        "--wall", metavar="wall.toml", show_default=False, help="Where a rectangle on the wall and "
        "the lamp are.")],
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="beam.csv", show_default=False, help="Where to write radiance by "
        "angle.")],
    dark: Annotated[tuple[Path, ...], typer.Option(
        metavar="PHOTO",
        help="The same with the lamp off, or dark frames, at the same exposure.")] = (),
    flat_field: Annotated[Path | None, typer.Option(
        metavar="PHOTO", help="Evenly lit white card: takes the lens's own fall-off out.")] = None,
    lens_file: UndistortLens = None,
    force: command_line.Force = False,
) -> command_line.Answer:
    """Measure how a lamp's radiance falls off with the angle, on a photo of a white wall."""
    from spectrabox.calibrate.lamp_beam import fit_beam, read_wall, wall_cells
    from spectrabox.capture.develop.developed import develop_photos
    from spectrabox.capture.photo.preview import bin_image, render_size
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.reconstruct.scene.scene_file import profile_text
    command_line.check_ending(out, {".csv": "radiance by angle"})
    command_line.require_new(out, force, photo, wall_file, flat_field,
                lens_file, *dark)
    wall = read_wall(wall_file)
    image, _ = develop_photos([photo], dark, flat_field)
    image, lens = _undistorted(image, lens_file)
    height, width = image.signal.shape[:2]
    if width > WIDTH:
        image = bin_image(image, *render_size(width, height, WIDTH))
    profile = fit_beam(*wall_cells(image, wall, lens), wall)
    write_text_whole(out, profile_text(profile.angle_deg, profile.radiance,
                                       profile.standard_error))
    return command_line.Answer({"out": out, **command_line.to_json(profile)},
                  "\n".join(_beam_lines(profile, out, flat_field is not None)))


def _beam_lines(profile: BeamProfile, out: Path, flat: bool) -> list[str]:
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
        lines.append("without --flat-field the lens's own fall-off towards the corners counts as "
                     "the lamp's")
    return [*lines, f"wrote {out}: give it to a panel as beam in [scene.box.lamp]; beyond "
            f"{top:.0f} degrees its last value holds"]


def _undistorted(image: LinearImage, lens_file: Path | None) -> tuple[LinearImage, Lens | None]:
    """The photo without distortion, and its lens; the photo as it is where no lens is named."""
    if lens_file is None:
        return image, None
    from spectrabox.calibrate.geometry.lens import read_lens
    from spectrabox.calibrate.geometry.projection import undistorted
    lens = read_lens(lens_file)
    return undistorted(image, lens), lens
