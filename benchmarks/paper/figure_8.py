"""Figure 8: the orange box in a Cornell box, from one photo in three bands against brute force at
31 wavelengths.

The brute force has a monochrome photo at each wavelength, and finds one reflectance for each by
Adam from black through Mitsuba's monochrome variant, as in the paper. Every third wavelength is
run, the time scaled to 31 and the RMSE taken at these. The three-band methods see one photo of a
measured camera. Times are the processor's: other work slows clocks.
"""
from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.fixtures.cornell_box import cornell_box_xml
from spectrabox.radiometry.chart import PATCH_NAMES, chart_reflectances
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.reconstruct.gradient_engine import LEARNING_RATE, START, cosine_rate
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.rendering.llvm import ensure_llvm
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.view import MaterialSpec, PhotoView
from spectrabox.sampling.draw_methods import draw_spectra
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior

from benchmarks.paper.per_wavelength import VARIANT, monochrome_xml
from benchmarks.paper.synthetic_photo import (
    BANDS,
    GRID,
    measured_camera,
    photograph,
    plain_settings,
    scene_of,
    spectrum_rmse,
)

WIDTH, BOUNCES, COEFFICIENTS, PHOTO_SPP, DRAWS = 32, 6, 7, 1024, 2000
PATCHES = {"white": "white 9.5", "green": "green", "red": "red", "small": "orange",
           "large": "white 9.5"}
STEPS, STEP_SPP = 120, 16
NM = np.linspace(400, 700, 11)
# at each wavelength; at 40 the overshoot of Adam was left. The last quarter is averaged
SINGLE_STEPS = 80


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("figure_8.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    start_mitsuba("cpu")
    table, curves = rows()
    picture(curves, arguments.out)
    if arguments.json:
        print(json.dumps({"rows": table, "picture": str(arguments.out)}))
        return
    print("Paper: brute force is more accurate and takes 7.1 times as long as the descent on three "
          "bands.")
    print(f"{'method':<52} {'photos':>6} {'steps':>6} {'RMSE':>7} {'CPU s':>8} "
          f"{'brute force / this':>18}")
    for row in table:
        print(f"{row['method']:<52} {row['photos']:6d} {row['steps']:6d} {row['rmse']:7.4f} "
              f"{row['seconds']:8.1f} {row['ratio']:18.1f}")


def rows() -> tuple[list[dict[str, Any]], dict[str, np.ndarray]]:
    """The table, and every spectrum by method."""
    chart, camera = chart_reflectances("BabelColor Average", GRID), measured_camera()
    truth = {bsdf: chart[PATCH_NAMES.index(patch)] for bsdf, patch in PATCHES.items()}
    box = scene_of(cornell_box_xml(WIDTH, BOUNCES + 1, painted_blocks=True))
    photo, scale = photograph(box, truth, camera, PHOTO_SPP), LightScale(1.0, None, None, "given")
    materials = tuple(MaterialSpec(bsdf, bsdf, None if bsdf == "small" else truth[bsdf])
                      for bsdf in PATCHES)
    view = PhotoView("photo", box, photo, camera, BANDS, materials, scale)
    curves, seconds, steps = {"truth": truth["small"]}, {}, {}
    orange = list(PATCHES).index("small")
    for engine, name in (("gradient", "paper: descent on three bands"),
                         ("transport", "ours: traced transport")):
        start = time.process_time()
        found = reconstruct(view, plain_settings(COEFFICIENTS, engine, STEPS, STEP_SPP),
                            lambda done, what: None)
        curves[name], seconds[name] = found.spectra[orange], time.process_time() - start
        response = camera.sensitivity.curves * GRID.weights_nm
        measurement = SpectralMeasurement(GRID, response / response.sum(axis=1, keepdims=True),
                                          found.signal[orange], np.zeros((3, 3)))
        method = "paper" if engine == "gradient" else "prior"
        draws = draw_spectra(measurement, method, DRAWS, 0, COEFFICIENTS, load_prior())
        then = f"{name}, then mean of {'its box' if method == 'paper' else 'the learnt prior'}"
        curves[then] = np.interp(GRID.nm, PRIOR_GRID.nm, draws.spectra.mean(axis=0))
        seconds[then] = time.process_time() - start
        if engine == "gradient":
            steps[name] = steps[then] = len(found.loss_history)
    at = np.array([np.interp(NM, GRID.nm, truth[bsdf]) for bsdf in PATCHES])
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        found_at, brute_s = pool.submit(brute_force, monochrome_xml(view), tuple(PATCHES), at,
                                        orange).result()
    brute_s *= 31 / NM.size
    name = "paper: brute force, 31 wavelengths"
    curves[name], seconds[name] = np.interp(GRID.nm, NM, found_at), brute_s
    steps[name] = 31 * SINGLE_STEPS
    table = [{"method": key, "photos": 31 if key == name else 1, "steps": steps.get(key, 0),
              "seconds": seconds[key], "rmse": spectrum_rmse(found_at, at[orange]) if key == name
              else spectrum_rmse(curve, truth["small"]), "ratio": brute_s / seconds[key]} for key,
             curve in curves.items() if key != "truth"]
    return table, curves


def brute_force(xml: str, bsdfs: tuple[str, ...], reflectances: np.ndarray,
                wanted: int) -> tuple[np.ndarray, float]:
    """Reflectance of one BSDF at each wavelength of NM, and seconds of finding all; in a process of
    its own.
    """
    ensure_llvm()
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(VARIANT)
    dr.set_thread_count(1)
    scene = mi.load_string(xml, optimize=False)
    parameters = mi.traverse(scene)
    keys = [next(key for key in parameters.keys()  # noqa: SIM118 - not a dict
                 if key.startswith(f"{bsdf}.") and key.endswith(".value")) for bsdf in bsdfs]
    found, seconds = [], 0.0
    for place, values in enumerate(reflectances.T):
        for key, value in zip(keys, values, strict=True):
            parameters[key] = mi.Float(float(value))
        parameters.update()
        photo = mi.TensorXf(np.array(mi.render(scene, spp=PHOTO_SPP, seed=900 + place)))
        start = time.process_time()
        steps = []
        optimizer = mi.ad.Adam(lr=LEARNING_RATE, params={keys[wanted]: mi.Float(START)})
        for step in range(SINGLE_STEPS):
            optimizer.set_learning_rate(LEARNING_RATE * cosine_rate(step / SINGLE_STEPS))
            parameters.update(optimizer)
            draw = 2 * (place * SINGLE_STEPS + step)
            image = mi.render(scene, parameters, spp=STEP_SPP, seed=draw, seed_grad=draw + 1)
            dr.backward(dr.mean(dr.square(image - photo), axis=None))
            optimizer.step()
            optimizer[keys[wanted]] = dr.clip(dr.detach(optimizer[keys[wanted]]), 0.0, 1.0)
            steps.append(float(optimizer[keys[wanted]][0]))
        found.append(np.mean(steps[-SINGLE_STEPS // 4:]))
        seconds += time.process_time() - start
    return np.array(found), seconds


def picture(curves: dict[str, np.ndarray], path: Path) -> None:
    """All spectra of the box."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(7, 4.5))
    for name, curve in curves.items():
        axis.plot(GRID.nm, curve, label=name, color="black" if name == "truth" else None,
                  linestyle="--" if name.startswith("paper") else "-")
    axis.set(xlabel="wavelength (nm)", ylabel="reflectance of the orange box", ylim=(0, 1))
    axis.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=80)


if __name__ == "__main__":
    main()
