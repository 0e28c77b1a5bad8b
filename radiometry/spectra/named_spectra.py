"""Published sensitivities, lights and test reflectances, by the names operators write, and lights
as an operator states them.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import names_a_file
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.published import published_tables
from spectrabox.radiometry.records import spectra as spectral_records
from spectrabox.radiometry.spectra import cameras, light_words, spectrum_files
from spectrabox.radiometry.system.words import known_name, nearest_words

NEAR = "A (tungsten, 2856 K), D50 or D65 (daylight), FL11 (tubes), LED-B3"
CHARTS = ("BabelColor Average", "ISO 17321-1", "ColorChecker N Ohta", "PMC")


def sensitivities(name: str, grid: spectral_records.WavelengthGrid) -> np.ndarray:
    """Sensitivities (K, P) of a file of curves, or of a camera or observer by name.

    Parameters
    ----------
    name : str
        A file, or a name of ``published.published_tables`` or of ``kept_cameras``.
    grid : WavelengthGrid
        Working grid, of P wavelengths.

    Raises
    ------
    InputError
        If there is neither such a file nor such a name, the curves do not cover the grid, or they
        are products with a light.
    """
    known, nm, _, curves = named_curves(name)
    curves = spectrum_files.on_grid(nm, curves, grid, known)
    return checked_curves(curves, name, grid)


def checked_curves(curves: np.ndarray, name: str,
                   grid: spectral_records.WavelengthGrid) -> np.ndarray:
    """Sensitivities (K, P) on a grid, each of which sees something.

    Parameters
    ----------
    curves : (K, P) array
    name : str
        Of the camera, for the message.
    grid : WavelengthGrid

    Raises
    ------
    InputError
        If one does not, or is not a number.
    """
    if not np.all(np.isfinite(curves)) or np.any(curves.max(axis=1) <= 0):
        raise InputError(f"a band of {name} sees nothing of {grid.nm[0]:g}-{grid.nm[-1]:g} nm; "
                         "leave it out")
    return curves


def named_curves(name: str) -> tuple[str, np.ndarray, tuple[str, ...], np.ndarray]:
    """Curves of a file, or of a camera or observer by name, as they were measured.

    Parameters
    ----------
    name : str
        As of ``sensitivities``.

    Returns
    -------
    name : str
        As it is known.
    nm : (Q,) array
    bands : tuple of K str
    curves : (K, Q) array

    Raises
    ------
    InputError
        If there is neither such a file nor such a name, or they are products with a light.
    """
    kept = cameras.own_cameras()
    own = known_name(name, kept)
    if names_a_file(name) or own is not None:
        path = Path(name) if own is None else kept[own]
        return (path.name if own is None else own, *spectrum_files.read_curves(path))
    known, nm, curves = _by_name(name, (published_tables.CAMERAS, published_tables.OBSERVERS),
                                 "camera or observer", "a file of curves, one column per band",
                                 tuple(kept))
    bands = ("X", "Y",
             "Z") if known.startswith("CIE") else spectral_records.default_band_names(len(curves))
    return known, nm, bands, curves


def light(name: str, grid: spectral_records.WavelengthGrid) -> np.ndarray:
    """Spectrum (P,) of a light from a file, or of a CIE illuminant by name.

    Parameters
    ----------
    name : str
        A file, or a name such as D65, A or LED-B3; E is equal energy.
    grid : WavelengthGrid
        Working grid, of P wavelengths.

    Raises
    ------
    InputError
        If there is neither such a file nor such a name, or the spectrum is not that of a light.
    """
    if names_a_file(name):
        values = spectrum_files.spectrum_on_grid(
            spectrum_files.read_spectrum(Path(name), role=spectral_records.Quantity.RELATIVE), grid)
    else:
        values = spectrum_files.on_grid(*light_samples(name), grid, name)
    return checked_light(values, f"the light {name}")


def checked_light(values: np.ndarray, name: str) -> np.ndarray:
    """The spectrum (P,) of something that shines, without what noise took below zero.

    Parameters
    ----------
    values : (P,) array
    name : str
        Of the light, for the message.

    Raises
    ------
    InputError
        If it is dark, below zero or not a number.
    """
    if not np.all(np.isfinite(values)) or values.max() <= 0 or values.min() < -0.01 * values.max():
        raise InputError(f"{name} is dark or falls below zero; measure it again")
    return np.maximum(values, 0)


def light_samples(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (Q,) in nm and spectrum (Q,) of a light, as it was measured or published.

    Parameters
    ----------
    name : str
        As of ``light``.

    Raises
    ------
    InputError
        If there is neither such a file nor such a name.
    """
    if names_a_file(name):
        spectrum = spectrum_files.read_spectrum(Path(name), role=spectral_records.Quantity.RELATIVE)
        return spectrum.grid.nm, spectrum.values
    if name not in published_tables.published_names(
            published_tables.LIGHTS) and light_words.vague_words(name) is not None:
        raise InputError(f"{name!r} says of what kind a light is, and here its spectrum is needed: "
                         f"give a CSV file of it, or a CIE name that comes near it, such as {NEAR}")
    _, nm, curves = _by_name(name, (published_tables.LIGHTS, ), "light",
                             "a CSV file of its spectrum",
                             (*light_words.LIGHT_KINDS, *light_words.SAME_KIND))
    return nm, curves[0]


