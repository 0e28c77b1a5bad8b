"""A session of the materials of a scene: what it needs, and what its keys cannot say together."""
from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from spectrabox.measure.steps.declared_steps import SCENE_STEPS, Step
from spectrabox.session.config.session_schema import (
    FILE_NAME,
    MaterialSection,
    SessionConfig,
    ViewSection,
    by_band,
)


class SceneSession(SessionConfig):
    """A session of the materials of a scene."""

    steps: ClassVar[tuple[Step, ...]] = SCENE_STEPS

    @property
    def surfaces(self) -> Mapping[str, MaterialSection]:
        return self.materials

    @property
    def camera_from_chart(self) -> bool:
        return self.sensitivity.from_chart

    @property
    def needs_chart(self) -> bool:
        return self.camera_from_chart or self.scale.source == "chart"

    @property
    def first_chart(self) -> dict[str, tuple[str, ...]]:
        return by_band(self.photos.chart if self.needs_chart else None)

    def chart_of(self, view: ViewSection, lamp: str) -> dict[str, tuple[str, ...]]:
        return by_band(view.chart)

    @property
    def bsdfs(self) -> dict[str, str]:
        """Id of the BSDF of every material."""
        return {name: material.bsdf or name for name, material in self.materials.items()}

    @property
    def chart_pose_known(self) -> bool:
        """Whether the session says where light and chart stood for the chart photo."""
        return self.chart.scene is not None or (self.box is not None
                                                and self.box.chart is not None)

    def faults(self) -> Iterator[str]:
        if self.scene is None or not self.materials:
            lacking = "the table [scene]" if self.scene is None else "the table [materials.NAME]"
            yield (f"{FILE_NAME}: {lacking} is missing; a scene needs [scene] and "
                   "[materials.NAME], a flat sample [regions.NAME] in their place")
            return
        if "plane" in self.repeatability.model_fields_set:
            yield (f"{FILE_NAME}: repeatability.plane belongs to regions of a flat sample; that of "
                   "a scene is repeatability.scene_level")
        if self.photos.orientation != 1:
            yield (f"{FILE_NAME}: photos.orientation belongs to a flat sample; a scene's lens and "
                   "camera are those of the photo as the sensor read it")
        yield from _chart(self)
        yield from _materials(self)
        if self.picture is not None:
            yield from _picture(self)


def _chart(config: SceneSession) -> Iterator[str]:
    """Faults of the chart and of where it stood."""
    if config.needs_chart and config.photos.chart is None:
        yield (f"{FILE_NAME}: photos.chart is missing, but sensitivities or scale are to come from "
               "it; add the photo, or give [sensitivity] from = \"curves.csv\" and [scale] from = "
               "\"material\"")
    if config.scale.source == "chart" and not config.chart_pose_known:
        missing = "chart.scene" if config.box is None else "the table [scene.box.chart]"
        yield (f"{FILE_NAME}: {missing} is missing: a scale from the chart photo needs light and "
               "chart in their places; add it, or use [scale] from = \"material\"")
    if config.chart.scene is not None and config.box is not None and config.box.chart is not None:
        yield (f"{FILE_NAME}: chart.scene and [scene.box.chart] both say where the chart stood; "
               "leave one out")
    if not config.chart_pose_known:
        for name, view in config.views.items():
            if view.chart is not None:
                yield (f"{FILE_NAME}: views.{name}.chart needs chart.scene: a scale from a chart "
                       "photo needs light and chart in their places")


def _materials(config: SceneSession) -> Iterator[str]:
    """Faults of the materials together."""
    materials = config.materials.values()
    if config.scale.source == "material" and not any(material.known for material in materials):
        yield (f"{FILE_NAME}: scale.from is \"material\", but no material has a known spectrum; "
               "add known = \"spectra/NAME.csv\" to one")
    if materials and all(material.known for material in materials):
        yield (f"{FILE_NAME}: every material is known, so there is nothing to find; leave out one "
               "'known'")
    owners: dict[str, str] = {}
    for name, bsdf in config.bsdfs.items():
        if bsdf in owners:
            yield (f"{FILE_NAME}: materials {owners[bsdf]!r} and {name!r} name the same BSDF "
                   f"{bsdf!r}")
        owners[bsdf] = name


def _picture(config: SceneSession) -> Iterator[str]:
    """What a picture of a scene cannot take into account."""
    chosen = config.reconstruct
    if chosen.engine == "gradient":
        yield (f"{FILE_NAME}: [picture] of a scene needs its light traced; set reconstruct.engine "
               f"= \"transport\" in place of {chosen.engine!r}, or leave [picture] out")
    for name, error in (("light_error", chosen.light_error), ("mixing_error", chosen.mixing_error)):
        if error > 0:
            yield (f"{FILE_NAME}: [picture] of a scene takes lights and bands as they are stated, "
                   f"and reconstruct.{name} lets the fit correct them; leave out one of the two")
