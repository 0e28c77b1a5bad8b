"""Faults of a session.toml between keys that are each well written."""
from __future__ import annotations

from collections.abc import Sequence

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import VISIBLE_NM
from spectrabox.radiometry.least_counts import MIN_PATCHES, MIN_SWATCHES
from spectrabox.radiometry.published.published_tables import LIGHTS, published_names
from spectrabox.radiometry.system.names import name_fault, sharing_a_file
from spectrabox.radiometry.system.words import shortened
from spectrabox.sampling.prior.families.family_names import unknown_families
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_schema import (
    FILE_NAME,
    FIRST_PHOTO,
    ONE_PHOTO,
    SessionConfig,
    ViewSection,
    by_band,
)


def inconsistencies(config: SessionConfig) -> list[str]:
    """A sentence for every pair of keys that do not go together."""
    problems = _ground(config) or (_regions(config) if config.flat else _scene(config))
    if config.sampling.through == "transport" and config.sampling.method != "prior":
        problems.append(f"{FILE_NAME}: sampling.through = \"transport\" draws from the learnt "
                        "prior alone; set sampling.method = \"prior\" in place of "
                        f"{config.sampling.method!r}")
    kind = "regions" if config.flat else "materials"
    if not config.flat:
        problems += nothing_to_measure(config)
    for name, surface in config.surfaces.items():
        if (wrong := unknown_families(surface.families)) is not None:
            problems.append(f"{FILE_NAME}: {kind}.{name}.family: {wrong}")
    if config.chart.corners_px is not None and [len(c) for c in config.chart.corners_px] != [2] * 4:
        problems.append(f"{FILE_NAME}: chart.corners_px needs four [x, y] pairs: of a ColorChecker "
                        "Classic the outer corners at dark skin, bluish green, black and white")
    problems += unpaired_references(config)
    if config.drift.chart_px and not config.needs_chart:
        problems.append(f"{FILE_NAME}: [drift] compares the object photo with the chart photo, but "
                        "nothing of this session comes from a chart photo; leave it out")
    return (problems + _names(config) + _views(config) + _bands(config) + _unknown_lights(config)
            + _patches(config) + _picture(config))


def nothing_to_measure(config: SessionConfig) -> list[str]:
    """A sentence where no surface is left to estimate; a flat sample can be calibrated all the
    same.
    """
    if config.flat and not config.regions:
        return [f"{FILE_NAME}: no region is outlined yet; outline one on the page ('spectrabox "
                "open'), or add [regions.NAME] with rect = [x0, y0, x1, y1]"]
    if config.surfaces and all(surface.measured for surface in config.surfaces.values()):
        kind = "region" if config.flat else "material"
        return [f"{FILE_NAME}: every {kind} is known, so there is nothing to find; leave out one "
                "'known'"]
    return []


def unpaired_references(config: SessionConfig) -> list[str]:
    """A sentence where one photo names more references of [drift] than the other."""
    if len(config.drift.chart_px) == len(config.drift.object_px):
        return []
    return [f"{FILE_NAME}: drift.chart_px names {len(config.drift.chart_px)} references and "
            f"drift.object_px {len(config.drift.object_px)}; name the same ones in both, in one "
            "order"]


def _unknown_lights(config: SessionConfig) -> list[str]:
    """What a light that nobody measured cannot do."""
    first, problems = config.all_views[0], []
    if unknown := [name for name, light in (config.light.by_id or {}).items() if not light.stated]:
        problems.append(f"{FILE_NAME}: light.by_id.{unknown[0]} is not known: one chart under "
                        "several lamps cannot tell their spectra apart; measure this lamp, or "
                        "leave it out if it has the spectrum of the others")
    if all(view.spectrum_stated for view in config.all_views):
        return problems
    if config.light.by_id:
        problems.append(f"{FILE_NAME}: a light is not known, but light.by_id says that the scene "
                        "has lamps of several spectra: products of the camera with each are "
                        "needed, and a chart tells those with one; measure the lamps, or leave out "
                        "light.by_id if all have one spectrum")
    by_chart = config.flat or config.sensitivity.from_chart
    if not by_chart or config.sensitivity.method not in (None, "prior"):
        problems.append(f"{FILE_NAME}: a light that is not known is found with the camera from the "
                        "chart: leave out sensitivity.from and sensitivity.method, or measure the "
                        "light")
    problems += [f"{FILE_NAME}: views.{view.name} has another light than the first photo, and not "
                 "both are known: give it a chart photo of its own, measure both lights, or write "
                 f"same_light_as = \"{FIRST_PHOTO}\" if one lamp lit both"
                 for view in config.all_views[1:] if not view.same_light(first) and not view.chart]
    return problems


