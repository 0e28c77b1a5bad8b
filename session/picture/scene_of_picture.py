"""A photo of a scene with the light on it traced, as its picture of spectra is made from it."""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records import Calibration, JointReconstruction
from spectrabox.reconstruct.pixels.pixel_light import PixelLight
from spectrabox.reconstruct.scene.regions import region_means
from spectrabox.reconstruct.tracer.unit_scene import UnitScene
from spectrabox.reconstruct.view import View
from spectrabox.sampling.prior.mixture import GRID as PRIOR_GRID
from spectrabox.sampling.prior.mixture import LogitMixture
from spectrabox.session.picture.part_of_photo import Part
from spectrabox.session.stages.inputs import GRID
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import calibrations_of, joint_of


@dataclass(frozen=True, eq=False)
class SceneOfPicture:
    """A photo of a scene with its light traced, and all that its pixels' errors depend on."""

    task: StageTask
    view: View                  # with the photo in full
    unit: UnitScene
    traced: PixelLight
    part: Part
    edges: np.ndarray           # (H, W) bool: pixels of the photo too near to another surface
    prior: LogitMixture

    @property
    def joint(self) -> JointReconstruction:
        """The reconstruction whose spectra the light begins with."""
        return joint_of(self.task.stored)

    @property
    def calibration(self) -> Calibration:
        """Of the photo."""
        return calibrations_of(self.task.config, self.task.stored)[0]

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
        sensed = self.view.sensitivities * self.view.grid.weights_nm
        return np.asarray(sensed[:, :, None] * interpolation_matrix(PRIOR_GRID.nm, GRID.nm))

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
