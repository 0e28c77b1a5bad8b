"""A colour profile of a finished calibration, and a photo with its colours.

A camera's colour profile under one light, with the errors to expect of it.

Its transforms are fitted to surfaces drawn from the prior of the stated families, and judged on
others. The spread of an error is that over draws of the camera's response: the profile stays, and
each draw is a camera that the calibration allows.
"""


from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.calibrate import colour_profile as colour_fit
from spectrabox.measure.pictures.crop import crop_of, node_grid
from spectrabox.measure.regions.white import FlatErrors, FlatPhoto, white_at_regions
from spectrabox.radiometry import error_model, interreflection, profile_files
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.records import calibration, photos, spectra
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.sampling.prior import mixture

STATED, MATRIX, TABLE = "camera's own matrix", "matrix", "table"
CHART, FRESH = "BabelColor Average", "CES99"    # the second is of measured surfaces, never fitted
FITTED, JUDGED = 3000, 1000     # drawn surfaces that a profile is fitted to, and judged by
FITTED_DRAWS, JUDGED_DRAWS = 8, 100     # of the response
MATRIX_DEGREE, TABLE_DEGREE = 1, 3
SEED = 1                        # of the order of the surfaces


@dataclass(frozen=True)
class Spread:
    """A number or an array, and its standard deviation over draws of the camera's curves; None
    where there are none. Fields are named as in ``--json``.
    """

    value: np.ndarray | float
    standard_deviation: np.ndarray | float | None

    @property
    def words(self) -> str:
        """A number as a person reads it."""
        spread = "" if self.standard_deviation is None else f" ± {self.standard_deviation:.2f}"
        return f"{self.value:.2f}{spread}"


@dataclass(frozen=True, eq=False)
class ColourProfile:
    """From a camera's signals under the light of its calibration to colours under D50.

    Attributes
    ----------
    matrix, table : ColourTransform
        The second is what tables of profiles are made of.
    errors : dict
        CIEDE2000 to expect, by transform ("matrix", "table", and "camera's own matrix" where the
        photo's file has one) and by set of surfaces: its "mean" and "percentile_95", each with its
        spread by the calibration's errors.
    draws : int
        Of the response, behind the spreads.

    References
    ----------
    Not in Xia et al. 2025. Finlayson, Mackiewicz and Hurlbert 2015 (root polynomials); errors:
    docs/results/profiles.md.

    Examples
    --------
    >>> camera = sb.fit_camera("mybox/photos/chart.dng", light="mybox/spectra/light.csv")
    >>> profile = camera.colour_profile(families="paint")
    >>> profile.lab([0.3, 0.25, 0.2])
    >>> profile.save("mycamera.icc", "My camera under LED")
    """

    matrix: colour_fit.ColourTransform
    table: colour_fit.ColourTransform
    errors: dict[str, dict[str, dict[str, Spread]]]
    draws: int

    @property
    def profile(self) -> ColourProfile:
        """Itself, with its matrix and its table."""
        return self

    def lab(self, signals: ArrayLike) -> np.ndarray:
        """L*, a*, b* (..., 3) under D50 by the table's transform.

        Parameters
        ----------
        signals : (..., 3) array
            Of the camera's bands relative to white.

        Returns
        -------
        (..., 3) array
        """
        return self.table.lab(np.asarray(signals, float))

    def save(self, path: str | Path, name: str) -> tuple[Path, ...]:
        """Write the profile for other programs.

        Parameters
        ----------
        path : path
            Ends in .icc, .clf or .ocio; the .clf file of an .ocio configuration is written beside
            it.
        name : str
            As programs list it.

        Returns
        -------
        tuple of Path
            That were written.

        Raises
        ------
        InputError
            For another ending.
        EnvironmentProblem
            If a file cannot be written.
        """
        target = Path(path)
        if target.suffix.lower() not in profile_files.FORMS:
            raise InputError(f"{target.name}: a colour profile ends in "
                             f"{', '.join(profile_files.FORMS)}")
        return profile_files.write_profile(target, name, self.matrix.coefficients, self.table.xyz)

    def facts(self) -> dict[str, dict[str, dict[str, Spread]]]:
        """Errors by transform and set of surfaces, each with its spread.

        Returns
        -------
        dict
        """
        return self.errors

    def error_lines(self) -> list[str]:
        """A line for each transform and set.

        Returns
        -------
        list of str
        """
        return [f"  {name}, {of}: mean {one['mean'].words}, 95 % below "
                f"{one['percentile_95'].words}"
                for name, sets in self.errors.items() for of, one in sets.items()]

    def __repr__(self) -> str:
        *_, expected = self.errors.values()
        return "<ColourProfile: CIEDE2000 " + ", ".join(
            f"{one['mean'].value:.2f} ({of})" for of, one in expected.items()) + ">"


