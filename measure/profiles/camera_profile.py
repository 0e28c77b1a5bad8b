"""A camera's profile: matrices, curves and their errors, and matrices of one camera compared.

Matrices of one camera compared: of its measured curves, of those that a chart photo gave, and of
the photographed chart alone.

All map white-balanced signals under the light of the photo to X, Y, Z under D50, keep white white,
and are fitted to the same chart in the same way; they differ in where the signals come from. The
measured curves are as sure as laboratories agree, the fitted ones as their draws say, and the
photographed signals as patches and model agree in the fit, and as charts differ.
"""


from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from spectrabox.calibrate import (
    chart_calibration,
    chart_copy,
    chart_equations,
    chart_photo,
    colour_profile,
    sensitivity,
    trust,
)
from spectrabox.calibrate.prior.camera_prior import prior_about
from spectrabox.calibrate.products.lamps import draw_cameras
from spectrabox.measure.profiles import colour_profile as colour_profiles
from spectrabox.radiometry import appearance, colour_science, profile_files
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.records.spectra import Spectrum, WavelengthGrid
from spectrabox.radiometry.spectra import named_spectra, spectrum_files
from spectrabox.sampling.prior.mixture import PRIOR_GRID

if TYPE_CHECKING:   # Matplotlib takes a while to import
    from matplotlib.axes import Axes

FITTED_SET, FRESH_SET = "BabelColor Average", "CES99"   # the second is never seen by the fit
MAX_IDT_DRAWS = 25          # an ACES matrix takes a search for each


class CameraProfile:
    """Matrices of a camera for other programs (DNG, ACES), each with those of draws of its curves,
    and its colour profile under the light of its photos.

    Parameters
    ----------
    camera : str
        As its raw files name it.
    curves : (3, P) array
        Sensitivities R, G, B on ``grid``, of any scale.
    grid : WavelengthGrid
    idt_light : str
        CIE name or file, of the ACES matrix.
    colours : ColourProfile
    light : str
        Of the colour profile.
    draws : (T, 3, P) array or None
        Of the curves, for the spread of every number.
    """

    def __init__(self, camera: str, curves: np.ndarray, grid: WavelengthGrid, idt_light: str,
                 colours: colour_profiles.ColourProfile, light: str,
                 draws: np.ndarray | None = None) -> None:
        each = (curves, *(() if draws is None else draws))
        sets = named_spectra.test_reflectances(grid)
        self.camera, self.colours, self.light, self.idt_light = camera, colours, light, idt_light
        self.draws = len(each) - 1
        # by illuminant, as of `colour_profile.matrices`: of the curves, then of their draws
        self.matrices = {name: colour_profile.matrices(each, name, grid, sets[FITTED_SET],
                                                       (sets[FITTED_SET], sets[FRESH_SET]))
                         for name in colour_profile.ILLUMINANTS}
        # matrix (3, 3) and white balance (3,), likewise
        self.aces = [colour_science.aces_idt(grid.nm, one, idt_light)
                     for one in each[:1 + MAX_IDT_DRAWS]]

    def of_illuminant(self,
                      name: str) -> tuple[colour_profiles.Spread, colour_profiles.Spread,
                                          dict[str, colour_profiles.Spread]]:
        """What a DNG profile states of an illuminant: the colour matrix, the forward matrix, and
        the mean CIEDE2000 of the second by set.
        """
        colour, forward, errors = self.matrices[name]
        return (spread_over(colour), spread_over(forward),
                {of: spread_over(each)
                 for of, each in zip((FITTED_SET, FRESH_SET), errors.T, strict=True)})

    def aces_spreads(self) -> tuple[colour_profiles.Spread, colour_profiles.Spread]:
        """The ACES matrix and its white balance."""
        matrix, balance = (spread_over(np.array(each)) for each in zip(*self.aces, strict=True))
        return matrix, balance

    def facts(self) -> dict[str, object]:
        """As ``spectrabox camera profile --json`` names them."""
        matrix, balance = self.aces_spreads()
        return {
            "camera": self.camera, "draws": self.draws, "illuminants":
            {name: dict(zip(("color_matrix", "forward_matrix", "delta_e00"),
                            self.of_illuminant(name), strict=True))
             for name in colour_profile.ILLUMINANTS}, "aces_idt": {
                 "light": self.idt_light, "draws": len(self.aces) - 1, "matrix":
                 matrix, "white_balance": balance
             }, "colour": {"light": self.light, "delta_e00": self.colours.facts()}
        }

    def text(self) -> str:
        """Matrices and colour errors, for a person."""
        known = (f", spread over {self.draws} draws of the curves" if self.draws
                 else "; without --draws-file their spread is not known")
        lines = [f"{self.camera}: matrices for {' and '.join(colour_profile.ILLUMINANTS)}{known}"]
        for name in colour_profile.ILLUMINANTS:
            colour, forward, differences = self.of_illuminant(name)
            lines += [f"ColorMatrix, {name}", *matrix_rows(colour),
                      f"ForwardMatrix, {name}", *matrix_rows(forward)]
            lines += [f"CIEDE2000 of the forward matrix under {name}, mean of {of}: {error.words}"
                      for of, error in differences.items()]
        lines += [f"CIEDE2000 under {self.light} to D50", *self.colours.error_lines()]
        return "\n".join([*lines, f"ACES IDT, {self.idt_light}",
                          *matrix_rows(self.aces_spreads()[0])])


