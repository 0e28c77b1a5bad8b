"""What is said of where a box's camera stood: for scripts, for a person, for the report."""
from __future__ import annotations

from typing import Any

from spectrabox.session.box.box_camera import FoundCamera


def camera_facts(camera: FoundCamera) -> dict[str, Any]:
    """For scripts: places in millimetres, angles in degrees, residuals in pixels.

    Parameters
    ----------
    camera : FoundCamera
    """
    facts: dict[str, Any] = {"how": camera.how, "at_mm": camera.at_mm, "direction":
                             camera.direction, "fov_deg": camera.fov_deg}
    if camera.how == "measured":
        return facts
    facts |= {"standard_error_mm": camera.standard_error_mm,
              "direction_standard_error_deg": camera.direction_error_deg,
              "residuals_px": camera.residuals_px}
    if (model := camera.model) is not None:
        facts["colmap"] = {
            "mm_per_unit": model.scale, "mm_per_unit_standard_error": model.scale_error,
            "rms_px": model.rms_px, "distances_mm": model.distances,
            "residuals_px": _by_picture(model.residuals_px)}
    return facts


def camera_text(name: str, camera: FoundCamera) -> list[str]:
    """Lines for a person.

    Parameters
    ----------
    name : str
        Of the view; empty where there is one.
    camera : FoundCamera
    """
    said = f"{name}: " if name else ""
    if camera.how == "measured":
        return [f"{said}the camera stands as measured: the edges drawn over the photo show how "
                "well"]
    place = ", ".join(f"{value:.1f} ({error:.1f})" for value, error in
                      zip(camera.at_mm, camera.standard_error_mm, strict=True))
    lines = [f"{said}camera at {place} mm (standard errors in brackets), its direction known to "
             f"{camera.direction_error_deg:.2f} degrees, field of view {camera.fov_deg:.1f} "
             "degrees across"]
    if (model := camera.model) is None:
        worst = max(camera.residuals_px, key=lambda name: camera.residuals_px[name])
        return [*lines, f"{len(camera.residuals_px)} corners, largest residual "
                f"{camera.residuals_px[worst]:.2f} pixels at {worst}"]
    picture, corner = max(model.residuals_px, key=lambda mark: model.residuals_px[mark])
    far = max(model.distances, key=lambda point: model.distances[point])
    return [*lines, f"COLMAP model: {model.scale:.5g} ({model.scale_error:.2g}) mm to its unit; "
            f"{len(model.residuals_px)} marks of corners, rms {model.rms_px:.2f} pixels, largest "
            f"{model.residuals_px[picture, corner]:.2f} at {corner} in {picture}",
            f"{len(model.distances)} corners are seen by two pictures or more: furthest from where "
            f"the tape has it is {far}, by {model.distances[far]:.1f} mm"]


def _by_picture(residuals: dict[tuple[str, str], float]) -> dict[str, dict[str, float]]:
    pictures: dict[str, dict[str, float]] = {}
    for (picture, corner), miss in residuals.items():
        pictures.setdefault(picture, {})[corner] = miss
    return pictures
