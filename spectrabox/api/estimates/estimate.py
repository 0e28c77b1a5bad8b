"""The estimate of one surface's spectrum: everything that is known of it, from one posterior."""
from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api.arguments import KnownSpectrum, as_reflectance_at
from spectrabox.api.estimates.estimate_tables import estimates_to_csv, estimates_to_xarray
from spectrabox.api.notebook import axes_for, spectrum_html
from spectrabox.measure import texts
from spectrabox.measure.advice.advice import Advice
from spectrabox.measure.extras import attempt
from spectrabox.measure.plots import plot_estimate, plot_given, plot_truth
from spectrabox.measure.surfaces.colour_comparison import Colour
from spectrabox.measure.surfaces.surface_signals import with_added
from spectrabox.radiometry.appearance import ciede2000, reflectance_to_lab
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.spectra import (
    SpectralMeasurement,
    SpectrumSamples,
    SpectrumSummary,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture
from spectrabox.sampling.prior.signal_posterior import SignalPosterior, solve_posterior
from spectrabox.sampling.summary import check_draws, check_level

if TYPE_CHECKING:
    from colour import SpectralDistribution
    from matplotlib.axes import Axes
    from xarray import Dataset

COLOUR_DRAWS = 2000         # behind a colour's standard error, where no draws are held
COLOUR_SEED = 1
DRAWS_SHOWN = 30


@dataclass(frozen=True, eq=False)
class SpectrumEstimate:
    """What is known of the reflectance of one surface.

    Attributes
    ----------
    name : str
    summary : SpectrumSummary or None
        Mean, standard deviation, band and exact bounds on P wavelengths; None where the spectrum
        was given.
    measurement : SpectralMeasurement or None
        The signal (K,), relative to white, that the estimate explains.
    errors : mapping of (K, K) arrays
        Covariance of the signal by cause of error; they add up to that of the measurement. What
        the surface's gloss may have added comes besides, among the measurement's states.
    prior : LogitMixture or None
        On reflectances; None where another method than the learnt prior drew.
    samples : SpectrumSamples or None
        The draws that the summary was made from, where there were any.
    inverse_rendering : (P,) array or None
        The one spectrum of the fit to the photo of a scene.
    given : (nm, reflectance) or None
        Of a surface whose spectrum is known.
    caveats : tuple of str
        What was not stated of a signal, and what was taken instead, in sentences.

    References
    ----------
    Mean and standard deviation are Eq. 7 of Xia et al. 2025, and the bounds come from the spectra
    of Eqs. 2 to 5. The posterior under the learnt prior: docs/explanation/sampling.md.

    Examples
    --------
    >>> orange = sb.sample([0.53, 0.24, 0.08], camera="Nikon 5100 (NPL)", light="D65", noise=0.003)
    >>> orange.nm, orange.mean, orange.standard_deviation
    >>> lower, upper = orange.band(0.95)
    >>> lightness = orange.lab("D65").value[0]
    >>> orange.plot()
    """

    name: str
    summary: SpectrumSummary | None
    measurement: SpectralMeasurement | None = None
    errors: Mapping[str, np.ndarray] = field(default_factory=dict)
    prior: LogitMixture | None = None
    samples: SpectrumSamples | None = None
    inverse_rendering: np.ndarray | None = None
    given: tuple[np.ndarray, np.ndarray] | None = None
    caveats: tuple[str, ...] = ()
    # forecasts what to do next, which takes a while: called when it is asked for
    advise: Callable[[], tuple[Advice, ...]] = tuple

    @property
    def advice(self) -> tuple[Advice, ...]:
        """What to do next, the best first: each with its cost, and the width of the band and the
        error of the colour to be expected after it. Nothing where that failed, as
        ``failed_extras`` says.
        """
        return self._advised[0]

    @property
    def failed_extras(self) -> tuple[Finding, ...]:
        """Why there is no advice, where it failed: a finding with "error" and "traceback" among
        its values.
        """
        failed = self._advised[1]
        return () if failed is None else (failed,)

    @cached_property
    def _advised(self) -> tuple[tuple[Advice, ...], Finding | None]:
        return attempt("advice", self.advise, ())

    @property
    def nm(self) -> np.ndarray:
        """Wavelengths (P,) in nm."""
        return self.given[0] if self.given is not None else self._summary.grid.nm

    @property
    def mean(self) -> np.ndarray:
        """Mean reflectance (P,), 0 to 1."""
        return self.given[1] if self.given is not None else self._summary.mean

    @property
    def standard_deviation(self) -> np.ndarray:
        """Standard deviation (P,) of the reflectance; zero where the spectrum was given."""
        return np.zeros_like(self.mean) if self.given is not None \
            else self._summary.standard_deviation

    def band(self, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper reflectance (P,) of the pointwise central band.

        Parameters
        ----------
        level : float
            Probability, 0 to 1, that it holds the reflectance at a wavelength.

        Returns
        -------
        lower, upper : (P,) arrays

        Raises
        ------
        InputError
            If the level is no probability.
        ConvergenceError
            If there are too few draws for this level, and no learnt prior to compute it from.
        """
        check_level(level)
        if self.given is not None:
            return self.mean, self.mean
        if level == self._summary.level:
            return self._summary.lower, self._summary.upper
        if self.prior is not None:
            lower, upper = self.posterior.band(level)
            grid_nm = PRIOR_GRID.nm
        else:
            draws = self._held_draws
            check_draws(draws.effective_samples, level)
            lower, upper = np.quantile(draws.spectra, [(1 - level) / 2, (1 + level) / 2], axis=0)
            grid_nm = draws.grid.nm
        return np.interp(self.nm, grid_nm, lower), np.interp(self.nm, grid_nm, upper)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Exact lowest and highest reflectance (P,) of any smooth spectrum behind the signal.

        Returns
        -------
        lowest, highest : (P,) arrays
            They hold for the spline class of the estimate, under any prior.
        """
        if self.given is not None:
            return self.mean, self.mean
        return self._summary.bound_lower, self._summary.bound_upper

    def draws(self, count: int = 4000, seed: int = 1) -> np.ndarray:
        """Independent draws (count, P) from all reflectances that explain the signal.

        Parameters
        ----------
        count : int
            T draws; equal seeds and counts give equal draws.
        seed : int

        Returns
        -------
        (T, P) array
            Reflectances, 0 to 1.

        Raises
        ------
        InputError
            For a count below 1, or an estimate without a learnt prior that holds fewer draws.
        ConvergenceError
            If draws do not reach the signal.
        """
        if self.given is not None:
            return np.repeat(self.mean[None], count, axis=0)
        held = self.samples
        if held is not None and held.seed == seed and len(held.spectra) == count:
            return _on(self.nm, held.grid.nm, held.spectra)
        if self.prior is None:
            if count > len(self._held_draws.spectra):
                raise InputError(f"{count} draws were asked for and {self.name!r} holds "
                                 f"{len(self._held_draws.spectra)}, of a method that cannot draw "
                                 "more here; ask for fewer, or estimate again with more draws")
            return _on(self.nm, self._held_draws.grid.nm, self._held_draws.spectra[:count])
        return _on(self.nm, PRIOR_GRID.nm, self.posterior.draws(count, seed))

    def lab(self, light: str = "D65") -> Colour:
        """L*, a*, b* (3,) of the mean under a light, 2 degree observer, with standard errors.

        Parameters
        ----------
        light : str
            CIE name: D65, A, FL11, LED-B3.

        Returns
        -------
        Colour
            ``value`` (3,) and ``standard_error`` (3,).

        Raises
        ------
        InputError
            If no light of that name is published.
        """
        mean, draws = (self._lab_of(light, spectra) for spectra in (self.mean, self._colour_draws))
        return Colour(mean, draws.std(axis=0))

    def delta_e(self, other: SpectrumEstimate | KnownSpectrum | ArrayLike,
                light: str = "D65") -> Colour:
        """CIEDE2000 between the means of two surfaces under a light, with its standard error.

        Parameters
        ----------
        other : SpectrumEstimate, (P,) array, path, (nm, values) or Spectrum
            Another estimate, whose errors are taken to be independent (surfaces of one photo share
            most of theirs: `MeasuredSpectra.compare`), or a measured reflectance, an array being
            one on the wavelengths of this estimate.
        light : str
            CIE name: D65, A, FL11, LED-B3.

        Returns
        -------
        Colour
            ``value`` and ``standard_error``, numbers.

        Raises
        ------
        InputError
            If no light of that name is published, or the other is no reflectance.
        """
        if not isinstance(light, str) or (isinstance(other, str) and not Path(other).is_file()):
            first, second = (repr(one) if isinstance(one, str) else type(one).__name__
                             for one in (other, light))
            raise InputError(f"{first} is no surface, or {second} no light: give the other "
                             "surface, a reflectance or its file first, and a CIE name after it, "
                             "as in delta_e(other, light='D65')")
        if isinstance(other, SpectrumEstimate):
            theirs, drawn = other._lab_of(light, other.mean), other._lab_of(light,
                                                                            other._colour_draws)
        else:
            theirs = drawn = self._lab_of(light, as_reflectance_at(self.nm, other, "other"))
        mine = self._lab_of(light, self._colour_draws)
        if drawn.ndim == 2:
            # in another order: draws of equal seeds would err alike
            count = min(len(mine), len(drawn))
            mine = mine[:count]
            drawn = np.random.default_rng(COLOUR_SEED).permutation(drawn)[:count]
        spread = ciede2000(mine, drawn)
        return Colour(np.asarray(ciede2000(self._lab_of(light, self.mean), theirs)),
                      np.asarray(spread.std()))

    @cached_property
    def causes(self) -> dict[str, float]:
        """Share of each cause in the variance of the spectrum, mean over wavelength; sums to 1.

        Metamerism is what would remain if the signal were perfect. Empty where the spectrum was
        given, or drawn by another method than the learnt prior.
        """
        if self.prior is None or self.measurement is None:
            return {}
        return self.posterior.variance_shares(self.errors)

    @property
    def error_budget(self) -> dict[str, np.ndarray]:
        """Relative standard error (K,) of the signal by cause."""
        if self.measurement is None:
            return {}
        return {cause: np.sqrt(np.diag(covariance)) / self.measurement.signal
                for cause, covariance in with_added(self.errors, self.measurement.states).items()}

    @property
    def outcome(self) -> str:
        """How the estimate ended, and what it is conditional on, in a sentence."""
        if self.given is not None:
            return "The spectrum was given."
        return texts.paragraph(
            self.samples.findings if self.samples is not None else self.posterior.findings)

    @property
    def next_reading_nm(self) -> float | None:
        """Wavelength at which one more reading would narrow the band most; None if given."""
        return None if self.given is not None else self._summary.next_measurement_nm

    @property
    def band_width(self) -> float:
        """Mean width of the band over wavelength, in reflectance."""
        lower, upper = self.band() if self.given is not None else (self._summary.lower,
                                                                   self._summary.upper)
        return float(np.mean(upper - lower))

    @cached_property
    def posterior(self) -> SignalPosterior:
        """The posterior under the learnt prior, solved once.

        Raises
        ------
        InputError
            If the estimate comes from another method.
        """
        if self.prior is None or self.measurement is None:
            raise InputError(f"{self.name!r} was not estimated with the learnt prior")
        return solve_posterior(self.prior, self.measurement)

    def plot(self, axes: Axes | None = None, *,
             truth: KnownSpectrum | ArrayLike | None = None) -> Axes:
        """Draws, band, exact bounds and mean over wavelength, as in the report.

        Parameters
        ----------
        axes : matplotlib Axes, optional
            To draw into; new ones by default.
        truth : (P,) array, path, (nm, values) or Spectrum, optional
            A measured reflectance to compare with.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_for(axes, (6.6, 3.7))
        if self.given is not None:
            plot_given(axes, self.nm, self.mean)
        else:
            held = self.samples
            draws, draws_nm = (self.draws(DRAWS_SHOWN, COLOUR_SEED), self.nm) if held is None \
                else (held.spectra, held.grid.nm)
            plot_estimate(axes, self._summary, draws, draws_nm, self.inverse_rendering)
        if truth is not None:
            plot_truth(axes, self.nm, as_reflectance_at(self.nm, truth, "truth"))
        axes.set_title(self.name)
        axes.legend(frameon=False, fontsize="small")
        return axes

    def to_xarray(self, draws: int = 0, seed: int = 1) -> Dataset:
        """The estimate as an xarray Dataset over ``wavelength`` (nm), and ``draw`` if asked for.

        Parameters
        ----------
        draws : int
            How many to include; none by default.
        seed : int
            Of these draws.

        Returns
        -------
        xarray.Dataset
            ``mean``, ``standard_deviation``, ``lower``, ``upper``, ``bound_lower``,
            ``bound_upper`` and ``draws``: reflectances, 0 to 1.

        Raises
        ------
        EnvironmentProblem
            If xarray is not installed.
        """
        return estimates_to_xarray({self.name: self}, draws, seed).isel(surface=0)

    def to_csv(self, path: str | Path) -> Path:
        """Write mean, standard deviation, band and bounds, a row a wavelength.

        Parameters
        ----------
        path : path

        Returns
        -------
        Path
            Of the file.

        Raises
        ------
        EnvironmentProblem
            If the file cannot be written; an older one is left as it was.
        """
        return estimates_to_csv({self.name: self}, path)

    def to_colour(self) -> SpectralDistribution:
        """The mean as a colour-science SpectralDistribution.

        Returns
        -------
        colour.SpectralDistribution
            Reflectance, 0 to 1, by wavelength in nm.
        """
        from colour import SpectralDistribution  # takes a second to import
        return SpectralDistribution(dict(zip(self.nm.tolist(), self.mean.tolist(), strict=True)),
                                    name=self.name)

    def _repr_html_(self) -> str:
        return spectrum_html([self])

    def renamed(self, name: str) -> SpectrumEstimate:
        """The same estimate under another name.

        Parameters
        ----------
        name : str

        Returns
        -------
        SpectrumEstimate
        """
        return dataclasses.replace(self, name=name)

    @property
    def _as_intended(self) -> bool:
        """Whether the draws ended without a reservation."""
        ended = self.samples.outcome if self.samples is not None else self.posterior.outcome
        return ended.as_intended

    @property
    def _summary(self) -> SpectrumSummary:
        assert self.summary is not None, "an estimate has a summary unless its spectrum was given"
        return self.summary

    @property
    def _held_draws(self) -> SpectrumSamples:
        assert self.samples is not None, "a method without a learnt prior keeps its draws"
        return self.samples

    @cached_property
    def _colour_draws(self) -> np.ndarray:
        if self.given is None and self.samples is not None:
            return _on(self.nm, self.samples.grid.nm, self.samples.spectra)
        return self.draws(COLOUR_DRAWS, COLOUR_SEED)

    def _lab_of(self, light: str, spectra: np.ndarray) -> np.ndarray:
        if not isinstance(light, str):
            raise InputError(f"{light!r} is no light: give a CIE name, such as 'D65' or 'A'")
        return reflectance_to_lab(self.nm, spectra, light)

    def __repr__(self) -> str:
        if self.given is not None:
            return f"<SpectrumEstimate {self.name!r}: given>"
        lightness, a, b = self.lab().value
        said = [f"<SpectrumEstimate {self.name!r}: L*a*b* {lightness:.1f} {a:.1f} {b:.1f}, "
                f"{100 * self._summary.level:.4g} % band {self.band_width:.3f} wide>",
                *([] if self._as_intended else [self.outcome]), *self.caveats]
        return "\n".join(said)


def _on(nm: np.ndarray, own_nm: np.ndarray, spectra: np.ndarray) -> np.ndarray:
    """Spectra (T, Q) at other wavelengths (P,), by straight lines between their own."""
    if np.array_equal(nm, own_nm):
        return spectra
    return np.array([np.interp(nm, own_nm, spectrum) for spectrum in spectra])
