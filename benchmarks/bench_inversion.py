"""Inversion of a Cornell box: one traced light transport against gradient descent and against the
brute force.

Three unknown materials, 7 coefficients each, 64 x 64 pixels, 6 bounces, all in one run. The photo
is made of the true spectra with at least 4096 paths per pixel that no engine sees; the image error
is that of the same paths with the found spectra, root mean square over the surfaces, relative to
the mean (bench_transport.py holds such an image against Mitsuba's spectral film). Seeds scatter
widely: medians are over 7 seeds of the transport engine and 3 of the gradient engine, which takes
exactly ``--steps`` steps with a step size that falls over all of them, the best of the schedules
tried. ``--large``: 5 materials, 8 bounces, 256 x 256 pixels.

The transport engine's trace may use every core, since its sums are the same in any order; the
gradient engine's gradients are not, so it keeps to one. ``--cores 1`` holds both to one.

The per-wavelength engine gets one path per pixel, wavelength and step, which favours it: 16 times
fewer per image than the others. One step in 20 is run, the time multiplied by 20; the error is that
of the steps that ran.
"""
from __future__ import annotations

import argparse
import json
import os
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import colour
import numpy as np

from spectrabox.fixtures.cornell_box import BLOCKS, MATERIALS, cornell_box_xml
from spectrabox.radiometry.chart import PATCH_NAMES, chart_reflectances
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.interreflection import band_products, exponents_up_to, signal
from spectrabox.radiometry.records.calibration import Calibration, LightScale, SensitivityFit
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind
from spectrabox.radiometry.records.spectra import Outcome, Quantity, Spectrum, WavelengthGrid
from spectrabox.reconstruct import gradient_engine as gradient
from spectrabox.reconstruct.fit.transport_fit import TracedView, fit_traced, smooth_prior
from spectrabox.reconstruct.fit.view_terms import Nuisances
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.scene.surfaces import block_regions
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.tracer.transport import TracedTransport, shaded_images, trace_transport
from spectrabox.reconstruct.transport_engine import unit_scene
from spectrabox.reconstruct.view import MaterialSpec, PhotoView

from benchmarks.paper.per_wavelength import descend, monochrome_job

COEFFICIENTS, STEPS, GRADIENT_SPP, TRACE_SPP, PHOTO_SPP = 7, 200, 16, 64, 4096
SHORTER = 20            # the per-wavelength engine runs this share of the steps
RUNS = 7                # of the transport engine, each with another seed; medians are printed
GRADIENT_SEEDS = (3, 4, 5)
PATCHES = {"white": "white 9.5", "green": "green", "red": "red", "small": "blue",
           "large": "orange yellow"}


@dataclass(frozen=True)
class Judged:
    """An inversion with the truth and the paths that made its photo."""

    view: PhotoView
    truth: np.ndarray               # (M, P)
    judge: TracedTransport          # of the pixels that one surface fills


def cornell_view(width: int, bounces: int, blocks: bool, photo_spp: int) -> Judged:
    """The inversion of a box with chart colours on its walls, under a constant light, and the paths
    of its photo.
    """
    view = box_view(width, bounces, blocks)
    truth = true_spectra(view)
    one_surface = view.surface >= 0
    region = np.where(one_surface, np.cumsum(one_surface.ravel()).reshape(width, width) - 1, -1)
    judge = traced(view, region, photo_spp, 77, passes=1)
    photo = np.zeros((width, width, 3))
    photo[one_surface] = signal(judge.coefficients, judge.exponents, truth, view.response)
    return Judged(box_view(width, bounces, blocks, photo), truth, judge)


def box_view(width: int, bounces: int, blocks: bool,
                photo: np.ndarray | None = None) -> PhotoView:
    """The box, whose photo (H, W, 3) is blank where none is given."""
    names = (*MATERIALS, *(BLOCKS if blocks else ()))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cornell.xml"
        path.write_text(cornell_box_xml(width, bounces + 1, blocks), encoding="utf-8")
        scene_file = read_scene(path)
    shape = (width, width, 3)
    image = LinearImage(np.ones(shape, np.float32) if photo is None else photo.astype(np.float32),
                        np.full(shape, 1e-12), np.zeros(shape, bool), 1.0, None, None, None,
                        PhotoKind.LINEAR_FILE, "", "rendered", "")
    return PhotoView("photo", scene_file, image, measured_camera(visible_grid()), ("R", "G", "B"),
                     tuple(MaterialSpec(name, name) for name in names),
                     LightScale(1.0, None, None, "given"))


