"""A camera's colour profile: colours of its signals under D50, and files for other programs."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import ArrayLike

from spectrabox.measure.plots import plot_matrices
from spectrabox.measure.profiles import camera_profile, colour_profile
from spectrabox.measure.profiles.colour_profile import ColourProfile as Profile
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.profile_files import FORMS, write_profile
from spectrabox.radiometry.records.calibration import Calibration

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class ColourProfile:
    """From a camera's signals under the light of its calibration to colours under D50.

    Attributes
    ----------
    profile : Profile
        Its matrix and its table.

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

    profile: Profile

    @property
    def errors(self) -> dict[str, dict[str, colour_profile.ColourError]]:
        """CIEDE2000 to expect, by transform ("matrix", "table", and "camera's own matrix" where the
        photo's file has one) and by set of surfaces; spreads are those by the calibration's errors.
        """
        return self.profile.errors

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
        return self.profile.table.lab(np.asarray(signals, float))

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
        if target.suffix.lower() not in FORMS:
            raise InputError(f"{target.name}: a colour profile ends in {', '.join(FORMS)}")
        return write_profile(target, name, self.profile.matrix.coefficients,
                             self.profile.table.xyz)

    def __repr__(self) -> str:
        *_, errors = self.errors.values()
        return "<ColourProfile: CIEDE2000 " + ", ".join(
            f"{one.mean:.2f} ({of})" for of, one in errors.items()) + ">"


@dataclass(frozen=True, eq=False)
class MatrixComparison:
    """Matrices of one camera, from white-balanced signals to X, Y, Z under D50: by its measured
    curves, by the curves that a chart photo gave, and by the photographed chart alone.

    Attributes
    ----------
    compared : ComparedMatrices
        ``rows``, each with its ``source``, ``matrix`` and ``aces`` (to ACES2065-1) with their
        standard deviations, CIEDE2000 of the ``chart`` as photographed and of ``fresh`` surfaces
        (mean and 90th percentile), and how far its colours are ``apart`` from those of the first.

    References
    ----------
    Not in Xia et al. 2025. How to read it: docs/how-to/matrices.md.

    Examples
    --------
    >>> camera = sb.fit_camera("mybox/photos/chart.dng", light="mybox/spectra/light.csv")
    >>> matrices = camera.matrices(measured="mybox/spectra/truth_sensitivity.csv")
    >>> print(matrices)
    >>> matrices.plot()
    """

    compared: camera_profile.ComparedMatrices

    def facts(self) -> list[dict[str, object]]:
        """A row for each matrix, as numbers.

        Returns
        -------
        list of dict
        """
        return [row.facts() for row in self.compared.rows]

    def plot(self, axes: Sequence[Axes] | None = None) -> Sequence[Axes]:
        """The entries of the matrices and their colour errors, each with one standard deviation
        either side.

        Parameters
        ----------
        axes : sequence of two matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        sequence of two matplotlib Axes
        """
        entries, errors = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")[1] \
            if axes is None else axes
        plot_matrices(entries, errors, self.compared)
        return entries, errors

    def __str__(self) -> str:
        return self.compared.text()

    def __repr__(self) -> str:
        return "<MatrixComparison: CIEDE2000 " + ", ".join(
            f"{row.fresh[0].words} ({row.source})" for row in self.compared.rows) + ">"


def profile_of(calibration: Calibration, families: tuple[str, ...],
               camera_from_xyz: np.ndarray | None) -> ColourProfile:
    """The colour profile of a calibration.

    Parameters
    ----------
    calibration : Calibration
    families : tuple of str
    camera_from_xyz : (3, 3) array or None
        As of ``measure.profiles.colour_profile.colour_profile``.

    Raises
    ------
    InputError
        If the camera has other than three bands.
    """
    if len(calibration.sensitivity.curves) != 3:
        raise InputError(f"the camera has {len(calibration.sensitivity.curves)} bands; a colour "
                         "profile is of three: R, G and B")
    response, draws = colour_profile.response_of_calibration(calibration)
    return ColourProfile(colour_profile.colour_profile(response, draws, families, camera_from_xyz))