def _patches(config: SessionConfig) -> list[str]:
    """Patches left out must be on the chart, and leave enough."""
    if not config.chart.leave_out:
        return []
    try:
        chart = session_chart(config)
    except InputError:      # said where the chart is read
        return []
    patches = len(chart.names)
    left = patches - len(set(config.chart.leave_out))
    if wrong := [number for number in config.chart.leave_out if not 1 <= number <= patches]:
        return [f"{FILE_NAME}: chart.leave_out names patch {wrong[0]}; the patches are numbered 1 "
                f"to {patches}, {chart.names[0]} first"]
    return [] if left >= MIN_PATCHES else [
        f"{FILE_NAME}: chart.leave_out leaves {left} patches; {MIN_PATCHES} are needed"]


def _picture(config: SessionConfig) -> list[str]:
    """Faults of [picture]."""
    section, place = config.picture, f"{FILE_NAME}: picture"
    if section is None:
        return []
    problems = []
    if section.rect is not None and (len(section.rect) != 4 or _empty(section.rect)):
        problems.append(f"{place}.rect is {list(section.rect)}; two opposite corners [x0, y0, x1, "
                        "y1] that enclose something are needed")
    if section.light is not None and section.light not in published_names(LIGHTS):
        problems.append(f"{place}.light is {shortened(section.light)}, which is no CIE name; take "
                        "A, D50, FL11 or LED-B3, say")
    low, high = VISIBLE_NM
    if outside := [nm for nm in section.bands_nm if not low <= nm <= high]:
        problems.append(f"{place}.bands_nm has {outside[0]:g}, which lies outside {low:g} to "
                        f"{high:g} nm")
    if (wrong := unknown_families(section.families)) is not None:
        problems.append(f"{place}.family: {wrong}")
    if not config.flat:
        return problems + _scene_picture(config)
    if config.regions and not config.regions_in(config.all_views[0]):
        problems.append(f"{FILE_NAME}: [picture] shows the photo of [photos], in which no region "
                        "lies; outline one there")
    return problems


def _scene_picture(config: SessionConfig) -> list[str]:
    """What a picture of a scene cannot take into account."""
    chosen, problems = config.reconstruct, []
    if chosen.engine == "gradient":
        problems.append(f"{FILE_NAME}: [picture] of a scene needs its light traced; set "
                        f"reconstruct.engine = \"transport\" in place of {chosen.engine!r}, or "
                        "leave [picture] out")
    problems += [f"{FILE_NAME}: [picture] of a scene takes lights and bands as they are stated, "
                 f"and reconstruct.{name} lets the fit correct them; leave out one of the two"
                 for name in ("light_error", "mixing_error") if getattr(chosen, name) > 0]
    return problems


def _names(config: SessionConfig) -> list[str]:
    """Names of the session and of what it has, by one rule; files are named after them."""
    named: dict[str, list[str]] = {
        "session.name = ": [config.session.name], "materials.": [*config.materials],
        "regions.": [*config.regions],
        "views.": [*config.views],
        "photos.object.": [band for band in by_band(config.photos.object) if band != ONE_PHOTO]}
    problems = []
    for place, names in named.items():
        problems += [f"{FILE_NAME}: {place}{shortened(name)}: {fault}" for name in names
                     if (fault := name_fault(name)) is not None]
        problems += [f"{FILE_NAME}: {place}{shortened(first)} and {shortened(other)}: files would "
                     "be named alike after both; rename one"
                     for first, other in sharing_a_file(names)]
    return problems


def _ground(config: SessionConfig) -> list[str]:
    """What a session measures: the materials of a scene, or the regions of a flat sample."""
    both = [name for name, written in (("[scene]", config.scene), ("[materials]", config.materials))
            if written]
    if config.regions and both:
        return [f"{FILE_NAME}: [regions] and {' and '.join(both)} stand together; a session "
                "measures the materials of a scene or the regions of a flat sample: leave one out"]
    if config.flat or len(both) == 2:
        return []
    lacking = "the table [materials.NAME] is missing" if config.scene else \
        "the table [scene] is missing"
    return [f"{FILE_NAME}: {lacking}; a scene needs [scene] and [materials.NAME], a flat sample "
            "[regions.NAME] in their place"]


