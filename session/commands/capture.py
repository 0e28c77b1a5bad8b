"""Commands between camera and calibration: develop a photo to linear signal, and judge a chart
photo.
"""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spectrabox.radiometry.errors import CheckError
from spectrabox.session.terminal import command_line

if TYPE_CHECKING:
    from spectrabox.capture.chart.quality import ChartVerdict
    from spectrabox.radiometry.chart import Chart
    from spectrabox.radiometry.records.photos import ChartDetection, LinearImage

ENCODED_SUFFIXES = (".jpg", ".jpeg", ".png")
RE_SHOOT = 4


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (develop, chart):
        app.command()(function)


@command_line.Command
def chart(
    photo: Annotated[
        Path,
        typer.Argument(
            metavar="PHOTO", show_default=False, help="Camera raw, DNG, linear EXR or TIFF; or a "
            "JPEG or PNG, of which light, glare and focus are judged.")],
    overlay: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="Write the photo with the samples drawn.")] = None,
    out: Annotated[Path | None,
                   typer.Option(
                       "--out", "-o", metavar="CSV",
                       help="Write position, linear values and their spread, a row "
                       "for each patch.")] = None,
    corners: Annotated[
        str | None,
        typer.Option(metavar=command_line.CORNERS, help=command_line.CORNERS_HELP)] = None,
    layout: command_line.ChartLayout = "",
    reference: Annotated[str | None,
                         typer.Option(
                             metavar="NAME|FILE", show_default=False,
                             help="Reflectances by which a chart is known that "
                             "is no ColorChecker of 24 patches.")] = None,
    leave_out: Annotated[
        str, typer.Option(metavar="N,N...", show_default=False, help="{chart.leave_out}")] = "",
    encoded: Annotated[
        bool | None,
        typer.Option(
            "--encoded/--linear", help="Take an image file as sRGB-encoded, or as linear. Default: "
            "JPEG and PNG are encoded.")] = None,
    as_json: command_line.Json = False,
    debug: command_line.Debug = False,
) -> command_line.Answer:
    """Find the colour chart in a photo, and say whether the photo is good enough."""
    from spectrabox.capture.chart.detection import chart_overlay
    from spectrabox.capture.photo.image_writers import write_png
    from spectrabox.measure import chart_patches, extras, texts
    from spectrabox.radiometry.chart import excluded_patches
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.session.camera import camera_files
    image, known = _open(photo, encoded), camera_files.read_layout(layout)
    excluded = excluded_patches(camera_files.numbers_of_patches(leave_out), known, "--leave-out")
    try:
        detection, verdict = camera_files.chart_named(image, layout, reference, corners, excluded)
    except CheckError as error:
        if debug or not as_json:
            raise
        return command_line.Answer({"verdict": "refused", "reasons": [str(error)], "findings": [],
                       "corners_px": None, "mean": None, "standard_error": None,
                       "mirrored": None, "confidence": 0.0, "photo": photo, "edition": None}, "",
                      error.exit_code)
    if overlay is not None:
        write_png(overlay, chart_overlay(image, detection))
    if out is not None:
        write_text_whole(out, chart_patches.table_of_columns(chart_patches.patch_columns(
            known, detection, verdict.samples, verdict.excluded)))
    edition = chart_patches.edition_in_photo(image, known, verdict.samples, excluded)
    verdict = replace(verdict, findings=(*verdict.findings, *edition.patches))
    failed = () if edition.failed is None else (edition.failed,)
    return command_line.Answer({**_facts(photo, image, known, detection, verdict),
                   "edition": edition.facts,
                   "failed_extras": [extras.facts(one) for one in failed]},
                  "\n".join([_text(photo, detection, verdict), f"edition: {edition.says}",
                             *(f"note: {texts.says(one)}" for one in failed)]),
                  0 if verdict.good else RE_SHOOT, failed)


