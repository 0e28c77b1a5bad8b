"""What the public functions accept: paths, names, arrays and records, to records."""
from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, Union

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api.known_camera import KnownCamera
from spectrabox.measure.captured import Outline, rectangle
from spectrabox.measure.shoot.options import Sampling
from spectrabox.radiometry import chart, checked_tables, errors, findings, gloss, interreflection
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.grid import FINE_GRID, WavelengthGrid
from spectrabox.radiometry.records import spectra
from spectrabox.radiometry.records.calibration import Calibration, Filter
from spectrabox.radiometry.spectra import (
    cameras,
    filters,
    given_spectra,
    light_words,
    named_spectra,
    spectrum_files,
)
from spectrabox.sampling.prior import mixture

if TYPE_CHECKING:
    from spectrabox.api.camera import CameraEstimate


Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


LightLike = str | Path | spectra.Spectrum | spectra.UnknownLight | given_spectra.Curves
FilterLike = str | Path | Filter | given_spectra.Curves
CameraLike = Union[str, Path, KnownCamera, "CameraEstimate", Calibration, given_spectra.Curves]


def as_light(light: LightLike) -> spectra.Spectrum | spectra.UnknownLight:
    """A light from a file, a name, (nm, values), or a record.

    Parameters
    ----------
    light : str, Path, (nm, values), Spectrum or UnknownLight
        A spectral file, a CIE name such as "D65", "unknown", a temperature such as "3200K", or a
        kind of lamp: daylight, halogen, led, fluorescent. Here and below (nm, values) may be a
        SpectralDistribution of colour-science, and several curves its MultiSpectralDistributions.

    Raises
    ------
    InputError
        If there is neither such a file nor such a name.
    """
    if isinstance(light, spectra.Spectrum):
        named_spectra.checked_light(light.values, "the light")
    if isinstance(light, spectra.Spectrum | spectra.UnknownLight):
        return light
    if isinstance(light, str | Path):
        return named_spectra.stated_light(str(light), FINE_GRID)
    nm, values = given_spectra.as_samples(light, "light")
    power = named_spectra.checked_light(spectrum_files.on_grid(nm, values, FINE_GRID, "light"),
                                        "the light")
    return spectra.Spectrum(FINE_GRID, power, spectra.Quantity.RELATIVE, "given")


def as_filter(through: FilterLike) -> Filter:
    """A filter from a file of its transmittance, (nm, values), or a record; or "unknown".

    Raises
    ------
    InputError
        If the file cannot be read, or is no transmittance over 400-700 nm.
    """
    if isinstance(through, Filter):
        return through
    if isinstance(through, str | Path):
        return filters.unknown_filter() if str(
            through) == light_words.UNKNOWN else filters.read_filter(Path(through))
    nm, values = given_spectra.as_samples(through, "filter")
    return filters.filter_of("given", nm, values)


def as_spectrum(light: LightLike) -> spectra.Spectrum:
    """A light whose spectrum is stated.

    Raises
    ------
    InputError
        If it is not: "unknown", a temperature or a kind of lamp.
    """
    known = as_light(light)
    if isinstance(known, spectra.UnknownLight):
        raise errors.InputError(
            f"the light is stated as {known.words}, and its spectrum is needed here; "
            "give a file, (nm, values) or a CIE name such as 'D65'")
    return known


def as_curves(camera: CameraLike, grid: WavelengthGrid = FINE_GRID) -> np.ndarray:
    """Sensitivities (K, P) on a grid.

    Parameters
    ----------
    camera : str, Path, KnownCamera, CameraEstimate, Calibration or (nm, curves)
        A file of curves, a camera or observer by its name, one of `sb.camera`, a fitted camera, or
        wavelengths (Q,) with curves (K, Q).

    Raises
    ------
    InputError
        If there is neither such a file nor such a name, the curves do not cover the grid, or they
        are products with a light that nobody knows.
    """
    if isinstance(camera, str | Path):
        return named_spectra.sensitivities(str(camera), grid)
    if isinstance(camera, KnownCamera):
        return spectrum_files.on_grid(camera.nm, camera.curves, grid, camera.name)
    if isinstance(camera, tuple) or hasattr(camera, "wavelengths"):
        nm, curves = given_spectra.as_samples(camera, "camera")
        return named_spectra.checked_curves(
            spectrum_files.on_grid(nm, np.atleast_2d(curves), grid, "camera"), "the camera", grid)
    if not isinstance(camera, Calibration) and not hasattr(camera, "calibration"):
        raise errors.InputError(
            f"camera: {type(camera).__name__} is no camera; give a name, a file, a "
            "fitted camera, or wavelengths and curves (nm, curves)")
    require_sensitivities(camera)
    fit = camera.sensitivity
    return spectrum_files.on_grid(fit.grid.nm, fit.curves, grid, "camera")


