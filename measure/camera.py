"""A camera from photos of a chart and the spectrum of its light.

``measure_chart`` takes the patches from a photo, ``fit_camera`` fits the curves with their band and
checks them on patches that no fit saw, ``camera_profile`` gives the matrices that other programs
take. Files are read and written by the callers.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spectrabox.calibrate.camera_profile import ILLUMINANTS, IlluminantMatrices, matrices, target
from spectrabox.calibrate.chart_calibration import (
    CalibrationOptions,
    ChartCalibration,
    ChartPhoto,
    CurveBand,
    calibrate_chart,
    camera_curves,
    curve_band,
    log_evidence,
)
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.capture.chart.chart_agreement import TYPICAL_SIGNALS
from spectrabox.capture.chart.detection import find_chart
from spectrabox.capture.chart.patches import require_unclipped, sample_patches
from spectrabox.measure.chart_check import held_out_patches
from spectrabox.radiometry.chart import Chart, typical_camera_signals
from spectrabox.radiometry.charts.references import published_signals
from spectrabox.radiometry.colour_science import aces_idt
from spectrabox.radiometry.records import (
    HeldOutPatches,
    LinearImage,
    PatchSamples,
    SensitivityFit,
    WavelengthGrid,
)
from spectrabox.radiometry.spectra.named_spectra import test_reflectances

FITTED_SET, FRESH_SET = "BabelColor Average", "CES99"   # the second is never seen by the fit
# nats, for another generation of a chart than the usual: charts that are of neither, and photos of
# one chart, scatter by 4 to 6 (docs/results/calibration.md)
DECISIVE = 7.0
MAX_IDT_DRAWS = 25          # an ACES matrix takes a search for each


def chart_signals(chart: Chart, reflectances: np.ndarray | None,
                  grid: WavelengthGrid) -> np.ndarray:
    """Signals (I, 3) by which a chart is known in a photo whose light is not.

    Parameters
    ----------
    chart : Chart
    reflectances : (I, P) array or None
        On ``grid``; None for a chart whose published colours are known.
    grid : WavelengthGrid
    """
    if chart.references:
        return TYPICAL_SIGNALS
    return (published_signals(chart, grid) if reflectances is None
            else typical_camera_signals(reflectances, grid))


def measure_chart(photo: LinearImage, chart: Chart, reflectances: np.ndarray, grid: WavelengthGrid,
                  corners_px: np.ndarray | None = None) -> PatchSamples:
    """Signals of the patches of a chart in a photo.

    Parameters
    ----------
    photo : LinearImage
    chart : Chart
    reflectances : (I, P) array
        Of the chart, on ``grid``.
    grid : WavelengthGrid
    corners_px : (4, 2) array or None
        Of the chart, in pixels of the photo; None to search for it.

    Raises
    ------
    ChartNotFoundError, CheckError
        As ``find_chart``.
    ClippedPhotoError
        If more than a few patches are saturated.
    """
    reference = chart_signals(chart, reflectances, grid)
    samples = sample_patches(photo, find_chart(photo, reference, corners_px, chart))
    require_unclipped(samples, chart.names, photo.source, chart.neutrals)
    return samples


@dataclass(frozen=True)
class ChartGeneration:
    """Which of the generations a chart is of, by the evidence of its photos."""

    reference: str                      # that the fit takes
    log_evidence: dict[str, float]      # of each, in nats over the first

    @property
    def words(self) -> str:
        """One sentence for an operator."""
        first, *_ = self.log_evidence
        other = max((name for name in self.log_evidence if name != self.reference),
                    key=lambda name: self.log_evidence[name])
        gain = self.log_evidence[self.reference] - self.log_evidence[other]
        if gain > DECISIVE:
            return (f"chart reference {self.reference}: explains the chart better than {other}, by "
                    f"{gain:.0f} nats")
        return (f"chart reference {first}: the photo does not tell it from {other} "
                f"({abs(gain):.0f} nats {'for' if gain > 0 else 'against'} it); measure your chart "
                "and give its file as reference")


@dataclass(frozen=True)
class CameraFit:
    """A camera's curves with everything that led to them.

    ``chart`` holds those that belong to the stated light, ``sensitivity`` the camera's own.
    """

    chart: ChartCalibration
    sensitivity: SensitivityFit
    band: CurveBand | None          # None for measured curves
    held_out: HeldOutPatches        # of the first photo, each by a calibration without it
    generation: ChartGeneration | None = None   # of the chart; None where it was stated


def fit_camera(photos: Sequence[ChartPhoto], grid: WavelengthGrid,
               options: CalibrationOptions | None = None, seed: int = 0,
               generations: Mapping[str, np.ndarray] | None = None) -> CameraFit:
    """Sensitivities of a camera from chart photos and the spectra of their lights.

    Parameters
    ----------
    photos : sequence of ChartPhoto
        By one camera.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    options : CalibrationOptions or None
        None takes the defaults.
    seed : int
        Of the draws of the curves.
    generations : mapping of (I, P) arrays or None
        Reflectances that the chart of all photos may have, by name, the usual ones first: those
        that explain the photos best are taken, with the method ``prior``. None: those of the
        photos.

    Raises
    ------
    InputError, CheckError, CalibrationError
        As ``calibrate_chart``.
    """
    chosen = CalibrationOptions() if options is None else options
    generation = None
    if generations and chosen.method == "prior" and chosen.curves is None:
        generation = _generation(photos, grid, chosen.prior, generations)
        photos = _with_reflectances(photos, generations[generation.reference])
    calibrated = calibrate_chart(photos, grid, options)
    return CameraFit(calibrated, camera_curves(calibrated), curve_band(calibrated, seed),
                     held_out_patches(calibrated, photos[0].reflectances), generation)


def _generation(photos: Sequence[ChartPhoto], grid: WavelengthGrid, prior: CameraPrior | None,
                generations: Mapping[str, np.ndarray]) -> ChartGeneration:
    """The usual one, unless the photos are decisively for another."""
    evidence = {name: log_evidence(_with_reflectances(photos, reflectances), grid, prior)
                for name, reflectances in generations.items()}
    first, *_ = evidence
    best = max(evidence, key=lambda name: evidence[name])
    return ChartGeneration(best if evidence[best] - evidence[first] > DECISIVE else first,
                           {name: value - evidence[first] for name, value in evidence.items()})


def _with_reflectances(photos: Sequence[ChartPhoto], reflectances: np.ndarray) -> list[ChartPhoto]:
    return [replace(photo, reflectances=reflectances) for photo in photos]


@dataclass(frozen=True)
class CameraProfile:
    """Matrices of a camera for other programs, each with those of draws of its curves."""

    matrices: dict[str, IlluminantMatrices]                     # by illuminant
    drawn: dict[str, tuple[IlluminantMatrices, ...]]
    aces: tuple[np.ndarray, np.ndarray]                         # matrix (3, 3), white balance (3,)
    aces_drawn: tuple[tuple[np.ndarray, np.ndarray], ...]


def camera_profile(curves: np.ndarray, grid: WavelengthGrid, idt_light: str,
                   draws: np.ndarray | None = None) -> CameraProfile:
    """Colour matrices (DNG, ACES) of a camera.

    Parameters
    ----------
    curves : (3, P) array
        Sensitivities R, G, B on ``grid``, of any scale.
    grid : WavelengthGrid
    idt_light : str
        CIE name, of the ACES matrix.
    draws : (T, 3, P) array or None
        Of the curves, for the spread of every number.
    """
    each = () if draws is None else tuple(draws)
    sets = test_reflectances(grid)
    targets = {name: target(name, grid, sets[FITTED_SET], (sets[FITTED_SET], sets[FRESH_SET]))
               for name in ILLUMINANTS}
    return CameraProfile(
        {name: matrices(curves, aim) for name, aim in targets.items()},
        {name: tuple(matrices(draw, aim) for draw in each) for name, aim in targets.items()},
        aces_idt(grid.nm, curves, idt_light),
        tuple(aces_idt(grid.nm, draw, idt_light) for draw in each[:MAX_IDT_DRAWS]))