@command_line.Command
def develop(
    photos: Annotated[tuple[Path, ...], typer.Argument(
        metavar="PHOTO...", show_default=False, help="Camera raw, DNG, or linear EXR or TIFF.")],
    out: Annotated[Path, typer.Option(
        "--out", "-o", metavar="OUT.exr", show_default=False, help="Where to write the signal.")],
    dark: Annotated[tuple[Path, ...], typer.Option(
        metavar="PHOTO",
        help="Dark frame at the photo's exposure and ISO; several are averaged.")] = (),
    flat_field: Annotated[Path | None, typer.Option(
        metavar="PHOTO", help="White card in the same place: divides the photo.")] = None,
    not_linear: Annotated[bool, typer.Option(
        "--not-linear", help="Take JPEG, PNG and 8-bit files too, decoded as sRGB and marked so: "
        "good for finding a chart, but not for measuring.")] = False,
) -> command_line.Answer:
    """Turn raw photos into linear camera signal: black and dark removed, exposures merged,
    flat-fielded; an EXR with its variance.
    """
    from spectrabox.capture.develop.developed import develop_photos
    from spectrabox.capture.photo import image_writers, preview
    from spectrabox.measure import texts
    command_line.check_ending(out, {".exr": "the signal in floating point"})
    image, findings = develop_photos(photos, dark, flat_field, not_linear)
    notes = [texts.says(finding) for finding in findings]
    image_writers.write_linear_exr(out, image, preview.photo_orientation(photos[0]))
    facts = {**_photo_facts(image), "out": str(out), "notes": notes,
             "findings": [texts.facts(finding) for finding in findings],
             "size": [image.signal.shape[1], image.signal.shape[0]]}
    lines = [f"wrote {out}: {image.signal.shape[1]} x {image.signal.shape[0]} pixels, "
             f"{facts['saturated_fraction']:.2%} saturated, noise at half scale "
             + ", ".join(f"{value:.3%}" for value in facts["noise_at_half"]),
             *(f"- {note}" for note in notes)]
    return command_line.Answer(facts, "\n".join(lines))


def _open(photo: Path, encoded: bool | None) -> LinearImage:
    from spectrabox.capture.photo import image_files, linear, preview, stored_images
    if encoded is None:
        encoded = photo.suffix.lower() in ENCODED_SUFFIXES
    image = image_files.read_encoded_file(photo) \
        if encoded and stored_images.is_image_file(photo) else linear.open_photo(photo)
    return preview.turned(image, preview.photo_orientation(photo))


def _photo_facts(image: LinearImage) -> dict[str, Any]:
    from spectrabox.capture.photo.noise import HALF_SCALE, noise_near
    noise = [noise_near(image, band, HALF_SCALE) for band in range(image.signal.shape[2])]
    return {"camera": image.camera, "exposure_s": image.exposure_s, "iso": image.iso,
            "f_number": image.f_number, "kind": image.kind.value, "source": image.source,
            "sha256": image.sha256,
            "saturated_fraction": image.clipped_share,
            "noise_at_half": [value / HALF_SCALE for value in noise if value is not None]}


def _facts(photo: Path, image: LinearImage, chart: Chart, detection: ChartDetection,
           verdict: ChartVerdict) -> dict[str, Any]:
    from spectrabox.measure import chart_patches, texts
    samples = verdict.samples
    return {"verdict": verdict.verdict, "reasons": texts.reasons(verdict.findings),
            "findings": [texts.facts(finding) for finding in verdict.findings],
            "names": chart.names,
            "corners_px": detection.corners_px.tolist(),
            "centres_px": chart_patches.centres_px(detection).tolist(),
            "angle_deg": chart_patches.angle_deg(detection, chart), "mean": samples.mean.tolist(),
            "standard_error": samples.standard_error.tolist(),
            "spread": samples.spread.tolist(), "clipped": samples.clipped.tolist(),
            "mirrored": detection.mirrored, "confidence": detection.confidence,
            "pixels": samples.pixels.tolist(),
            "saturated_fraction": samples.saturated_fraction.tolist(),
            "gradient": samples.gradient.tolist(), "excluded_fraction": verdict.excluded.tolist(),
            "white_signal": verdict.white_signal, "uneven": verdict.uneven, "glare": verdict.glare,
            "veil": verdict.veil, "tilt_deg": verdict.tilt_deg, "blur": verdict.blur,
            "how_found": texts.says(detection.how_found), "kind": image.kind.value,
            "camera": image.camera, "exposure_s": image.exposure_s, "photo": str(photo)}


def _text(photo: Path, detection: ChartDetection, verdict: ChartVerdict) -> str:
    from spectrabox.measure import texts
    return "\n".join([
        f"{verdict.verdict.upper()}  {photo.name}: agreement with the chart "
        f"{detection.confidence:.2f}",
        *(f"- {texts.says(finding)}" for finding in (detection.how_found, *verdict.findings))])
