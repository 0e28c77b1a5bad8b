"""Spectra of the materials of a scene, from one photo of it."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.api import arguments, estimates, shoot_arguments
from spectrabox.api.camera import CameraEstimate
from spectrabox.api.photo import Photo, open_photo
from spectrabox.api.progress import ProgressLike, progress_steps
from spectrabox.calibrate.chart_calibration import calibration_from_curves
from spectrabox.calibrate.trust import certain_glare
from spectrabox.capture.photo.preview import AS_READ
from spectrabox.measure import captured, plots, records, texts
from spectrabox.measure.pictures.texture_files import textures_of
from spectrabox.measure.results.scene_result import bsdf_reflectances, scene_result
from spectrabox.measure.scene.rehearsal import Rehearsed
from spectrabox.measure.shoot.options import Repeatability
from spectrabox.measure.steps import measurement
from spectrabox.radiometry import chart, error_model, files, grid, light_scale
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.calibration import Calibration, LightScale
from spectrabox.radiometry.records.scenes import JointReconstruction
from spectrabox.radiometry.records.spectra import Spectrum
from spectrabox.radiometry.spectra.given_spectra import KnownSpectrum
from spectrabox.radiometry.system.threads import one_blas_thread
from spectrabox.reconstruct.rendering.renderer import threads_given_back
from spectrabox.reconstruct.scene import scene_file, scene_xml

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class SceneSpectra(estimates.MeasuredSpectra):
    """Estimates of the materials of a scene, with the reconstruction that they come from.

    Attributes
    ----------
    records : CaptureRecords
        What each step made: photo, calibration, fit, spectra.

    References
    ----------
    Xia et al. 2025, Secs. 3.2 and 4.2; docs/explanation/reconstruction.md says how the fit differs.

    Examples
    --------
    >>> camera = sb.fit_camera("mybox/photos/chart.dng", light="mybox/spectra/light.csv",
    ...                        chart_scene="mybox/scene/chart.xml")
    >>> scene = sb.reconstruct_scene("mybox/photos/box.dng", scene="mybox/scene/box.xml", width=48,
    ...     camera=camera, light="mybox/spectra/light.csv",
    ...     materials={"white": None, "green": None, "red": None, "cube": None,
    ...                "card": "mybox/spectra/card.csv"})
    >>> scene.outcome
    >>> scene.plot_agreement()
    """

    def __init__(self, capture: captured.SceneCapture, records: records.CaptureRecords,
                 rehearsal: Rehearsed | None = None, picture_folder: str = "",
                 folder: Path = Path()) -> None:
        result = scene_result(capture, records, rehearsal, picture_folder)
        super().__init__(result, records.signals)
        self.records, self._folder = records, folder
        self._stated_scene, self._bsdfs = capture.views[0].scene, capture.bsdfs

    @property
    def reconstruction(self) -> JointReconstruction:
        """Photo and rendering, agreement of every surface, light scale, engine."""
        return self.records.reconstruct.joint

    @property
    def outcome(self) -> str:
        """How the fit ended, in a sentence."""
        return texts.sentence(self.reconstruction.views[0].outcome.finding())

    def to_mitsuba(self, path: str | Path) -> Path:
        """Write the scene of the first photo with the mean reflectances in its BSDFs, as XML that
        a stock Mitsuba 3 loads in a spectral variant.

        Parameters
        ----------
        path : path
            Of an XML file: a session's own scene is not to be overwritten.

        Returns
        -------
        Path
            Of the file. Coats, metals, camera, film and lights are those of the scene; meshes are
            named as they are seen from there, and so are the textures of a picture of spectra:
            Mitsuba renders them after ``register_spectral_texture``.

        Raises
        ------
        EnvironmentProblem
            If the file cannot be written; an older one is left as it was.
        InputError
            If it is the scene itself.
        """
        target, stated = Path(path), self._stated_scene
        if target.resolve() == stated.path.resolve():
            raise InputError(f"{target} is the scene that was measured; give another name")
        scene = stated if isinstance(stated, scene_file.SceneFile) else scene_file.scene_of_text(
            self.records.reconstruct.box_scenes[""], stated.path)
        files.write_text_whole(target, scene_xml.recovered_xml(
            scene, *bsdf_reflectances(self.found, self._bsdfs), target.parent,
            self._textures(scene)))
        return target

    def _textures(self, scene: scene_file.SceneFile) -> dict[str, Path]:
        """Files of the textures that a picture of spectra found, by surface."""
        picture = self.found.picture
        return {} if picture is None else textures_of(picture.files, scene.surfaces,
                                                      self._folder / self.found.picture_folder)

    def plot_agreement(self, ax: Axes | None = None) -> Axes:
        """The relative residual (photo - rendering) / photo, mean over the bands.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = plots.axes_for(ax)
        view = self.reconstruction.views[0]
        usable = view.used[..., None] & (view.measured > 0)
        residual = np.where(usable, 1 - view.rendered / np.where(usable, view.measured, 1.0),
                            np.nan)
        shown = axes.imshow(residual.mean(axis=2), cmap="RdBu_r", vmin=-0.1, vmax=0.1)
        axes.set(xticks=[], yticks=[], title="(photo - rendering) / photo")
        axes.figure.colorbar(shown, ax=axes, shrink=0.8)
        return axes


