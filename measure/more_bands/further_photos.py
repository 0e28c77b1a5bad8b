"""Photos that may still be taken: under other lamps, and through filters."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from spectrabox.measure.regions.flat_signals import DARK_BAND
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.calibration import Calibration, Filter
from spectrabox.radiometry.spectra.spectrum_files import on_grid, spectrum_on_grid

DARK = 1e-3             # of the brightest: no curve is divided by a light below it


@dataclass(frozen=True)
class LampsAtHand:
    """Lamps, and filters for the present light, by name."""

    lamps: Mapping[str, np.ndarray]     # (301,) spectra at 400, 401 ... 700 nm, any unit
    filters: Mapping[str, Filter]


@dataclass(frozen=True, eq=False)
class FurtherPhoto:
    """A photo that may be taken: what its bands see, and how bright they are."""

    name: str
    response: np.ndarray        # (K, 301) to reflectances; rows sum to 1
    white: np.ndarray           # (K,) signal of white, that of the brightest band being 1
    stops: float                # exposure to add for that; 0 under another lamp
    same_lamp: bool
    light: np.ndarray           # (301,) that the camera sees
    filter: Filter | None = None

    @property
    def dark(self) -> np.ndarray:
        """Numbers of the bands that tell nothing."""
        return np.flatnonzero(self.white < DARK_BAND)


def photos_at_hand(curves: np.ndarray, present: np.ndarray,
                   hand: LampsAtHand) -> list[FurtherPhoto]:
    """A further photo under each lamp and through each filter.

    Parameters
    ----------
    curves : (K, 301) array
        Sensitivities at 400, 401 ... 700 nm.
    present : (301,) array
        The light that filters are used under.
    hand : LampsAtHand

    Raises
    ------
    InputError
        If a band sees nothing at all.
    """
    photos = {name: _photo(name, curves, light) for name, light in hand.lamps.items()}
    now = _white(curves, present).max()
    for name, filter in hand.filters.items():
        light = present * filter.transmittance
        photo = _photo(name, curves, light)
        stops = float(np.log2(now / _white(curves, light).max()))
        photos[name] = replace(photo, stops=stops, same_lamp=True, filter=filter)
    return list(photos.values())


def _photo(name: str, curves: np.ndarray, light: np.ndarray) -> FurtherPhoto:
    """A photo under another lamp."""
    white = _white(curves, light)
    if np.any(white <= 0):
        raise InputError(f"a band of the camera sees nothing with {name}; leave it out")
    return FurtherPhoto(name, curves * light * FINE_GRID.weights_nm / white[:, None],
                        white / white.max(), 0.0, False, light)


def white_of_bands(curves: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Signal of white (K,), that of the brightest band being 1.

    Parameters
    ----------
    curves : (K, 301) array
    light : (301,) array
    """
    white = _white(curves, light)
    return white / white.max()


def _white(curves: np.ndarray, light: np.ndarray) -> np.ndarray:
    return np.asarray((curves * light) @ FINE_GRID.weights_nm)


def curves_and_light(calibration: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivities (K, 301) and the light (301,) of a calibration.

    Parameters
    ----------
    calibration : Calibration
    """
    fit = calibration.sensitivity
    curves = on_grid(fit.grid.nm, np.maximum(fit.curves, 0), FINE_GRID, "the camera's curves")
    if calibration.light_posterior is None:
        return curves, spectrum_on_grid(calibration.light, FINE_GRID)
    known = calibration.light_posterior
    light = on_grid(known.grid.nm, known.mean, FINE_GRID, "the light's posterior")
    light = np.maximum(light, DARK * light.max())
    return curves / light, light
