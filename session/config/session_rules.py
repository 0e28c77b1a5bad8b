"""Faults of a session.toml between keys that are each well written."""
from __future__ import annotations

from collections.abc import Iterator

from spectrabox.measure.captured import FIRST_PHOTO, ONE_PHOTO
from spectrabox.measure.options import PictureOptions
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.published.published_tables import LIGHTS, published_names
from spectrabox.radiometry.records.photos import MIN_PATCHES
from spectrabox.radiometry.system.known_names import nearest_words
from spectrabox.radiometry.system.words import name_fault, sharing_a_file, shortened
from spectrabox.sampling.prior.families.family_names import unknown_families
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_schema import (
    FILE_NAME,
    SessionConfig,
    ViewSection,
    by_band,
    encloses,
)


def inconsistencies(config: SessionConfig) -> list[str]:
    """A sentence for every pair of keys that do not go together."""
    faults = _flat_and_scene(config) or [*config.faults()]
    return [*faults, *_sampling(config), *_families(config), *_chart_corners(config),
            *_names(config), *_views(config),
            *_lens(config), *_bands(config), *_unknown_lights(config), *_patches(config),
            *_picture(config)]


def _flat_and_scene(config: SessionConfig) -> list[str]:
    """A session measures the materials of a scene, or the regions of a flat sample."""
    of_scene = [name for name, is_written in (("[scene]", config.scene is not None),
                                              ("[materials]", bool(config.materials)))
                if is_written]
    if not (config.regions and of_scene):
        return []
    return [f"{FILE_NAME}: [regions] and {' and '.join(of_scene)} stand together; a session "
            "measures the materials of a scene or the regions of a flat sample: leave one out"]


def _sampling(config: SessionConfig) -> Iterator[str]:
    """What draws through the traced light are made of."""
    if config.sampling.through == "transport" and config.sampling.method != "prior":
        yield (f"{FILE_NAME}: sampling.through = \"transport\" draws from the learnt prior alone; "
               f"set sampling.method = \"prior\" in place of {config.sampling.method!r}")


def _families(config: SessionConfig) -> Iterator[str]:
    """Families that nobody measured."""
    stated = {f"regions.{name}": region for name, region in config.regions.items()} \
        | {f"materials.{name}": material for name, material in config.materials.items()} \
        | ({} if config.picture is None else {"picture": config.picture})
    for place, surface in stated.items():
        wrong = unknown_families(surface.families)
        if wrong is not None:
            yield f"{FILE_NAME}: {place}.family: {wrong}"


def _chart_corners(config: SessionConfig) -> Iterator[str]:
    """Corners of the chart are four."""
    corners = config.chart.corners_px
    if corners is not None and [len(corner) for corner in corners] != [2] * 4:
        yield (f"{FILE_NAME}: chart.corners_px needs four [x, y] pairs: of a ColorChecker Classic "
               "the outer corners at dark skin, bluish green, black and white")


def _names(config: SessionConfig) -> Iterator[str]:
    """Names of the session and of what it has, by one rule; files are named after them."""
    named: dict[str, list[str]] = {
        "session.name = ": [config.session.name], "materials.": [*config.materials],
        "regions.": [*config.regions],
        "views.": [*config.views],
        "photos.object.": [band for band in by_band(config.photos.object) if band != ONE_PHOTO]}
    for place, names in named.items():
        for name in names:
            fault = name_fault(name)
            if fault is not None:
                yield f"{FILE_NAME}: {place}{shortened(name)}: {fault}"
        for first, other in sharing_a_file(names):
            yield (f"{FILE_NAME}: {place}{shortened(first)} and {shortened(other)}: files would be "
                   "named alike after both; rename one")


def _views(config: SessionConfig) -> Iterator[str]:
    """Faults of further photos."""
    if FIRST_PHOTO in config.views:
        yield (f"{FILE_NAME}: views.{FIRST_PHOTO}: {FIRST_PHOTO!r} is what the photo of [photos] "
               "is called; rename the view")
    for name, view in config.views.items():
        yield from _turntable(config, name, view)
        yield from _same_light(config, name, view)
        yield from _camera(config, name, view)
        if view.lamp_at_mm is not None and (config.box is None or view.scene is not None):
            yield (f"{FILE_NAME}: views.{name}.lamp_at_mm moves the lamp of [scene.box], and this "
                   "view's scene is a file, which has its own; leave it out")
    engine = config.reconstruct.engine
    if config.views and engine not in ("auto", "transport"):
        yield (f"{FILE_NAME}: several views are fitted by reconstruct.engine = \"transport\" "
               f"alone; {engine!r} takes one photo")


def _turntable(config: SessionConfig, name: str, view: ViewSection) -> Iterator[str]:
    """A view that is turned, of a scene that does not turn."""
    turns = config.box is not None and config.box.turntable_mm is not None and view.scene is None
    if view.turn_deg is not None and not turns:
        yield (f"{FILE_NAME}: views.{name}.turn_deg turns the turntable of [scene.box], which this "
               "view has none of; give turntable_mm there, or leave it out")


def _same_light(config: SessionConfig, name: str, view: ViewSection) -> Iterator[str]:
    """Faults of what a view says of the lamp that it has in common with another."""
    place, other = f"{FILE_NAME}: views.{name}.same_light_as", view.same_light_as
    if view.lamp is not None and view.light is not None:
        yield (f"{FILE_NAME}: views.{name}.lamp says that the lamp of another photo was moved and "
               f"views.{name}.light names one; leave one out")
    if view.lamp is not None and not config.regions:
        yield (f"{FILE_NAME}: views.{name}.lamp belongs to flat samples; where a lamp stands in a "
               f"scene the scene says: give views.{name}.scene")
    if other is None:
        return
    if view.light is not None:
        yield f"{place} says whose lamp it is and views.{name}.light names one; leave one out"
        return
    if other != FIRST_PHOTO and other not in config.views:
        yield (f"{place} names {other!r}; the session's photos are "
               f"{', '.join((FIRST_PHOTO, *config.views))}")
        return
    passed = [name]
    while other in config.views and other not in passed:
        passed.append(other)
        other = config.views[other].same_light_as
    if other in passed:
        yield (f"{place}: {' -> '.join((*passed, other))} goes round in a circle; let one of them "
               "name its light")


