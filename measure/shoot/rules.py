"""Faults of a shoot between keys that are each well written, a sentence each."""
from __future__ import annotations

from collections.abc import Iterator

from spectrabox.measure.captured import FIRST_PHOTO, ONE_PHOTO
from spectrabox.measure.shoot.inputs import Inputs, chart_of
from spectrabox.measure.shoot.shoot import RegionSection, Shoot, ViewSection, by_band, encloses
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.published.published_tables import LIGHTS, published_names
from spectrabox.radiometry.records.photos import MIN_PATCHES
from spectrabox.radiometry.system import words
from spectrabox.sampling.prior.families.family_names import unknown_families


def faults_of(shoot: Shoot, inputs: Inputs) -> list[str]:
    """A sentence for every pair of keys that do not go together."""
    kind = _flat_and_scene(shoot) or [*(_flat(shoot) if shoot.flat else _scene(shoot))]
    return [*kind, *_sampling(shoot), *_families(shoot), *_chart_corners(shoot), *_names(shoot),
            *_views(shoot), *_lens(shoot), *_bands(shoot), *_unknown_lights(shoot),
            *_patches(shoot, inputs), *_picture(shoot)]


def _flat_and_scene(shoot: Shoot) -> list[str]:
    """A session measures the materials of a scene, or the regions of a flat sample."""
    of_scene = [name for name, is_written in (("[scene]", shoot.scene is not None),
                                              ("[materials]", bool(shoot.materials)))
                if is_written]
    if not (shoot.regions and of_scene):
        return []
    return [f"[regions] and {' and '.join(of_scene)} stand together; a session "
            "measures the materials of a scene or the regions of a flat sample: leave one out"]


def _flat(shoot: Shoot) -> Iterator[str]:
    """Faults of regions of flat samples."""
    yield from _keys_of_a_scene(shoot)
    if shoot.sampling.through == "transport":
        yield ("sampling.through = \"transport\" follows light through a scene; "
               "regions of a flat sample take \"surface\"")
    if shoot.sensitivity.method != "prior":
        yield (f"sensitivity.method = {shoot.sensitivity.method!r} knows nothing "
               "of the light over the chart, which carries it to the regions; use \"prior\"")
    photos = (FIRST_PHOTO, *shoot.views)
    for name, region in shoot.regions.items():
        yield from _region(f"regions.{name}", region, photos)
    if shoot.picture is not None and shoot.regions \
            and not shoot.regions_in(shoot.all_views[0]):
        yield ("[picture] shows the photo of [photos], in which no region lies; "
               "outline one there")


def _keys_of_a_scene(shoot: Shoot) -> Iterator[str]:
    """What is stated of a scene that is not there."""
    repeatability = shoot.repeatability.model_fields_set
    written = {
        "chart.scene": shoot.chart.scene is not None,
        "camera.lens": shoot.camera.lens is not None,
        "light.by_id": bool(shoot.light.by_id),
        "[reconstruct]": "reconstruct" in shoot.model_fields_set,
        "[scale]": "scale" in shoot.model_fields_set,
        "repeatability.lamp_position": "lamp_position" in repeatability,
        "repeatability.scene_level": "scene_level" in repeatability,
        "stray_light.ambient": "ambient" in shoot.stray_light.model_fields_set}
    for key, is_written in written.items():
        if is_written:
            yield (f"{key} belongs to a scene, and regions of a flat sample need "
                   "none; leave it out")
    for name, view in shoot.views.items():
        if view.scene is not None:
            yield f"views.{name}.scene belongs to a scene; leave it out"


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


def _scene(shoot: Shoot) -> Iterator[str]:
    """Faults of the materials of a scene."""
    if shoot.scene is None or not shoot.materials:
        lacking = "the table [scene]" if shoot.scene is None else "the table [materials.NAME]"
        yield (f"{lacking} is missing; a scene needs [scene] and "
               "[materials.NAME], a flat sample [regions.NAME] in their place")
        return
    if "plane" in shoot.repeatability.model_fields_set:
        yield ("repeatability.plane belongs to regions of a flat sample; that of "
               "a scene is repeatability.scene_level")
    if shoot.photos.orientation != 1:
        yield ("photos.orientation belongs to a flat sample; a scene's lens and "
               "camera are those of the photo as the sensor read it")
    yield from _chart(shoot)
    yield from _materials(shoot)
    if shoot.picture is not None:
        yield from _scene_picture(shoot)


