"""One surface's spectrum and everything that is known of it: from one posterior, from draws that
are held, or as it was given. Library, report, page, tables and JSON read it, each what it shows.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.measure import extras, texts
from spectrabox.measure.advice.advice import Advice
from spectrabox.measure.surfaces.colour_comparison import Colour
from spectrabox.measure.surfaces.surface_signals import with_added
from spectrabox.measure.surfaces.surface_spectra import Scores, score
from spectrabox.radiometry import appearance, files
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records import spectra as spectral_records
from spectrabox.radiometry.spectra import given_spectra, spectrum_files
from spectrabox.sampling.prior import family_coverage, mixture, signal_posterior
from spectrabox.sampling.summary import check_draws, check_level

if TYPE_CHECKING:
    from colour import SpectralDistribution
    from matplotlib.axes import Axes
    from xarray import Dataset

COLOUR_DRAWS = 2000         # behind a colour's standard error, where no draws are held
COLOUR_SEED = 1
DRAWS_SHOWN = 30
MITSUBA_NM = 360.0, 830.0  # that Mitsuba samples wavelengths from
SHOWN_NM = 25               # between the wavelengths of a text
CURVES = ("mean", "standard_deviation", "lower", "upper")
BOUNDS = ("bound_lower", "bound_upper")


@dataclass(frozen=True, eq=False)
class Estimate:
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
    inverse_rendering : (P,) array or None
        The one spectrum of the fit to the photo of a scene.
    given : (nm, reflectance) or None
        Of a surface whose spectrum is known.
    of_signal : tuple of Finding
        What was not stated of a signal, and what was taken instead.
    truth : Spectrum or None
        A measured reflectance to compare with.

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
    summary: spectral_records.SpectrumSummary | None
    measurement: spectral_records.SpectralMeasurement | None = None
    errors: Mapping[str, np.ndarray] = field(default_factory=dict)
    prior: mixture.LogitMixture | None = None
    inverse_rendering: np.ndarray | None = None
    given: tuple[np.ndarray, np.ndarray] | None = None
    of_signal: tuple[Finding, ...] = ()
    truth: spectral_records.Spectrum | None = None
    # what was solved before, so that it need not be solved again: the posterior, or how it ended
    solved: signal_posterior.SignalPosterior | None = None
    ended: spectral_records.Outcome | None = None
    # the draws rest on more than ``measurement``: further readings, or all surfaces of a scene
    from_more: bool = False
    bounds_from: str = "all measurements"
    contradicting: tuple[Finding, ...] | None = None    # of further measurements
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
        return extras.attempt("advice", self.advise, ())

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

    @property
    def samples(self) -> spectral_records.SpectrumSamples | None:
        """The draws that the summary was made from, where there were any."""
        return None if self.summary is None else self.summary.samples

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
        if self._solvable:
            lower, upper = self.posterior.band(level)
            grid_nm = mixture.PRIOR_GRID.nm
        else:
            draws = self._summary.draws
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
        if not self._solvable:
            held = self._summary.draws
            if count > len(held.spectra):
                raise InputError(f"{count} draws were asked for and {self.name!r} holds "
                                 f"{len(held.spectra)}, of a method that cannot draw "
                                 "more here; ask for fewer, or estimate again with more draws")
            return _on(self.nm, held.grid.nm, held.spectra[:count])
        return _on(self.nm, mixture.PRIOR_GRID.nm, self.posterior.draws(count, seed))

    @property
    def known(self) -> bool:
        """Whether the spectrum was given."""
        return self.given is not None

    @cached_property
    def srgb(self) -> np.ndarray:
        """Encoded sRGB (3,) of the mean, 0 to 1."""
        return appearance.reflectance_to_srgb(self.nm, self.mean)

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
        if light not in self._colours:
            self._colours[light] = Colour(self._lab_of(light, self.mean),
                                          self._drawn_lab(light).std(axis=0))
        return self._colours[light]

    @cached_property
    def within(self) -> tuple[float, float] | None:
        """How far draws lie from the mean, at the probability of the band: CIEDE2000 under D65, and
        root mean square over wavelengths, reflectance. None where the spectrum was given, or of a
        single draw.
        """
        if self.given is not None or (self.samples is not None and len(self.samples.spectra) < 2):
            return None
        if self.samples is None:
            nm, drawn = self.nm, self.draws(COLOUR_DRAWS, COLOUR_SEED)
        else:
            nm, drawn = self.samples.grid.nm, self.samples.spectra
        colours = appearance.reflectance_to_lab(nm, drawn)
        mean = np.broadcast_to(self._lab_of("D65", self.mean), colours.shape)
        off = (appearance.ciede2000(colours, mean), np.sqrt(np.mean(
            (drawn - np.interp(nm, self.nm, self.mean)) ** 2, axis=1)))
        colour, spectrum = np.quantile(off, self._summary.level, axis=1).tolist()
        return colour, spectrum

    def delta_e(self, other: Estimate | given_spectra.KnownSpectrum | ArrayLike,
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
        if isinstance(other, Estimate):
            theirs, drawn = other._lab_of(light, other.mean), other._drawn_lab(light)
        else:
            theirs = drawn = self._lab_of(
                light, given_spectra.as_reflectance_at(self.nm, other, "other"))
        mine = self._drawn_lab(light)
        if drawn.ndim == 2 and min(len(mine), len(drawn)) > 1:
            # in another order: draws of equal seeds would err alike
            count = min(len(mine), len(drawn))
            mine = mine[:count]
            drawn = np.random.default_rng(COLOUR_SEED).permutation(drawn)[:count]
        spread = appearance.ciede2000(mine, drawn)
        return Colour(np.asarray(appearance.ciede2000(self._lab_of(light, self.mean), theirs)),
                      np.asarray(spread.std()))

    @cached_property
    def causes(self) -> dict[str, float]:
        """Share of each cause in the variance of the spectrum, mean over wavelength; sums to 1.

        Metamerism is what would remain if the signal were perfect. Empty where the spectrum was
        given, drawn by another method than the learnt prior, or from more than its own signal.
        """
        if self.summary is not None and self.summary.variance_shares:
            return dict(self.summary.variance_shares)
        if not self._solvable or self.measurement is None:
            return {}
        return self.posterior.variance_shares(self.errors)

    @cached_property
    def families(self) -> tuple[family_coverage.FamilyCoverage, ...]:
        """Kinds of surface that were stated, or that the signal allows, and what 95 % bands of each
        held when they were judged; none without the learnt prior.
        """
        if self.prior is None or not self._outcome.as_intended:
            return ()
        return family_coverage.family_coverages(
            shares, self.prior.stated, self.prior.certificates) if (shares := self._shares) else ()

    @property
    def _shares(self) -> dict[str, float]:
        """Of families, under the learnt prior."""
        return self._summary.family_shares or self.posterior.family_shares

    @property
    def _tested(self) -> list[Finding]:
        """What 95 % bands of these families held on unseen surfaces; none without the learnt prior.
        """
        if self.prior is None:
            return []
        if self._outcome.as_intended:
            return family_coverage.certified(self.families)
        return [Finding("families.none-alike"
                        if self._outcome is spectral_records.Outcome.UNFAMILIAR
                        else "families.smoothness", Severity.INFO)]

    @property
    def certificate(self) -> str | None:
        """The same in a sentence; None without the learnt prior."""
        return None if self.prior is None else texts.paragraph(self._tested)

    @property
    def caveats(self) -> tuple[str, ...]:
        """What was not stated of its signal, and what was taken instead, in sentences."""
        return tuple(map(texts.says, self.of_signal))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was not stated, what contradicts it, how it ended and what it is conditional on, and
        on what surfaces its bands were tested.
        """
        return (*self.of_signal, *(self.contradicting or ()), *self._ending, *self._tested)

    @cached_property
    def scores(self) -> Scores | None:
        """How near it came to the truth; None where that is not known, or no draws are held."""
        if self.truth is None or self.summary is None or self.samples is None:
            return None
        return score(spectrum_files.spectrum_on_grid(self.truth, self.summary.grid),
                     self.inverse_rendering, self.summary, self.samples)

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
        return texts.paragraph(self._ending)

    @property
    def _ending(self) -> tuple[Finding, ...]:
        """How the estimate ended, and what it is conditional on; nothing if it was given."""
        if self.given is not None:
            return ()
        if self.samples is not None:
            return self.samples.findings
        if self.ended is None or self.prior is None:
            return self.posterior.findings
        return signal_posterior.outcome_findings(self.ended, self.prior.stated,
                                                 self._summary.family_shares)

    @property
    def as_intended(self) -> bool:
        """Whether the draws ended without a reservation."""
        return self.known or self._outcome.as_intended

    @property
    def method(self) -> str:
        """Which prior and sampler it is of."""
        if self.samples is not None:
            return self.samples.method
        return signal_posterior.prior_named(self._outcome)

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
    def posterior(self) -> signal_posterior.SignalPosterior:
        """The posterior under the learnt prior, solved once.

        Raises
        ------
        InputError
            If the estimate comes from another method.
        """
        if self.solved is not None:
            return self.solved
        if self.prior is None or self.measurement is None:
            raise InputError(f"{self.name!r} was not estimated with the learnt prior")
        return signal_posterior.solve_posterior(self.prior, self.measurement)

    def plot(self, ax: Axes | None = None, *,
             truth: given_spectra.KnownSpectrum | ArrayLike | None = None) -> Axes:
        """Draws, band, exact bounds and mean over wavelength, as in the report.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            To draw into; new ones by default.
        truth : (P,) array, path, (nm, values) or Spectrum, optional
            A measured reflectance to compare with; by default that of the estimate, if it has one.

        Returns
        -------
        matplotlib Axes
        """
        from spectrabox.measure import plots  # Matplotlib takes a while to import
        axes = plots.axes_for(ax, (6.6, 3.7))
        truth = self.truth if truth is None else truth
        if self.given is not None:
            plots.plot_given(axes, self.nm, self.mean)
        else:
            held = self.samples
            draws, draws_nm = (self.draws(DRAWS_SHOWN, COLOUR_SEED), self.nm) if held is None \
                else (held.spectra, held.grid.nm)
            plots.plot_estimate(axes, self._summary, draws, draws_nm, self.inverse_rendering)
        if truth is not None:
            plots.plot_truth(axes, self.nm,
                             given_spectra.as_reflectance_at(self.nm, truth, "truth"))
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
            ``mean``, ``standard_deviation``, ``lower`` and ``upper`` of 95 % bands,
            ``bound_lower``, ``bound_upper`` and ``draws``: reflectances, 0 to 1.

        Raises
        ------
        EnvironmentProblem
            If xarray is not installed.
        """
        return to_xarray({self.name: self}, draws, seed).isel(surface=0)

    def to_csv(self, path: str | Path) -> Path:
        """Write mean, standard deviation, 95 % band and bounds, a row a wavelength.

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
        return to_csv({self.name: self}, path)

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

    def to_mitsuba(self) -> dict[str, str]:
        """The mean as a spectrum of Mitsuba 3: a dictionary for ``mitsuba.load_dict``, by itself or
        as the reflectance of a BSDF.

        Returns
        -------
        dict
            An ``irregular`` spectrum. Mitsuba takes a spectrum for 0 outside its wavelengths, so
            the ends are carried on over 360 to 830 nm, of which the camera says nothing.
        """
        nm = np.concatenate([[min(MITSUBA_NM[0], self.nm[0] - 1)], self.nm,
                             [max(MITSUBA_NM[1], self.nm[-1] + 1)]])
        values = np.pad(np.clip(self.mean, 0, 1), 1, mode="edge")
        return {"type": "irregular",
                **{name: ", ".join(f"{number:.9g}" for number in numbers)
                   for name, numbers in (("wavelengths", nm), ("values", values))}}

    def _repr_html_(self) -> str:
        from spectrabox.measure import plots
        return plots.spectrum_html([self])

    def facts(self) -> dict[str, Any]:
        """What is known, as plain numbers and sentences, by the keys of
        ``spectrabox sample --json`` (docs/reference/json.md).

        Returns
        -------
        dict
            Of numbers, strings, lists and dicts; without what does not apply.
        """
        if self.given is not None:
            return {"name": self.name, "known": True, "wavelengths_nm": self.nm.tolist(),
                    "mean": self.mean.tolist()}
        summary, held = self._summary, self.samples
        facts: dict[str, Any] = {
            "wavelengths_nm": self.nm.tolist(),
            **{curve: getattr(summary, curve).tolist() for curve in (*CURVES, *BOUNDS)},
            "effective_samples": None if held is None else held.effective_samples,
            "samples": 0 if held is None else len(held.spectra), "level": summary.level,
            "method": self.method, "outcome": self.outcome, "ended": self._outcome.value,
            "conditional_on": texts.paragraph(summary.conditional_on),
            "next_measurement_nm": summary.next_measurement_nm, "bounds_from": self.bounds_from}
        if self.contradicting is not None:
            facts["doubtful"] = [*map(texts.says, self.contradicting)]
        if self.causes:
            facts["error_budget"] = self.causes
        if self.prior is not None:
            facts |= {"families": dict(self._shares),
                      "certified": family_coverage.coverage_facts(self.families),
                      "certificate": self.certificate}
        if self.name:
            facts["name"] = self.name
        facts["findings"] = [texts.facts(one) for one in self.findings]
        if self.caveats:
            facts["caveat"] = "\n".join(self.caveats)
        return facts

    def text(self) -> str:
        """Every 25 nm, and what is to be said of it, as ``spectrabox sample`` prints it.

        Returns
        -------
        str
        """
        if self.given is not None:
            return f"{self.name}: {self.outcome}"
        summary = self._summary
        lines = [f"{'nm':>5} {'mean':>7} {'sd':>7} {'band':>15} {'bounds':>15}"]
        for index in np.flatnonzero(self.nm % SHOWN_NM == 0):
            mean, deviation, lower, upper, lowest, highest = (
                getattr(summary, curve)[index] for curve in (*CURVES, *BOUNDS))
            lines.append(f"{self.nm[index]:5.0f} {mean:7.3f} {deviation:7.3f} "
                         f"{lower:7.3f}-{upper:.3f}  {lowest:7.3f}-{highest:.3f}")
        if self.causes:
            lines.append("variance from: " + ", ".join(
                f"{cause} {100 * share:.1f} %" for cause, share in self.causes.items()
                if share > 0))
        lines += map(texts.says, self.contradicting or ())
        lines += [*self.caveats, self.outcome]
        if self.certificate is not None:
            lines.append(self.certificate)
        draws = "computed in closed form" if self.samples is None \
            else f"{len(self.samples.spectra)} draws"
        return "\n".join([*lines, f"{draws}, {self.method}; the next reading helps most at "
                          f"{summary.next_measurement_nm:.0f} nm"])

    def renamed(self, name: str) -> Estimate:
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
    def ending(self) -> spectral_records.Outcome | None:
        """How the estimate ended, for programs: ``estimate.ending.value`` is "familiar",
        "unfamiliar", or "out-of-reach" where no spectrum between 0 and 1 gives the signal. None
        where the spectrum was given.
        """
        return None if self.given is not None else self._outcome

    @property
    def _outcome(self) -> spectral_records.Outcome:
        if self.samples is not None:
            return self.samples.outcome
        return self.posterior.outcome if self.ended is None else self.ended

    @property
    def _solvable(self) -> bool:
        """Whether the posterior of its own signal is all that is known of it."""
        return self.prior is not None and not self.from_more

    @property
    def _summary(self) -> spectral_records.SpectrumSummary:
        assert self.summary is not None, "an estimate has a summary unless its spectrum was given"
        return self.summary

    @cached_property
    def _colours(self) -> dict[str, Colour]:
        return {}

    def _drawn_lab(self, light: str) -> np.ndarray:
        """L*, a*, b* of draws (T, 3)."""
        if self.given is not None:
            return self._lab_of(light, self.mean[None])
        if self.samples is not None:
            return appearance.reflectance_to_lab(self.samples.grid.nm, self.samples.spectra, light)
        return self._lab_of(light, self.draws(COLOUR_DRAWS, COLOUR_SEED))

    def _lab_of(self, light: str, spectra: np.ndarray) -> np.ndarray:
        if not isinstance(light, str):
            raise InputError(f"{light!r} is no light: give a CIE name, such as 'D65' or 'A'")
        return appearance.reflectance_to_lab(self.nm, spectra, light)

    def __repr__(self) -> str:
        if self.given is not None:
            return f"<SpectrumEstimate {self.name!r}: given>"
        lightness, a, b = self.lab().value
        said = [f"<SpectrumEstimate {self.name!r}: L*a*b* {lightness:.1f} {a:.1f} {b:.1f}, "
                f"{100 * self._summary.level:.4g} % band {self.band_width:.3f} wide>",
                *([] if self.as_intended else [self.outcome]), *self.caveats]
        return "\n".join(said)