def true_spectra(view: PhotoView) -> np.ndarray:
    """Chart colours (M, P) of the view's materials."""
    chart = chart_reflectances("BabelColor Average", view.grid)
    return np.array([chart[PATCH_NAMES.index(PATCHES[material.name])]
                     for material in view.scene_materials])


def measured_camera(grid: WavelengthGrid) -> Calibration:
    """A measured camera under a constant light, without error."""
    camera = colour.MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    curves = np.array([np.interp(grid.nm, camera.wavelengths, curve) for curve in camera.values.T])
    light = Spectrum(grid, np.ones(grid.nm.size), Quantity.RADIANCE, "constant")
    fit = SensitivityFit(grid, curves / curves.max(), None, None, None, None, None, None, None,
                         "measured", Outcome.CONVERGED)
    return Calibration(fit, light, None, np.zeros((3, 3)), ())


def traced(view: PhotoView, region: np.ndarray, spp: int, seed: int,
           passes: int = 4) -> TracedTransport:
    """Transport of the regions with the scene's own number of bounces."""
    return trace_transport(unit_scene(view, view.scene_file.max_depth - 1), region, spp=spp,
                           seed=seed, passes=passes)


def by_transport(view: PhotoView, seed: int = 5) -> tuple[np.ndarray, float, float]:
    """Coefficients, seconds of tracing and seconds of fitting; the scene is loaded within the
    time.
    """
    start = time.perf_counter()
    region, group = block_regions(view.surface, view.used)
    transport = traced(view, region, TRACE_SPP, seed)
    between = time.perf_counter()
    fit = fit_traced([TracedView(view, transport, region, group, Nuisances(scale=1.0))],
                     [smooth_prior(COEFFICIENTS, 0.1)] * len(view.unknown))
    return fit.coefficients, between - start, time.perf_counter() - between


def by_gradient(view: PhotoView, steps: int, seed: int = 3) -> tuple[np.ndarray, float]:
    """Coefficients and seconds of the paper's method: Adam through differentiable rendering,
    ``steps`` steps.
    """
    # no stop by itself; the step size falls from first to last
    gradient.WINDOW, gradient.TAIL = steps + 1, 1.0
    start = time.perf_counter()
    tail, _, _, _ = gradient.fit_by_gradient(
        view, InversionSettings(COEFFICIENTS, steps, GRADIENT_SPP, seed), lambda done, what: None)
    return tail.mean(axis=0), time.perf_counter() - start


def by_wavelengths(view: PhotoView, steps: int) -> tuple[np.ndarray, float]:
    """Coefficients and seconds of one monochrome rendering per wavelength and step; its process
    starts in the time.
    """
    start = time.perf_counter()
    coefficients = descend(monochrome_job(view, InversionSettings(COEFFICIENTS, steps, 1, 3)))
    return coefficients, time.perf_counter() - start


def errors(judged: Judged, coefficients: np.ndarray) -> dict[str, Any]:
    """Relative image error on the surfaces (lamp left out), and each spectrum's RMSE."""
    spectra, judge = judged.view.spectra(coefficients), judged.judge
    reflected = judge.coefficients * (judge.exponents.sum(axis=1) > 0)
    true, found = (signal(reflected, judge.exponents, rows, judged.view.response)
                   for rows in (judged.truth, spectra))
    rmse = np.sqrt(np.mean((spectra - judged.truth) ** 2, axis=1))
    return {"image_error": float(np.sqrt(np.mean((found - true) ** 2)) / true.mean()),
            "rmse": rmse.tolist()}