def _scene(config: SessionConfig) -> list[str]:
    """Faults of a session of a scene."""
    problems = [f"{FILE_NAME}: repeatability.plane belongs to regions of a flat sample; that of a "
                "scene is repeatability.scene_level"] if \
        "plane" in config.repeatability.model_fields_set else []
    if config.needs_chart and config.photos.chart is None:
        problems.append(f"{FILE_NAME}: photos.chart is missing, but sensitivities or scale are to "
                        "come from it; add the photo, or give [sensitivity] from = \"curves.csv\" "
                        "and [scale] from = \"material\"")
    if config.scale.source == "chart" and not config.chart_pose_known:
        missing = "chart.scene" if config.box is None else "the table [scene.box.chart]"
        problems.append(f"{FILE_NAME}: {missing} is missing: a scale from the chart photo needs "
                        "light and chart in their places; add it, or use [scale] from = "
                        "\"material\"")
    if config.chart.scene is not None and config.box is not None and config.box.chart is not None:
        problems.append(f"{FILE_NAME}: chart.scene and [scene.box.chart] both say where the chart "
                        "stood; leave one out")
    if config.photos.orientation != 1:
        problems.append(f"{FILE_NAME}: photos.orientation belongs to a flat sample; a scene's lens "
                        "and camera are those of the photo as the sensor read it")
    if config.scale.source == "material" and not any(m.known for m in config.materials.values()):
        problems.append(f"{FILE_NAME}: scale.from is \"material\", but no material has a known "
                        "spectrum; add known = \"spectra/NAME.csv\" to one")
    owners: dict[str, str] = {}
    for name, bsdf in config.bsdfs.items():
        if bsdf in owners:
            problems.append(f"{FILE_NAME}: materials {owners[bsdf]!r} and {name!r} name the same "
                            f"BSDF {bsdf!r}")
        owners[bsdf] = name
    return problems


def _regions(config: SessionConfig) -> list[str]:
    """Faults of a session of a flat sample."""
    problems = [f"{FILE_NAME}: {key} belongs to a scene, and regions of a flat sample need none; "
                "leave it out"
                for key, written in (("chart.scene", config.chart.scene),
                                     ("camera.lens", config.camera.lens),
                                     ("light.by_id", config.light.by_id),
                                     ("[reconstruct]", "reconstruct" in config.model_fields_set),
                                     ("[scale]", "scale" in config.model_fields_set),
                                     *((f"repeatability.{name}",
                                        name in config.repeatability.model_fields_set)
                                       for name in ("lamp_position", "scene_level")),
                                     ("stray_light.ambient", "ambient"
                                      in config.stray_light.model_fields_set)) if written]
    problems += [f"{FILE_NAME}: views.{name}.scene belongs to a scene; leave it out"
                 for name, view in config.views.items() if view.scene is not None]
    if config.sampling.through == "transport":
        problems.append(f"{FILE_NAME}: sampling.through = \"transport\" follows light through a "
                        "scene; regions of a flat sample take \"surface\"")
    if config.sensitivity.method not in (None, "prior"):
        problems.append(f"{FILE_NAME}: sensitivity.method = {config.sensitivity.method!r} knows "
                        "nothing of the light over the chart, which carries it to the regions; use "
                        "\"prior\"")
    swatches = [name for name, region in config.regions.items() if region.swatch is not None]
    if 0 < len(swatches) < MIN_SWATCHES:
        problems.append(f"{FILE_NAME}: {len(swatches)} regions are swatches; a correction needs "
                        f"{MIN_SWATCHES} or more of the material, better 24")
    if swatches and config.sampling.method != "prior":
        problems.append(f"{FILE_NAME}: swatches correct the learnt prior; set sampling.method = "
                        f"\"prior\" in place of {config.sampling.method!r}")
    photos = (FIRST_PHOTO, *config.views)
    for name, region in config.regions.items():
        place = f"{FILE_NAME}: regions.{name}"
        if region.known is not None and region.swatch is not None:
            problems.append(f"{place} is known and a swatch; a known region tells of the light, a "
                            "swatch of the material: state one of the two")
        if (region.rect is None) == (region.polygon is None):
            problems.append(f"{place} needs either rect = [x0, y0, x1, y1] or polygon = [[x, y], "
                            "...], in pixels of the photo")
        elif region.rect is not None and (len(region.rect) != 4 or _empty(region.rect)):
            problems.append(f"{place}.rect is {list(region.rect)}; two opposite corners [x0, y0, "
                            "x1, y1] that enclose something are needed")
        elif region.polygon is not None and (len(region.polygon) < 3
                                             or any(len(corner) != 2 for corner in region.polygon)):
            problems.append(f"{place}.polygon needs three corners [x, y] or more, going round")
        if unknown := [photo for photo in region.photos if photo not in photos]:
            problems.append(f"{place}.photo names {unknown[0]!r}; the session's photos are "
                            f"{', '.join(photos)}")
    return problems


