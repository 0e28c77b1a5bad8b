"""Priors on reflectances, trained."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api.arguments import (
    CameraLike,
    LightLike,
    relative_response,
)
from spectrabox.api.array_arguments import as_numbers, as_wavelengths
from spectrabox.measure.signals.prior_training import train_prior as learn_prior
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.sampling.prior.libraries import (
    ReflectanceLibrary,
    left_out_words,
    read_library,
    usable,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture
from spectrabox.sampling.spectral_measurement import check_seed

OBSERVER = "CIE 1931 2 Degree Standard Observer"

LibraryLike = str | Path | ArrayLike


def train_prior(libraries: Mapping[str, LibraryLike | Sequence[LibraryLike]], *,
                nm: ArrayLike | None = None, camera: CameraLike = OBSERVER,
                light: LightLike = "D65", seed: int = 0) -> LogitMixture:
    """A prior on reflectances from your own measurements.

    Parameters
    ----------
    libraries : mapping
        From the name of a family (paint, textile, leaves, skin, white, earth, animal, or "mixed")
        to reflectances (n, P), a folder of them, or a list of these. Libraries are left out in
        turn to calibrate the bands; an array alone is parted into two at random, and its bands
        are then those of surfaces like its own.
    nm : (P,) array, optional
        Wavelengths of reflectances that are given as arrays.
    camera, light
        With which the bands are calibrated.
    seed : int
        Of the reflectances that models make, and of the fit.

    Returns
    -------
    LogitMixture
        For ``prior=`` of the other functions.

    Raises
    ------
    InputError
        For a family that there is not, a library that cannot be left out, too few curves, or an
        array whose rows are not at ``nm``.

    References
    ----------
    A Gaussian mixture in the logit of the reflectance, its bands calibrated on libraries left out
    in turn: docs/explanation/sampling.md. Not in Xia et al. 2025.

    Examples
    --------
    >>> import numpy as np
    >>> nm = np.arange(400, 701, 5)
    >>> centres = np.linspace(430, 670, 60)[:, None]
    >>> reflectances = 0.1 + 0.7 * np.exp(-0.5 * ((nm - centres) / 60) ** 2)
    >>> prior = sb.train_prior({"paint": reflectances}, nm=nm)
    >>> orange = sb.sample([0.53, 0.24, 0.08], camera="Nikon 5100 (NPL)", light="D65", noise=0.003,
    ...                    prior=prior)
    """
    check_seed(seed)
    if not isinstance(libraries, Mapping) or not libraries:
        raise InputError("no library is given; give reflectances or folders of them by family")
    read = {family: _libraries(value, family, nm, seed) for family, value in libraries.items()}
    return learn_prior(read, _coarse(camera, light), seed).prior


def _libraries(value: LibraryLike | Sequence[LibraryLike], family: str, nm: ArrayLike | None,
               seed: int) -> list[ReflectanceLibrary]:
    """The libraries of a family; an array alone in two halves, chosen at random."""
    if isinstance(value, list | tuple):
        return [_library(one, nm, f"{family} {number}") for number, one in enumerate(value, 1)]
    if isinstance(value, str | Path):
        return [read_library(Path(value))]
    rows = np.random.default_rng(seed).permutation(
        _rows(value, nm, family)[1])   # type: ignore[arg-type]
    return [_library(rows[half::2], nm, f"{family} {half + 1}") for half in (0, 1)]


def _library(library: LibraryLike, nm: ArrayLike | None, name: str) -> ReflectanceLibrary:
    if isinstance(library, str | Path):
        return read_library(Path(library))
    curves, reasons = usable(*_rows(library, nm, name))
    if not len(curves):
        raise InputError(f"{name} holds no usable reflectance ({left_out_words(reasons)}); values "
                         "between 0 and 1 from 400 to 700 nm are needed")
    return ReflectanceLibrary(name, curves, reasons)


def _rows(values: ArrayLike, nm: ArrayLike | None, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (Q,) and a row (n, Q) for each surface."""
    if nm is None:
        raise InputError("reflectances that are given as arrays need their wavelengths nm")
    wavelengths, rows = as_wavelengths(nm, "nm"), np.atleast_2d(as_numbers(values, name))
    if rows.ndim != 2 or rows.shape[1] != wavelengths.size:
        raise InputError(f"{name}: reflectances of shape {rows.shape} and wavelengths of shape "
                         f"{wavelengths.shape} were given; give a row of {wavelengths.size} values "
                         "for each surface")
    return wavelengths, rows


def _coarse(camera: CameraLike, light: LightLike) -> np.ndarray:
    """Relative response (K, 61) on the prior's wavelengths."""
    return relative_response(camera, light) @ interpolation_matrix(PRIOR_GRID.nm, FINE_GRID.nm)