def _chart(shoot: Shoot) -> Iterator[str]:
    """Faults of the chart and of where it stood."""
    if shoot.needs_chart and shoot.photos.chart is None:
        yield ("photos.chart is missing, but sensitivities or scale are to come from "
               "it; add the photo, or give [sensitivity] from = \"curves.csv\" and [scale] from = "
               "\"material\"")
    if shoot.scale.source == "chart" and not shoot.chart_pose_known:
        missing = "chart.scene" if shoot.box is None else "the table [scene.box.chart]"
        yield (f"{missing} is missing: a scale from the chart photo needs light and "
               "chart in their places; add it, or use [scale] from = \"material\"")
    if shoot.chart.scene is not None and shoot.box is not None and shoot.box.chart is not None:
        yield ("chart.scene and [scene.box.chart] both say where the chart stood; "
               "leave one out")
    if not shoot.chart_pose_known:
        for name, view in shoot.views.items():
            if view.chart is not None:
                yield (f"views.{name}.chart needs chart.scene: a scale from a chart "
                       "photo needs light and chart in their places")


def _materials(shoot: Shoot) -> Iterator[str]:
    """Faults of the materials together."""
    materials = shoot.materials.values()
    if shoot.scale.source == "material" and not any(material.known for material in materials):
        yield ("scale.from is \"material\", but no material has a known spectrum; "
               "add known = \"spectra/NAME.csv\" to one")
    if materials and all(material.known for material in materials):
        yield ("every material is known, so there is nothing to find; leave out one "
               "'known'")
    owners: dict[str, str] = {}
    for name, bsdf in shoot.bsdfs.items():
        if bsdf in owners:
            yield (f"materials {owners[bsdf]!r} and {name!r} name the same BSDF "
                   f"{bsdf!r}")
        owners[bsdf] = name


def _scene_picture(shoot: Shoot) -> Iterator[str]:
    """What a picture of a scene cannot take into account."""
    chosen = shoot.reconstruct
    if chosen.engine == "gradient":
        yield ("[picture] of a scene needs its light traced; set reconstruct.engine "
               f"= \"transport\" in place of {chosen.engine!r}, or leave [picture] out")
    for name, error in (("light_error", chosen.light_error), ("mixing_error", chosen.mixing_error)):
        if error > 0:
            yield ("[picture] of a scene takes lights and bands as they are stated, "
                   f"and reconstruct.{name} lets the fit correct them; leave out one of the two")


def _sampling(shoot: Shoot) -> Iterator[str]:
    """What draws through the traced light are made of."""
    if shoot.sampling.through == "transport" and shoot.sampling.method != "prior":
        yield ("sampling.through = \"transport\" draws from the learnt prior alone; "
               f"set sampling.method = \"prior\" in place of {shoot.sampling.method!r}")


def _families(shoot: Shoot) -> Iterator[str]:
    """Families that nobody measured."""
    stated = {f"regions.{name}": region for name, region in shoot.regions.items()} \
        | {f"materials.{name}": material for name, material in shoot.materials.items()} \
        | ({} if shoot.picture is None else {"picture": shoot.picture})
    for place, surface in stated.items():
        wrong = unknown_families(surface.families)
        if wrong is not None:
            yield f"{place}.family: {wrong}"


def _chart_corners(shoot: Shoot) -> Iterator[str]:
    """Corners of the chart are four."""
    corners = shoot.chart.corners_px
    if corners is not None and [len(corner) for corner in corners] != [2] * 4:
        yield ("chart.corners_px needs four [x, y] pairs: of a ColorChecker Classic "
               "the outer corners at dark skin, bluish green, black and white")


