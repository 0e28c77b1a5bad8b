"""A synthetic finished session: records that hang together, made from a fixed seed, small enough
for tests.
"""
from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from matplotlib import image as raster
from small_captures import scene_capture, scene_view

from spectrabox.measure.captured import InputFile, SceneCapture
from spectrabox.measure.records import ChartFit, MeasuredChart
from spectrabox.measure.results.scene_result import SceneResult
from spectrabox.measure.results.surface_result import SurfaceResult
from spectrabox.radiometry.error_model import (
    DISAGREEMENT,
    LIGHT_SPECTRUM,
    RENDERING_NOISE,
    SENSITIVITIES,
)
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import basis_matrix, visible_grid
from spectrabox.radiometry.records.calibration import Calibration, LightScale, SensitivityFit
from spectrabox.radiometry.records.photos import (
    ChartDetection,
    LinearImage,
    PatchSamples,
    PhotoKind,
)
from spectrabox.radiometry.records.scenes import Reconstruction, SurfaceAgreement
from spectrabox.radiometry.records.spectra import (
    Outcome,
    Quantity,
    Spectrum,
    SpectrumSamples,
    SpectrumSummary,
    SurfaceSignals,
)
from spectrabox.session.outputs.session_results import SessionResults, UsedFile

GIVEN_CORNERS = Finding("chart.corners-given", Severity.INFO)
GRID = visible_grid(5.0)
COEFFICIENTS = 12
BASIS = basis_matrix(GRID.nm, COEFFICIENTS)
HEIGHT, WIDTH = 36, 48
# painted in this order
SURFACES = ("back wall", "left wall", "right wall", "floor", "tall box / front")
WORST_RATIO = 1.13  # photo / rendering on the left wall in the first band


def example_session(folder: Path, bands: tuple[str, ...] = ("R", "G", "B"), chart: bool = True,
                    truth: bool = True, materials: tuple[str, ...] = ("white", "red paint",
                                                                      "green paint"),
                    name: str = "Yellow box",
                    notes: str = "Second session of the day.") -> SessionResults:
    """A session of a box with a back wall, two side walls, a floor and a box; the last material is
    a given one.
    """
    rng = np.random.default_rng(5)
    made = _reconstruction(rng, len(bands), materials)
    fit = _sensitivity(rng, len(bands), chart)
    light = Spectrum(GRID, 0.8 + 0.3 * np.sin(GRID.nm / 60), Quantity.RELATIVE,
                     "reading of the lamp on a white tile", np.full(GRID.nm.size, 0.01))
    raster.imsave(folder / "overlay.png", rng.uniform(size=(40, 60, 3)))
    preview = np.clip(made.measured[..., :3] * 1.6, 0, 1)
    raster.imsave(folder / "preview.png", preview.repeat(4, 0).repeat(4, 1))
    fitted, measured = _chart(rng, len(bands), _photo(made)) if chart else (None, None)
    found = SceneResult(
        bands=bands, chart=fitted, measured_chart=measured,
        calibration=Calibration(fit, light, made.light_scale, np.eye(len(bands)) * 1e-4, (
            Finding("calibration.condition-number", Severity.INFO, values={"value": 12.5}),)),
        photo_of_view={"": _photo(made)}, grid=GRID, reconstruction=made,
        surfaces=tuple(_surface(rng, made, m, bands, truth) for m in range(len(materials))),
        signal_bands=bands, stated=stated_scene())
    return SessionResults(
        found=found, folder=folder, name=name, operator="A. Operator", notes=notes,
        inputs=(UsedFile("object photo", "photos/scene.dng", "9f" * 32, 25_000_123, 1 / 60, 0.004,
                         {"iso": 100.0, "camera": "Maker Model 1234"}),
                UsedFile("light", "spectra/lamp.csv", "0a" * 32, 4321)),
        sensitivity_truth=(GRID.nm, fit.curves * 0.98) if truth else None,
        previews={"": folder / "preview.png"}, chart_overlay=folder / "overlay.png",
        stages=(("chart", 2.31, "run"), ("sample", 0.8, "kept")),
        provenance={"spectrabox": "0.1.0", "numpy": np.__version__,
                    "command": "spectrabox run session", "seed": 7,
                    "machine": {"cores": 2, "gpu": False}})


def stated_scene(moved: str = "", **fields: object) -> SceneCapture:
    """A scene with a flat field whose chart has a photo of its own; nothing else is stated."""
    return scene_capture(scene_view(chart="chart.dng", moved=moved), **fields,
                         flat_fields={"": InputFile("white.dng", Path("white.dng"))})


def with_found(results: SessionResults, **changes: object) -> SessionResults:
    """The session with other fields of what was found."""
    return dataclasses.replace(results, found=dataclasses.replace(results.found, **changes))


def _spectra(count: int) -> np.ndarray:
    steps = 1 / (1 + np.exp(-(GRID.nm - 590) / 14))
    bump = np.exp(-((GRID.nm - 535) / 45) ** 2)
    base = [0.74 + 0.05 * steps, 0.06 + 0.62 * steps, 0.08 + 0.45 * bump]
    return np.array([base[m % 3] for m in range(count)])


def _sensitivity(rng: np.random.Generator, bands: int, chart: bool) -> SensitivityFit:
    peaks = np.linspace(610, 450, bands)
    curves = np.exp(-((GRID.nm - peaks[:, None]) / 38) ** 2) * np.linspace(0.8, 1, bands)[:, None]
    curves /= curves.max()
    residuals = rng.normal(0, 0.009, (24, bands)) if chart else None
    return SensitivityFit(
        GRID, curves, None, None, None, 0.01 + 0.02 * curves if chart else None, residuals,
        None if residuals is None else 1.7 * residuals, 41.2 if chart else None,
        "smooth spline fit to the 24 chart patches" if chart
        else "measured with a monochromator, read from camera.csv", Outcome.CONVERGED)


