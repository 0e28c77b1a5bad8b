"""What ``spectrabox colour`` writes of a finished session of flat samples."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate import colour_profile
from spectrabox.capture.photo.image_writers import write_tiff16
from spectrabox.measure import captured, opened_photos, texts
from spectrabox.measure.profiles import archive_quantities
from spectrabox.measure.profiles import colour_profile as colour_profiles
from spectrabox.measure.steps import signals
from spectrabox.radiometry import appearance, errors, findings, grid, interreflection, profile_files
from spectrabox.radiometry.files import write_text_whole
from spectrabox.session.config.session_file import SessionConfig
from spectrabox.session.kept_stages import FinishedRun
from spectrabox.session.report.page import style_sheet, templates

PHOTO, PAGE = "photo.tif", "archive.html"
CHART_CHECK = "calibration.chart-colours"
OF_ITS_OWN_CHART = ("These grades are of the chart that camera, light and profile were fitted to, "
                    "which flatters the picture: they are no certificate")
NOT_MEASURED = ("resolution and sharpening", "colour misregistration", "geometric distortion",
                "reproduction scale", "gain modulation", "evenness on a card over the whole field")


def write_colour(config: SessionConfig, run: FinishedRun, folder: Path, space: str,
                 families: Sequence[str]) -> tuple[dict[str, Any], str]:
    """Write profile, photo and page for the archive; JSON object and text of the command.

    Parameters
    ----------
    config : SessionConfig
    run : FinishedRun
    folder : Path
        Made where it is missing.
    space : str
        One of ``profile_files.NAMES``, of the photo.
    families : sequence of str
        Of the surfaces; none for those that the session states, if it states one of every region.

    Raises
    ------
    InputError
        For a session of a scene, or of a camera of other than three bands.
    """
    capture = run.capture
    if not isinstance(capture, captured.FlatCapture):
        raise errors.InputError(
            "spectrabox colour takes a session of flat samples; of a camera alone "
            "'spectrabox camera profile' writes profiles")
    records, view = run.records, capture.views[0]
    calibration, chart = records.calibrations(capture.views)[0], records.charts[""]
    fit, layout = records.calibrate.chart, capture.layout
    if len(calibration.sensitivity.curves) != 3 or fit is None:
        raise errors.InputError(
            "a colour profile is of a camera of three bands, R, G and B, that was "
            f"calibrated by a chart; {view.photo_names[0]} has "
            f"{len(calibration.sensitivity.curves)}")
    photo, _ = opened_photos.develop(capture, view.photo)
    own = photo.camera_from_xyz
    response, draws = colour_profiles.response_of_calibration(calibration)
    profile = colour_profiles.colour_profile(response, draws, families or _stated_families(capture),
                                             own)
    camera = chart.thumbnail.camera or "camera"
    files = [
        path for name in ("camera.icc", "camera.ocio")
        for path in profile_files.write_profile(folder / name, f"{camera}, {config.session.name}",
                                                profile.matrix.coefficients, profile.table.xyz)
    ]
    picture, clipped = colour_profiles.colour_picture(
        colour_profiles.relative_signals(photo, signals.flat_photos(capture, records)[0],
                                         signals.known_of_signals(capture, records),
                                         signals.flat_errors(capture, records)),
        profile.table, space)
    # a picture in CIELAB says itself what it is
    write_tiff16(folder / PHOTO, picture, None if space == profile_files.LAB
                 else profile_files.picture_profile(space))
    reflectances = capture.lit_chart.reflectances
    relative = reflectances @ interreflection.relative_response(calibration, grid.FINE_GRID).T
    glare = records.calibrate.whites[""].glare
    white = (fit.predicted - glare) / relative
    patches = (chart.samples.mean - glare) / white
    patches[chart.samples.clipped.any(axis=1)] = np.nan
    lab = profile.table.lab(patches)
    reference = appearance.lab_from_xyz(
        reflectances @ colour_profile.d50_weights(grid.FINE_GRID).T, colour_profile.D50)
    differences = appearance.ciede2000(lab, reference)
    shown = np.isfinite(differences)
    facts = {"files": [str(path) for path in (*files, folder / PHOTO, folder / PAGE)],
             "space": profile_files.NAMES[space], "clipped": clipped,
             "delta_e00": profile.facts(),
             "chart": {"mean": float(differences[shown].mean()),
                       "by_own_matrix": None if own is None else float(appearance.ciede2000(
                           colour_profile.stated_transform(own).lab(patches),
                           reference)[shown].mean())},
             "archive": archive_quantities.archive_quantities(
                 layout, lab, reference, archive_quantities.lightness_noise(
                     chart.samples, patches, white, profile.table),
                 records.flat_signals.light_maps[view.name])}
    rows = [{"name": layout.names[patch], "lab": lab[patch].tolist(),
             "reference": reference[patch].tolist(), "difference": float(differences[patch])}
            for patch in np.flatnonzero(shown)]
    write_text_whole(folder / PAGE, _page(config, facts, profile, rows, calibration.findings))
    return facts, _text(facts, profile)


def _stated_families(capture: captured.FlatCapture) -> list[str]:
    """Families of the regions, if every one states its own."""
    stated = [region.families for region in capture.regions.values() if region.known is None]
    return sorted({name for families in stated for name in families}) if all(stated) else []


def _text(facts: dict[str, Any], profile: colour_profiles.ColourProfile) -> str:
    own = facts["chart"]["by_own_matrix"]
    return "\n".join([
        "CIEDE2000 to D50, expected", *profile.error_lines(),
        f"chart as photographed: mean {facts['chart']['mean']:.2f}"
        + ("" if own is None else f", by the camera's own matrix {own:.2f}"),
        *(f"{one['name']}: {one['value']:.3g} {one['unit']}"
          + "".join(f"; {guideline}: {grade}" for guideline, grade in one["grades"].items())
          for one in facts["archive"]),
        OF_ITS_OWN_CHART,
        f"{facts['clipped']:.2%} of the pixels lie outside {facts['space']} or above white and are "
        "clipped", *(f"wrote {path}" for path in facts["files"])])


def _page(config: SessionConfig, facts: dict[str, Any], profile: colour_profiles.ColourProfile,
          patches: list[dict[str, Any]], findings: Sequence[findings.Finding]) -> str:
    of_the_chart = [texts.says(one) for one in findings if one.code == CHART_CHECK]
    return templates().get_template("archive.html.j2").render(
        name=config.session.name, style=style_sheet(), facts=facts, patches=patches,
        of_the_chart=of_the_chart, iso=archive_quantities.ISO, fadgi=archive_quantities.FADGI,
        source=archive_quantities.SOURCE, draws=profile.draws, not_measured=NOT_MEASURED)
