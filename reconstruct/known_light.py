"""The light on a scene by what surfaces of known spectrum show: its level and its colour.

The chart says how bright the light is at the chart, by positions how bright on the scene, and what
colour it had in the chart's photo. A known surface in the scene's own photo says all of it where it
counts: photo / rendering of it is the light there against what was expected, in every band. Both
are combined by their errors.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spectrabox.radiometry import error_model
from spectrabox.radiometry.records import calibration, photos, scenes
from spectrabox.reconstruct.agreement import SceneErrors, surface_sums
from spectrabox.reconstruct.view import PhotoView

KNOWN_LEVEL_ERROR = 0.01    # relative, of a known surface: its spectrum, its tilt and its place
KNOWN_COLOUR_ERROR = 0.005  # relative, of a band of it against the mean of its bands
# of a band's light, relative: how a lamp's colour changes between two photos that nobody compared
LAMP_COLOUR_ERROR = 0.02
# Of a change of the light's colour, what one factor for a band leaves of it: within its band a
# filament's light changes by a third of what it changes between bands, and half of that counts.
COLOUR_LEFT = 0.25
# The level of a surface is off by this much more than the parts of one are among themselves: 1.5
# under a moved lamp, a narrow beam, an encoded photo (benchmarks/bench_known_level.py).
LEVEL_OF_PATTERN = 1.5
HUBER, ROUNDS = 1.345, 50       # errors, from which a known surface's pull grows no more


def tie_to_known(view: PhotoView, rendered: np.ndarray,
                 errors: SceneErrors | None) -> tuple[PhotoView, scenes.KnownLight]:
    """The view with level and colour of the light as its known surfaces show them.

    Parameters
    ----------
    view : PhotoView
        With its own photo and, if a chart tells one, its light scale.
    rendered : (H, W, K) array
        For a light scale of 1.
    errors : SceneErrors or None
        By which surfaces of one material disagree; what one known surface tells is no surer.

    Returns
    -------
    view : PhotoView
        With that light scale, and its photo as under the colour of the chart's light.
    light : KnownLight
    """
    known = view.known_surface
    numbers = np.unique(known[known >= 0])
    measured, predicted = surface_sums(view.measured, known), surface_sums(rendered, known)
    lit = np.all((measured > 0) & (predicted > 0), axis=1)
    logs = np.log(measured[lit] / predicted[lit])
    bands = logs.shape[1]
    by_surface = logs.mean(axis=1)
    tints = logs - by_surface[:, None]
    brightness, tint, pattern = (0.0, 0.0, 0.0) if errors is None else (
        errors.brightness, errors.colour, errors.pattern)
    # of several known surfaces one may be shaded, or lit by more than the scene says
    seen = middle(by_surface, LEVEL_OF_PATTERN * float(np.hypot(KNOWN_LEVEL_ERROR, pattern)))
    colour = np.median(tints, axis=0)
    colour = colour - colour.mean()
    seen_error = float(_of_middle(by_surface, np.hypot(KNOWN_LEVEL_ERROR, brightness)))
    colour_error = _of_middle(tints, np.hypot(KNOWN_COLOUR_ERROR, tint))

    expected, expected_error, own = _expected(view.light_scale, bands)
    level, level_error = _combined(expected, expected_error, seen, seen_error)
    tied, tied_error = _combined(np.zeros(bands), np.hypot(own, LAMP_COLOUR_ERROR), colour,
                                 colour_error)
    tied = tied - tied.mean()
    tied_error = np.hypot(tied_error, COLOUR_LEFT * np.abs(tied))
    value, names = float(np.exp(level)), tuple(dict.fromkeys(
        view.surface_materials[index] for index in numbers[lit]))
    scale = error_model.with_common_error(
        calibration.LightScale(value, value * float(np.sqrt(np.mean(tied_error**2))), None, _source(
            view.light_scale, names)), error_model.KNOWN_SURFACES, float(level_error))
    found = scenes.KnownLight(
        names, None if view.light_scale is None else float(np.exp(seen - expected)),
        None if view.light_scale is None else expected_error, seen_error, float(level_error),
        np.exp(tied), tied_error)
    return view.with_photo(in_chart_light(view.photo, found), scale), found


def in_chart_light(photo: photos.LinearImage, light: scenes.KnownLight) -> photos.LinearImage:
    """A photo as it would be if the light had the colour that the chart's photo says.

    Parameters
    ----------
    photo : LinearImage
        (H, W, K), of any size.
    light : KnownLight
        As that photo showed it.
    """
    return replace(photo, signal=(photo.signal / light.colour).astype(photo.signal.dtype),
                   variance=(photo.variance / light.colour**2).astype(photo.variance.dtype))


def middle(values: np.ndarray, error: float) -> float:
    """Huber's mean of values (S,): one that lies farther off than the errors pulls no more than if
    it were just as far.

    Where all of a scene's surfaces are uneven, the one that lies apart tells of the light as the
    others do, and their mean is nearest; in a scene that is otherwise right it is shaded, and the
    middle of the others is.

    Parameters
    ----------
    values : (S,) array
    error : float
        Standard deviation of one of them, above 0.
    """
    at = float(np.median(values))
    for _ in range(ROUNDS):
        weight = np.minimum(1.0, HUBER * error / np.maximum(np.abs(values - at), 1e-12))
        at = float(weight @ values / weight.sum())
    return at


def _of_middle(values: np.ndarray, stated: float) -> np.ndarray:
    """Standard error of the middle of surfaces (S, ...): by their scatter, and by what is stated of
    one.
    """
    count = len(values)
    scatter = values.std(axis=0, ddof=1) if count > 1 else np.zeros(values.shape[1:])
    return np.asarray(np.maximum(scatter, stated) / np.sqrt(count))


def _expected(scale: calibration.LightScale | None, bands: int) -> tuple[float, float, float]:
    """Logarithm of the light scale by the chart, its standard error in all bands together, and in
    each.
    """
    if scale is None:
        return 0.0, np.inf, 0.0
    own = error_model.error_of_each_band(scale)
    common = np.hypot.reduce([0.0, *scale.common_errors.values()])
    return float(np.log(scale.value)), float(np.hypot(common, own / np.sqrt(bands))), own


def _combined(expected: np.ndarray | float, expected_error: np.ndarray | float,
              seen: np.ndarray | float,
              seen_error: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Mean of two values by their errors, and its standard error: what was given without one stays.
    """
    with np.errstate(divide="ignore"):
        share = 1 / (1 + (np.asarray(seen_error) / expected_error) ** 2)
    return expected + share * (np.asarray(seen) - expected), np.sqrt(share) * seen_error


def _source(scale: calibration.LightScale | None, names: Sequence[str]) -> str:
    known = f"known material {', '.join(names)}"
    return known if scale is None else f"{scale.source} and {known}"
