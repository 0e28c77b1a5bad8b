"""A camera or an observer whose curves are known by its name."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.measure import plots
from spectrabox.radiometry.files import in_folder, write_text_whole
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra import named_spectra, spectrum_files

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class KnownCamera:
    """Curves of a camera or an observer, as they were measured; ``camera=`` of the other functions
    takes it.

    Attributes
    ----------
    name : str
    nm : (Q,) array
        Wavelengths in nm.
    bands : tuple of K str
    curves : (K, Q) array
        Sensitivities; the highest peak is 1.

    References
    ----------
    Not in Xia et al. 2025. rawtoaces-data (Apache-2.0), colour-science, or one's own: "Cameras by
    name" in docs/how-to/camera.md.

    Examples
    --------
    >>> camera = sb.camera("nikon d810")
    >>> camera.name, camera.bands
    >>> camera.plot()
    """

    name: str
    nm: np.ndarray
    bands: tuple[str, ...]
    curves: np.ndarray

    def plot(self, axes: Axes | None = None) -> Axes:
        """The curves.

        Parameters
        ----------
        axes : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = plots.axes_for(axes, (5.6, 3.4))
        plots.plot_sensitivities(axes, self.nm, self.curves, None, self.bands)
        axes.set_title(self.name)
        axes.legend(frameon=False, fontsize="small")
        return axes

    def to_csv(self, path: str | Path) -> Path:
        """Write the curves, a column each.

        Parameters
        ----------
        path : path
            A text file, wavelengths in nm; ``camera=`` and ``--sensitivity`` take it.

        Returns
        -------
        Path
            Of the file.

        Raises
        ------
        EnvironmentProblem
            If the file cannot be written; an older one is left as it was.
        """
        target = in_folder(path)
        write_text_whole(target, spectrum_files.table_text(
            self.nm, dict(zip(self.bands, self.curves, strict=True)), quantity=Quantity.RELATIVE,
            source=self.name))
        return target

    def __repr__(self) -> str:
        peaks = ", ".join(f"{band} {self.nm[curve.argmax()]:.0f}"
                          for band, curve in zip(self.bands, self.curves, strict=True))
        return (f"<KnownCamera {self.name}: {self.nm[0]:.0f} to {self.nm[-1]:.0f} nm, peaks at "
                f"{peaks} nm>")

    def _repr_html_(self) -> str:
        return plots.curves_html(self.nm, self.curves, self.bands, (repr(self)[1:-1],))


def camera(name: str) -> KnownCamera:
    """A camera or an observer by its name, as ``spectrabox camera list`` lists them.

    Parameters
    ----------
    name : str
        In any case, with or without blanks and hyphens; or a file of curves.

    Returns
    -------
    KnownCamera

    Raises
    ------
    InputError
        If it is not known; the nearest names are said.

    References
    ----------
    Not in Xia et al. 2025. The curves are those of rawtoaces-data (Apache-2.0) and colour-science,
    and those that ``camera fit --keep`` and ``camera add`` kept.

    Examples
    --------
    >>> nikon = sb.camera("nikon d5100")
    >>> nikon.nm, nikon.curves
    >>> orange = sb.sample([0.53, 0.24, 0.08], camera=nikon, light="D65", noise=0.003)
    """
    known, nm, bands, curves = named_spectra.named_curves(name)
    return KnownCamera(known, nm, bands, curves / curves.max())
