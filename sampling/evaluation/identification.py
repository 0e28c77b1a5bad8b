"""Which measured spectra could give a signal, which cannot be told apart, and whether none does.

A spectrum r of a library predicts the signal y ~ N(A r, V) with V = C + A D A': C is the signal's
own covariance, and D says how far another sample of the same material differs from the one that was
measured, D_ij = s_i s_j exp(-(nm_i - nm_j)^2 / (2 L^2)). Its evidence is that density at y, its
misfit the Mahalanobis distance of y. That it is none of them is the signal's evidence under the
learnt prior, which is the density that any other surface is expected to give.
"""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from spectrabox.radiometry import errors, files, shaped
from spectrabox.radiometry.records.spectra import Quantity, SpectralMeasurement, WavelengthGrid
from spectrabox.radiometry.spectra import named_spectra, spectrum_files
from spectrabox.radiometry.spectra.formats.measurement_table import distinct
from spectrabox.radiometry.system.words import nearest_words
from spectrabox.sampling.prior import libraries, mixture, mixture_posterior
from spectrabox.sampling.spectral_measurement import response_on

VARIATION = 0.01        # of white: standard deviation between samples of one material
ALIKE_NM = 50.0         # L: wavelengths nearer than this vary together
REJECTED = 0.01         # a spectrum is rejected that gives so large a misfit less often
BY_CHANCE = 0.05        # the usual ratio: the one that a true spectrum exceeds less often


@dataclass(frozen=True, eq=False)
class SpectralLibrary(shaped.Record):
    """Reflectances of n materials by name, on one grid.

    Attributes
    ----------
    names, libraries : tuples of n str
        Of the material, and of the library it is from.
    spectra, standard_error : (n, P) arrays
        The error is 0 where nobody stated it.
    left_out : tuple of str
        Sentences on spectra that could not be used.
    """

    names: tuple[str, ...]
    libraries: tuple[str, ...]
    spectra: Annotated[np.ndarray, "n P"]
    standard_error: Annotated[np.ndarray, "n P"]
    left_out: tuple[str, ...]


def evidence(measurement: SpectralMeasurement, library: SpectralLibrary,
             variation: float = VARIATION) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How well every spectrum of a library explains one signal.

    Parameters
    ----------
    measurement : SpectralMeasurement
        0.1 % of white is added to its noise, as samplers do.
    library : SpectralLibrary
        Of n spectra on the measurement's wavelengths.
    variation : float
        Standard deviation between samples of one material, of white.

    Returns
    -------
    log_evidence : (n,) array
        Nats.
    misfit : (n,) array
        Mahalanobis distances, in standard errors.
    p_value : (n,) array
        Of misfits at least as large, by chance.
    """
    from scipy.special import chdtrc

    bands = len(measurement.signal)
    noise = mixture_posterior.with_floor(measurement.noise_covariance)
    # one row does for all where nobody stated errors
    spectra, stated = library.spectra, library.standard_error
    if not stated.any():
        stated = np.zeros_like(spectra[:1])
    covariance = noise + _sample_covariance(measurement, np.sqrt(stated**2 + variation**2))
    covariance = np.broadcast_to(covariance, (len(spectra), bands, bands))
    residual = measurement.signal - spectra @ measurement.relative_response.T
    distance = np.einsum("nk,nk->n", residual,
                         np.linalg.solve(covariance, residual[..., None])[..., 0])
    log_evidence = -(distance + np.linalg.slogdet(covariance)[1] + bands * np.log(2 * np.pi)) / 2
    return log_evidence, np.sqrt(distance), chdtrc(bands, distance)


def usual_ratio(bands: int) -> float:
    """The ratio of evidence to the best that a true spectrum exceeds with a probability of 5 % at
    most: exp(q / 2) with the 95 % quantile q of chi-square.
    """
    from scipy.special import chdtri

    return float(np.exp(chdtri(bands, BY_CHANCE) / 2))


def evidence_of_none(measurement: SpectralMeasurement, log_evidence: np.ndarray,
                     prior: mixture.LogitMixture) -> tuple[float, float]:
    """Evidence that a surface is none of a library under the learnt prior, in nats, and its
    probability at even odds of both.

    Parameters
    ----------
    measurement : SpectralMeasurement
    log_evidence : (n,) array
        Of the library's spectra.
    prior : LogitMixture
        What else the surface may be.
    """
    none = float(
        mixture_posterior.posterior(prior, response_on(measurement, mixture.PRIOR_GRID),
                                    measurement.signal[None],
                                    measurement.noise_covariance).log_evidence[0])
    of_library = log_evidence.max() + np.log(np.mean(np.exp(log_evidence - log_evidence.max())))
    return none, float(0.5 * (1 + np.tanh(0.5 * (none - of_library))))


def _sample_covariance(measurement: SpectralMeasurement, deviation: np.ndarray) -> np.ndarray:
    """A D A' (n, K, K) for deviations s (n, P)."""
    nm = measurement.grid.nm
    alike = np.exp(-((nm[:, None] - nm) / ALIKE_NM)**2 / 2)
    weighted = measurement.relative_response * deviation[:, None, :]
    return (weighted.reshape(-1, nm.size) @ alike).reshape(weighted.shape) \
        @ weighted.transpose(0, 2, 1)


