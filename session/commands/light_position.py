"""Command that refines the position of a light of the scene."""
from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.session.command_line import (
    Debug,
    Device,
    Json,
    answer,
    check_device,
    check_ending,
    command,
)

if TYPE_CHECKING:
    import numpy as np

    from spectrabox.reconstruct.scene.light_position import LightPosition

# per degree of freedom: above it, the position depends on which errors the fit allows for
MAX_CHI_SQUARE = 2.0


def light(photo: Annotated[Path, typer.Argument(metavar="PHOTO", show_default=False,
                                                help="Camera raw, DNG, or linear EXR or TIFF, as "
                                                "the scene shows it.")],
          scene: Annotated[Path, typer.Option(metavar="scene.xml", help="The Mitsuba scene.",
                                              show_default=False)],
          light_spectrum: Annotated[str, typer.Option("--light", help="Spectrum of the light: a "
                                                      "file or a CIE name.", show_default=False)],
          sensitivity: Annotated[str, typer.Option(help="Camera: a file of curves or a name.",
                                                   show_default=False)],
          reflectances: Annotated[Path, typer.Option(metavar="paints.csv", show_default=False,
                                                     help="One column per BSDF of the scene, named "
                                                     "by its id.")],
          out: Annotated[Path, typer.Option("--out", "-o", metavar="scene.xml", show_default=False,
                                            help="Where to write its copy with the light moved.")],
          light_id: Annotated[str | None,
                              typer.Option(
                                  help="Which light, where the scene has several.")] = None,
          lens_file: Annotated[Path | None, typer.Option("--lens", metavar="lens.json",
                                                         help="Undistort the photo with this lens "
                                                         "first.")] = None,
          width: Annotated[int, typer.Option(min=16, max=1024,
                                             help="Of the rendered view in pixels.")] = 96,
          spp: Annotated[int, typer.Option(min=1, help="Paths per pixel of each rendering.")] = 256,
          seed: Annotated[int, typer.Option(min=0, help="Of the paths.")] = 1,
          force: Annotated[bool, typer.Option("--force",
                                              help="Replace the output where it exists.")] = False,
          device: Device = "auto", as_json: Json = False, debug: Debug = False) -> None:
    """Refine the position of a light, from a photo of surfaces of known reflectance."""
    with command(as_json, debug):
        check_device(device)
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
        from spectrabox.reconstruct.scene.light_position import (
            PositionSettings,
            refine_light_position,
        )
        from spectrabox.reconstruct.scene.moved_light import light_number
        from spectrabox.reconstruct.scene.pose_scene import scene_with_light_moved
        from spectrabox.reconstruct.scene.refinements import Refinement, rounded
        from spectrabox.reconstruct.scene.scene_file import read_scene
        from spectrabox.session.progress_display import progress_display
        from spectrabox.session.stages.scenes import check_aspect
        check_ending(out, {".xml": "the scene with the light moved"})
        if out.resolve() in {photo.resolve(), reflectances.resolve()}:
            raise InputError(f"{out} is an input of this command; give another name for the output")
        if out.exists() and not force:
            raise InputError(f"{out} exists already; give another name, or replace it with --force")
        grid = visible_grid()
        written = read_scene(scene)
        number = light_number(written, light_id)
        response = response_matrix(grid, sensitivities(sensitivity, grid),
                                   spectrum_of_light(light_spectrum, grid))
        paints = _paints(reflectances)
        image = open_photo(photo)
        if lens_file is not None:
            from spectrabox.calibrate.geometry.lens_files import read_lens
            from spectrabox.calibrate.geometry.projection import undistorted
            image = undistorted(image, read_lens(lens_file))
        if image.signal.shape[2] != len(response):
            raise InputError(f"photo {photo.name} has {image.signal.shape[2]} bands and "
                             f"{sensitivity} has {len(response)} curves; one curve per band is "
                             "needed")
        check_aspect(image, written, photo.name)
        size = render_size(image.signal.shape[1], image.signal.shape[0], width)
        start_mitsuba(device)
        with progress_display(as_json) as show:
            estimate = refine_light_position(
                written, paints, response, bin_image(image, *size), light_id,
                PositionSettings(spp=spp, seed=seed),
                lambda done, message: show("light", done, message))
        said = Refinement(what="light", name=estimate.light, how="moved to explain the shading of "
                          f"surfaces of known reflectance in {photo.name}; chi-square "
                          f"{estimate.misfit:.2f} per degree of freedom, {estimate.before:.2f} "
                          "before", moved=rounded(estimate.offset),
                          standard_error=rounded(estimate.standard_error))
        write_text_whole(out, scene_with_light_moved(scene, number, estimate.offset, out.parent,
                                                     said))
        answer(as_json, _facts(estimate, out), _text(estimate, out, is_of_box(scene)))
        if estimate.outcome is Outcome.STEP_LIMIT:
            raise typer.Exit(ConvergenceError.exit_code)


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