def median_errors(judged: Judged, found: list[np.ndarray]) -> dict[str, Any]:
    """Medians of ``errors`` over inversions with different seeds, and the image error of each."""
    scored = [errors(judged, coefficients) for coefficients in found]
    return {"image_error": float(np.median([score["image_error"] for score in scored])),
            "image_errors": [score["image_error"] for score in scored],
            "rmse": np.median([score["rmse"] for score in scored], axis=0).tolist()}


def small(steps: int) -> dict[str, Any]:
    """The three engines on the box of three materials."""
    judged = cornell_view(64, 6, False, PHOTO_SPP)
    view = judged.view
    _, cold_trace, cold_fit = by_transport(view)
    runs = [by_transport(view, seed) for seed in range(RUNS)]
    ours = {"trace_s": float(np.median([run[1] for run in runs])),
            "fit_s": float(np.median([run[2] for run in runs])), "first_call_s": cold_trace
            + cold_fit, "seconds": float(np.median([run[1] + run[2] for run in runs])),
            **median_errors(judged, [run[0] for run in runs])}
    by_gradient(view, 4)  # compiles its kernels, which are not counted
    descents = [by_gradient(view, steps, seed) for seed in GRADIENT_SEEDS]
    descended = {"seconds": float(np.median([run[1] for run in descents])),
                 **median_errors(judged, [run[0] for run in descents])}
    few = max(steps // SHORTER, 1)
    coefficients, seconds = by_wavelengths(view, few)
    brute = {"seconds": seconds * steps / few, "steps_run": few, **errors(judged, coefficients)}
    return {"transport": ours, "gradient": descended, "per_wavelength": brute,
            "ratio_gradient": descended["seconds"] / ours["seconds"],
            "ratio_per_wavelength": brute["seconds"] / ours["seconds"],
            "error_ratio_gradient": descended["image_error"] / ours["image_error"],
            "error_ratio_per_wavelength": brute["image_error"] / ours["image_error"]}


def large() -> dict[str, Any]:
    """Trace and fit of five materials, eight bounces, 256 x 256 pixels."""
    blank = box_view(256, 8, True)
    truth = true_spectra(blank)
    exponents = exponents_up_to(len(truth), 8)
    photo, = shaded_images(unit_scene(blank, 8), exponents,
                           band_products(exponents, truth, blank.response), spp=64, seed=77)
    view = box_view(256, 8, True, photo)
    coefficients, trace_s, fit_s = by_transport(view)
    rmse = np.sqrt(np.mean((view.spectra(coefficients) - truth) ** 2, axis=1))
    return {"trace_s": trace_s, "fit_s": fit_s, "seconds": trace_s + fit_s, "rmse": rmse.tolist(),
            "process_peak_gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=STEPS, help="of the two descents")
    parser.add_argument("--large", action="store_true",
                        help="only the larger box: 5 materials, 8 bounces, 256 x 256")
    parser.add_argument("--cores", type=int,
                        help="that the trace may use; all of this process without it")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    if arguments.cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:arguments.cores])
    start_mitsuba("cpu")
    result = large() if arguments.large else small(arguments.steps)
    if arguments.json:
        print(json.dumps(result))
        return
    if arguments.large:
        print(f"5 materials, 8 bounces, 256 x 256: trace {result['trace_s']:.1f} s, fit "
              f"{result['fit_s']:.1f} s, peak of the whole process "
              f"{result['process_peak_gib']:.2f} GiB")
        return
    print(f"{'engine':<16} {'seconds':>8} {'ratio':>7} {'image error':>12}   spectra RMSE")
    for name, key in (("transport", None), ("gradient", "ratio_gradient"),
                      ("per_wavelength", "ratio_per_wavelength")):
        row = result[name]
        print(f"{name:<16} {row['seconds']:8.2f} {result[key] if key else 1:7.0f} "
              f"{row['image_error']:12.2%}   "
              + " ".join(f"{value:.3f}" for value in row["rmse"]))
    ours = result["transport"]
    print(f"transport: trace {ours['trace_s']:.3f} s, fit {ours['fit_s']:.3f} s, first call in a "
          f"process {ours['first_call_s']:.2f} s")
    for name in ("transport", "gradient"):
        print(f"{name}: image errors", *(f"{value:.2%}" for value in result[name]["image_errors"]))


if __name__ == "__main__":
    main()