# ---- libraries -----------------------------------------------------------------------------------
# Libraries of measured reflectances with their names: files, folders of files, published sets.

ARCHIVES = (".mat", ".rda", ".zip")     # which state no names of their spectra
TEXTS = (".txt", ".hdr")
UNNAMED = ("", "value", "reflectance")  # names of a column that say nothing: the file's says more


Row = tuple[str, np.ndarray, np.ndarray]    # name, spectrum (P,), standard error (P,)


def read_spectral_libraries(words: Sequence[str], grid: WavelengthGrid) -> SpectralLibrary:
    """Every reflectance of some libraries.

    Parameters
    ----------
    words : sequence of str
        Files of any format of spectra, folders of them, or names of published sets.
    grid : WavelengthGrid
        That each must cover: nothing is extrapolated.

    Raises
    ------
    InputError
        If one holds no reflectance that covers the grid.
    """
    names: list[str] = []
    libraries: list[str] = []
    rows: list[Row] = []
    left_out: list[str] = []
    for word in words:
        refused: list[str] = []
        spectra = list(_rows(word, grid, refused))
        if not spectra:
            more = f"; {len(refused) - 1} more like it" if len(refused) > 1 else ""
            raise errors.InputError(refused[0] + more if refused else
                             f"{word} holds no spectra of a known format; give a file of "
                             "reflectances, a folder of them, or a published set")
        left_out += refused
        names += [name for name, _, _ in spectra]
        libraries += [Path(word).name or word] * len(spectra)
        rows += spectra
    return SpectralLibrary(tuple(names), tuple(libraries), np.array([row[1] for row in rows]),
                           np.array([row[2] for row in rows]), tuple(left_out))


def _rows(word: str, grid: WavelengthGrid, refused: list[str]) -> Iterator[Row]:
    path = Path(word)
    if path.is_dir():
        for file in sorted(path.iterdir()):
            suffix = file.suffix.lower()
            header = suffix == ".hdr" and any(file.with_suffix(other).exists()
                                              for other in (".sli", ".slb"))
            if file.is_file() and not header and suffix in (*spectrum_files.SUFFIXES, *ARCHIVES,
                                                            *TEXTS, ".json"):
                try:
                    yield from _of_file(file, grid, refused)
                except errors.InputError as error:
                    refused.append(str(error))
    elif files.names_a_file(word):
        yield from _of_file(path, grid, refused)
    else:
        yield from _published(word, grid)


def _of_file(path: Path, grid: WavelengthGrid, refused: list[str]) -> Iterator[Row]:
    if path.suffix.lower() in ARCHIVES:
        yield from _of_archive(path, grid, refused)
        return
    table = spectrum_files.read_table(path)
    columns = [index for index, name in enumerate(table.names)
               if not name.startswith("standard_error") and table.main in (None, name)]
    named = distinct(list(table.names))
    for index in columns:
        try:
            spectrum = spectrum_files.spectrum_of(table, role=Quantity.REFLECTANCE,
                                                  column=index + 2)
            values = spectrum_files.spectrum_on_grid(spectrum, grid)
        except errors.InputError as refusal:
            refused.append(str(refusal))
            continue
        error = np.zeros(grid.nm.size)
        if spectrum.standard_error is not None and np.all(np.isfinite(spectrum.standard_error)):
            error = spectrum_files.on_grid(spectrum.grid.nm, spectrum.standard_error, grid,
                                           spectrum.source)
        nameless = len(columns) == 1 and named[index].lower() in UNNAMED
        yield (path.stem if nameless else named[index]), values, error


def _of_archive(path: Path, grid: WavelengthGrid, refused: list[str]) -> Iterator[Row]:
    """Spectra of a file that states no names, by their numbers from 1."""
    number = 0
    for nm, curves in libraries.READERS[path.suffix.lower()](path):
        for curve in curves:
            number += 1
            kept, why = libraries.usable(nm, curve[None])
            if len(kept):
                yield (f"{path.stem} {number}", np.interp(grid.nm, mixture.PRIOR_GRID.nm, kept[0]),
                       np.zeros(grid.nm.size))
            else:
                reason = next(reason for reason, count in why.items() if count)
                refused.append(f"spectrum {number} of {path.name} cannot be used: {reason}")


def _published(word: str, grid: WavelengthGrid) -> Iterator[Row]:
    sets = named_spectra.test_reflectances(grid)
    if word not in sets:
        raise errors.InputError(f"{word!r} is no file and no published set of reflectances"
                         f"{nearest_words(word, sets)}; known are {', '.join(sets)}")
    for number, values in enumerate(sets[word], start=1):
        yield f"{word} {number}", values, np.zeros(grid.nm.size)
