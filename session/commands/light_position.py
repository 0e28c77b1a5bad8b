"""Command that refines the position of a light of the scene."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.session.command_line import (
    Answer,
    CommonOptions,
    Device,
    Force,
    check_device,
    check_ending,
    command,
    require_new,
)

if TYPE_CHECKING:
    import numpy as np

    from spectrabox.reconstruct.scene.light_position import LightPosition

# per degree of freedom: above it, the position depends on which errors the fit allows for
MAX_CHI_SQUARE = 2.0


@dataclass(frozen=True, kw_only=True)
class LightRequest(CommonOptions):
    """Options of ``spectrabox geometry light``."""

    photo: Annotated[Path, typer.Argument(
        metavar="PHOTO", show_default=False, help="Camera raw, DNG, or linear EXR or TIFF, as the "
        "scene shows it.")]
    scene: Annotated[Path, typer.Option(
        metavar="scene.xml", show_default=False, help="The Mitsuba scene.")]
    light_spectrum: Annotated[str, typer.Option(
        "--light", show_default=False, help="Spectrum of the light: a file or a CIE name.")]
    sensitivity: Annotated[str, typer.Option(
        show_default=False, help="Camera: a file of curves or a name.")]
    reflectances: Annotated[Path, typer.Option(
        metavar="paints.csv", show_default=False, help="One column per BSDF of the scene, named by "
        "its id.")]
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="scene.xml", show_default=False, help="Where to write its copy with "
        "the light moved.")]
    light_id: Annotated[str | None, typer.Option(
        help="Which light, where the scene has several.")] = None
    lens_file: Annotated[Path | None, typer.Option(
        "--lens", metavar="lens.json", help="Undistort the photo with this lens first.")] = None
    width: Annotated[int, typer.Option(
        min=16, max=1024, help="Width of the rendered view in pixels.")] = 96
    spp: Annotated[int, typer.Option(min=1, help="Paths per pixel of each rendering.")] = 256
    seed: Annotated[int, typer.Option(min=0, help="Random seed of the paths.")] = 1
    force: Force = False
    device: Device = "auto"


@command
def light(request: LightRequest) -> Answer:
    """Refine the position of a light, from a photo of surfaces of known reflectance."""
    check_device(request.device)
    from spectrabox.capture.photo.binning import bin_image, render_size
    from spectrabox.capture.photo.linear import open_photo
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.radiometry.grid import visible_grid
    from spectrabox.radiometry.records import Outcome
    from spectrabox.radiometry.response import response_matrix
    from spectrabox.radiometry.spectra.named_spectra import light as spectrum_of_light
    from spectrabox.radiometry.spectra.named_spectra import sensitivities
    from spectrabox.reconstruct.rendering.renderer import start_mitsuba
    from spectrabox.reconstruct.scene.box_scene import is_of_box
    from spectrabox.reconstruct.scene.edit_scene import light_number, scene_with_light_moved
    from spectrabox.reconstruct.scene.light_position import (
        PositionSettings,
        refine_light_position,
    )
    from spectrabox.reconstruct.scene.refinements import Refinement, rounded
    from spectrabox.reconstruct.scene.scene_file import read_scene, require_same_shape
    from spectrabox.session.progress_display import progress_display
    check_ending(request.out, {".xml": "the scene with the light moved"})
    require_new(request.out, request.force, request.photo, request.reflectances)
    grid = visible_grid()
    written = read_scene(request.scene)
    number = light_number(written, request.light_id)
    response = response_matrix(grid, sensitivities(request.sensitivity, grid),
                               spectrum_of_light(request.light_spectrum, grid))
    paints = _paints(request.reflectances)
    image = open_photo(request.photo)
    if request.lens_file is not None:
        from spectrabox.calibrate.geometry.lens_files import read_lens
        from spectrabox.calibrate.geometry.projection import undistorted
        image = undistorted(image, read_lens(request.lens_file))
    if image.signal.shape[2] != len(response):
        raise InputError(f"photo {request.photo.name} has {image.signal.shape[2]} bands and "
                         f"{request.sensitivity} has {len(response)} curves; one curve per band is "
                         "needed")
    require_same_shape(image, written, request.photo.name)
    size = render_size(image.signal.shape[1], image.signal.shape[0], request.width)
    start_mitsuba(request.device)
    with progress_display(request.as_json) as show:
        estimate = refine_light_position(
            written, paints, response, bin_image(image, *size), request.light_id,
            PositionSettings(spp=request.spp, seed=request.seed),
            lambda done, message: show("light", done, message))
    refinement = Refinement(
        what="light", name=estimate.light,
        how="moved to explain the shading of surfaces of known reflectance in "
        f"{request.photo.name}; chi-square {estimate.misfit:.2f} per degree of freedom, "
        f"{estimate.before:.2f} before",
        moved=rounded(estimate.offset), standard_error=rounded(estimate.standard_error))
    write_text_whole(request.out, scene_with_light_moved(
        request.scene, number, estimate.offset, request.out.parent, refinement))
    return Answer(_facts(estimate, request.out),
                  _text(estimate, request.out, is_of_box(request.scene)),
                  ConvergenceError.exit_code if estimate.outcome is Outcome.STEP_LIMIT else 0)


def _paints(path: Path) -> dict[str, np.ndarray]:
    from spectrabox.radiometry.grid import visible_grid
    from spectrabox.radiometry.spectra.spectrum_files import read_reflectances
    return read_reflectances(path, visible_grid())


def _facts(estimate: LightPosition, out: Path) -> dict[str, Any]:
    return {"light": estimate.light, "offset": estimate.offset.tolist(),
            "standard_error": estimate.standard_error.tolist(),
            "covariance": estimate.covariance.tolist(), "light_scale": estimate.scale.value,
            "light_scale_standard_error": estimate.scale.standard_error,
            "chi_square_before": estimate.before,
            "chi_square": estimate.misfit, "steps": len(estimate.offsets) - 1,
            "outcome": estimate.outcome.value, "out": str(out)}


def _text(estimate: LightPosition, out: Path, of_box: bool) -> str:
    moved = ", ".join(f"{axis} {value:+.3g} ({error:.2g})" for axis, value, error in
                      zip("xyz", estimate.offset, estimate.standard_error, strict=True))
    lines = [f"light {estimate.light!r} moved by {moved} in the scene's unit (standard errors in "
             "brackets)",
             f"chi-square per degree of freedom {estimate.misfit:.2f}, {estimate.before:.2f} with "
             "the light as given"]
    if estimate.misfit >= MAX_CHI_SQUARE:
        lines.append("something besides the light's position is wrong too (a lamp with a beam, a "
                     "photo that is not linear, geometry): do not rely on this position")
    if of_box:
        by, within = ([round(float(value), 2) for value in values] for values in
                      (estimate.offset, estimate.standard_error))
        lines.append("to keep [scene.box] in session.toml, write into [scene.box.lamp] in place of "
                     f"the copy:\nmoved_mm = {by}\nmoved_error_mm = {within}")
    return "\n".join([*lines, estimate.outcome.value, f"wrote {out}"])
