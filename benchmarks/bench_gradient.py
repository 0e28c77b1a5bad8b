"""The gradient engine: where it stops, whether it agrees with the transport engine, and its memory
over 1000 steps.

Cornell box, 3 unknown materials, 7 coefficients each; the photo is Mitsuba's ``path`` with the true
spectra. The image error compares renderings with the true and the found spectra along the same
paths.
"""
from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.fixtures.cornell_box import MATERIALS, cornell_box_xml
from spectrabox.radiometry.chart import PATCH_NAMES, chart_reflectances
from spectrabox.radiometry.records import LightScale
from spectrabox.reconstruct.engines import gradient
from spectrabox.reconstruct.engines.gradient import fit_by_gradient
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.view import MaterialSpec, View

from benchmarks.paper.synthetic_photo import (
    BANDS,
    GRID,
    measured_camera,
    photograph,
    plain_settings,
    scene_of,
)

WIDTH, BOUNCES, COEFFICIENTS, PHOTO_SPP = 48, 6, 7, 2048
PATCHES = {"white": "white 9.5", "green": "green", "red": "red"}
MOST_STEPS, STEP_SPP = 400, 16
SCALE = LightScale(1.0, None, None, "given")
SPECS = tuple(MaterialSpec(name, name) for name in MATERIALS)


def agreement() -> dict[str, Any]:
    """Signals, spectra and image error of both engines on one photo, and the steps that the descent
    took.
    """
    camera, box = measured_camera(), scene_of(cornell_box_xml(WIDTH, BOUNCES + 1))
    chart = chart_reflectances("BabelColor Average", GRID)
    truth = {name: chart[PATCH_NAMES.index(patch)] for name, patch in PATCHES.items()}
    photo = photograph(box, truth, camera, PHOTO_SPP)
    response = camera.sensitivity.curves * GRID.weights_nm
    wanted = np.array(list(truth.values())) @ (response / response.sum(axis=1, keepdims=True)).T
    true_image = photograph(box, truth, camera, 128, 5).signal
    result: dict[str, Any] = {}
    for engine in ("transport", "gradient"):
        start = time.perf_counter()
        settings = plain_settings(COEFFICIENTS, engine, MOST_STEPS, STEP_SPP)
        found = reconstruct(View("photo", box, photo, camera, BANDS, SPECS, SCALE), settings,
                            lambda done, what: None)
        seconds = time.perf_counter() - start
        image = photograph(box, dict(zip(MATERIALS, found.spectra, strict=True)), camera, 128,
                           5).signal
        on_surface = found.surface >= 0
        error = (image - true_image)[on_surface]
        result[engine] = {
            "seconds": seconds, "outcome": found.outcome.value,
            "image_error": float(np.sqrt(np.mean(error**2)) / true_image[on_surface].mean()),
            "rmse": np.sqrt(np.mean((found.spectra - np.array(list(truth.values()))) ** 2,
                                    axis=1)).tolist(), "signal_error": (found.signal / wanted
                                                                        - 1).tolist()}
        if engine == "gradient":
            result[engine]["steps"] = len(found.loss_history)
    return result


def memory(steps: int) -> list[float]:
    """Resident memory in MiB after a tenth of the steps, and then after every other tenth."""
    flat = photograph(scene_of(cornell_box_xml(32, 3)),
                      dict.fromkeys(MATERIALS, np.full(GRID.nm.size, 0.4)), measured_camera(), 64)
    view = View("photo", scene_of(cornell_box_xml(32, 3)), flat, measured_camera(), BANDS, SPECS,
                SCALE)
    resident: list[float] = []

    def note(done: float, what: str) -> None:
        line = next(line for line in Path("/proc/self/status").read_text().splitlines()
                    if line.startswith("VmRSS"))
        resident.append(int(line.split()[1]) / 1024)

    gradient.WINDOW = steps  # never stalls
    fit_by_gradient(view, plain_settings(5, "gradient", steps, 1), note)
    return resident[steps // 10 - 1::steps // 10]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=1000, help="of the memory test")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the text")
    arguments = parser.parse_args()
    start_mitsuba("cpu")
    found, resident = agreement(), memory(arguments.steps)
    if arguments.json:
        print(json.dumps(found | {"resident_mib": resident}))
        return
    for engine, row in found.items():
        print(f"{engine}: {row['seconds']:.1f} s, image error {row['image_error']:.2%}, spectra "
              f"RMSE {' '.join(f'{value:.3f}' for value in row['rmse'])}, signals off by at most "
              f"{np.abs(row['signal_error']).max():.2%}; {row['outcome']}")
    print(f"the descent took {found['gradient']['steps']} of at most {MOST_STEPS} steps")
    print(f"resident memory over {arguments.steps} steps: {resident[0]:.1f} MiB after a tenth, "
          f"{resident[-1]:.1f} MiB at the end, most {max(resident):.1f} MiB")


if __name__ == "__main__":
    main()