@threads_given_back()
@one_blas_thread()
def reconstruct_scene(photo: str | Path | Photo, *, scene: str | Path, light: arguments.LightLike,
                      materials: Sequence[str] | Mapping[str, KnownSpectrum | None],
                      camera: arguments.CameraLike | None = None, chart_photo: str | Path | Photo
                      | None = None, lights: Mapping[str, arguments.LightLike | float] | None
                      = None, chart_scene: str | Path | None = None,
                      layout: str | Path | chart.Chart | None = None, reference: str | None = None,
                      flat_field: str | Path | None = None,
                      families: Mapping[str, str | Sequence[str]] | None = None,
                      surface: str | Mapping[str, str] | None = None,
                      picture: str | Path | None = None,
                      width: int = shoot_arguments.INVERSION.width,
                      draws: int = shoot_arguments.SAMPLING.draws,
                      seed: int = shoot_arguments.SESSION.seed, device: str = "auto",
                      progress: ProgressLike = None) -> SceneSpectra:
    """Spectra of the materials of a scene from one photo, by inverse rendering in Mitsuba 3.

    The light transport is traced once, then the spectra are fitted to it by algebra.

    Parameters
    ----------
    photo : path or Photo
        The whole view that the scene's film describes.
    scene : path
        Mitsuba XML: geometry, camera and light in their positions; reflectances are placeholders.
    light : path, name, (nm, values) or Spectrum
        Of the scene's light; of several, of the strongest. The others are as strong and as coloured
        beside it as the scene states them.
    materials : sequence of str, or mapping
        Ids of the BSDFs; a mapping gives the reflectance of those that are known: a file, or
        (nm, values), None where it is to be estimated. A known one tells the strength of the light.
    camera : CameraEstimate, name, path, Calibration or (nm, curves), optional
        One from ``fit_camera(..., chart_scene=...)`` also tells the strength of the light. Without
        it the camera is fitted to ``chart_photo``, as in a session.
    chart_photo : path or Photo, optional
        The chart under the same light, by the same camera.
    lights : mapping, optional
        By id, lights that the scene states wrongly: their spectrum in the unit of ``light``, or how
        many times as strong as ``light`` they are.
    chart_scene : path, optional
        Mitsuba XML with the light and a rectangle of id "chart" in their positions: then the chart
        photo tells the strength of the light too.
    layout, reference
        Of the chart, as of `find_chart`.
    flat_field : path, optional
        An evenly lit white card: corrects the vignetting of both photos.
    families : mapping, optional
        What a surface is, by material: paint, textile, leaves, skin, white, earth or animal.
    surface : str or mapping, optional
        How much the surfaces mirror: "matt", "satin" or "glossy"; of all materials, or by material.
    picture : path, optional
        A folder that takes the spectrum of every pixel, with maps.
    width : int
        Of the rendered view that is compared with the photo, in pixels.
    draws, seed : int
        T spectra behind each band, and the seed of paths and draws.
    device : {"auto", "cpu", "cuda"}
        That traces the light.
    progress : bool or function, optional
        True shows a bar; a function is called with the share that is done, and what is being
        done. By default a bar is shown in notebooks and on terminals.

    Returns
    -------
    SceneSpectra
        Estimates by material. Where nothing tells the strength of the light, it is estimated from
        what the prior expects of surfaces, and its error widens every band.

    Raises
    ------
    InputError
        If scene and photo do not show the same view, or the materials are not those of the scene.
    EnvironmentProblem
        If there is no LLVM, or no GPU that was asked for.
    ConvergenceError
        If fit or draws do not reach their criterion.

    References
    ----------
    Xia et al. 2025, Secs. 3.2 and 4.2, which descend through the renderer:
    docs/explanation/reconstruction.md.

    Examples
    --------
    >>> camera = sb.fit_camera("mybox/photos/chart.dng", light="mybox/spectra/light.csv",
    ...                        chart_scene="mybox/scene/chart.xml")
    >>> scene = sb.reconstruct_scene("mybox/photos/box.dng", scene="mybox/scene/box.xml",
    ...     camera=camera, light="mybox/spectra/light.csv",
    ...     materials={"white": None, "green": None, "red": None, "cube": None,
    ...                "card": "mybox/spectra/card.csv"}, width=48)
    """
    spectrum = arguments.as_spectrum(light)
    known = dict(materials) if isinstance(materials, Mapping) else dict.fromkeys(materials)
    for name in families or {}:
        if name not in known:
            raise InputError(f"there is no material {name!r}; there are {', '.join(known)}")
    surfaces = arguments.surfaces_of(surface, known, "material")
    opened = photo if isinstance(photo, Photo) else open_photo(photo, orientation=AS_READ,
                                                               flat=flat_field)
    if (camera is None) == (chart_photo is None):
        raise InputError("the camera is needed: give camera= or the photo of a chart, chart_photo=")
    kept: dict[str, records.Record | records.KeptRecord] = {}
    scale = None
    if camera is not None:
        calibration, glare, scale = _calibration(camera, spectrum, opened, Repeatability())
        kept["calibrate"] = records.CalibrationRecords({"": calibration}, {}, None, {}, (), glare)
    stated = shoot_arguments.Arguments()
    capture = stated.capture({
        "session": {"name": "", "seed": seed},
        "photos": {"object": stated.photo(opened), "chart": stated.photo(chart_photo),
                   "flat": stated.photo(flat_field)},
        "light": {"spectrum": stated.light(light), "by_id": {
            name: stated.light((spectrum.grid.nm, own * spectrum.values)
                               if isinstance(own, int | float) else own)
            for name, own in (lights or {}).items()}},
        "chart": stated.chart(layout, reference) | {
            "scene": None if chart_scene is None else str(chart_scene)},
        "scene": {"file": str(scene)},
        "materials": {name: {"bsdf": name} | stated.surface(name, families, surfaces, known, {})
                      for name in known},
        "reconstruct": {"width": width}, "sampling": arguments.sampling_of(draws=draws),
        "picture": None if picture is None else {}})
    assert isinstance(capture, captured.SceneCapture)
    if scale is not None:
        capture = replace(capture, views=(replace(capture.views[0], scale=scale),))
    with progress_steps(progress, "scene") as show:
        keeper = measurement.MemoryKeeper(
            lambda step, share, message: show(share, message),
            kept,
            None if picture is None else arguments.folder_for_pictures(picture))
        return SceneSpectra(capture, measurement.measure(capture, keeper, device=device),
                            picture_folder="" if picture is None else Path(picture).as_posix())


