"""What was found of a scene: photo against rendering, its light, geometry, the verdict's share."""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from spectrabox.measure import captured, conditions, records, rules
from spectrabox.measure.results import capture_result, methods
from spectrabox.radiometry import error_model, findings
from spectrabox.radiometry.records.calibration import Calibration, LightScale
from spectrabox.radiometry.records.scenes import MarkedView, Placement, Reconstruction

if TYPE_CHECKING:
    from spectrabox.measure.scene.rehearsal import Rehearsed


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneResult(capture_result.CaptureResult):
    """What was found of a scene."""

    stated: captured.SceneCapture
    reconstruction: Reconstruction              # of the first photo
    # photos beyond the first, by name: each with a calibration of its light
    views: Mapping[str, tuple[Calibration, Reconstruction]] = dataclasses.field(
        default_factory=dict)
    rehearsal: Rehearsed | None = None          # the last one of these results
    placements: tuple[Placement, ...] = ()      # none where camera and lamp stand as stated
    marked_views: tuple[MarkedView, ...] = ()

    surface_word = "material"
    right = "scene.right"

    @property
    def light_scale(self) -> LightScale:
        """From rendered signal to that of the first photo."""
        return self.reconstruction.light_scale

    @property
    def level_error(self) -> float | None:
        """Relative standard error of the level of the light where nothing stated it, and what is
        expected of surfaces told it; None where a chart or a known material did.
        """
        return self.light_scale.common_errors.get(error_model.LEVEL_BY_PRIOR)

    @property
    def own_findings(self) -> list[findings.Finding]:
        return rules.scene_findings(self)

    @cached_property
    def conditions(self) -> tuple[findings.Finding, ...]:
        return conditions.scene_conditions(self)

    @property
    def own_facts(self) -> dict[str, Any]:
        agreement, scale = self.reconstruction.agreement, self.light_scale
        light = self.reconstruction.known_light
        return {"materials": [surface.facts() for surface in self.surfaces],
                "surfaces": [{"name": name, "ratio": ratio.tolist()} for name, ratio
                             in zip(agreement.names, agreement.ratio, strict=True)],
                "median_surface_error": rules.median_surface_error(agreement),
                "light_scale": {"value": scale.value, "standard_error": scale.standard_error,
                                "common_errors": dict(scale.common_errors)},
                "known_light": None if light is None else {
                    "materials": list(light.materials), "level": light.level,
                    "level_error": light.level_error, "expected_error": light.expected_error,
                    "surfaces_error": light.surfaces_error, "colour": light.colour.tolist(),
                    "colour_error": light.colour_error.tolist()}}

    @property
    def methods(self) -> list[str]:
        return methods.scene_methods(self)


def bsdf_reflectances(result: capture_result.CaptureResult, bsdfs: Mapping[str, str]
                      ) -> tuple[dict[str, np.ndarray], tuple[float, float]]:
    """Reflectance (P,) of every BSDF as renderers take it, 0 to 1, and the first and last
    wavelength: the mean of the draws of its material, or the given spectrum.

    Parameters
    ----------
    result : CaptureResult
        Of a scene.
    bsdfs : mapping
        From names of materials to ids.
    """
    nm = result.grid.nm
    return ({bsdfs[surface.name]: np.clip(surface.mean, 0, 1) for surface in result.surfaces},
            (float(nm[0]), float(nm[-1])))


def scene_result(capture: captured.SceneCapture, records: records.CaptureRecords,
                 rehearsal: Rehearsed | None = None, picture_folder: str = "") -> SceneResult:
    """What was found of a scene.

    Parameters
    ----------
    capture : SceneCapture
    records : CaptureRecords
        Of all steps.
    rehearsal : Rehearsed, optional
        Of these results.
    picture_folder : str
        Where the picture's files lie, as its reader knows it.
    """
    joint, names = records.reconstruct.joint, records.signals.names
    bands = capture.band_names(records.photo.bands)
    views = {view.name: (calibration, reconstruction) for view, calibration, reconstruction
             in zip(capture.views, records.calibrations(capture.views), joint.views, strict=True)
             if view.name}
    common = capture_result.common_findings(capture, records)
    if len(set(joint.lamps)) > len({view.lamp for view in capture.views}):
        common["stated"] = dataclasses.replace(common["stated"], lamp_moved=True)
    surfaces = [
        capture_result.surface_of_records(capture, records, name, joint.spectra[names.index(name)])
        for name in capture.surfaces if name in names
    ]
    if not views:       # the bands of a single photo are not named after it
        surfaces = [dataclasses.replace(
            surface, signals=dataclasses.replace(surface.signals, bands=bands))
            for surface in surfaces]
        common["signal_bands"] = bands
    return SceneResult(
        **common, surfaces=tuple(surfaces), reconstruction=joint.views[0],
        views=views, rehearsal=rehearsal, placements=records.reconstruct.placements,
        marked_views=records.reconstruct.marked_views,
        picture_folder=picture_folder)
