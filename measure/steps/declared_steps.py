"""The steps of a measurement in their order, and what of a capture each depends on.

Keys of kept records are made from this: it computes nothing. The functions that make the records
are in the modules beside it, and ``measurement.py`` says which is of which step.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from spectrabox.measure import captured
from spectrabox.reconstruct.scene.scene_file import SceneFile


def inputs_of_charts(capture: captured.Capture) -> dict[str, Any]:
    """What of a capture the charts depend on."""
    chart = capture.lit_chart
    return {"chart": [chart.layout, chart.reflectances, chart.stated, chart.corners_px],
            "photos": {view.name: view.chart for view in capture.views_with_chart},
            "lights": lights_of(capture), "development": development_of(capture),
            "channels": channels_from(capture)}


def development_of(capture: captured.Capture) -> list[Any]:
    """How every photo becomes linear signal."""
    return [capture.dark_frames, capture.flat_fields, capture.not_linear, capture.orientation]


def lights_of(capture: captured.Capture) -> dict[str, Any]:
    """What is stated of the light of each view."""
    return {view.name: [view.light, view.place, view.filter, view.filter_words]
            for view in capture.views}


def channels_from(capture: captured.Capture) -> list[captured.PhotoFiles | bool]:
    """What tells the channels of each band of a table of photos; nothing of a colour camera: the
    photo that shows them, and whether there are curves, one for each photo.
    """
    if captured.ONE_PHOTO in capture.views[0].photo:
        return []
    return [*(view.chart for view in capture.views_with_chart[:1]),
            capture.sensitivity.curves is not None]


def inputs_of_flat_photos(capture: captured.FlatCapture) -> dict[str, Any]:
    """What of a capture the signals of regions depend on."""
    return {"photos": {view.name: view.photo for view in capture.views},
            "regions": {name: [region.outline, region.photos]
                        for name, region in capture.regions.items()},
            "development": development_of(capture),
            "channels": channels_from(capture)}


def inputs_of_scene_photos(capture: captured.SceneCapture) -> dict[str, Any]:
    """What of a capture the photos of a scene depend on."""
    return {"photos": {view.name: [view.photo, view.lens] for view in capture.views},
            "scenes": {view.name: _film_of(view) for view in capture.views},
            "width": capture.inversion.width, "development": development_of(capture),
            "channels": channels_from(capture)}


def _film_of(view: captured.SceneView) -> list[Any]:
    """What of its scene a photo depends on: the size of the film; of a measured box, whose film has
    the photo's own, the lens that a COLMAP model knows.
    """
    scene = view.scene
    if isinstance(scene, SceneFile):
        return [scene.width, scene.height]
    if scene.camera.image is None:
        return [scene.taken]
    lens, _ = scene.model[scene.camera.image]
    return [scene.taken, lens]


def inputs_of_calibration(capture: captured.Capture) -> dict[str, Any]:
    """What of a capture the calibration depends on."""
    chart = capture.chart
    return {"lights": lights_of(capture), "sensitivity": capture.sensitivity,
            "chart": chart and [chart.layout, chart.reflectances, chart.excluded],
            "chart scene": capture.chart_scene, "seed": capture.seed,
            "lamp position": capture.repeatability.lamp_position}


def inputs_of_signals(capture: captured.FlatCapture) -> dict[str, Any]:
    """What of a capture the signals depend on."""
    return {"known": capture.known, "known errors": capture.known_errors,
            "families": capture.families,
            "surfaces": {name: region.surface for name, region in capture.regions.items()},
            "repeatability": capture.repeatability, "stray light": capture.stray_light,
            "seed": capture.seed}


def inputs_of_inversion(capture: captured.SceneCapture) -> dict[str, Any]:
    """What of a capture the inversion depends on."""
    learnt = capture.inversion.spectrum_prior == "learnt"
    return {"materials": {name: [material.bsdf, material.known, material.surface,
                                 material.families if learnt else ()]
                          for name, material in capture.materials.items()},
            "scenes": {view.name: view.scene for view in capture.views},
            "lights": lights_of(capture),
            "lights by id": {view.name: view.lights_by_id for view in capture.views},
            "refinements": capture.refinements, "reconstruct": capture.inversion,
            "scale from chart": capture.scale_from_chart,
            "scales": {view.name: view.scale for view in capture.views},
            "repeatability": capture.repeatability, "stray light": capture.stray_light,
            "seed": capture.seed}


def inputs_of_spectra(capture: captured.Capture) -> dict[str, Any]:
    """What of a capture the draws depend on."""
    return {"sampling": capture.sampling, "families": capture.families, "seed": capture.seed}


def inputs_of_flat_picture(capture: captured.FlatCapture) -> dict[str, Any]:
    """What of a capture the picture depends on; it shows no regions but the known ones."""
    return {"picture": capture.picture, "seed": capture.seed,
            "photos": {view.name: view.photo for view in capture.picture_views},
            "known": {name: [region.outline, region.photos, region.known, region.known_error]
                      for name, region in capture.regions.items() if region.known is not None},
            "development": development_of(capture), "repeatability": capture.repeatability,
            "stray light": capture.stray_light}


def inputs_of_scene_picture(capture: captured.SceneCapture) -> dict[str, Any]:
    """What of a capture the picture depends on."""
    first = capture.views[0]
    return {"picture": capture.picture, "photo": [first.photo, first.lens], "scene": first.scene,
            "development": development_of(capture), "engine": capture.inversion.engine,
            "repeatability": capture.repeatability, "stray light": capture.stray_light,
            "seed": capture.seed}


@dataclass(frozen=True)
class Step:
    """A step by its name, and what its record is made from."""

    name: str                                   # of its record: in folders, JSON and --until
    inputs: Callable[[Any], dict[str, Any]]     # parts of the capture, by their names in sentences
    after: tuple[str, ...] = ()                 # steps whose records change it
    renders: bool = False                       # light is followed: by the compiler that is there


CHART = Step("chart", inputs_of_charts)
FLAT_PHOTOS = Step("photo", inputs_of_flat_photos, ("chart",))     # whose corners must agree
FLAT_CALIBRATION = Step("calibrate", inputs_of_calibration, ("chart",))
SIGNALS = Step("signals", inputs_of_signals, ("chart", "photo", "calibrate"))
FLAT_SPECTRA = Step("sample", inputs_of_spectra, ("signals",))
# not after "photo": a picture shows no regions, and is not made again for a new one
FLAT_PICTURE = Step("picture", inputs_of_flat_picture, ("chart", "calibrate"))
FLAT_STEPS = (CHART, FLAT_PHOTOS, FLAT_CALIBRATION, SIGNALS, FLAT_SPECTRA, FLAT_PICTURE)

SCENE_PHOTOS = Step("photo", inputs_of_scene_photos)
SCENE_CALIBRATION = Step("calibrate", inputs_of_calibration, ("chart",), renders=True)
INVERSION = Step("reconstruct", inputs_of_inversion, ("photo", "calibrate"), renders=True)
SCENE_SPECTRA = Step("sample", inputs_of_spectra, ("reconstruct",))
SCENE_PICTURE = Step("picture", inputs_of_scene_picture, ("calibrate", "reconstruct"),
                           renders=True)
SCENE_STEPS = (CHART, SCENE_PHOTOS, SCENE_CALIBRATION, INVERSION, SCENE_SPECTRA, SCENE_PICTURE)


def steps_of(capture: captured.Capture) -> tuple[Step, ...]:
    """The steps that a capture needs, in order."""
    steps = FLAT_STEPS if isinstance(capture, captured.FlatCapture) else SCENE_STEPS
    return needed_steps(steps, bool(capture.views_with_chart), capture.picture is not None)


def needed_steps(steps: tuple[Step, ...], with_chart: bool,
                 with_picture: bool) -> tuple[Step, ...]:
    """Those that are needed, in order.

    Parameters
    ----------
    steps : tuple of Step
        ``FLAT_STEPS`` or ``SCENE_STEPS``.
    with_chart : bool
        Whether a photo shows a chart.
    with_picture : bool
        Whether a picture of spectra is asked for.
    """
    unneeded = {name for name, needed in (("chart", with_chart), ("picture", with_picture))
                if not needed}
    return tuple(step for step in steps if step.name not in unneeded)