def _names(shoot: Shoot) -> Iterator[str]:
    """Names of the session and of what it has, by one rule; files are named after them."""
    named: dict[str, list[str]] = {
        "session.name = ": [shoot.session.name], "materials.": [*shoot.materials],
        "regions.": [*shoot.regions],
        "views.": [*shoot.views],
        "photos.object.": [band for band in by_band(shoot.photos.object) if band != ONE_PHOTO]}
    for place, names in named.items():
        for name in names:
            fault = words.name_fault(name)
            if fault is not None:
                yield f"{place}{words.shortened(name)}: {fault}"
        for first, other in words.sharing_a_file(names):
            yield (f"{place}{words.shortened(first)} and {words.shortened(other)}: files would be "
                   "named alike after both; rename one")


def _views(shoot: Shoot) -> Iterator[str]:
    """Faults of further photos."""
    if FIRST_PHOTO in shoot.views:
        yield (f"views.{FIRST_PHOTO}: {FIRST_PHOTO!r} is what the photo of [photos] "
               "is called; rename the view")
    for name, view in shoot.views.items():
        yield from _turntable(shoot, name, view)
        yield from _same_light(shoot, name, view)
        yield from _camera(shoot, name, view)
        if view.lamp_at_mm is not None and (shoot.box is None or view.scene is not None):
            yield (f"views.{name}.lamp_at_mm moves the lamp of [scene.box], and this "
                   "view's scene is a file, which has its own; leave it out")
    engine = shoot.reconstruct.engine
    if shoot.views and engine not in ("auto", "transport"):
        yield ("several views are fitted by reconstruct.engine = \"transport\" "
               f"alone; {engine!r} takes one photo")


def _turntable(shoot: Shoot, name: str, view: ViewSection) -> Iterator[str]:
    """A view that is turned, of a scene that does not turn."""
    turns = shoot.box is not None and shoot.box.turntable_mm is not None and view.scene is None
    if view.turn_deg is not None and not turns:
        yield (f"views.{name}.turn_deg turns the turntable of [scene.box], which this "
               "view has none of; give turntable_mm there, or leave it out")


def _same_light(shoot: Shoot, name: str, view: ViewSection) -> Iterator[str]:
    """Faults of what a view says of the lamp that it has in common with another."""
    place, other = f"views.{name}.same_light_as", view.same_light_as
    if view.lamp is not None and view.light is not None:
        yield (f"views.{name}.lamp says that the lamp of another photo was moved and "
               f"views.{name}.light names one; leave one out")
    if view.lamp is not None and not shoot.regions:
        yield (f"views.{name}.lamp belongs to flat samples; where a lamp stands in a "
               f"scene the scene says: give views.{name}.scene")
    if other is None:
        return
    if view.light is not None:
        yield f"{place} says whose lamp it is and views.{name}.light names one; leave one out"
        return
    if other != FIRST_PHOTO and other not in shoot.views:
        yield (f"{place} names {other!r}; the session's photos are "
               f"{', '.join((FIRST_PHOTO, *shoot.views))}")
        return
    passed = [name]
    while other in shoot.views and other not in passed:
        passed.append(other)
        other = shoot.views[other].same_light_as
    if other in passed:
        yield (f"{place}: {' -> '.join((*passed, other))} goes round in a circle; let one of them "
               "name its light")


def _camera(shoot: Shoot, name: str, view: ViewSection) -> Iterator[str]:
    """Faults of a view's own camera."""
    if view.camera is None:
        return
    if shoot.box is None or view.scene is not None:
        yield (f"views.{name}.camera places a camera before [scene.box], and this "
               "view's scene is a file, which has its own; leave it out")
        return
    fault = shoot.box.turned(view.turn_deg or 0.0).corner_fault(view.camera)
    if fault is not None:
        yield f"views.{name}.camera: {fault}"