def _empty(rect: Sequence[float]) -> bool:
    x0, y0, x1, y1 = rect
    return x0 == x1 or y0 == y1


def _views(config: SessionConfig) -> list[str]:
    problems = []
    if FIRST_PHOTO in config.views:
        problems.append(f"{FILE_NAME}: views.{FIRST_PHOTO}: {FIRST_PHOTO!r} is what the photo of "
                        "[photos] is called; rename the view")
    for name, view in config.views.items():
        if view.chart is not None and not config.chart_pose_known and not config.flat:
            problems.append(f"{FILE_NAME}: views.{name}.chart needs chart.scene: a scale from a "
                            "chart photo needs light and chart in their places")
        if view.turn_deg is not None and (config.box is None or config.box.turntable_mm is None
                                          or view.scene is not None):
            problems.append(f"{FILE_NAME}: views.{name}.turn_deg turns the turntable of "
                            "[scene.box], which this view has none of; give turntable_mm there, or "
                            "leave it out")
        if view.same_light_as is not None:
            problems += _same_light(config, name, view)
        if view.camera is not None:
            problems += _camera_of(config, name, view)
    cameras = [view.camera for view in config.views.values()]
    if config.box is not None:
        cameras.append(config.box.camera)
    if config.camera.lens is not None and any(camera is not None and camera.image is not None
                                              for camera in cameras):
        problems.append(f"{FILE_NAME}: camera.lens and a camera with image both say what the lens "
                        "is: the COLMAP model has its own; leave camera.lens out")
    if config.views and config.reconstruct.engine not in ("auto", "transport"):
        problems.append(f"{FILE_NAME}: several views are fitted by reconstruct.engine = "
                        f"\"transport\" alone; {config.reconstruct.engine!r} takes one photo")
    return problems


def _same_light(config: SessionConfig, name: str, view: ViewSection) -> list[str]:
    """Faults of what a view says of the lamp that it has in common with another."""
    place, other = f"{FILE_NAME}: views.{name}.same_light_as", view.same_light_as
    if view.light is not None:
        return [f"{place} says whose lamp it is and views.{name}.light names one; leave one out"]
    if other != FIRST_PHOTO and other not in config.views:
        return [f"{place} names {other!r}; the session's photos are "
                f"{', '.join((FIRST_PHOTO, *config.views))}"]
    passed = [name]
    while other in config.views and other not in passed:
        passed.append(other)
        other = config.views[other].same_light_as
    return [] if other not in passed else [
        f"{place}: {' -> '.join((*passed, other))} goes round in a circle; let one of them name "
        "its light"]


def _camera_of(config: SessionConfig, name: str, view: ViewSection) -> list[str]:
    """Faults of a view's own camera."""
    assert view.camera is not None
    if config.box is None or view.scene is not None:
        return [f"{FILE_NAME}: views.{name}.camera places a camera before [scene.box], and this "
                "view's scene is a file, which has its own; leave it out"]
    fault = config.box.turned(view.turn_deg or 0.0).corner_fault(view.camera)
    return [] if fault is None else [f"{FILE_NAME}: views.{name}.camera: {fault}"]


def _bands(config: SessionConfig) -> list[str]:
    """Photos taken band by band must name the same bands."""
    problems = []
    wanted = list(by_band(config.photos.object))
    others = {"photos.chart": by_band(config.photos.chart)}
    others |= {f"views.{name}.{key}": by_band(getattr(view, key)) for name,
               view in config.views.items()
               for key in ("photo", "chart")}
    if wanted == []:
        problems.append(f"{FILE_NAME}: photos.object names no file")
    for place, photo in others.items():
        if photo and list(photo) != wanted:
            said = " and ".join(", ".join(repr(name) for name in names) if any(names)
                                else "a single photo"
                                for names in (list(photo), wanted))
            problems.append(f"{FILE_NAME}: {place} and photos.object must have the same bands in "
                            f"the same order; they have {said}")
    if unknown := [name for name in config.photos.flats if name not in (ONE_PHOTO, *wanted)]:
        problems.append(f"{FILE_NAME}: photos.flat has {', '.join(map(repr, unknown))}, which "
                        "photos.object lacks")
    return problems