def test_reflectances(grid: spectral_records.WavelengthGrid) -> dict[str, np.ndarray]:
    """Sets of reflectances (n, P) by name: charts and published test colours.

    Those of CIE 13.3, CIE 224 and NIST CQS.

    Parameters
    ----------
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    import colour
    from colour.quality.cfi2017 import load_TCS_CIE2017
    from colour.quality.datasets import SDS_TCS, SDS_VS

    sets = {name: list(colour.SDS_COLOURCHECKERS[name].values()) for name in CHARTS}
    sets["CIE 13.3 test colours"] = [sd for part in SDS_TCS.values() for sd in part.values()]
    sets["NIST CQS test colours"] = [sd for part in SDS_VS.values() for sd in part.values()]
    resampled = {
        name:
        np.array([
            spectrum_files.on_grid(np.asarray(sd.wavelengths), np.asarray(sd.values), grid, name)
            for sd in spectra
        ])
        for name, spectra in sets.items()
    }
    samples = load_TCS_CIE2017(colour.SpectralShape(380, 780, 5))
    resampled["CES99"] = spectrum_files.on_grid(np.asarray(samples.wavelengths),
                                                np.asarray(samples.values).T, grid, "CES99")
    return resampled


def relative_response(sensitivity: str, light_name: str,
                      grid: spectral_records.WavelengthGrid | None = None) -> np.ndarray:
    """Response (K, P), rows summing to 1, of sensitivities under a light.

    Parameters
    ----------
    sensitivity, light_name : str
        As ``sensitivities`` and ``light`` take them.
    grid : WavelengthGrid or None
        None for 400-700 nm in steps of 1 nm.

    Raises
    ------
    InputError
        If a band sees nothing under the light, or a name is not known.
    """
    grid = grid or visible_grid(1)
    response = sensitivities(sensitivity, grid) * light(light_name, grid) * grid.weights_nm
    total = response.sum(axis=1, keepdims=True)
    if np.any(total <= 0):
        raise InputError(f"a band of {sensitivity} sees nothing under {light_name}; choose another "
                         "light")
    return response / total


def _by_name(name: str, kinds: tuple[str, ...], what: str, instead: str,
             own: tuple[str, ...] = ()) -> tuple[str, np.ndarray, np.ndarray]:
    """The name as it is known, wavelengths (P,) and curves (K, P)."""
    kind_of = {known: kind for kind in kinds for known in published_tables.published_names(kind)}
    meant = known_name(name, kind_of)
    if meant is None:
        raise InputError(f"{name!r} is no {what} that is known"
                         f"{nearest_words(name, [*own, *kind_of])}; give one of these or {instead}")
    return meant, *published_tables.published_curves(kind_of[meant], meant)


# ---- lights as an operator states them -----------------------------------------------------------
# What an operator says of a light: a file, a CIE name, a kind of lamp, 3200K, or "unknown".

def stated_light(word: str, grid: spectral_records.WavelengthGrid
                 ) -> spectral_records.Spectrum | spectral_records.UnknownLight:
    """The light that a word of the command line means.

    Parameters
    ----------
    word : str
        A spectral file, a CIE name, a temperature such as 3200K, a kind of lamp, or unknown.
    grid : WavelengthGrid
        Of the spectrum of a name.

    Raises
    ------
    InputError
        If there is neither such a file nor such a name.
    """
    vague = vague_light(word)
    if vague is not None:
        return vague
    if names_a_file(word):
        return spectrum_files.read_spectrum(Path(word), role=spectral_records.Quantity.RELATIVE)
    return spectrum_of_name(word, grid)


def spectrum_of_name(name: str, grid: spectral_records.WavelengthGrid) -> spectral_records.Spectrum:
    """The published spectrum of a CIE name.

    Parameters
    ----------
    name : str
    grid : WavelengthGrid

    Raises
    ------
    InputError
        If no published light has this name.
    """
    try:
        values = light(name, grid)
        published = published_tables.published_names(published_tables.LIGHTS)
        return spectral_records.Spectrum(grid, values, spectral_records.Quantity.RELATIVE,
                                         f"CIE {known_name(name, published) or name}")
    except InputError as error:
        raise InputError(f"{error}; a light may also be {light_words.UNKNOWN}, 3200K or one of "
                         f"{', '.join(light_words.LIGHT_KINDS)}") from None


def vague_light(word: str) -> spectral_records.UnknownLight | None:
    """What a word says of a light whose spectrum is not stated; None if the word states one.

    Parameters
    ----------
    word : str

    Raises
    ------
    InputError
        If it is a temperature that no lamp has.
    """
    stated = light_words.vague_words(word)
    return None if stated is None else spectral_records.UnknownLight(*stated)