def _calibration(camera: arguments.CameraLike, light: Spectrum, photo: Photo, errors: Repeatability
                 ) -> tuple[Calibration, np.ndarray, LightScale | None]:
    """The calibration that a camera brings along, the certain glare of its chart photo, and the
    strength of the light on the scene, as far as it is known.
    """
    if isinstance(camera, Calibration | CameraEstimate):
        arguments.require_sensitivities(camera)
    if isinstance(camera, Calibration):
        return replace(camera, light=light), np.zeros(1), camera.light_scale
    if not isinstance(camera, CameraEstimate):
        curves = arguments.as_curves(camera)
        return calibration_from_curves(grid.FINE_GRID, curves, light,
                                       captured.CURVES_ERROR), np.zeros(1), None
    calibration = replace(camera.calibration, light=light)
    if camera.photo is None:        # patches without an exposure
        return replace(calibration, light_scale=None), np.zeros(1), None
    scale = calibration.light_scale
    if scale is not None:
        scale = light_scale.scale_for_photo(scale, camera.photo, photo.image)
        for cause, error in ((error_model.REPEATABILITY, errors.relative_error),
                             (error_model.SCENE_LEVEL, errors.scene_level)):
            scale = error_model.with_common_error(scale, cause, error)
    return calibration, certain_glare(camera.chart.prior_fit, camera.photo), scale
