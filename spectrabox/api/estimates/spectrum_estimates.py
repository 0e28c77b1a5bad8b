"""The estimates of several surfaces, by name."""
from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, overload

from spectrabox.api.estimates.estimate import SpectrumEstimate
from spectrabox.api.estimates.estimate_tables import estimates_to_csv, estimates_to_xarray
from spectrabox.api.notebook import axes_for, spectrum_html
from spectrabox.measure.plots import frame_wavelengths

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
        return estimates_to_csv(self, path)

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
        each = self._estimates.values()
        lines = [f"  {dataclasses.replace(estimate, caveats=())!r}" for estimate in each]
        caveats = dict.fromkeys(caveat for estimate in each for caveat in estimate.caveats)
        return "\n".join([f"<{type(self).__name__}, {len(lines)} surfaces>", *lines, *caveats])

    def _repr_html_(self) -> str:
        return spectrum_html(list(self._estimates.values()))
