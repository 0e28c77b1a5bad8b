"""Priors on reflectances: training, certificates, and other methods' spectra judged."""
from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api.arguments import (
    CameraLike,
    LightLike,
    as_prior,
    families_of,
    relative_response,
)
from spectrabox.api.array_arguments import as_number, as_numbers, as_wavelengths
from spectrabox.measure.signals.options import JudgeOptions
from spectrabox.measure.signals.picture_judgement import (
    PictureJudgement,
    judge_picture,
)
from spectrabox.measure.signals.prior_training import train_prior as learn_prior
from spectrabox.measure.signals.spectral_pictures import open_picture
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.spectra.formats.measurement_table import SpectralTable
from spectrabox.radiometry.spectra.light_words import DELTA_LIGHTS
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.sampling.evaluation.certificate import Certificate
from spectrabox.sampling.evaluation.certificate import certify as certify_library
from spectrabox.sampling.evaluation.cube_regions import CubeRegion
from spectrabox.sampling.evaluation.cubes import Cube
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


def certify(prior: str | Path | LogitMixture | None, library: LibraryLike, *,
            nm: ArrayLike | None = None, camera: CameraLike = OBSERVER, light: LightLike = "D65",
            noise: float = 0.0, families: str | Sequence[str] | None = None,
            seed: int = 0) -> Certificate:
    """Do the bands of a prior hold the spectra of a library that it never saw?

    Parameters
    ----------
    prior : path, LogitMixture or None
        None for the shipped one.
    library : folder, or (n, P) array
        Ten reflectances or more.
    nm : (P,) array, optional
        Wavelengths of a library that is given as an array.
    camera, light
        That see them.
    noise : float
        Relative standard error of the signals.
    families : str or sequence of str, optional
        What the surfaces are.
    seed : int
        Of the noise and the draws.

    Returns
    -------
    Certificate
        ``verdict``, a sentence; ``coverage`` by level, ``rmse``, ``width``, ``delta_e00``.

    Raises
    ------
    InputError
        For fewer than ten usable curves, or an array whose rows are not at ``nm``.

    References
    ----------
    Interval score: Gneiting and Raftery 2007, Eq. 43. Measures and limits:
    docs/results/certificate.md.

    Examples
    --------
    >>> import numpy as np
    >>> nm = np.arange(400, 701, 5)
    >>> centres = np.linspace(430, 670, 60)[:, None]
    >>> reflectances = 0.1 + 0.7 * np.exp(-0.5 * ((nm - centres) / 60) ** 2)
    >>> certificate = sb.certify(None, reflectances, nm=nm, noise=0.01)
    >>> certificate.verdict, certificate.coverage[0.95]
    """
    return certify_library(as_prior(prior, families_of(families)), _library(library, nm, "library"),
                           _coarse(camera, light), as_number(noise, "noise"), seed, DELTA_LIGHTS)