def band_names(camera: CameraLike, count: int) -> tuple[str, ...]:
    """Names of a camera's bands; empty ones of curves that are given as arrays.

    Parameters
    ----------
    camera : as of `as_curves`
    count : int
        K, of its bands.
    """
    if isinstance(camera, str | Path):
        return named_spectra.named_curves(str(camera))[2]
    return tuple(getattr(camera, "bands", ("",) * count))


def curve_error(camera: CameraLike) -> tuple[float | None, tuple[findings.Finding, ...]]:
    """Standard error of a fitted camera's curves, of their highest peak, and what speaks against
    its fit.

    Parameters
    ----------
    camera : as of `as_curves`

    Returns
    -------
    error : float or None
        None where the curves have none.
    doubts : tuple of Finding
    """
    if isinstance(camera, KnownCamera):
        camera = camera.name
    if isinstance(camera, str | Path):
        return cameras.stated_curve_error(str(camera)), ()
    if isinstance(camera, tuple) or hasattr(camera, "wavelengths"):
        return None, ()
    calibration = camera if isinstance(camera, Calibration) else camera.calibration
    fit = calibration.sensitivity
    return None if fit.standard_error is None else cameras.relative_curve_error(
        fit.curves, fit.standard_error), findings.faults(calibration.findings)


def require_sensitivities(camera: Calibration | CameraEstimate) -> None:
    """Refuse a camera that was fitted under an unknown light, where a light is given.

    Parameters
    ----------
    camera : Calibration or CameraEstimate

    Raises
    ------
    InputError
        If its curves are products with that light.
    """
    calibration = camera if isinstance(camera, Calibration) else camera.calibration
    if calibration.products:
        spectrum_files.refuse_products(spectra.PRODUCTS, "the camera")


def relative_response(camera: CameraLike, light: LightLike) -> np.ndarray:
    """Response (K, 301) of a camera's bands to reflectances under a light; rows sum to 1."""
    matrix = interreflection.response_matrix(FINE_GRID, as_curves(camera),
                             spectrum_files.spectrum_on_grid(as_spectrum(light), FINE_GRID))
    return matrix / interreflection.white_signal(matrix)[:, None]


def as_prior(
    prior: str | Path | mixture.LogitMixture | None, families: Sequence[str] = ()
) -> mixture.LogitMixture:
    """The shipped prior, one of a file, or a record; of some families where they are stated."""
    if not isinstance(prior, str | Path | mixture.LogitMixture | None):
        raise errors.InputError(f"prior: {type(prior).__name__} is no prior; give a file")
    learnt = prior if isinstance(prior, mixture.LogitMixture) else mixture.load_prior(
        None if prior is None else Path(prior))
    return mixture.of_families(learnt, families)


def as_chart(layout: str | Path | chart.Chart | None) -> chart.Chart:
    """A chart by the name it is sold under, a layout file, or a record; the Classic by default."""
    if isinstance(layout, chart.Chart):
        return layout
    return chart.CLASSIC if layout is None else chart_layout(str(layout))


def as_corners(corners: ArrayLike | None) -> np.ndarray | None:
    """Four corners (4, 2) of a chart, or None.

    Raises
    ------
    InputError
        If they are not four points.
    """
    if corners is None:
        return None
    points = np.asarray(corners)
    if points.shape != (4, 2) or points.dtype.kind not in "iuf" or not np.isfinite(points).all():
        raise errors.InputError(
            f"corners= is four points [(x, y), ...] in pixels of the photo; {corners} "
            "was given")
    return points.astype(float)


def region_points(region: Sequence[float] | Sequence[Sequence[float]], name: str) -> np.ndarray:
    """Two opposite corners of a rectangle (4,), or the corners of a region (Q, 2) going round.

    Raises
    ------
    InputError
        If it is neither.
    """
    try:
        points = np.asarray(region, dtype=float)
    except (TypeError, ValueError):         # text, or points of several lengths
        points = np.empty(0)
    polygon = points.ndim == 2 and points.shape[1] == 2 and len(points) > 2
    if not (polygon or points.shape == (4,)) or not np.isfinite(points).all():
        raise errors.InputError(f"{name} is (x0, y0, x1, y1), or three corners [(x, y), ...] or "
                                f"more, in pixels of the photo; {region} was given")
    return points


def as_outline(region: Sequence[float] | Sequence[Sequence[float]]) -> Outline:
    """The corners (x, y) of a region, going round, as ``region_points`` takes it."""
    points = region_points(region, "a region")
    return rectangle(points.tolist()) if points.ndim == 1 else tuple(
        (float(x), float(y)) for x, y in points)