def _camera(config: SessionConfig, name: str, view: ViewSection) -> Iterator[str]:
    """Faults of a view's own camera."""
    if view.camera is None:
        return
    if config.box is None or view.scene is not None:
        yield (f"{FILE_NAME}: views.{name}.camera places a camera before [scene.box], and this "
               "view's scene is a file, which has its own; leave it out")
        return
    fault = config.box.turned(view.turn_deg or 0.0).corner_fault(view.camera)
    if fault is not None:
        yield f"{FILE_NAME}: views.{name}.camera: {fault}"


def _lens(config: SessionConfig) -> Iterator[str]:
    """Two lenses of one photo."""
    cameras = [view.camera for view in config.views.values()]
    if config.box is not None:
        cameras.append(config.box.camera)
    of_model = [camera for camera in cameras if camera is not None and camera.image is not None]
    if config.camera.lens is not None and of_model:
        yield (f"{FILE_NAME}: camera.lens and a camera with image both say what the lens is: the "
               "COLMAP model has its own; leave camera.lens out")


def _bands(config: SessionConfig) -> Iterator[str]:
    """Photos taken band by band must name the same bands."""
    wanted = by_band(config.photos.object)
    if not wanted:
        yield f"{FILE_NAME}: photos.object names no file"
    others = {"photos.chart": by_band(config.photos.chart)}
    for name, view in config.views.items():
        others |= {f"views.{name}.photo": by_band(view.photo),
                   f"views.{name}.chart": by_band(view.chart)}
    for place, photo in others.items():
        if photo and [*photo] != [*wanted]:
            yield (f"{FILE_NAME}: {place} and photos.object must have the same bands in the same "
                   f"order; they have {_named_bands(photo)} and {_named_bands(wanted)}")
    unknown = [name for name in config.photos.flats if name not in (ONE_PHOTO, *wanted)]
    if unknown:
        yield (f"{FILE_NAME}: photos.flat has {', '.join(map(repr, unknown))}, which photos.object "
               "lacks")


def _named_bands(photo: dict[str, tuple[str, ...]]) -> str:
    return ", ".join(map(repr, photo)) if any(photo) else "a single photo"


def _unknown_lights(config: SessionConfig) -> Iterator[str]:
    """What a light that nobody measured cannot do."""
    first, *others = config.all_views
    by_id = config.light.by_id or {}
    unknown = [name for name, light in by_id.items() if not light.stated]
    if unknown:
        yield (f"{FILE_NAME}: light.by_id.{unknown[0]} is not known: one chart under several lamps "
               "cannot tell their spectra apart; measure this lamp, or leave it out if it has the "
               "spectrum of the others")
    if all(view.spectrum_stated for view in config.all_views):
        return
    if by_id:
        yield (f"{FILE_NAME}: a light is not known, but light.by_id says that the scene has lamps "
               "of several spectra: products of the camera with each are needed, and a chart tells "
               "those with one; measure the lamps, or leave out light.by_id if all have one "
               "spectrum")
    if not config.camera_from_chart or config.sensitivity.method not in (None, "prior"):
        yield (f"{FILE_NAME}: a light that is not known is found with the camera from the chart: "
               "leave out sensitivity.from and sensitivity.method, or measure the light")
    for view in others:
        if not view.same_light(first) and not view.chart:
            yield (f"{FILE_NAME}: views.{view.name} has another light than the first photo, and "
                   "not both are known: give it a chart photo of its own, measure both lights, or "
                   f"write same_light_as = \"{FIRST_PHOTO}\" if one lamp lit both")


def _patches(config: SessionConfig) -> Iterator[str]:
    """Patches left out must be on the chart, and leave enough."""
    if not config.chart.leave_out:
        return
    try:
        chart = session_chart(config)
    except InputError:      # said where the chart is read
        return
    patches = len(chart.names)
    left = patches - len(set(config.chart.leave_out))
    wrong = [number for number in config.chart.leave_out if not 1 <= number <= patches]
    if wrong:
        yield (f"{FILE_NAME}: chart.leave_out names patch {wrong[0]}; the patches are numbered 1 "
               f"to {patches}, {chart.names[0]} first")
    elif left < MIN_PATCHES:
        yield f"{FILE_NAME}: chart.leave_out leaves {left} patches; {MIN_PATCHES} are needed"


def _picture(config: SessionConfig) -> Iterator[str]:
    """Faults of [picture] of either kind of session."""
    if config.picture is not None:
        yield from _picture_keys(config.picture, f"{FILE_NAME}: picture")


def _picture_keys(section: PictureOptions, place: str) -> Iterator[str]:
    if section.rect is not None and not encloses(section.rect):
        yield (f"{place}.rect is {list(section.rect)}; two opposite corners [x0, y0, x1, y1] that "
               "enclose something are needed")
    if section.light is not None and section.light not in published_names(LIGHTS):
        yield (f"{place}.light is {shortened(section.light)}, which is no CIE name"
               f"{nearest_words(section.light, published_names(LIGHTS))}; take A, D50, FL11 or "
               "LED-B3, say")
