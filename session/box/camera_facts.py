"""The camera of a box in words: for scripts and for a person."""
from __future__ import annotations

from typing import Any

from spectrabox.measure.scene.box_camera import BoxCamera


def camera_facts(camera: BoxCamera) -> dict[str, Any]:
    """For scripts: places in millimetres, angles in degrees, residuals in pixels.

    Parameters
    ----------
    camera : BoxCamera
    """
    facts: dict[str, Any] = {"how": camera.how, "at_mm": camera.at_mm, "direction":
                             camera.direction, "fov_deg": camera.fov_deg}
    if camera.how == "measured":
        return facts
    facts |= {"standard_error_mm": camera.standard_error_mm,
              "direction_standard_error_deg": camera.direction_error_deg,
              "residuals_px": camera.residuals_px}
    if (model := camera.model) is not None:
        by_picture: dict[str, dict[str, float]] = {}
        for (picture, corner), residual in model.residuals_px.items():
            by_picture.setdefault(picture, {})[corner] = residual
        facts["colmap"] = {
            "mm_per_unit": model.scale, "mm_per_unit_standard_error": model.scale_error,
            "rms_px": model.rms_px, "distances_mm": model.distances,
            "residuals_px": by_picture}
    return facts


def camera_text(name: str, camera: BoxCamera) -> list[str]:
    """Lines for a person.

    Parameters
    ----------
    name : str
        Of the view; empty where there is one.
    camera : BoxCamera
    """
    whose = f"{name}: " if name else ""
    if camera.how == "measured":
        return [f"{whose}the camera stands as measured: the edges drawn over the photo show how "
                "well"]
    position = ", ".join(f"{value:.1f} ({error:.1f})" for value, error in
                         zip(camera.at_mm, camera.standard_error_mm, strict=True))
    lines = [f"{whose}camera at {position} mm (standard errors in brackets), its direction known "
             f"to {camera.direction_error_deg:.2f} degrees, field of view {camera.fov_deg:.1f} "
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