def sampling_of(**stated: Any) -> Sampling:
    """How spectra are drawn, as arguments state it.

    Raises
    ------
    InputError
        If a number is out of its range.
    """
    return checked_tables.checked(Sampling, stated, "arguments")


def surfaces_of(surface: str | Mapping[str, str] | None, names: Collection[str],
                kind: str) -> dict[str, str]:
    """What is stated of how much each surface mirrors.

    Parameters
    ----------
    surface : str or mapping or None
        Of all, or by name.
    names : collection of str
    kind : str
        What is named, for sentences: region or material.

    Raises
    ------
    InputError
        If there is no such name or statement.
    """
    stated = {} if surface is None else dict.fromkeys(names, surface) \
        if isinstance(surface, str) else dict(surface)
    for name, word in stated.items():
        if name not in names:
            raise errors.InputError(f"there is no {kind} {name!r}; there are {', '.join(names)}")
        if word not in gloss.SURFACE_WORDS:
            raise errors.InputError(f"a surface is {', '.join(gloss.SURFACE_WORDS)}, not {word!r}")
    return stated


def folder_for_pictures(folder: str | Path) -> Path:
    """A folder for the files of a picture of spectra, made where it is missing."""
    path = Path(folder)
    path.mkdir(parents=True, exist_ok=True)
    return path


def families_of(families: str | Sequence[str] | None) -> tuple[str, ...]:
    """One family or several, as a tuple."""
    if families is None:
        return ()
    stated = (families,) if isinstance(families, str) else families
    if not isinstance(stated, list | tuple) or not all(isinstance(one, str) for one in stated):
        raise errors.InputError(
            f"families: {families!r} are no names of families; give one, such as "
            "'paint', or a list of them")
    return tuple(stated)


# ---- numbers and arrays, and nothing of ours: checked, or refused --------------------------------


def as_numbers(given: ArrayLike, name: str) -> np.ndarray:
    """An array of numbers.

    Parameters
    ----------
    given : array
    name : str
        What it is, for the message.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        if np.iscomplexobj(given):
            raise TypeError
        return np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        shown = repr(given) if isinstance(given, str) else type(given).__name__
        raise errors.InputError(f"{name}: {shown} is no array of numbers") from None


def as_number(given: float, name: str) -> float:
    """A number.

    Parameters
    ----------
    given : float
    name : str
        What it is, for the message.

    Raises
    ------
    InputError
        If it is none.
    """
    number = as_numbers(given, name)
    if number.ndim:
        raise errors.InputError(f"{name}: {given!r} is no number")
    return float(number)


def as_code_values(given: ArrayLike, name: str) -> tuple[np.ndarray, bool]:
    """sRGB code values (..., 3), 0 to 1, and whether they are rounded to 8 bits.

    Parameters
    ----------
    given : (..., 3) array or str
        Unsigned 8-bit integers, or integers 0 to 255; numbers from 0 to 1; or "#rrggbb".
    name : str
        What it is, for the message.

    Raises
    ------
    InputError
        If it is none of these.
    """
    if isinstance(given, str) and re.fullmatch("#[0-9a-fA-F]{6}", given):
        return np.frombuffer(bytes.fromhex(given[1:]), np.uint8) / 255, True
    values = as_numbers(given, name)
    whole = np.asarray(given).dtype
    most = np.iinfo(np.uint16).max if whole == np.uint16 else 255 if whole.kind in "ui" else 1
    if values.shape[-1:] != (3,) or not values.size or not np.all((values >= 0)
                                                                  & (values <= most)):
        raise errors.InputError(
            f"{name}: sRGB code values of shape {values.shape} and type {whole} were given; give "
            "R, G, B as integers from 0 to 255, as numbers from 0 to 1, or '#rrggbb'")
    return values / most, most == 255


def as_wavelengths(nm: ArrayLike, name: str) -> np.ndarray:
    """Wavelengths (Q,) in nm.

    Parameters
    ----------
    nm : (Q,) array
    name : str
        Of the argument.

    Raises
    ------
    InputError
        If it is no list of two wavelengths or more.
    """
    wavelengths = as_numbers(nm, name)
    if wavelengths.ndim != 1 or wavelengths.size < 2 or not np.all(wavelengths > 0):
        raise errors.InputError(f"{name} of shape {wavelengths.shape} was given; give wavelengths "
                                "(Q,) in nm")
    return wavelengths


def require_mapping(given: object, argument: str, form: str) -> None:
    """Refuse what is no mapping, such as a list or a name by itself.

    Parameters
    ----------
    given : object
        None where it was left out.
    argument, form : str
        What it is called, and what it should be.

    Raises
    ------
    InputError
    """
    if given is not None and not isinstance(given, Mapping):
        raise errors.InputError(
            f"{argument}= is a mapping, {form}; {type(given).__name__} was given")