def spread_over(values: np.ndarray) -> colour_profiles.Spread:
    """The first of some values (1 + T, ...) with the standard deviation over the others, which are
    draws of it, where there are any.
    """
    deviation = np.std(values[1:].copy(), axis=0, ddof=1) if len(values) > 2 else None
    return colour_profiles.Spread(values[0], deviation)


def matrix_rows(matrix: colour_profiles.Spread) -> list[str]:
    """A matrix for a person, a line for each row, with its spread where that is known."""
    shown = [" ".join(f"{cell:8.4f}" for cell in row) for row in np.asarray(matrix.value)]
    if matrix.standard_deviation is not None:
        shown = [f"{row}   ± " + " ".join(f"{cell:.4f}" for cell in spread) for row, spread
                 in zip(shown, np.asarray(matrix.standard_deviation), strict=True)]
    return [f"  {row}" for row in shown]


# ---- matrices of one camera compared -------------------------------------------------------------

MEASURED, FITTED, PHOTOGRAPHED = "measured curves", "fitted curves", "photographed chart"
DRAWS = 100
PERCENTILE = 90
FIGURES = ("mean", f"percentile_{PERCENTILE}")


@dataclass(frozen=True, eq=False)
class MatrixComparison:
    """Matrices of one camera, from white-balanced signals to X, Y, Z under D50: by its measured
    curves, by the curves that a chart photo gave, and by the photographed chart alone.

    Attributes
    ----------
    matrices : dict of (1 + T, 3, 3) arrays
        By source: the matrix, then what it may be as well, T draws.
    chart, fresh : dict of (1 + T, 2) arrays
        Likewise: mean and 90th percentile of CIEDE2000 of the chart as photographed, and of
        surfaces that no matrix was fitted to.
    apart : dict of float
        By source: mean CIEDE2000 of the same surfaces from the first matrix.
    judge : str
        By which curves fresh surfaces were judged.

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

    matrices: dict[str, np.ndarray]
    chart: dict[str, np.ndarray]
    fresh: dict[str, np.ndarray]
    apart: dict[str, float]
    judge: str

    @property
    def compared(self) -> MatrixComparison:
        """Itself."""
        return self

    def facts(self) -> list[dict[str, Any]]:
        """A row for each matrix, as numbers with their standard deviations.

        Returns
        -------
        list of dict
            Each with its ``source``, ``matrix`` and ``aces`` (to ACES2065-1), ``chart`` and
            ``fresh``, each with its mean and 90th percentile, and ``apart``.
        """
        return [{"source": source, "matrix": spread_over(each),
                 "aces": spread_over(profile_files.aces_from_d50() @ each),
                 **{of: dict(zip(FIGURES, map(spread_over, errors[source].T), strict=True))
                    for of, errors in (("chart", self.chart), ("fresh", self.fresh))},
                 "apart": self.apart[source]} for source, each in self.matrices.items()]

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
        import matplotlib.pyplot as plt  # takes a while to import

        from spectrabox.measure import plots
        entries, errors = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")[1] \
            if axes is None else axes
        plots.plot_matrices(entries, errors, self)
        return entries, errors

    def __str__(self) -> str:
        lines = [f"CIEDE2000 under D50, mean and {PERCENTILE}th percentile: the chart as "
                 f"photographed; {colour_profiles.FRESH}, as the {self.judge} see them; how far "
                 "from the first matrix these are"]
        for row in self.facts():
            chart, fresh = (", ".join(row[of][figure].words for figure in FIGURES)
                            for of in ("chart", "fresh"))
            lines.append(f"{row['source']}: chart {chart}; {colour_profiles.FRESH} {fresh}; "
                         f"{row['apart']:.2f} from the first")
            lines += matrix_rows(row["matrix"])
        return "\n".join(lines)

    def __repr__(self) -> str:
        return "<MatrixComparison: CIEDE2000 " + ", ".join(
            f"{spread_over(errors[:, 0]).words} ({source})"
            for source, errors in self.fresh.items()) + ">"


def compare_matrices(calibration: chart_calibration.ChartCalibration, photo: chart_photo.ChartPhoto,
                     measured: np.ndarray | None = None, seed: int = 0) -> MatrixComparison:
    """Matrices by measured curves, by fitted ones and by the photographed chart.

    Parameters
    ----------
    calibration : ChartCalibration
        Of three bands.
    photo : ChartPhoto
        The first that it was made from.
    measured : (3, P) array, optional
        Curves on FINE_GRID. Then they judge fresh surfaces too; the fitted ones do otherwise.
    seed : int
        Of the draws.

    Raises
    ------
    InputError
        If the camera has other than three bands, or the light of measured curves is not stated.
    """
    if photo.samples.mean.shape[1] != 3:
        raise InputError(f"the camera has {photo.samples.mean.shape[1]} bands; matrices are of "
                         "three: R, G and B")
    rng = np.random.default_rng(seed)
    fitted, fitted_draws = colour_profiles.response_of_calibration(calibration.calibration)
    responses = {FITTED: (fitted, fitted[None] if fitted_draws is None else fitted_draws)}
    if measured is not None:
        responses = {MEASURED: _measured_response(measured, photo, rng), **responses}
    judge, (judging, _) = next(iter(responses.items()))

    used = photo.used & ~photo.samples.clipped.any(axis=1)
    patches = calibration.reflectances[used][:, np.searchsorted(FINE_GRID.nm, PRIOR_GRID.nm)]
    shown, balance_error = photographed_signals(calibration, photo)
    shown = shown[used]
    signals = {name: (patches @ response.T, patches @ draws.swapaxes(1, 2))
               for name, (response, draws) in responses.items()}
    signals[PHOTOGRAPHED] = (shown,
                             _as_they_may_be(
                                 shown, calibration, chart_copy.COPY_ERROR if photo.editions else
                                 sensitivity.CHART_ERROR, balance_error, rng))

    to_xyz, fresh = colour_profile.d50_weights(PRIOR_GRID).T, named_spectra.test_reflectances(
        PRIOR_GRID)[colour_profiles.FRESH]
    xyz, seen = patches @ to_xyz, fresh @ judging.T
    transforms = {name: [
        colour_profile.transform_of_signals(one, xyz, colour_profiles.MATRIX_DEGREE)
        for one in (of_source, *draws)] for name, (of_source, draws) in signals.items()}
    of_chart, of_fresh = (appearance.lab_from_xyz(each, colour_profile.D50)
                          for each in (xyz, fresh @ to_xyz))
    first = transforms[judge][0].lab(seen)
    return MatrixComparison(
        {name: np.array([one.coefficients for one in each]) for name, each in transforms.items()},
        {name: _colour_errors(each, shown, of_chart) for name, each in transforms.items()},
        {name: _colour_errors(each, seen, of_fresh) for name, each in transforms.items()},
        {name: float(appearance.ciede2000(each[0].lab(seen), first).mean())
         for name, each in transforms.items()}, judge)


def _measured_response(curves: np.ndarray, photo: chart_photo.ChartPhoto, rng: np.random.Generator
                       ) -> tuple[np.ndarray, np.ndarray]:
    """Response (3, 61) of measured curves, and draws of it as laboratories differ."""
    if not isinstance(photo.light, Spectrum):
        raise InputError(f"the photo has an {photo.light.words}, under which measured curves give "
                         "no signals; state its spectrum")
    power = spectrum_files.spectrum_on_grid(photo.light, FINE_GRID)
    prior = prior_about(FINE_GRID, curves, trust.LABORATORY, "measured curves")
    drawn = draw_cameras(prior, DRAWS, rng) @ interpolation_matrix(prior.nm, FINE_GRID.nm).T
    return (colour_profiles.response_of_curves(curves, power, FINE_GRID),
            colour_profiles.response_of_curves(drawn, power, FINE_GRID))


def _as_they_may_be(signals: np.ndarray, calibration: chart_calibration.ChartCalibration,
                    chart_error: float, balance_error: float,
                    rng: np.random.Generator) -> np.ndarray:
    """Draws (T, n, 3) of photographed signals, as far as patches and model disagree in the fit, as
    levels of patches differ from chart to chart, and as greys are not quite grey.
    """
    fit = calibration.prior_fit
    error = chart_equations.PatchError(0.0) if fit is None else fit.patch_error
    return np.asarray(signals * np.exp(
        error.own * rng.standard_normal((DRAWS, *signals.shape))
        + np.hypot(error.common, chart_error) * rng.standard_normal((DRAWS, len(signals), 1))
        + balance_error * rng.standard_normal((DRAWS, 1, 3))))


def photographed_signals(calibration: chart_calibration.ChartCalibration,
                         photo: chart_photo.ChartPhoto) -> tuple[np.ndarray, float]:
    """Signals (I, 3) of a photographed chart relative to white: glare off, the light made even as
    the fit found it, and balanced by the chart's neutral patches; and the relative error of that
    balance, by how far X, Y and Z of these are from grey.

    Parameters
    ----------
    calibration : ChartCalibration
    photo : ChartPhoto

    Raises
    ------
    InputError
        If the photo shows no neutral patch.
    """
    white, lit = calibration.white, photo.irradiance_or_pi / np.pi
    signal = photo.samples.mean
    if white is not None:
        signal = signal - white.glare
        if white.field.size:
            lit = lit * np.exp(chart_equations.field_terms(photo.chart.centres_uv) @ white.field)
    signal = signal / lit[:, None]
    neutrals = [patch for patch in photo.chart.neutrals
                if photo.used[patch] and not photo.samples.clipped[patch].any()]
    if not neutrals:
        raise InputError(f"a {photo.chart.name} shows no neutral patch that its photo could be "
                         "balanced by")
    # red sees of a grey that is not quite about what X does, green Y, and blue Z
    grey = calibration.reflectances[neutrals] @ colour_profile.d50_weights(
        FINE_GRID).T / colour_profile.D50
    balance = (grey * signal[neutrals]).sum(axis=0) / (grey**2).sum(axis=0)
    return signal / balance, float(np.log(grey.sum(axis=0)).std(ddof=1))


def _colour_errors(each: list[colour_profile.ColourTransform], signals: np.ndarray,
                   truth: np.ndarray) -> np.ndarray:
    """Mean and high percentile of CIEDE2000 against L*, a*, b* (n, 3), by transform (T, 2)."""
    errors = [appearance.ciede2000(one.lab(signals), truth) for one in each]
    return np.array([(of.mean(), np.percentile(of, PERCENTILE)) for of in errors])