def colour_profile(response: np.ndarray, draws: np.ndarray | None = None,
                   families: Sequence[str] = (), camera_from_xyz: np.ndarray | None = None
                   ) -> ColourProfile:
    """The colour profile of a camera's response to reflectances.

    Parameters
    ----------
    response : (3, 61) array
        On ``PRIOR_GRID``, of any scale.
    draws : (T, 3, 61) array or None
        Of the same.
    families : sequence of str
        Of the surfaces that will be photographed; none for any.
    camera_from_xyz : (3, 3) array or None
        The camera's own matrix, of a raw file, whose errors are stated too.

    Raises
    ------
    InputError
        For a word that names no family.
    CalibrationError
        If the bands are too alike.
    """
    response = _relative(response)
    cameras = response[None] if draws is None else _relative(draws)[:JUDGED_DRAWS]
    surfaces = mixture.drawn_reflectances(mixture.of_families(mixture.load_prior(), families),
                                          FITTED + JUDGED)
    surfaces = np.random.default_rng(SEED).permutation(surfaces)
    fitted, judged = surfaces[:FITTED], surfaces[FITTED:]
    known = response[None] if draws is None else np.concatenate(
        [response[None], cameras[:FITTED_DRAWS]])
    transforms = {} if camera_from_xyz is None else {
        STATED: colour_fit.stated_transform(camera_from_xyz)}
    transforms |= {MATRIX: colour_fit.fit_transform(known, fitted, mixture.PRIOR_GRID,
                                                    MATRIX_DEGREE),
                   TABLE: colour_fit.fit_transform(known, fitted, mixture.PRIOR_GRID, TABLE_DEGREE)}
    tests = test_reflectances(mixture.PRIOR_GRID)
    kinds = ", ".join(families) if families else "any family"
    sets = {CHART: tests[CHART], f"{JUDGED} surfaces of {kinds}": judged, FRESH: tests[FRESH]}
    errors = {name: {of: _error(transform, cameras, reflectances)
                     for of, reflectances in sets.items()}
              for name, transform in transforms.items()}
    return ColourProfile(transforms[MATRIX], transforms[TABLE], errors,
                         0 if draws is None else len(cameras))


def profile_of(calibration: calibration.Calibration, families: Sequence[str],
               camera_from_xyz: np.ndarray | None) -> ColourProfile:
    """The colour profile of a calibration.

    Parameters
    ----------
    calibration : Calibration
    families, camera_from_xyz
        As of ``colour_profile``.

    Raises
    ------
    InputError
        If the camera has other than three bands, or a word names no family.
    """
    if len(calibration.sensitivity.curves) != 3:
        raise InputError(f"the camera has {len(calibration.sensitivity.curves)} bands; a colour "
                         "profile is of three: R, G and B")
    return colour_profile(*response_of_calibration(calibration), families, camera_from_xyz)


