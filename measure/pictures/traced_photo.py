"""A photo of a scene with the light on it traced, and all that its pixels' errors depend on."""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spectrabox.measure.pictures.crop import Crop
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.records.scenes import JointReconstruction
from spectrabox.reconstruct.pixel_light import PixelLight
from spectrabox.reconstruct.scene.surfaces import region_means
from spectrabox.reconstruct.tracer.unit_scene import UnitScene
from spectrabox.reconstruct.view import PhotoView
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture


@dataclass(frozen=True, eq=False)
class TracedPhoto:
    """A photo (H, W) of a scene with its light traced at N nodes."""

    view: PhotoView             # with the photo in full
    unit: UnitScene
    traced: PixelLight
    crop: Crop
    edges: np.ndarray           # (H, W) bool: pixels of the photo too near to another surface
    prior: LogitMixture
    joint: JointReconstruction  # whose spectra the light begins with
    calibration: Calibration
    veil: np.ndarray            # (K,) signal: standard error of one veil over the whole photo
    ambient: float              # standard error of stray light, of the brightest light
    surface: str | None         # what is stated of the surfaces, of gloss.KINDS
    disagreement: float         # stated relative error by which photo and light disagree
    seed: int

    @property
    def lamps(self) -> np.ndarray:
        """Spectra (L, P) of the lights that were traced apart."""
        view = self.view
        if self.traced.coefficients.shape[1] == 1:
            return view.light[None]
        return np.array([view.own_lights.get(name, view.light) for name, in view.light_groups])

    @property
    def to_signals(self) -> np.ndarray:
        """Signal (K, P, 61) of light at each wavelength from reflectances of the prior, for a light
        scale of 1.
        """
        view = self.view
        return np.asarray((view.sensitivities * view.grid.weights_nm)[:, :, None]
                          * interpolation_matrix(PRIOR_GRID.nm, view.grid.nm))

    @cached_property
    def node_signals(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean signal (N, K) of the pixels of each node, and the variance of its noise."""
        region, photo = self.traced.nodes.region, self.view.photo
        pixels = np.bincount(region[region >= 0])[:, None]
        return region_means(photo.signal, region), region_means(photo.variance, region) / pixels

    @cached_property
    def compared(self) -> np.ndarray:
        """Nodes (N,) bool without an edge, a lamp or a clipped pixel."""
        region = self.traced.nodes.region
        spoilt = (self.edges | self.view.photo.saturated.any(axis=2)) & (region >= 0)
        count = len(self.traced.own)
        return (np.bincount(region[spoilt], minlength=count) == 0) & ~self.traced.lamp
