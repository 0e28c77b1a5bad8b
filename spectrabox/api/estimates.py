"""Estimates of several surfaces by name, and those of a photo with the verdict on them."""
from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from markupsafe import Markup

from spectrabox.measure import conditions, estimate, plots
from spectrabox.measure.advice.advice import Advice
from spectrabox.measure.results.capture_result import CaptureResult
from spectrabox.measure.surfaces.colour_comparison import ColourComparison, compare_colours
from spectrabox.measure.surfaces.surface_signals import alone
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records import calibration, spectra

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import Dataset

SpectrumEstimate = estimate.Estimate  # as the library calls it


class SpectrumEstimates(Mapping[str, estimate.Estimate]):
    """Estimates by the name of their surface, in their order; also by number.

    Parameters
    ----------
    estimates : sequence of SpectrumEstimate
        Of different names.

    References
    ----------
    Those of `SpectrumEstimate`.

    Examples
    --------
    >>> many = sb.sample([[0.5, 0.4, 0.3], [0.2, 0.3, 0.4]], camera="Nikon 5100 (NPL)", light="D65",
    ...                  noise=0.01, names=["warm", "cool"])
    >>> many["warm"].mean
    >>> widths = {name: one.band_width for name, one in many.items()}
    >>> many.to_xarray(draws=100)
    """

    def __init__(self, estimates: Sequence[estimate.Estimate]) -> None:
        self._estimates = {one.name: one for one in estimates}

    @overload
    def __getitem__(self, name: str) -> estimate.Estimate: ...
    @overload
    def __getitem__(self, name: int) -> estimate.Estimate: ...

    def __getitem__(self, name: str | int) -> estimate.Estimate:
        if isinstance(name, int):
            return list(self._estimates.values())[name]
        if name not in self._estimates:
            raise KeyError(f"there is no surface {name!r}; there are "
                           f"{', '.join(self._estimates)}")
        return self._estimates[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._estimates)

    def __len__(self) -> int:
        return len(self._estimates)

    def to_xarray(self, draws: int = 0, seed: int = 1) -> Dataset:
        """All estimates as an xarray Dataset over ``surface``, ``wavelength`` (nm) and ``draw``.

        Parameters
        ----------
        draws : int
            How many of each surface to include; none by default.
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
        return estimate.to_xarray(self, draws, seed)

    def to_csv(self, path: str | Path) -> Path:
        """Write mean, standard deviation, 95 % band and bounds of every surface, a row a
        wavelength.

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
        InputError
            If there is no surface.
        """
        return estimate.to_csv(self, path)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Means and bands of all surfaces.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = plots.axes_for(ax, (6.6, 3.7))
        for name, one in self._estimates.items():
            line, = axes.plot(one.nm, one.mean, label=name)
            axes.fill_between(one.nm, *one.band(), color=line.get_color(), alpha=0.15, lw=0)
        plots.frame_wavelengths(axes, self[0].nm)
        axes.set(ylabel="Reflectance", ylim=(0, None))
        axes.legend(frameon=False, fontsize="small")
        return axes

    def __repr__(self) -> str:
        each = self._estimates.values()
        lines = [f"  {dataclasses.replace(one, of_signal=())!r}" for one in each]
        caveats = dict.fromkeys(caveat for one in each for caveat in one.caveats)
        return "\n".join([f"<{type(self).__name__}, {len(lines)} surfaces>", *lines, *caveats])

    def _repr_html_(self) -> str:
        return plots.spectrum_html(list(self._estimates.values()))


class MeasuredSpectra(SpectrumEstimates):
    """Estimates of the surfaces of a photo, with the verdict on them and what they rest on.

    Parameters
    ----------
    found : CaptureResult
    signals : SurfaceSignals

    Attributes
    ----------
    calibration : Calibration
        Sensitivities and light, or their products where the light is unknown.
    signals : SurfaceSignals
        Of the surfaces, relative to white, with their errors by cause.
    notes : tuple of str
        What to beware of, in sentences.

    References
    ----------
    Criteria of the verdict: docs/how-to/report.md.

    Examples
    --------
    >>> result = sb.flat("painting/photos/painting.dng", {"wall": (986, 462, 1073, 537)})
    >>> print(result.text())
    >>> result.facts()["regions"][0]["band_width"]
    """

    def __init__(self, result: CaptureResult, signals: spectra.SurfaceSignals) -> None:
        super().__init__([
            dataclasses.replace(surface, advise=partial(advice_of, result, surface.name))
            for surface in result.surfaces
        ])
        self.found = result
        self.signals = signals
        self.calibration: calibration.Calibration = result.calibration
        self.notes: tuple[str, ...] = tuple(result.warnings)

    @property
    def verdict(self) -> str:
        """"pass", "warn" or "fail", by the criteria of the report."""
        return self.found.verdict.word

    @property
    def reasons(self) -> list[str]:
        """Why the verdict is no "pass", in sentences; the verdict's one sentence otherwise."""
        return self.found.verdict.reasons

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found, each with ``code``, ``severity``, ``subject`` and ``values``: what the
        verdict is made of, and the same list as of the command.
        """
        return self.found.findings

    @property
    def methods(self) -> list[str]:
        """Paragraphs for the methods section of a paper, as the report has them."""
        return self.found.methods

    @property
    def advice(self) -> tuple[Advice, ...]:
        """What to do next of all surfaces together, the best first, as `SpectrumEstimate.advice` of
        each.
        """
        return self.found.advice.overall

    @property
    def failed_extras(self) -> tuple[Finding, ...]:
        """What of that which is no part of the answer could not be made, such as the advice: the
        subject of each finding, with "error" and "traceback" among its values.
        """
        return self.found.failed_extras

    def compare(self, first: str, second: str) -> ColourComparison:
        """How two surfaces differ, in spectrum and colour, and whether the camera tells them apart.

        Parameters
        ----------
        first, second : str
            Names of surfaces whose spectra were estimated.

        Returns
        -------
        ColourComparison
            Errors that both share are counted once, so that two areas of one paint do not differ by
            them, as they seem to in `SpectrumEstimate.delta_e`.

        Raises
        ------
        KeyError
            If there is no such surface.
        InputError
            If a spectrum was given, or not drawn from the learnt prior.
        CheckError
            If no band of the photos shows both.
        """
        estimates = [self[first], self[second]]
        return compare_colours(
            [alone(self.signals, self.signals.names.index(name)) for name in (first, second)],
            [estimate.posterior for estimate in estimates])

    def facts(self) -> dict[str, Any]:
        """Everything that was found as plain numbers and sentences, by the keys of
        ``spectrabox run --json`` (docs/reference/json.md).

        Returns
        -------
        dict
            Of numbers, strings, lists and dicts.
        """
        return self.found.facts()

    def text(self, verbose: bool = True) -> str:
        """What ``spectrabox run --verbose`` prints: a row for each condition and surface, notes,
        and the verdict.

        Parameters
        ----------
        verbose : bool
            False for what it prints without: verdict, colours and what to do next.

        Returns
        -------
        str
        """
        return self.found.text() if verbose else self.found.brief()

    def __repr__(self) -> str:
        return "\n".join([conditions.conditions_text(self.found.conditions), super().__repr__(),
                          self.found.verdict.line])

    def _repr_html_(self) -> str:
        verdict = Markup("<p>{}</p><pre>{}</pre>").format(
            self.found.verdict.line, conditions.conditions_text(self.found.conditions))
        return str(verdict) + super()._repr_html_()


def advice_of(result: CaptureResult, name: str) -> tuple[Advice, ...]:
    """What to do next of one surface.

    Parameters
    ----------
    result : CaptureResult
    name : str
        Of the surface.
    """
    # of advice that failed once more by itself: its error is what is known of it
    of_all = result.advise() if result.failed_advice else result.advice
    return of_all.by_surface.get(name, ())