def _lens(shoot: Shoot) -> Iterator[str]:
    """Two lenses of one photo."""
    cameras = [view.camera for view in shoot.views.values()]
    if shoot.box is not None:
        cameras.append(shoot.box.camera)
    of_model = [camera for camera in cameras if camera is not None and camera.image is not None]
    if shoot.camera.lens is not None and of_model:
        yield ("camera.lens and a camera with image both say what the lens is: the "
               "COLMAP model has its own; leave camera.lens out")


def _bands(shoot: Shoot) -> Iterator[str]:
    """Photos taken band by band must name the same bands."""
    wanted = by_band(shoot.photos.object)
    if not wanted:
        yield "photos.object names no file"
    others = {"photos.chart": by_band(shoot.photos.chart)}
    for name, view in shoot.views.items():
        others |= {f"views.{name}.photo": by_band(view.photo),
                   f"views.{name}.chart": by_band(view.chart)}
    for place, photo in others.items():
        if photo and [*photo] != [*wanted]:
            yield (f"{place} and photos.object must have the same bands in the same "
                   f"order; they have {_named_bands(photo)} and {_named_bands(wanted)}")
    unknown = [name for name in shoot.photos.flats if name not in (ONE_PHOTO, *wanted)]
    if unknown:
        yield (f"photos.flat has {', '.join(map(repr, unknown))}, which photos.object "
               "lacks")


def _named_bands(photo: dict[str, tuple[str, ...]]) -> str:
    return ", ".join(map(repr, photo)) if any(photo) else "a single photo"


def _unknown_lights(shoot: Shoot) -> Iterator[str]:
    """What a light that nobody measured cannot do."""
    first, *others = shoot.all_views
    by_id = shoot.light.by_id or {}
    unknown = [name for name, light in by_id.items() if not light.stated]
    if unknown:
        yield (f"light.by_id.{unknown[0]} is not known: one chart under several lamps "
               "cannot tell their spectra apart; measure this lamp, or leave it out if it has the "
               "spectrum of the others")
    if all(view.spectrum_stated for view in shoot.all_views):
        return
    if by_id:
        yield ("a light is not known, but light.by_id says that the scene has lamps "
               "of several spectra: products of the camera with each are needed, and a chart tells "
               "those with one; measure the lamps, or leave out light.by_id if all have one "
               "spectrum")
    if not shoot.camera_from_chart or shoot.sensitivity.method != "prior":
        yield ("a light that is not known is found with the camera from the chart: "
               "leave out sensitivity.from and sensitivity.method, or measure the light")
    for view in others:
        if not view.same_light(first) and not view.chart:
            yield (f"views.{view.name} has another light than the first photo, and "
                   "not both are known: give it a chart photo of its own, measure both lights, or "
                   f"write same_light_as = \"{FIRST_PHOTO}\" if one lamp lit both")


def _patches(shoot: Shoot, inputs: Inputs) -> Iterator[str]:
    """Patches left out must be on the chart, and leave enough."""
    if not shoot.chart.leave_out:
        return
    try:
        chart = chart_of(shoot, inputs)
    except InputError:      # said where the chart is read
        return
    patches = len(chart.names)
    left = patches - len(set(shoot.chart.leave_out))
    wrong = [number for number in shoot.chart.leave_out if not 1 <= number <= patches]
    if wrong:
        yield (f"chart.leave_out names patch {wrong[0]}; the patches are numbered 1 "
               f"to {patches}, {chart.names[0]} first")
    elif left < MIN_PATCHES:
        yield f"chart.leave_out leaves {left} patches; {MIN_PATCHES} are needed"


def _picture(shoot: Shoot) -> Iterator[str]:
    """Faults of [picture] of either kind."""
    if shoot.picture is None:
        return
    rect, light = shoot.picture.rect, shoot.picture.light
    if rect is not None and not encloses(rect):
        yield (f"picture.rect is {list(rect)}; two opposite corners [x0, y0, x1, y1] that enclose "
               "something are needed")
    if light is not None and light not in published_names(LIGHTS):
        yield (
            f"picture.light is {words.shortened(light)}, which is no CIE name"
            f"{words.nearest_words(light, published_names(LIGHTS))}; take A, D50, FL11 or LED-B3, "
            "say"
        )
