"""What one view adds to the cost of a fit: equations, light scale, nuisances with their priors.

A view's signal is scale x surface gain x (transport @ mixed signals of the products). The
nuisances are logarithms of gains of surfaces and of lights, and the departure of a band-mixing
matrix from the identity, all Gaussian around zero.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.interreflection import band_products, band_products_jacobian


@dataclass(frozen=True)
class SpectrumModel:
    """What the coefficients stand for, and which are unknown."""

    exponents: np.ndarray               # (E, M)
    response: np.ndarray                # (L, K, P) sensitivity x light x integration weight
    basis: np.ndarray                   # (P, N)
    known: dict[int, np.ndarray]        # reflectance (P,) of the materials whose spectrum is given

    @property
    def unknown(self) -> tuple[int, ...]:
        """Indices of the materials whose spectrum is to be estimated."""
        return tuple(m for m in range(self.exponents.shape[1]) if m not in self.known)

    def reflectances(self, coefficients: np.ndarray) -> np.ndarray:
        """All spectra (M, P).

        Parameters
        ----------
        coefficients : (U, N) array
            Of the unknown materials.
        """
        spectra = np.empty((self.exponents.shape[1], len(self.basis)))
        for m, reflectance in self.known.items():
            spectra[m] = reflectance
        spectra[list(self.unknown)] = coefficients @ self.basis.T
        return spectra

    def signals(self, coefficients: np.ndarray) -> np.ndarray:
        """Signal (L E, K) of every product, light after light.

        Parameters
        ----------
        coefficients : (U, N) array
        """
        spectra = self.reflectances(coefficients)
        return np.vstack([band_products(self.exponents, spectra, response)
                          for response in self.response])

    def signals_and_jacobian(self, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signal (L E, K) of every product and its derivative (L E, K, U N).

        Parameters
        ----------
        coefficients : (U, N) array
        """
        spectra = self.reflectances(coefficients)
        parts = [band_products_jacobian(self.exponents, spectra, response, self.basis, self.unknown)
                 for response in self.response]
        jacobian = np.concatenate([part[1] for part in parts])
        return np.vstack([part[0] for part in parts]), jacobian.reshape(*jacobian.shape[:2], -1)


@dataclass(frozen=True)
class Nuisances:
    """What is taken as known of one view besides its pixels.

    Errors are standard deviations, 0 for exactly right.
    """

    scale: float | None = None          # light scale; None to estimate it
    scale_error: float = 0.0            # of its logarithm: it is estimated about ``scale``
    # log gain of a surface, independent in each band: colour of the light, uneven paint
    surface_error: float = 0.0
    # log gain of a surface, the same in all bands: light profile, pose, geometry
    brightness_error: float = 0.0
    light_error: float = 0.0            # log gain of each light group
    mixing_error: float = 0.0  # each entry of the band-mixing matrix: colour processing, cross-talk
    # relative, of each block of pixels besides its noise: light profile, shadows
    block_error: float = 0.0


@dataclass(frozen=True)
class ViewFit:
    """The solution for one view besides the spectra: light scale and nuisances."""

    scale: float
    scale_error: float | None           # standard error; None where the scale was given
    gains: dict[int, np.ndarray]        # surface -> (K,)
    light_gains: np.ndarray             # (L,)
    mixing: np.ndarray                  # (K, K)
    # (L E, K) of the products, light gains and mixing applied
    signals: np.ndarray = field(repr=False)

    def findings(self, bands: Sequence[str], lights: Sequence[str]) -> tuple[Finding, ...]:
        """What the fit corrected of lights and bands; the rendering shows it corrected.

        Parameters
        ----------
        bands : K names
        lights : L names
        """
        found = []
        if np.any(self.light_gains != 1):
            found.append(Finding("fit.lights-corrected", Severity.NOTE, values={
                "factors": dict(zip(lights, self.light_gains.tolist(), strict=True))}))
        if np.any(self.mixing != np.eye(len(bands))):
            found.append(Finding("fit.bands-mixed", Severity.NOTE, values={
                "bands": list(bands), "mixing": self.mixing.tolist()}))
        return tuple(found)


