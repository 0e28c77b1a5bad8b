"""A camera or an observer whose curves are known by its name."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.measure import plots
from spectrabox.radiometry import files, grid
from spectrabox.radiometry.published import published_tables
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra import light_words, named_spectra, spectrum_files
from spectrabox.radiometry.spectra.cameras import own_cameras

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

    def plot(self, ax: Axes | None = None) -> Axes:
        """The curves.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = plots.axes_for(ax, (5.6, 3.4))
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
        target = files.in_folder(path)
        files.write_text_whole(target, spectrum_files.table_text(
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


def cameras() -> tuple[str, ...]:
    """Names of the cameras and observers that ``camera=`` takes, your own first.

    Returns
    -------
    tuple of str

    References
    ----------
    Not in Xia et al. 2025; of the curves, as `camera`.

    Examples
    --------
    >>> [name for name in sb.cameras() if "Nikon" in name]
    """
    return tuple(dict.fromkeys((*own_cameras(),
                                *published_tables.published_names(published_tables.CAMERAS),
                                *published_tables.published_names(published_tables.OBSERVERS))))


def lights() -> tuple[str, ...]:
    """Names of the lights that ``light=`` takes: CIE illuminants and measured lamps, then kinds of
    lamp, of which no spectrum is stated.

    Returns
    -------
    tuple of str
        A temperature such as "3200K", a file, and arrays are taken too.

    References
    ----------
    Not in Xia et al. 2025. CIE 15 and colour-science.

    Examples
    --------
    >>> [name for name in sb.lights() if name.startswith("LED")]
    """
    covering = [name for name, (nm, _) in
                published_tables.all_published(published_tables.LIGHTS).items()
                if nm[0] <= grid.FINE_GRID.nm[0] and nm[-1] >= grid.FINE_GRID.nm[-1]]
    first = covering.index("A")         # the illuminants of the CIE are the end of the table
    return (*covering[first:], *covering[:first], *light_words.LIGHT_KINDS, light_words.UNKNOWN)
