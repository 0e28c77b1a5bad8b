"""A session of regions of flat samples: what it needs, and what its keys cannot say together."""
from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from spectrabox.measure.captured import FIRST_PHOTO
from spectrabox.measure.steps.declared_steps import FLAT_STEPS, Step
from spectrabox.session.config.session_schema import (
    FILE_NAME,
    RegionSection,
    SessionConfig,
    ViewSection,
    by_band,
    encloses,
)


class FlatSession(SessionConfig):
    """A session of regions of flat samples, which lie beside a chart."""

    steps: ClassVar[tuple[Step, ...]] = FLAT_STEPS

    @property
    def surfaces(self) -> Mapping[str, RegionSection]:
        return self.regions

    @property
    def camera_from_chart(self) -> bool:
        return True

    @property
    def needs_chart(self) -> bool:
        return True

    @property
    def first_chart(self) -> dict[str, tuple[str, ...]]:
        """Where no other photo does, that of the samples shows the chart itself."""
        return by_band(self.photos.object if self.photos.chart is None else self.photos.chart)

    def chart_of(self, view: ViewSection, lamp: str) -> dict[str, tuple[str, ...]]:
        """As of ``SessionConfig``; without one of its own, the view's photo shows the chart where
        its light is another, elsewhere or through a filter, or where the first photo shows it.
        """
        if view.chart is not None:
            return by_band(view.chart)
        shows_chart = lamp != FIRST_PHOTO or view.filter is not None or view.lamp is not None \
            or self.photos.chart is None
        return by_band(view.photo) if shows_chart else {}

    def faults(self) -> Iterator[str]:
        yield from _keys_of_a_scene(self)
        if self.sampling.through == "transport":
            yield (f"{FILE_NAME}: sampling.through = \"transport\" follows light through a scene; "
                   "regions of a flat sample take \"surface\"")
        if self.sensitivity.method not in (None, "prior"):
            yield (f"{FILE_NAME}: sensitivity.method = {self.sensitivity.method!r} knows nothing "
                   "of the light over the chart, which carries it to the regions; use \"prior\"")
        photos = (FIRST_PHOTO, *self.views)
        for name, region in self.regions.items():
            yield from _region(f"{FILE_NAME}: regions.{name}", region, photos)
        if self.picture is not None and self.regions \
                and not self.regions_in(self.all_views[0]):
            yield (f"{FILE_NAME}: [picture] shows the photo of [photos], in which no region lies; "
                   "outline one there")


def _keys_of_a_scene(config: FlatSession) -> Iterator[str]:
    """What is stated of a scene that is not there."""
    repeatability = config.repeatability.model_fields_set
    written = {
        "chart.scene": config.chart.scene is not None,
        "camera.lens": config.camera.lens is not None,
        "light.by_id": bool(config.light.by_id),
        "[reconstruct]": "reconstruct" in config.model_fields_set,
        "[scale]": "scale" in config.model_fields_set,
        "repeatability.lamp_position": "lamp_position" in repeatability,
        "repeatability.scene_level": "scene_level" in repeatability,
        "stray_light.ambient": "ambient" in config.stray_light.model_fields_set}
    for key, is_written in written.items():
        if is_written:
            yield (f"{FILE_NAME}: {key} belongs to a scene, and regions of a flat sample need "
                   "none; leave it out")
    for name, view in config.views.items():
        if view.scene is not None:
            yield f"{FILE_NAME}: views.{name}.scene belongs to a scene; leave it out"


def _region(place: str, region: RegionSection, photos: tuple[str, ...]) -> Iterator[str]:
    """Faults of one region.

    Parameters
    ----------
    place : str
        Its table, as sentences call it.
    region : RegionSection
    photos : tuple of str
        Names of the session's photos.
    """
    if (region.rect is None) == (region.polygon is None):
        yield (f"{place} needs either rect = [x0, y0, x1, y1] or polygon = [[x, y], ...], in "
               "pixels of the photo")
    elif region.rect is not None and not encloses(region.rect):
        yield (f"{place}.rect is {list(region.rect)}; two opposite corners [x0, y0, x1, y1] that "
               "enclose something are needed")
    elif region.polygon is not None and (len(region.polygon) < 3
                                         or any(len(corner) != 2 for corner in region.polygon)):
        yield f"{place}.polygon needs three corners [x, y] or more, going round"
    unknown = [photo for photo in region.photos if photo not in photos]
    if unknown:
        yield (f"{place}.photo names {unknown[0]!r}; the session's photos are "
               f"{', '.join(photos)}")