def _on(nm: np.ndarray, own_nm: np.ndarray, spectra: np.ndarray) -> np.ndarray:
    """Spectra (T, Q) at other wavelengths (P,), by straight lines between their own."""
    if np.array_equal(nm, own_nm):
        return spectra
    return np.array([np.interp(nm, own_nm, spectrum) for spectrum in spectra])


def to_csv(estimates: Mapping[str, Estimate], path: str | Path) -> Path:
    """Write mean, standard deviation, 95 % band and bounds of every surface, a row a wavelength.

    Parameters
    ----------
    estimates : mapping of Estimate
        On the same wavelengths.
    path : path

    Raises
    ------
    EnvironmentProblem
        If the file cannot be written; an older one is left as it was.
    InputError
        If there is no surface, or no such folder.
    """
    if not estimates:
        raise InputError("there is no surface to write")
    columns: dict[str, np.ndarray] = {}
    for name, one in estimates.items():
        (lower, upper), (lowest, highest) = one.band(), one.bounds()
        columns |= {f"{name} mean": one.mean,
                    f"{name} standard_deviation": one.standard_deviation,
                    f"{name} lower": lower, f"{name} upper": upper,
                    f"{name} bound_lower": lowest, f"{name} bound_upper": highest}
    target = files.in_folder(path)
    nm = next(iter(estimates.values())).nm
    files.write_text_whole(target,
                           spectrum_files.table_text(nm, columns,
                                                     quantity=spectral_records.Quantity.REFLECTANCE,
                                        source="spectrabox"))
    return target