def response_of_calibration(calibration: calibration.Calibration
                            ) -> tuple[np.ndarray, np.ndarray | None]:
    """A calibrated camera's response (3, 61) on ``PRIOR_GRID``, and draws (T, 3, 61) of it by the
    calibration's errors; None where it states no errors of curves and light.

    Parameters
    ----------
    calibration : Calibration
    """
    response = interreflection.relative_response(calibration, FINE_GRID)
    errors = error_model.curve_errors(calibration, FINE_GRID).together_with(
        error_model.light_errors(calibration, FINE_GRID,
                                 response)).at(mixture.PRIOR_GRID.nm, FINE_GRID)
    on_prior = response @ interpolation_matrix(mixture.PRIOR_GRID.nm, FINE_GRID.nm)
    count = errors.by_spectrum.shape[2]
    if count == 0:
        return on_prior, None
    parts = np.random.default_rng(0).standard_normal((JUDGED_DRAWS, count))
    return on_prior, _relative(on_prior + np.einsum("kpe,te->tkp", errors.by_spectrum, parts))


def response_of_curves(curves: np.ndarray, power: np.ndarray,
                       grid: spectra.WavelengthGrid) -> np.ndarray:
    """Response (..., 3, 61) on ``PRIOR_GRID`` of curves (..., 3, P) under a light (P,)."""
    weights = curves * power * grid.weights_nm
    return _relative(weights @ interpolation_matrix(mixture.PRIOR_GRID.nm, grid.nm))


def _relative(response: np.ndarray) -> np.ndarray:
    return np.asarray(response / response.sum(axis=-1, keepdims=True))


def _error(transform: colour_fit.ColourTransform, cameras: np.ndarray,
           surfaces: np.ndarray) -> dict[str, Spread]:
    """CIEDE2000 of surfaces without noise: means over the cameras that it may be, and their
    standard deviations.
    """
    errors = np.array([colour_fit.colour_errors(transform, response, surfaces, mixture.PRIOR_GRID)
                       for response in cameras])
    figures = np.column_stack([errors.mean(axis=1), np.percentile(errors, 95, axis=1)])
    mean, high = figures.mean(axis=0).tolist()
    spread = [None, None] if len(cameras) == 1 else figures.std(axis=0, ddof=1).tolist()
    return {"mean": Spread(mean, spread[0]), "percentile_95": Spread(high, spread[1])}


# ---- a photo of flat samples as a picture for colour management ----------------------------------

COLUMNS = 24                # of the nodes at which white is computed
ROWS = 128                  # that are converted at once


def relative_signals(photo: photos.LinearImage, lit: FlatPhoto, known: Mapping[str, np.ndarray],
                     errors: FlatErrors) -> Iterator[np.ndarray]:
    """Signals (rows, W, K) relative to white at each pixel, some rows at a time.

    Parameters
    ----------
    photo : LinearImage
        At its full size.
    lit : FlatPhoto
        The same with its chart and its light.
    known : mapping
        From names of regions to their known reflectances (P,).
    errors : FlatErrors
    """
    crop = crop_of(photo, None)
    nodes_px, between = node_grid(crop, COLUMNS)
    white = white_at_regions(lit, known, errors, nodes_px)
    assert white is not None, "the first photo shows regions"
    log_white = np.log(white.white[-len(nodes_px):])        # the nodes stand after the regions
    glare = white.glare + white.mean[white.glare_part]
    for first in range(0, len(photo.signal), ROWS):
        rows = photo.signal[first:first + ROWS]
        there = np.exp(between(first, first + len(rows)) @ log_white)
        yield (rows - glare) / there.reshape(rows.shape)


def colour_picture(
        signals: Iterator[np.ndarray], transform: colour_fit.ColourTransform,
        space: str) -> tuple[np.ndarray, float]:
    """Code values (H, W, 3) uint16 of a picture, and the share of its pixels that were clipped.

    Parameters
    ----------
    signals : iterator of (rows, W, 3) arrays
        Relative to white.
    transform : ColourTransform
    space : str
        One of ``profile_files.NAMES``.
    """
    parts = [profile_files.code_values(space, transform.xyz(rows)) for rows in signals]
    picture, clipped = (np.concatenate(each) for each in zip(*parts, strict=True))
    return picture, float(clipped.mean())
