"""The light's scale by the closed form and by descent through the renderer, for the demo's chart
scene.

The photo's patches come from Eq. 17 written out for the small sphere, with 1 % of noise; the true
factor is 0.37. Prints both values with their standard errors, the times of one run each (the closed
form with its irradiance), and their ratio.
"""
from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.fixtures.demo_photos import camera_sensitivities, light_factor
from spectrabox.fixtures.demo_scenes import CHART_CM, chart_scene_xml
from spectrabox.fixtures.lamp import radiance
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.chart import chart_reflectances, patch_centres_uv, patch_size_uv
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.light_scale import scale_from_signals
from spectrabox.radiometry.records import LightScale
from spectrabox.radiometry.response import response_matrix
from spectrabox.reconstruct.rendering.irradiance import patch_irradiance
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.scene.scene_file import read_scene

from benchmarks.light_scale_descent import scale_by_descent

TRUE_SCALE, NOISE = 0.37, 0.01


def row(found: LightScale, seconds: float) -> dict[str, Any]:
    return {"value": found.value, "standard_error": found.standard_error, "seconds": seconds,
            "errors_of_truth": (found.value - TRUE_SCALE) / (found.standard_error or np.nan)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1, help="of the photo's noise")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    grid = visible_grid()
    curves = np.array([np.interp(grid.nm, NM, curve) for curve in camera_sensitivities()])
    light = radiance(grid.nm)
    reflectances, centres, size = chart_reflectances("BabelColor Average",
                                                     grid), patch_centres_uv(), patch_size_uv()
    unscaled = reflectances @ response_matrix(grid, curves, light).T
    photo = TRUE_SCALE * unscaled * light_factor((centres - 0.5) * [1, -1] * CHART_CM)[:, None]
    photo *= 1 + NOISE * np.random.default_rng(arguments.seed).standard_normal(photo.shape)
    start_mitsuba("cpu")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chart.xml"
        path.write_text(chart_scene_xml((60, 90)), encoding="utf-8")
        scene = read_scene(path)
    start = time.perf_counter()
    irradiance = patch_irradiance(scene, centres, size, arguments.seed)
    closed = scale_from_signals(photo, unscaled * (irradiance / np.pi)[:, None], NOISE,
                                "closed form")
    middle = time.perf_counter()
    descended = scale_by_descent(scene, centres, size, grid, reflectances, light, curves, photo,
                                 NOISE, seed=arguments.seed)
    end = time.perf_counter()
    result = {"true": TRUE_SCALE, "closed_form": row(closed, middle - start),
              "descent": row(descended, end - middle),
              "difference_in_errors": (descended.value - closed.value) / (closed.standard_error
                                                                          or np.nan),
              "ratio_seconds": (end - middle) / (middle - start)}
    if arguments.json:
        print(json.dumps(result))
        return
    print(f"true factor {TRUE_SCALE}")
    print(f"{'':<12} {'value':>9} {'standard error':>15} {'from truth':>11} {'seconds':>8}")
    for name in ("closed_form", "descent"):
        one = result[name]
        print(f"{name:<12} {one['value']:9.5f} {one['standard_error']:15.5f} "
              f"{one['errors_of_truth']:+10.2f}s {one['seconds']:8.2f}")
    print(f"difference {result['difference_in_errors']:+.2f} standard errors; the descent takes "
          f"{result['ratio_seconds']:.0f} times as long")


if __name__ == "__main__":
    main()
