"""A camera's sensitivities from photos of a chart."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api import arguments, photo, shoot_arguments
from spectrabox.api.chart_check import ChartCheck
from spectrabox.calibrate import chart_findings
from spectrabox.measure import plots
from spectrabox.measure.camera import CameraFit, ChartSignals, chart_in_photo
from spectrabox.measure.profiles.camera_profile import MatrixComparison, compare_matrices
from spectrabox.measure.profiles.colour_profile import ColourProfile, profile_of
from spectrabox.radiometry import chart, errors, files
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records import spectra
from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.radiometry.system.threads import one_blas_thread
from spectrabox.reconstruct.rendering.renderer import threads_given_back
from spectrabox.session.camera import camera_files

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class CameraEstimate(CameraFit):
    """A camera's sensitivities, or their products with an unknown light, with their errors.

    Attributes
    ----------
    bands : tuple of K str
    verdict : str
        "pass", "warn" or "fail", by the worst finding.
    says : str
        What was fitted, how surely, and what speaks against it, in one sentence.
    findings : tuple of Finding
        What was found of light, camera and chart, each with ``code``, ``severity``, ``subject``
        and ``values``; causes before symptoms.
    checks : tuple of str
        The findings in sentences.
    sensitivity : SensitivityFit
        The curves with their covariance and residuals, by ``method``.
    chart : ChartCalibration
        The fit that belongs to the stated light.
    photo : LinearImage or None
        The first photo of a chart: its exposure tells the light's strength in other photos. None
        of patches that were given as numbers.

    References
    ----------
    Equations 17 to 20 of Xia et al. 2025 give the published fit; docs/explanation/calibration.md
    says what is estimated here instead.

    Examples
    --------
    >>> camera = sb.fit_camera("mybox/photos/chart.dng", light="mybox/spectra/light.csv")
    >>> camera.verdict, camera.says
    >>> lower, upper = camera.band()
    >>> camera.plot()
    """

    @property
    def calibration(self) -> Calibration:
        """Sensitivities and light, with their covariance."""
        return self.chart.calibration

    @property
    def nm(self) -> np.ndarray:
        """Wavelengths (P,) in nm."""
        return self.sensitivity.grid.nm

    @property
    def curves(self) -> np.ndarray:
        """Sensitivities (K, P); the highest peak is 1."""
        return self.sensitivity.curves

    def band(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper sensitivities (K, P) of the 90 % band.

        Returns
        -------
        lower, upper : (K, P) arrays

        Raises
        ------
        InputError
            For measured curves, which have no band.
        """
        if self.curve_band is None:
            raise errors.InputError("measured curves have no band of their own")
        return self.curve_band

    @property
    def light_evidence(self) -> tuple[Finding, ...]:
        """What the chart says for and against each light that was stated, of the code
        "light.contradicted" where it is wrong: ``values`` hold ``stated``, ``against`` (in nats;
        negative speaks for it), ``limit``, and ``kinds`` with their probabilities by the chart
        alone.
        """
        return self.chart.light_evidence

    @property
    def chart_check(self) -> ChartCheck:
        """The first photo's patches, each by a calibration without it."""
        return ChartCheck(self.chart_photos[0].chart.names, self.held_out,
                          chart_findings.of_patches(self.findings))

    @property
    def chart_delta_e(self) -> float:
        """Mean CIEDE2000 of the chart patches, each predicted by a fit without it."""
        return float(self.chart.held_out_delta_e.mean())

    def colour_profile(self, families: str | Sequence[str] | None = None) -> ColourProfile:
        """Colours under D50 of what the camera sees under this light, for colour management.

        Parameters
        ----------
        families : str or sequence of str, optional
            What will be photographed: paint, textile, leaves, skin, white, earth or animal.

        Returns
        -------
        ColourProfile

        Raises
        ------
        InputError
            If the camera has other than three bands, or a word names no family.
        """
        return profile_of(self.calibration, arguments.families_of(families),
                          None if self.photo is None else self.photo.camera_from_xyz)

    def matrices(self, measured: arguments.CameraLike | None = None) -> MatrixComparison:
        """Matrices from the camera's signals to colours, by its curves and by the photographed
        chart alone, compared.

        Parameters
        ----------
        measured : name, path, KnownCamera or (nm, curves), optional
            Measured curves of the camera, to compare with as well.

        Returns
        -------
        MatrixComparison

        Raises
        ------
        InputError
            If the camera has other than three bands, the light of measured curves is not stated, or
            a name is not known.
        """
        return compare_matrices(self.chart, self.chart_photos[0],
                                None if measured is None else arguments.as_curves(measured))

    def plot(self, ax: Axes | None = None) -> Axes:
        """The curves, shaded to two standard errors either side, as in the report.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = plots.axes_for(ax, (5.6, 3.4))
        plots.plot_sensitivities(axes, self.nm, self.curves, self.sensitivity.standard_error,
                                 self.bands)
        axes.legend(frameon=False, fontsize="small")
        return axes

    def to_csv(self, path: str | Path) -> Path:
        """Write the curves and their standard errors, a column each, as ``camera fit --out``.

        Parameters
        ----------
        path : path
            A text file, wavelengths in nm; ``camera=`` of the other functions takes it.

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
        files.write_text_whole(
            target,
            table_text(self.nm, self.columns(), quantity=spectra.Quantity.RELATIVE,
                       source=self.source))
        return target

    def __repr__(self) -> str:
        return f"<CameraEstimate {self.verdict}: {self.says}>"

    def _repr_html_(self) -> str:
        return plots.curves_html(self.nm, self.curves, self.bands,
                           (self.line, *self.checks))


