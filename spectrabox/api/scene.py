"""Spectra of the materials of a scene, from one photo of it."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.api.camera import CameraEstimate
from spectrabox.api.estimate import SpectrumEstimate, surface_estimate
from spectrabox.api.estimates import SpectrumEstimates
from spectrabox.api.inputs import (
    CameraLike,
    KnownSpectrum,
    LightLike,
    as_curves,
    as_prior,
    as_reflectance,
    as_spectrum,
    families_of,
    one_blas_thread,
    surfaces_of,
)
from spectrabox.api.notebook import axes_for
from spectrabox.api.photo import Photo, open_photo
from spectrabox.api.progress import ProgressLike, progress_steps
from spectrabox.calibrate.chart_calibration import calibration_from_curves
from spectrabox.calibrate.trust import certain_glare
from spectrabox.measure.scene.reconstruction import SceneEstimate, SceneOptions
from spectrabox.measure.scene.reconstruction import reconstruct_scene as reconstruct
from spectrabox.measure.surface_spectra import DrawOptions
from spectrabox.radiometry.error_model import (
    REPEATABILITY,
    SCENE_LEVEL,
    SCENE_LEVEL_ERROR,
    with_common_error,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.light_scale import scale_for_photo
from spectrabox.radiometry.records import Calibration, JointReconstruction
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.settings import InversionSettings

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REPEATS = hypot(0.012, 0.009)       # light and shutter, from the chart photo to the photo
CURVES_ERROR = 0.02                 # of signals predicted from measured curves


class SceneSpectra(SpectrumEstimates):
    """Estimates of the materials of a scene, with the reconstruction that they come from.

    Attributes
    ----------
    estimate : SceneEstimate
        The fit and the spectra as records.
    calibration : Calibration
        Sensitivities and light.

    References
    ----------
    Xia et al. 2025, Secs. 3.2 and 4.2; docs/explanation/reconstruction.md says how the fit differs.

    Examples
    --------
    >>> camera = sb.fit_camera("mybox/photos/chart.dng", light="mybox/spectra/light.csv",
    ...                        chart_scene="mybox/scene/chart.xml")
    >>> scene = sb.reconstruct_scene("mybox/photos/box.dng", scene="mybox/scene/box.xml", width=48,
    ...     camera=camera, light="mybox/spectra/light.csv",
    ...     materials=["white", "green", "red", "cube"])
    >>> scene.outcome
    >>> scene.plot_agreement()
    """

    def __init__(self, estimates: Sequence[SpectrumEstimate], estimate: SceneEstimate,
                 calibration: Calibration) -> None:
        super().__init__(estimates)
        self.estimate = estimate
        self.calibration = calibration

    @property
    def reconstruction(self) -> JointReconstruction:
        """Photo and rendering, agreement of every surface, light scale, engine."""
        return self.estimate.joint

    @property
    def outcome(self) -> str:
        """How the fit ended, in a sentence."""
        return self.reconstruction.views[0].outcome.value

    def plot_agreement(self, axes: Axes | None = None) -> Axes:
        """The relative residual (photo - rendering) / photo, mean over the bands.

        Parameters
        ----------
        axes : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_for(axes)
        view = self.reconstruction.views[0]
        usable = view.used[..., None] & (view.measured > 0)
        residual = np.where(usable, 1 - view.rendered / np.where(usable, view.measured, 1.0),
                            np.nan)
        shown = axes.imshow(residual.mean(axis=2), cmap="RdBu_r", vmin=-0.1, vmax=0.1)
        axes.set(xticks=[], yticks=[], title="(photo - rendering) / photo")
        axes.figure.colorbar(shown, ax=axes, shrink=0.8)
        return axes