def _reconstruction(rng: np.random.Generator, bands: int,
                    materials: tuple[str, ...]) -> Reconstruction:
    surface = np.full((HEIGHT, WIDTH), 0)
    column, row = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    surface[column < 0.25 * WIDTH], surface[column > 0.75 * WIDTH] = 1, 2
    surface[row > 0.72 * HEIGHT] = 3
    surface[(abs(column - 28) < 6) & (abs(row - 22) < 9)] = 4
    surface[:, [12, 36]] = -1
    ratio = 1 + rng.normal(0, 0.006, (len(SURFACES), bands))
    ratio[1, 0] = WORST_RATIO
    signal = rng.uniform(0.15, 0.5, (len(SURFACES) + 1, bands))
    rendered = signal[surface] * (1 - 0.3 * row / HEIGHT)[..., None]
    measured = rendered * np.r_[ratio, np.ones((1, bands))][surface] * rng.normal(1, 0.01,
                                                                                  (HEIGHT, WIDTH,
                                                                                   bands))
    count = len(materials)
    known = tuple(m == count - 1 for m in range(count))
    return Reconstruction(
        materials, known, GRID, BASIS, np.full((count, COEFFICIENTS), 0.5), _spectra(count),
        np.full(bands, 1.0), rng.uniform(0.1, 0.8, (count, bands)),
        np.array([np.eye(bands) * 1e-5] * count),
        np.array([np.eye(bands) * 4e-5] * count), measured, rendered, surface >= 0, surface,
        SurfaceAgreement(SURFACES, tuple(materials[s % count] for s in range(len(SURFACES))),
                         np.array([(surface == s).sum() for s in range(len(SURFACES))]), ratio,
                         np.full((len(SURFACES), bands), 0.012)),
        LightScale(0.8123, 0.0042, None, "chart photo, exposure ratio applied"),
        3e-2 * 0.8 ** np.arange(40.0) + 1e-5, "transport", 256, 7, Outcome.CONVERGED)


def _photo(made: Reconstruction) -> LinearImage:
    saturated = np.zeros(made.measured.shape, dtype=bool)
    saturated[:2, :3] = True
    return LinearImage(made.measured, made.measured * 1e-4, saturated, 40.0, 1 / 60, 100.0, 8.0,
                       PhotoKind.RAW,
                       "Maker Model 1234", "photos/scene.dng", "9f" * 32)


def _chart(rng: np.random.Generator, bands: int,
           photo: LinearImage) -> tuple[ChartFit, MeasuredChart]:
    measured = rng.uniform(0.03, 0.6, (24, bands))
    measured[18:] = np.array([0.62, 0.41, 0.25, 0.14, 0.06, 0.022])[:, None]
    corners = np.zeros((24, 4, 2)) + np.array([[0, 0], [9, 0], [9, 9], [0, 9]])
    samples = PatchSamples(measured, np.array([np.eye(bands) * 1e-7] * 24), np.full(24, 400),
                           np.zeros((24, bands)), np.full((24, bands), 0.01))
    fall_off = np.linspace(1, 0.88, 6) * np.linspace(1, 0.96, 4)[:, None]
    chart = MeasuredChart(ChartDetection(corners, 0.97, False, GIVEN_CORNERS), samples, photo,
                          np.ones(24))
    return ChartFit(measured * rng.normal(1, 0.01, measured.shape), fall_off.ravel()), chart


def _surface(rng: np.random.Generator, made: Reconstruction, m: int, bands: tuple[str, ...],
             truth: bool) -> SurfaceResult:
    name, estimate = made.materials[m], made.spectra[m]
    measured = Spectrum(GRID, np.clip(estimate + 0.012 * np.cos(GRID.nm / 25), 0, 1),
                        Quantity.REFLECTANCE, "spectroradiometer") if truth else None
    level = made.signal[m]
    errors = {RENDERING_NOISE: made.signal_covariance[m],
              DISAGREEMENT: made.model_covariance[m] * np.outer(level, level),
              **{cause: np.diag((rng.uniform(0.2, 1) * size * level)**2) for cause, size
                 in {SENSITIVITIES: 8e-3, LIGHT_SPECTRUM: 5e-3}.items()}}
    signals = SurfaceSignals(
        (name,), (bool(made.known[m]),), GRID, estimate[None], bands, np.zeros(len(bands), int),
        np.tile(1 / GRID.nm.size, (len(bands), GRID.nm.size)), level[None],
        {cause: covariance[None] for cause, covariance in errors.items()})
    if made.known[m]:
        return SurfaceResult(name, None, given=(GRID.nm, estimate), signals=signals, truth=measured)
    centre = np.linalg.lstsq(BASIS, estimate, rcond=None)[0]
    coefficients = np.clip(centre + rng.normal(0, 0.06, (200, COEFFICIENTS)), 0, 1)
    draws = coefficients @ BASIS.T
    lower, upper = np.quantile(draws, [0.025, 0.975], axis=0)
    samples = SpectrumSamples(GRID, draws, coefficients, "hit-and-run", 180.0, 7,
                              Outcome.EXACT, (Outcome.EXACT.finding(),))
    summary = SpectrumSummary(GRID, draws.mean(axis=0), draws.std(axis=0), lower, upper,
                              np.clip(lower - 0.12, 0, 1), np.clip(upper + 0.12, 0, 1), 0.95,
                              (Finding("band.sampler", Severity.INFO, values={
                                  "method": "hit-and-run", "coefficients": COEFFICIENTS}),),
                              423.0, samples)
    return SurfaceResult(name, summary, inverse_rendering=estimate, signals=signals, truth=measured)