@threads_given_back()
@one_blas_thread()
def fit_camera(charts: str | Path | photo.Photo | Sequence[str | Path | photo.Photo] | None = None,
               *, patches: ArrayLike | str | Path | None = None,
               patch_errors: ArrayLike | None = None,
               light: arguments.LightLike | list[arguments.LightLike],
               layout: str | Path | chart.Chart | None = None, reference: str | None = None,
               chart_scene: str | Path | None = None, leave_out: Sequence[int] = (),
               method: str = shoot_arguments.SENSITIVITY.method, prior: str | Path | None = None,
               seed: int = 0) -> CameraEstimate:
    """Sensitivities of a camera from photos of a chart and the spectrum of the light.

    Parameters
    ----------
    charts : path, Photo, or several, optional
        Photos of a chart by one camera.
    patches : (I, K) array or path, optional
        In place of photos: linear signals of the chart's patches in its order, of any unit, or a
        table of them as ``camera fit --patches`` takes it.
    patch_errors : (I, K) array, optional
        Standard errors of an array of patches; by default 0.4 %, and the fit says so.
    light : path, name, (nm, values) or Spectrum, or a list of one for each photo
        "unknown" gives the products of camera and light.
    layout, reference
        As of `find_chart`.
    chart_scene : path, optional
        Mitsuba XML with the light and a rectangle of id "chart" in their positions: then the
        strength of the light is known too, as `reconstruct_scene` needs it.
    leave_out : sequence of int
        Numbers of patches, from 1, that no fit uses.
    method : {"prior", "smooth", "nonnegative", "paper"}
        Learnt from measured cameras, or splines; "paper" is the published least squares.
    prior : path, optional
        A prior made by ``spectrabox camera prior``.
    seed : int
        Of the draws behind the band.

    Returns
    -------
    CameraEstimate

    Raises
    ------
    InputError
        If a file cannot be read, or photos and lights do not match in number.
    ChartNotFoundError, ClippedPhotoError, CheckError
        If a photo does not show the chart, or is saturated.
    CalibrationError
        If chart and light do not determine the curves.

    References
    ----------
    Xia et al. 2025, Eqs. 17 to 20 (``method="paper"``). The default fits curves, exposure, fall-off
    and glare together under a prior of 39 measured cameras: docs/explanation/calibration.md.

    Examples
    --------
    >>> camera = sb.fit_camera(["mybox/photos/chart.dng"], light="mybox/spectra/light.csv")
    >>> camera.nm, camera.curves
    >>> camera.checks
    >>> chart = sb.find_chart("mybox/photos/chart.dng")
    >>> same = sb.fit_camera(patches=chart.mean, patch_errors=chart.standard_error,
    ...                      light="mybox/spectra/light.csv")
    """
    given = [charts] if isinstance(charts, str | Path | photo.Photo) else list(charts or ())
    if bool(given) == (patches is not None):
        raise errors.InputError("give either photos of a chart or patches=")
    lights = light if isinstance(light, list) else [light]
    if len(lights) not in (1, len(given) or 1):
        raise errors.InputError(
            f"{len(lights)} lights were given for {len(given)} photos; give one for "
            "each photo or one for all")
    photos = [one if isinstance(one, photo.Photo) else photo.open_photo(one) for one in given]
    stated = []
    for one in lights:
        tables = shoot_arguments.Arguments()
        stated.append(tables.capture({
            "photos": {"object": tables.photo(photos[0]) if photos else "patches"},
            "regions": {},
            "light": {"spectrum": tables.light(one)},
            "chart": tables.chart(layout, reference) | {
                "scene": None if chart_scene is None else str(chart_scene),
                "leave_out": [int(number) for number in leave_out]},
            "sensitivity": {"method": method} | tables.camera_prior(prior)}))
    shown = [chart_in_photo(photo.image, stated[0]) for photo in photos] \
        if patches is None else [_given_patches(patches, patch_errors, stated[0].layout)]
    return CameraEstimate.of_charts(shown, stated, seed)


def _given_patches(patches: ArrayLike | str | Path, patch_errors: ArrayLike | None,
                   layout: chart.Chart) -> ChartSignals:
    """Signals of patches from an array, or a table."""
    if isinstance(patches, str | Path):
        if patch_errors is not None:
            raise errors.InputError("a table of patches states its errors itself; leave "
                                    "patch_errors out")
        return camera_files.read_patches(Path(patches), layout)
    signal = arguments.as_numbers(patches, "patches")
    if signal.ndim != 2 or len(signal) != len(layout.names) or not np.isfinite(signal).all():
        raise errors.InputError(
            f"patches of shape {signal.shape} were given; give finite signals "
            f"({len(layout.names)}, K), one row per patch, {layout.names[0]} first, "
            f"{layout.names[-1]} last")
    error = None
    if patch_errors is not None:
        error = arguments.as_numbers(patch_errors, "patch_errors")
        if error.shape != signal.shape or not np.all(error >= 0):
            raise errors.InputError(f"patch_errors of shape {error.shape} were given; give "
                                    f"standard errors {signal.shape} of 0 or more")
    return camera_files.signals_of_patches(
        "the array of patches", signal, error, spectra.default_band_names(signal.shape[1]),
        np.zeros(signal.shape))
