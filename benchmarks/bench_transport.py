"""The traced transport against Mitsuba's own renderings: bias and Z-test, by ``specfilm`` and by 31
monochrome images.

A Cornell box of three chart colours, 4 x 4 blocks of a 32 x 32 image, three bands. Every renderer
runs several times with other seeds; the scatter of the runs gives the standard errors. The
threshold of the largest |Z| is the 1 % level of Student's law, Sidak-corrected for the number of
blocks and bands. Mitsuba draws with its ``independent`` sampler, since ``ldsampler`` is low by 0.3
% (docs/explanation/reconstruction.md). "Bias at most": largest |bias| plus 2.33 standard errors.
"""
from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
from scipy.stats import t as student

from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.interreflection import response_matrix, signal
from spectrabox.reconstruct.rendering.llvm import ensure_llvm
from spectrabox.reconstruct.rendering.renderer import all_cores, load_scene, render, start_mitsuba
from spectrabox.reconstruct.view import PhotoView

from benchmarks.bench_inversion import cornell_view, traced
from benchmarks.paper.per_wavelength import VARIANT, WAVELENGTHS, monochrome_xml

WIDTH, BLOCK, BOUNCES, LEVEL = 32, 8, 6, 0.01


def blocks(image: np.ndarray) -> np.ndarray:
    """Means (n, n, K) over blocks of an image (H, W, K)."""
    count = WIDTH // BLOCK
    return image.reshape(count, BLOCK, count, BLOCK, -1).mean(axis=(1, 3))


def by_transport(view: PhotoView, spectra: np.ndarray, response: np.ndarray, runs: int,
                 spp: int) -> np.ndarray:
    """Block means (runs, n, n, K) of the traced transport, for any response (K, P) and spectra (M,
    P).
    """
    pixels = np.arange(WIDTH * WIDTH).reshape(WIDTH, WIDTH)
    found = (traced(view, pixels, spp, 500 + run, passes=1) for run in range(runs))
    return np.array([blocks(signal(one.coefficients, one.exponents, spectra,
                                   response).reshape(WIDTH, WIDTH, -1))
                     for one in found])


def by_film(view: PhotoView, spectra: np.ndarray, runs: int, spp: int) -> np.ndarray:
    """The same of Mitsuba's path integrator with its spectral film."""
    names = [material.bsdf for material in view.scene_materials]
    scene = load_scene(view.xml(dict(zip(names, spectra, strict=True)), integrator="path"))
    with all_cores():
        return np.array([blocks(render(scene, spp, 900 + run)[0]) for run in range(runs)])


def by_wavelengths(job: tuple[str, tuple[str, ...], np.ndarray, np.ndarray, int,
                              int]) -> np.ndarray:
    """The same of one monochrome rendering per wavelength; runs in a process of its own."""
    xml, bsdfs, spectra, response, runs, spp = job
    ensure_llvm()
    import mitsuba as mi

    mi.set_variant(VARIANT)
    scene = mi.load_string(xml.replace('type="prb"', 'type="path"'), optimize=False)
    parameters = mi.traverse(scene)
    keys = [f"{bsdf}.reflectance.value" for bsdf in bsdfs]
    images = np.zeros((runs, WIDTH, WIDTH, len(response)))
    for wavelength in range(spectra.shape[1]):
        for key, values in zip(keys, spectra, strict=True):
            parameters[key] = mi.Float(float(values[wavelength]))
        parameters.update()
        for run in range(runs):
            plane = np.array(mi.render(scene, spp=spp, seed=run * WAVELENGTHS + wavelength))[:, :,
                                                                                             :1]
            images[run] += plane * response[:, wavelength]
    return np.array([blocks(image) for image in images])


def compared(ours: np.ndarray, theirs: np.ndarray) -> dict[str, Any]:
    """Bias of the whole image per band with its standard error, and the largest |Z| with its
    threshold.
    """
    error = np.sqrt(ours.var(axis=0, ddof=1) / len(ours) + theirs.var(axis=0, ddof=1) / len(theirs))
    z = np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) / error
    whole = [image.mean(axis=(1, 2)) for image in (ours, theirs)]
    mean = whole[1].mean(axis=0)
    bias = whole[0].mean(axis=0) / mean - 1
    bias_error = np.sqrt(sum(part.var(axis=0, ddof=1) / len(part) for part in whole)) / mean
    level = 1 - (1 - LEVEL) ** (1 / z.size)
    threshold = student.isf(level / 2, len(ours) + len(theirs) - 2)
    return {"bias": bias.tolist(), "bias_standard_error": bias_error.tolist(),
            "bias_at_most": float((np.abs(bias) + 2.33 * bias_error).max()),
            "largest_z": float(z.max()),
            "threshold_z": float(threshold), "agrees": bool(z.max() < threshold)}


def print_row(name: str, row: dict[str, Any]) -> None:
    bias = "  ".join(f"{100 * b:+.3f} ({100 * e:.3f})"
                     for b, e in zip(row["bias"], row["bias_standard_error"], strict=True))
    print(f"{name:<12} {bias:<48} {100 * row['bias_at_most']:11.3f}% {row['largest_z']:11.2f} "
          f"{row['threshold_z']:10.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=16, help="of each renderer")
    parser.add_argument("--spp", type=int, default=4096,
                        help="paths per pixel and run; an eighth per wavelength")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    start_mitsuba("cpu")
    judged = cornell_view(WIDTH, BOUNCES, False, 1024)
    view, truth = judged.view, judged.truth
    if not arguments.json:
        print(f"{'against':<12} {'bias R, G, B (standard error) %':<48} {'bias at most':>12} "
              f"{'largest |Z|':>11} {'1 % level':>10}", flush=True)
    start = time.perf_counter()
    ours = by_transport(view, truth, view.response, arguments.runs, arguments.spp)
    seconds = time.perf_counter() - start
    film = compared(ours, by_film(view, truth, arguments.runs, arguments.spp))
    if not arguments.json:
        print_row("specfilm", film)
    grid = grid_from_nm(np.linspace(400, 700, WAVELENGTHS))
    coarse = np.array([np.interp(grid.nm, view.grid.nm, row) for row in truth])
    curves = np.array([np.interp(grid.nm, view.grid.nm, row) for row in view.sensitivities])
    response = response_matrix(grid, curves, np.ones(grid.nm.size))
    bsdfs = tuple(material.bsdf for material in view.scene_materials)
    job = (monochrome_xml(view), bsdfs, coarse, response, arguments.runs,
           max(arguments.spp // 8, 1))
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        mono = pool.submit(by_wavelengths, job).result()
    same = by_transport(view, coarse, response, arguments.runs, arguments.spp)
    row = compared(same, mono)
    if arguments.json:
        print(json.dumps({"specfilm": film, "monochrome": row, "transport_seconds": seconds,
                          "runs": arguments.runs, "spp": arguments.spp}))
        return
    print_row("monochrome", row)


if __name__ == "__main__":
    main()