@one_blas_thread
def reconstruct_scene(photo: str | Path | Photo, *, scene: str | Path, camera: CameraLike,
                      light: LightLike,
                      materials: Sequence[str] | Mapping[str, KnownSpectrum | None],
                      families: Mapping[str, str | Sequence[str]] | None = None,
                      surface: str | Mapping[str, str] | None = None,
                      width: int = 96, draws: int = 4000, seed: int = 1, device: str = "auto",
                      progress: ProgressLike = None) -> SceneSpectra:
    """Spectra of the materials of a scene from one photo, by inverse rendering in Mitsuba 3.

    The light transport is traced once, then the spectra are fitted to it by algebra.

    Parameters
    ----------
    photo : path or Photo
        The whole view that the scene's film describes.
    scene : path
        Mitsuba XML: geometry, camera and light in their positions; reflectances are placeholders.
    camera : CameraEstimate, name, path, Calibration or (nm, curves)
        One from ``fit_camera(..., chart_scene=...)`` also tells the strength of the light.
    light : path, name, (nm, values) or Spectrum
    materials : sequence of str, or mapping
        Ids of the BSDFs; a mapping gives the reflectance of those that are known: a file, or
        (nm, values), None where it is to be estimated. A known one tells the strength of the light.
    families : mapping, optional
        What a surface is, by material: paint, textile, leaves, skin, white, earth or animal.
    surface : str or mapping, optional
        How much the surfaces mirror: "matt", "satin" or "glossy"; of all materials, or by material.
    width : int
        Of the rendered view that is compared with the photo, in pixels.
    draws, seed : int
        T spectra behind each band, and the seed of paths and draws.
    device : {"auto", "cpu", "cuda"}
        That traces the light.
    progress : bool or function, optional
        True shows a bar; a function is called with the share that is done, and what is being
        done. By default a bar is shown in notebooks.

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
    >>> camera = sb.fit_camera("mybox/photos/chart.dng", light="mybox/spectra/light.csv")
    >>> scene = sb.reconstruct_scene("mybox/photos/box.dng", scene="mybox/scene/box.xml",
    ...     camera=camera, light="mybox/spectra/light.csv",
    ...     materials=["white", "green", "red", "cube"], width=48)
    """
    opened = photo if isinstance(photo, Photo) else open_photo(photo, orientation=1)
    spectrum, scale, glare = as_spectrum(light), None, np.zeros(1)
    if isinstance(camera, CameraEstimate):
        calibration = replace(camera.calibration, light=spectrum)
        if calibration.light_scale is not None:
            scale = scale_for_photo(calibration.light_scale, camera.photo, opened.image)
            for cause, error in ((REPEATABILITY, REPEATS), (SCENE_LEVEL, SCENE_LEVEL_ERROR)):
                scale = with_common_error(scale, cause, error)
        glare = certain_glare(camera.fit.chart.prior_fit, camera.photo)
    elif isinstance(camera, Calibration):
        calibration, scale = replace(camera, light=spectrum), camera.light_scale
    else:
        calibration = calibration_from_curves(FINE_GRID, as_curves(camera), spectrum, CURVES_ERROR)
    known = dict.fromkeys(materials) if not isinstance(materials, Mapping) else {
        name: None if given is None else as_reflectance(given, name)
        for name, given in materials.items()}
    stated = {name: families_of(one) for name, one in (families or {}).items()}
    for name in stated:
        if name not in known:
            raise InputError(f"there is no material {name!r}; there are {', '.join(known)}")
    start_mitsuba(device)
    options = SceneOptions(width=width, inversion=InversionSettings(seed=seed),
                           drawing=DrawOptions(draws=draws, seed=seed))
    with progress_steps(progress, "scene") as step:
        result = reconstruct(opened.image, read_scene(Path(scene)), calibration, known, options,
                             families=stated, surfaces=surfaces_of(surface, known, "material"),
                             scale=scale, chart_glare=glare, progress=step)
    estimates = [surface_estimate(result.signals, name, result.spectra,
                                  as_prior(None, stated.get(name, ())), rendered=True)
                 for name in result.signals.names]
    return SceneSpectra(estimates, result, calibration)