def judge(cube: str | Path | ArrayLike, regions: Mapping[str, Sequence[int]],
          truth: str | Path | Mapping[str, ArrayLike], *, nm: ArrayLike | None = None,
          truth_nm: ArrayLike | None = None, camera: CameraLike = OBSERVER,
          light: LightLike = "D65", white_region: str | None = None,
          full_scale: float = 1.0) -> PictureJudgement:
    """Score another method's cube of spectra next to ours.

    Parameters
    ----------
    cube : path or (H, W, C) array
        Reflectances, of an ENVI, MATLAB, Zarr or spectral EXR file, or as an array.
    regions : mapping
        From names to (x0, y0, x1, y1) in pixels, the ends not counted.
    truth : path or mapping
        Measured reflectances: a table with a column for each region, or of one column for all; or
        arrays (Q,), one for each region by its name.
    nm : (C,) array, optional
        Wavelengths of the cube, where it is an array or its file does not state them.
    truth_nm : (Q,) array, optional
        Wavelengths of truths that are given as arrays.
    camera, light
        That our methods see the truth with.
    white_region : str, optional
        Region of known reflectance to divide by.
    full_scale : float
        What reflectance 1 reads in the cube.

    Returns
    -------
    PictureJudgement
        ``rows`` by region and method, ``means`` by method: RMSE, coverage, width, CIEDE2000.

    Raises
    ------
    InputError
        If cube and truth do not both cover 420 to 680 nm, a region leaves the cube, or has no
        truth.

    References
    ----------
    Interval score: Gneiting and Raftery 2007, Eq. 43; CIEDE2000: Sharma, Wu and Dalal 2005. The
    other methods are named in docs/how-to/judge.md.

    Examples
    --------
    >>> import numpy as np
    >>> nm = np.arange(400, 701, 10)
    >>> truth = 0.2 + 0.5 * (nm > 580)
    >>> cube = np.tile(truth + 0.01, (8, 8, 1))
    >>> judgement = sb.judge(cube, {"patch": (1, 1, 7, 7)}, {"patch": truth}, nm=nm, truth_nm=nm)
    >>> {row["method"]: row["rmse"] for row in judgement.rows}
    """
    if not isinstance(regions, Mapping):
        raise InputError("regions are given by name: regions={name: (x0, y0, x1, y1)}")
    if isinstance(cube, str | Path):
        opened = open_picture(Path(cube), None if nm is None else np.asarray(nm, float), None)
    else:
        values = as_numbers(cube, "cube")
        if nm is None or values.ndim != 3 or len(np.asarray(nm)) != values.shape[2]:
            raise InputError("a cube that is given as an array needs (height, width, C) values and "
                             "its C wavelengths nm")
        height, width = values.shape[:2]
        opened = Cube("cube", np.asarray(nm, dtype=float), height, width,
                      lambda first, last: values[first:last])
    if not regions:
        raise InputError("no region is given; give regions={name: (x0, y0, x1, y1)}")
    boxes = []
    for name, box in regions.items():
        corners = as_numbers(box, f"region {name!r}")
        if corners.shape != (4,) or not np.all(np.isfinite(corners)):
            raise InputError(f"region {name!r} is {box!r}; (x0, y0, x1, y1) in pixels is needed")
        x0, y0, x1, y1 = (int(value) for value in corners)
        if not (0 <= x0 < x1 <= opened.width and 0 <= y0 < y1 <= opened.height):
            raise InputError(f"region {name!r} is {tuple(box)}; x0 < x1 up to {opened.width} and "
                             f"y0 < y1 up to {opened.height} are needed")
        boxes.append(CubeRegion(name, None, (x0, y0, x1, y1), None))
    if isinstance(truth, Mapping):
        table = _truths(truth, truth_nm, regions)
    else:
        table = read_table(Path(truth))
    return judge_picture(opened, boxes, table, relative_response(camera, light), as_prior(None),
                         JudgeOptions(DELTA_LIGHTS, full_scale=full_scale,
                                      white_region=white_region))


def _truths(truth: Mapping[str, ArrayLike], nm: ArrayLike | None,
            regions: Collection[str]) -> SpectralTable:
    """Measured reflectances of all regions, as a table."""
    if nm is None:
        raise InputError("truths that are given as arrays need their wavelengths truth_nm")
    wavelengths = as_wavelengths(nm, "truth_nm")
    if missing := [name for name in regions if name not in truth]:
        raise InputError(f"no truth is given for {', '.join(map(repr, missing))}; there are "
                         f"{', '.join(map(repr, truth)) or 'none'}")
    if np.any(np.diff(wavelengths) <= 0):
        raise InputError("truth_nm does not rise; give wavelengths in their order")
    curves = {name: as_numbers(one, f"truth {name!r}") for name, one in truth.items()}
    for name, values in curves.items():
        if values.shape != wavelengths.shape:
            raise InputError(f"truth {name!r} of shape {values.shape} and wavelengths of shape "
                             f"{wavelengths.shape} were given; give one value for each wavelength")
    return SpectralTable(wavelengths, tuple(curves), np.array(list(curves.values())),
                         {"quantity": "reflectance"}, "truth")


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