def to_xarray(estimates: Mapping[str, Estimate], draws: int,
                        seed: int) -> Dataset:
    """Estimates on the same wavelengths as an xarray Dataset.

    Parameters
    ----------
    estimates : mapping of Estimate
    draws : int
        How many of each to include.
    seed : int

    Returns
    -------
    xarray.Dataset
        Dimensions ``surface``, ``wavelength`` (nm), and ``draw`` where draws are asked for;
        variables are reflectances, 0 to 1.

    Raises
    ------
    EnvironmentProblem
        If xarray is not installed.
    """
    try:
        import xarray
    except ImportError:
        raise EnvironmentProblem("to_xarray needs xarray, which is not installed: pip install "
                                 "'spectrabox[xarray]'") from None
    each = list(estimates.values())
    columns: dict[str, Any] = {
        "mean": [one.mean for one in each],
        "standard_deviation": [one.standard_deviation for one in each],
        "lower": [one.band()[0] for one in each], "upper": [one.band()[1] for one in each],
        "bound_lower": [one.bounds()[0] for one in each],
        "bound_upper": [one.bounds()[1] for one in each]}
    reflectance: dict[str, Any] = {"units": "1", "long_name": "reflectance"}
    variables: dict[str, Any] = {name: (("surface", "wavelength"), np.array(values), reflectance)
                                 for name, values in columns.items()}
    if draws:
        variables["draws"] = (("surface", "draw", "wavelength"),
                              np.array([one.draws(draws, seed) for one in each]),
                              reflectance | {"seed": seed})
    nm = ("wavelength", each[0].nm, {"units": "nm"})
    return xarray.Dataset(variables, {"surface": list(estimates), "wavelength": nm},
                          {"title": "reflectance estimates", "band_level": 0.95,
                           "outcome": [one.outcome for one in each]})


def columns_of(estimates: Sequence[Estimate]) -> dict[str, np.ndarray]:
    """Of each surface its mean, standard deviation and band (P,), as the columns of a table."""
    return {f"{one.name} {curve}".strip(): getattr(one.summary, curve)
            for one in estimates for curve in CURVES}


def draws_of(estimates: Sequence[Estimate]) -> dict[str, np.ndarray]:
    """Draws (S, T, P) of surfaces that all hold some, as the arrays of a file; (T, P) of one that
    has no name.
    """
    draws = [one.samples for one in estimates if one.samples is not None]
    if len(draws) < len(estimates):
        return {}
    arrays = {"spectra": np.array([each.spectra for each in draws]),
              "coefficients": np.array([each.coefficients for each in draws])}
    if not estimates[0].name:
        arrays = {name: values[0] for name, values in arrays.items()}
    return arrays | {"wavelengths_nm": draws[0].grid.nm}
