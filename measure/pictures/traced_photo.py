"""A photo of a scene with the light on it traced, and all that its pixels' errors depend on."""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spectrabox.measure.pictures.crop import Crop
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.records.scenes import JointReconstruction
from spectrabox.reconstruct.fit import transport_fit
from spectrabox.reconstruct.pixel_light import LightNodes, light_on_nodes
from spectrabox.reconstruct.scene.surfaces import region_means
from spectrabox.reconstruct.tracer.transport import TracedTransport
from spectrabox.reconstruct.tracer.unit_scene import UnitScene
from spectrabox.reconstruct.view import PhotoView
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture


@dataclass(frozen=True, eq=False)
class TracedPhoto:
    """A photo (H, W) of a scene with its light traced at N nodes."""

    view: PhotoView             # with the photo in full
    unit: UnitScene
    nodes: LightNodes
    traced: TracedTransport     # of the nodes
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
        if self.traced.passes.shape[2] == 1:
            return view.light[None]
        return np.array([view.own_lights.get(name, view.light) for name, in view.light_groups])

    @cached_property
    def own(self) -> np.ndarray:
        """Material (N,) of each node, index into those of the unit scene."""
        return np.array([self.unit.materials.index(name)
                         for name in self.view.surface_materials])[self.nodes.keys[0]]

    @cached_property
    def lamp(self) -> np.ndarray:
        """Nodes (N,) bool that show a lamp."""
        return transport_fit.shows_lamp(self.traced)

    @cached_property
    def relative_variance(self) -> np.ndarray:
        """Of the light on each node (N,) by the noise of tracing."""
        region = self.nodes.region
        return transport_fit.smoothed_variance(self.traced.relative_variance, self.nodes.keys[0],
                                               np.bincount(region[region >= 0]))

    def light(self, reflectances: np.ndarray) -> np.ndarray:
        """Light (N, P) on the nodes: radiance of a perfect white there.

        Parameters
        ----------
        reflectances : (M, P) array
        """
        return light_on_nodes(self.traced, self.own, reflectances, self.lamps)

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
        region, photo = self.nodes.region, self.view.photo
        pixels = np.bincount(region[region >= 0])[:, None]
        return region_means(photo.signal, region), region_means(photo.variance, region) / pixels

    @cached_property
    def compared(self) -> np.ndarray:
        """Nodes (N,) bool without an edge, a lamp or a clipped pixel."""
        region = self.nodes.region
        spoilt = (self.edges | self.view.photo.saturated.any(axis=2)) & (region >= 0)
        count = len(self.lamp)
        return (np.bincount(region[spoilt], minlength=count) == 0) & ~self.lamp
