"""What a photo determines of each material without any prior, and what is left to the prior."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.covariance import block_diagonal
from spectrabox.reconstruct.fit.transport_fit import TransportFit

# standard deviation, in coefficients, of the directions that the camera cannot see directly
HIDDEN_ERROR = 0.25
MIN_SINGULAR = 1e-6     # of the largest singular value: below, bands repeat each other
# information of the photo over that of the prior, above which a direction is the photo's
MIN_RATIO = 1.0


@dataclass(frozen=True)
class Identifiability:
    """Of one material: how many directions of its N coefficients the photo determines."""

    material: str
    by_photo: int            # directions of which the photo holds more information than the prior
    by_colour: int  # of these, as many as the camera has bands at most: read off the surface itself
    by_interreflection: int  # the others: only light from other surfaces determines them
    by_prior: int            # left to the prior
    # (N,) information of the photo / of the prior along each direction, the best determined first
    ratio: np.ndarray


def band_signals(fit: TransportFit, operator: np.ndarray,
                 names: int) -> tuple[np.ndarray, np.ndarray]:
    """Signals of the unknown materials that the photo, not the prior on spectra, gives.

    One more Gauss-Newton step from the solution with the prior on the spectra taken off: free in
    what the bands see of each material, and only loosely held (``HIDDEN_ERROR``) in what they do
    not; gains move along. The covariance is that of photo noise and Monte Carlo noise, and of gains
    of lights and band mixing; gains of surfaces and the light scale are taken as exact: later
    stages add their errors (``TransportFit.added_later``).

    Parameters
    ----------
    fit : TransportFit
    operator : (K, N) array
        Relative signal of the coefficients; bands of several photos may stand in it one below the
        other.
    names : int
        Number U of unknown materials.

    Returns
    -------
    signals : (U, K) array
        Relative to white.
    covariances : (U, K, K) array
    """
    count = operator.shape[1]
    left, singular, vt = np.linalg.svd(operator)
    seen_of_each = int(np.count_nonzero(singular > MIN_SINGULAR * singular[0]))
    size = names * count
    turn = np.eye(len(fit.information))
    turn[:size, :size] = np.kron(np.eye(names), vt.T)
    hidden = np.zeros(len(turn))
    hidden[:size] = np.tile(np.arange(count) >= seen_of_each, names) / HIDDEN_ERROR**2
    information = turn.T @ fit.information @ turn + np.diag(hidden)
    information += 1e-12 * np.trace(information) * np.eye(len(information))
    move = np.linalg.solve(information, turn.T @ fit.pull)
    within = ~fit.added_later
    covariance = np.linalg.inv(information[np.ix_(within, within)])
    to_signal = left[:, :seen_of_each] * singular[:seen_of_each]
    signals, covariances = [], []
    for index in range(names):
        seen = slice(index * count, index * count + seen_of_each)
        signals.append(operator @ fit.coefficients[index] + to_signal @ move[seen])
        covariances.append(to_signal @ covariance[seen, seen] @ to_signal.T)
    return np.array(signals), np.array(covariances)


def identifiability(fit: TransportFit, materials: tuple[str, ...],
                    operator: np.ndarray) -> tuple[Identifiability, ...]:
    """Which directions of which material the photo determines, all else being unknown as well.

    Other materials and all nuisances are marginalised.

    Parameters
    ----------
    fit : TransportFit
    materials : U names of the unknown materials
    operator : (K, N) array
        Relative signal of the coefficients.

    Returns
    -------
    U of Identifiability
    """
    count = operator.shape[1]
    size = count * len(materials)
    cross = fit.information[:size, size:]
    # nuisances marginalised; then, material by material, all others
    photo = fit.information[:size, :size] - cross @ np.linalg.pinv(
        fit.information[size:, size:], hermitian=True) @ cross.T
    posterior = np.linalg.inv(photo + block_diagonal(*fit.prior_precision))
    answers = []
    for index, name in enumerate(materials):
        own = slice(index * count, (index + 1) * count)
        prior = fit.prior_precision[index]
        root = np.linalg.cholesky(prior)
        information = np.linalg.inv(posterior[own, own]) - prior
        whitened = np.linalg.solve(root, np.linalg.solve(root, information).T)
        ratio = np.linalg.eigvalsh((whitened + whitened.T) / 2)[::-1]
        by_photo = int(np.count_nonzero(ratio > MIN_RATIO))
        colour = min(by_photo, np.linalg.matrix_rank(operator))
        answers.append(Identifiability(name, by_photo, int(colour), by_photo - int(colour),
                                       count - by_photo, np.maximum(ratio, 0.0)))
    return tuple(answers)


def sentences(materials: tuple[Identifiability, ...]) -> tuple[str, ...]:
    """One sentence per material: how much of its spectrum is measured and how much assumed.

    Parameters
    ----------
    materials : U of Identifiability
    """
    return tuple(
        f"{item.material}: of {item.ratio.size} coefficients the photo decides {item.by_photo} "
        f"({item.by_colour} by the surface's own colour, {item.by_interreflection} only by "
        f"interreflection); {item.by_prior} are left to the prior" for item in materials)
