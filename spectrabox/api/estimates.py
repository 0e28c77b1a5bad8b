"""The estimates of several surfaces, by name."""
from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from markupsafe import Markup

from spectrabox.api.estimate import SpectrumEstimate, estimates_to_xarray
from spectrabox.api.notebook import axes_for, spectrum_html
from spectrabox.measure.advice.advice import Advice
from spectrabox.measure.plots import frame_wavelengths
from spectrabox.measure.results.capture_result import CaptureResult
from spectrabox.measure.verdict.conditions import conditions_text
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import Dataset


class SpectrumEstimates(Mapping[str, SpectrumEstimate]):
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

    def __init__(self, estimates: Sequence[SpectrumEstimate]) -> None:
        self._estimates = {estimate.name: estimate for estimate in estimates}

    @overload
    def __getitem__(self, name: str) -> SpectrumEstimate: ...
    @overload
    def __getitem__(self, name: int) -> SpectrumEstimate: ...

    def __getitem__(self, name: str | int) -> SpectrumEstimate:
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
            ``mean``, ``standard_deviation``, ``lower``, ``upper``, ``bound_lower``,
            ``bound_upper`` and ``draws``: reflectances, 0 to 1.

        Raises
        ------
        EnvironmentProblem
            If xarray is not installed.
        """
        return estimates_to_xarray(self, draws, seed)

    def to_csv(self, path: str | Path) -> Path:
        """Write mean, standard deviation, band and bounds of every surface, a row a wavelength.

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
        if not self._estimates:
            raise InputError("there is no surface to write")
        columns: dict[str, np.ndarray] = {}
        for name, one in self._estimates.items():
            (lower, upper), (lowest, highest) = one.band(), one.bounds()
            columns |= {f"{name} mean": one.mean,
                        f"{name} standard_deviation": one.standard_deviation,
                        f"{name} lower": lower, f"{name} upper": upper,
                        f"{name} bound_lower": lowest, f"{name} bound_upper": highest}
        target = Path(path)
        write_text_whole(target, table_text(self[0].nm, columns, quantity=Quantity.REFLECTANCE,
                                            source="spectrabox"))
        return target

    def plot(self, axes: Axes | None = None) -> Axes:
        """Means and bands of all surfaces.

        Parameters
        ----------
        axes : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_for(axes, (6.6, 3.7))
        for name, one in self._estimates.items():
            line, = axes.plot(one.nm, one.mean, label=name)
            axes.fill_between(one.nm, *one.band(), color=line.get_color(), alpha=0.15, lw=0)
        frame_wavelengths(axes, self[0].nm)
        axes.set(ylabel="Reflectance", ylim=(0, None))
        axes.legend(frameon=False, fontsize="small")
        return axes

    def __repr__(self) -> str:
        lines = [f"  {estimate!r}" for estimate in self._estimates.values()]
        return "\n".join([f"<{type(self).__name__}, {len(lines)} surfaces>", *lines])

    def _repr_html_(self) -> str:
        return spectrum_html(list(self._estimates.values()))


class MeasuredSpectra(SpectrumEstimates):
    """Estimates of the surfaces of a photo, with the verdict on them and what they rest on.

    Parameters
    ----------
    found : CaptureResult
    estimates : sequence of SpectrumEstimate
        Of its surfaces.

    Attributes
    ----------
    calibration : Calibration
        Sensitivities and light, or their products where the light is unknown.
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

    def __init__(self, found: CaptureResult, estimates: Sequence[SpectrumEstimate]) -> None:
        super().__init__(estimates)
        self.found = found
        self.calibration: Calibration = found.calibration
        self.notes: tuple[str, ...] = tuple(found.warnings)

    @property
    def verdict(self) -> str:
        """"pass", "warn" or "fail", by the criteria of the report."""
        return self.found.verdict.word

    @property
    def reasons(self) -> list[str]:
        """Why the verdict is no "pass", in sentences; the verdict's one sentence otherwise."""
        return self.found.verdict.reasons

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

    def facts(self) -> dict[str, Any]:
        """Everything that was found as plain numbers and sentences, by the keys of
        ``spectrabox run --json`` (docs/reference/json.md).

        Returns
        -------
        dict
            Of numbers, strings, lists and dicts.
        """
        return self.found.facts()

    def text(self) -> str:
        """What ``spectrabox run`` prints: a row for each surface, warnings, and the verdict.

        Returns
        -------
        str
        """
        return self.found.text()

    def __repr__(self) -> str:
        return "\n".join([conditions_text(self.found.conditions), super().__repr__(),
                          self.found.verdict.line])

    def _repr_html_(self) -> str:
        verdict = Markup("<p>{}</p><pre>{}</pre>").format(
            self.found.verdict.line, conditions_text(self.found.conditions))
        return str(verdict) + super()._repr_html_()


def advice_of(found: CaptureResult, name: str) -> tuple[Advice, ...]:
    """What to do next of one surface.

    Parameters
    ----------
    found : CaptureResult
    name : str
        Of the surface.
    """
    return found.advice.by_surface.get(name, ())