class ViewTerms:
    """Misfit of one view as a function of its own state.

    The state is (size,): coefficients, then nuisances, then the log scale if free, relative to the
    stated one where there is one.
    """

    def __init__(self, system: BandSystem, model: SpectrumModel, nuisances: Nuisances) -> None:
        self.system, self.model, self.nuisances = system, model, nuisances
        self.lights, self.bands = model.response.shape[:2]
        self.count = len(model.unknown) * model.basis.shape[1]
        varied = nuisances.surface_error > 0 or nuisances.brightness_error > 0
        self.surfaces = np.unique(system.group) if varied else np.array([], dtype=int)
        sizes = (self.surfaces.size * self.bands, self.lights * (nuisances.light_error > 0),
                 self.bands**2 * (nuisances.mixing_error > 0), int(self.scale_is_free))
        ends = self.count + np.cumsum(sizes)
        self.size = int(ends[-1])
        self.gain, self.light, self.mix, self.free_scale = (
            slice(int(end - size), int(end)) for end, size in zip(ends, sizes, strict=True))

    @property
    def scale_is_free(self) -> bool:
        """Whether the light scale is estimated."""
        return self.nuisances.scale is None or self.nuisances.scale_error > 0

    @property
    def prior(self) -> np.ndarray:
        """Prior precision (size - count,) squared of the nuisances; none on a scale that nothing
        is stated of.
        """
        given = self.nuisances
        matrix = np.zeros((self.size, self.size))
        if self.surfaces.size:
            covariance = (max(given.surface_error, 1e-6) ** 2 * np.eye(self.bands)
                          + given.brightness_error**2)
            precision = np.linalg.inv(covariance)
            matrix[self.gain, self.gain] = np.kron(np.eye(self.surfaces.size), precision)
        stated_scale = self.free_scale if given.scale is not None else slice(0)
        for part, error in ((self.light, given.light_error), (self.mix, given.mixing_error),
                            (stated_scale, given.scale_error)):
            indices = np.arange(self.size)[part]
            matrix[indices, indices] = 1 / max(error, 1e-9) ** 2
        return matrix[self.count:, self.count:]

    def start_scale(self, state: np.ndarray) -> float:
        """State of the light scale that suits the coefficients of the state best.

        Parameters
        ----------
        state : (size,) array
        """
        predicted = self.system.root * (self.system.rows @ self._signals(state))
        value = np.sum(predicted * self.system.root * self.system.target) / np.sum(predicted**2)
        return float(np.log(max(value, 1e-30) / (self.nuisances.scale or 1.0)))

    def misfit(self, state: np.ndarray) -> float:
        """Sum of squares of the weighted residuals, less that of the Monte Carlo noise.

        Parameters
        ----------
        state : (size,) array
        """
        system, signals = self.system, self._signals(state)
        data = system.root * (self._factor(state, system.group) * (system.rows @ signals)
                              - system.target)
        noise = (system.noise_root * self._factor(state, system.noise_group)
                 * (system.noise @ signals))
        return float(np.sum(data**2) - np.sum(noise**2))

    def expand(self, state: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Misfit and its expansion at a state.

        Parameters
        ----------
        state : (size,) array

        Returns
        -------
        misfit : float
        pull : (size,) array
            Minus half the gradient.
        curvature : (size, size) array
            Half the Gauss-Newton Hessian.
        """
        system = self.system
        coefficients = state[:self.count].reshape(len(self.model.unknown), -1)
        plain, slope = self.model.signals_and_jacobian(coefficients)
        data, by_data = self._linear(state, plain, slope, system.rows, system.root, system.group)
        data = data - (system.root * system.target).ravel()
        noise, by_noise = self._linear(state, plain, slope, system.noise, system.noise_root,
                                       system.noise_group)
        return (float(data @ data - noise @ noise), by_noise.T @ noise - by_data.T @ data,
                by_data.T @ by_data - by_noise.T @ by_noise)

    def solution(self, state: np.ndarray, covariance: np.ndarray) -> ViewFit:
        """Light scale and nuisances of a state.

        Parameters
        ----------
        state : (size,) array
        covariance : (size, size) array
            Of the state.
        """
        gains = np.exp(state[self.gain]).reshape(-1, self.bands)
        scale = float(np.exp(state[self.free_scale]).sum() if self.scale_is_free else 1.0) \
            * (self.nuisances.scale or 1.0)
        error = scale * float(np.sqrt(covariance[-1, -1])) if self.scale_is_free else None
        return ViewFit(scale, error, dict(zip(self.surfaces.tolist(), gains, strict=True)),
                       self._light_gains(state), self._mixing(state), self._signals(state))

    def _linear(self, state: np.ndarray, plain: np.ndarray, slope: np.ndarray, rows: np.ndarray,
                root: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted prediction (Q K,) of some rows and its derivative (Q K, size)."""
        factor = root * self._factor(state, group)
        mixing, products = self._mixing(state), len(plain) // self.lights
        if self.light.stop > self.light.start:
            light = np.repeat(self._light_gains(state), products)
            plain, slope = light[:, None] * plain, light[:, None, None] * slope
        predicted = factor * (rows @ (plain @ mixing.T))
        derivative = np.zeros((*predicted.shape, self.size))
        by_coefficient = np.empty((len(rows), self.bands, self.count))
        size = self.model.basis.shape[1]
        for number, material in enumerate(self.model.unknown):
            met = np.flatnonzero(np.tile(self.model.exponents[:, material] > 0, self.lights))
            own = slice(number * size, (number + 1) * size)
            by_coefficient[..., own] = (rows[:, met] @ slope[met, :, own].reshape(
                met.size, self.bands * size)).reshape(len(rows), self.bands, size)
        if self.mix.stop > self.mix.start:
            by_coefficient = np.einsum("kj,qjn->qkn", mixing, by_coefficient, optimize=True)
            unmixed = rows @ plain
            for band in range(self.bands):
                row = slice(self.mix.start + band * self.bands,
                            self.mix.start + (band + 1) * self.bands)
                derivative[:, band, row] = factor[:, band, None] * unmixed
        derivative[..., :self.count] = factor[..., None] * by_coefficient
        if self.surfaces.size:
            column = self.gain.start + np.searchsorted(self.surfaces, group)[:, None] * self.bands
            np.put_along_axis(derivative, (column + np.arange(self.bands))[..., None],
                              predicted[..., None], axis=2)
        for number in range(self.light.stop - self.light.start):
            of_light = slice(number * products, (number + 1) * products)
            alone = rows[:, of_light] @ (plain[of_light] @ mixing.T)
            derivative[..., self.light.start + number] = factor * alone
        derivative[..., self.free_scale] = predicted[..., None]
        return predicted.ravel(), derivative.reshape(-1, self.size)

    def _light_gains(self, state: np.ndarray) -> np.ndarray:
        fitted = self.light.stop > self.light.start
        return np.exp(state[self.light]) if fitted else np.ones(self.lights)

    def _mixing(self, state: np.ndarray) -> np.ndarray:
        departure = state[self.mix] if self.mix.stop > self.mix.start else np.zeros(self.bands**2)
        return np.eye(self.bands) + departure.reshape(self.bands, self.bands)

    def _signals(self, state: np.ndarray) -> np.ndarray:
        plain = self.model.signals(state[:self.count].reshape(len(self.model.unknown), -1))
        light = np.repeat(self._light_gains(state), len(plain) // self.lights)
        mixed: np.ndarray = (light[:, None] * plain) @ self._mixing(state).T
        return mixed

    def _factor(self, state: np.ndarray, group: np.ndarray) -> np.ndarray:
        """Scale x gain (Q, K), or a number."""
        scale = np.asarray(self.nuisances.scale or 1.0)
        if self.scale_is_free:
            scale = scale * np.exp(state[self.free_scale])
        if not self.surfaces.size:
            return scale
        gains = state[self.gain].reshape(-1, self.bands)
        return scale * np.exp(gains[np.searchsorted(self.surfaces, group)])


# ---- equations of a band -------------------------------------------------------------------------
# Noise-weighted equations of a photo in the products of reflectances, made small once by QR.
#
# The photo says rows @ G = target in every band, G (E, K) being the signals of the products. A thin
# QR factor of the weighted rows of each surface keeps all of it: a fit then costs the same for 4096
# pixels as for 400.
#
# The rows carry Monte Carlo noise, an error in the variables, which would pull every spectrum down
# by its relative variance. The scatter of independent passes gives the noise's share of their Gram
# matrix; ``noise`` carries it, and the fit takes its sum of squares off. The cost is then the
# unbiased product of residuals of different passes.

NEGLIGIBLE_NOISE = 0.01     # share of a surface's Monte Carlo noise that is not taken off
HUBER = 3.0     # standard deviations beyond which a pixel's pull on the fit grows no more


@dataclass(frozen=True)
class BandSystem:
    """Q equations for each of K bands, and the Monte Carlo noise that their rows carry.

    cost = sum (root (rows G - target))^2 - sum (noise_root noise G)^2
    """

    rows: np.ndarray         # (Q, E)
    target: np.ndarray       # (Q, K)
    root: np.ndarray         # (Q, K) square root of the weight
    group: np.ndarray        # (Q,) surface of each equation
    noise: np.ndarray        # (Z, E) Monte Carlo noise of the rows, compressed as they are
    noise_root: np.ndarray   # (Z, K)
    noise_group: np.ndarray  # (Z,)


def compress(coefficients: np.ndarray, measured: np.ndarray, weight: np.ndarray, group: np.ndarray,
             deviations: np.ndarray | None = None) -> BandSystem:
    """Equations of the pixels, as few as carry the same information.

    Bands may be weighted differently, but within one surface in a fixed proportion (its median), so
    that one factor serves all bands: noise is nearly proportional to the signal, whose colour is
    that of the surface.

    Parameters
    ----------
    coefficients : (R, E) transport of each pixel or region
    measured : (R, K) signal
    weight : (R, K) inverse variance; a row of zeros does not count
    group : (R,) surface index
    deviations : (A, R, E), optional
        Whose squares sum to the Monte Carlo variance of ``coefficients``.

    Raises
    ------
    ValueError
        If no pixel has any weight.
    """
    counts = np.flatnonzero((weight > 0).all(axis=1))
    if not counts.size:
        raise ValueError("no pixel has any weight")
    products = coefficients.shape[1]
    parts: list[tuple[np.ndarray, ...]] = []
    noises: list[tuple[np.ndarray, ...]] = []
    for name in np.unique(group[counts]):
        members = counts[group[counts] == name]
        band_weight = np.median(weight[members], axis=0)
        pixel_root = np.sqrt((weight[members] / band_weight).mean(axis=1))[:, None]
        rows = np.hstack([pixel_root * coefficients[members], pixel_root * measured[members]])
        if len(rows) > rows.shape[1]:
            rows = np.asarray(np.linalg.qr(rows, mode="r"))
        noise = np.zeros((0, products))
        if deviations is not None:
            noise = _compressed_noise((pixel_root * deviations[:, members]).reshape(-1, products))
        for pieces, equations in ((parts, rows), (noises, noise)):
            root = np.broadcast_to(np.sqrt(band_weight), (len(equations), band_weight.size))
            pieces.append((equations, root, np.full(len(equations), name)))
    (rows, root, names), (noise, noise_root, noise_names) = (
        [np.concatenate(columns) for columns in zip(*pieces, strict=True)]
        for pieces in (parts, noises))
    return BandSystem(rows[:, :products], rows[:, products:], root, names, noise, noise_root,
                      noise_names)


def _compressed_noise(noise: np.ndarray) -> np.ndarray:
    """Triangular factor of the noise, the products with most of it first, without the rows that
    hold next to nothing.
    """
    order = np.argsort(-np.sum(noise**2, axis=0))
    factor = np.asarray(np.linalg.qr(noise[:, order], mode="r"))
    left = np.cumsum(np.sum(factor**2, axis=1)[::-1])[::-1]     # from each row on
    kept = factor[left > NEGLIGIBLE_NOISE * left[0]]
    rows = np.empty_like(kept)
    rows[:, order] = kept
    return rows


def huber_weight(residual: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Factor (R, 1) in (0, 1] for the weights of pixels, below 1 beyond ``HUBER`` sigma.

    Parameters
    ----------
    residual : (R, K) array
        Whose worst band counts.
    sigma : (R, K) array
        Its standard deviation, above 0.
    """
    worst = np.abs(residual / sigma).max(axis=1, keepdims=True)
    return np.minimum(1.0, HUBER / np.maximum(worst, 1e-12))
