"""What measured cameras and known lamps say of their products, before any photo.

The product of sensitivity and light is one curve a band. The prior is a kernel mixture: every pair
of a camera and a lamp is a component, and all have one covariance about them, a share of that of
all pairs [methods of density estimation: Silverman 1986, Ch. 4]. Cameras are draws from the camera
prior, which holds no measured curve.

One vector of a component holds the product (mass at each node over the whole band, K N), the
logarithm of each band's white signal less their mean (K), and the lamp by itself (N, of mean 1):
what the photo says of the first two moves the third with them.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.products.lamps import Lamps
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.shaped import Record

CAMERAS = 400               # draws of the camera prior
COMPONENTS = 6600
LEAST_CURVE = 1e-4          # of the largest: below it a drawn curve is round-off of its floor


@dataclass(frozen=True, eq=False)
class ProductPrior(Record):
    """C components of X = K N + K + N entries, and the covariance of them all."""

    nm: Annotated[np.ndarray, "N"]                  # nodes
    bands: int
    components: Annotated[np.ndarray, "C X"]
    covariance: Annotated[np.ndarray, "X X"]
    weights: Annotated[np.ndarray, "C"]
    lamp: Annotated[np.ndarray, "C"]                # index into the lamps
    lamps: Lamps

    @property
    def products(self) -> slice:
        """Where a component's products lie."""
        return slice(0, self.bands * self.nm.size)

    @property
    def balance(self) -> slice:
        """Where its white balance lies."""
        return slice(self.bands * self.nm.size, self.bands * (self.nm.size + 1))

    @property
    def light(self) -> slice:
        """Where its lamp lies."""
        return slice(self.bands * (self.nm.size + 1), self.components.shape[1])


def product_prior(cameras: CameraPrior, lamps: Lamps, seed: int,
                  components: int = COMPONENTS) -> ProductPrior:
    """Prior on products of the cameras of a prior and some lamps.

    Parameters
    ----------
    cameras : CameraPrior
    lamps : Lamps
    seed : int
        Of the draws of cameras and of the pairs.
    components : int
        About how many pairs; every lamp has the same number of cameras.
    """
    rng = np.random.default_rng(seed)
    drawn = draw_cameras(cameras, CAMERAS, rng)
    each = max(components // len(lamps.names), 1)
    camera = np.concatenate([rng.permutation(len(drawn))[:each] for _ in lamps.names])
    lamp = np.repeat(np.arange(len(lamps.names)), min(each, len(drawn)))
    return paired(cameras.nm, drawn[camera], lamp, lamps)


def paired(nm: np.ndarray, curves: np.ndarray, lamp: np.ndarray, lamps: Lamps) -> ProductPrior:
    """Prior of given pairs of curves (C, K, N) at nodes and lamps, by index (C,).

    Parameters
    ----------
    nm : (N,) array
        Nodes.
    curves : (C, K, N) array
    lamp : (C,) int array
        Index into the lamps.
    lamps : Lamps
    """
    basis = interpolation_matrix(nm, FINE_GRID.nm)
    mass = FINE_GRID.weights_nm @ basis                  # of each node, nm
    at_nodes = (lamps.spectra * FINE_GRID.weights_nm) @ basis / mass
    product = curves * at_nodes[lamp][:, None] * mass
    white = product.sum(axis=2)
    balance = np.log(white) - np.log(white).mean(axis=1, keepdims=True)
    count = len(curves)
    components = np.hstack([(product / white[..., None]).reshape(count, -1), balance,
                            at_nodes[lamp]])
    weights = lamps.weights[lamp] / np.bincount(lamp, minlength=len(lamps.names))[lamp]
    weights = weights / weights.sum()
    away = components - weights @ components
    return ProductPrior(nm, curves.shape[1], components, (away * weights[:, None]).T @ away,
                        weights, lamp, lamps)


def draw_cameras(prior: CameraPrior, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Curves (T, K, N) of cameras as the prior expects them, as wide as it says that it may err.

    Parameters
    ----------
    prior : CameraPrior
    draws : int
    rng : numpy.random.Generator
    """
    roots = [np.linalg.cholesky(covariance) for covariance in prior.covariances()]
    component = rng.choice(len(prior.weights), draws, p=prior.weights)
    normal = rng.standard_normal((draws, prior.means.shape[1]))
    states = np.empty(normal.shape)
    for level, root in enumerate(roots):
        rows = np.flatnonzero(prior.level[component] == level)
        states[rows] = (prior.means[component[rows]]
                        + prior.widening[level] * normal[rows] @ root.T)
    curves = prior.curves(states)
    least = LEAST_CURVE * curves.max(axis=1, keepdims=True)
    return np.asarray(np.maximum(curves, least).reshape(draws, prior.bands, -1))
