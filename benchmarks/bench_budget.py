"""What 95 % bands hold when the light, the shutter, the lamp's position or the lens is not as
stated, with the error budget and without it.

Each scene is a rendered box (``fixtures/box_render.py``: another renderer than the inversion's, at
1 nm, with twice the bounces) painted with four of the CES99 colours, with its own chart and noise.
The photos are then taken again with one fault each. "Before" leaves out of the likelihood what
[repeatability] and [stray_light] state, as if their keys were 0; "now" is what a session does. The
light is traced once a scene.

    python -m benchmarks.bench_budget [--scenes 2] [--seed 5] [--json]
"""
from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

import numpy as np

from spectrabox.fixtures import demo_photos, demo_session
from spectrabox.fixtures.demo_photos import (
    camera_sensitivities,
    chart_light,
    exposure_for,
    take_photo,
)
from spectrabox.fixtures.lamp import radiance
from spectrabox.fixtures.paints import NM, chart_truth
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.light_scale import error_of_each_band
from spectrabox.radiometry.records import JointReconstruction, LightScale
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.reconstruct.engines.transport_engine import nuisances, solve_traced, trace_views
from spectrabox.reconstruct.fit.traced_view import TracedView
from spectrabox.reconstruct.inverse_rendering import reconstruction_of
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.replay import region_picture
from spectrabox.sampling.prior.draws import prior_spectra
from spectrabox.sampling.prior.mixture import GRID, load_prior
from spectrabox.session.config.session_file import read_session
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.pipeline import run_stages
from spectrabox.session.stages.error_budget import measurement_of
from spectrabox.session.stages.reconstruct_stage import settings_of, views_of, with_errors
from spectrabox.session.stages.stored_records import calibrations_of

SIZE, PATHS, WIDTH, DRAWS = (208, 312), 16, 40, 999
LEVEL = 0.95
WEAKER, SHUTTER, MOVED_CM, GLARE = 0.04, 0.05, 0.5, 0.02


@dataclass(frozen=True)
class Scene:
    """A painted box and its chart, as light on the sensor."""

    folder: Path
    truths: dict[str, np.ndarray]       # (61,) of each material
    box: np.ndarray                     # (H, W, K)
    chart: np.ndarray                   # (24, P) reflectances
    seed: int


Fault = Callable[[Scene, np.random.Generator], tuple[np.ndarray, np.ndarray]]


def painted_box(folder: Path, seed: int) -> Scene:
    """A session's folder of a box in four colours drawn from CES99."""
    grid = visible_grid()
    colours = test_reflectances(grid)["CES99"]
    chosen = np.random.default_rng(seed).choice(len(colours), size=4, replace=False)
    of = {formula: np.interp(NM, grid.nm, colours[index]) for formula, index
          in zip(demo_session.PAINTS.values(), chosen, strict=True)}
    rendered: list[np.ndarray] = []
    box_light = demo_session.box_light

    def kept(*given: object, **chosen: object) -> np.ndarray:
        rendered.append(box_light(*given, **chosen))    # type: ignore[arg-type]
        return rendered[-1]

    with mock.patch.object(demo_session, "paint", lambda name: (NM, of[name])), \
            mock.patch.object(demo_session, "box_light", kept):
        demo_session.write_demo_session(folder, seed, size=SIZE, spp=PATHS)
    path = folder / "session.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("width = 96", f"width = {WIDTH}"),
                    encoding="utf-8")
    truths = {name: np.interp(GRID.nm, NM, of[formula])
              for name, formula in demo_session.PAINTS.items()}
    chart = chart_truth(np.random.default_rng(seed).spawn(5)[0])
    return Scene(folder, truths, rendered[0], chart, seed)


def _chart(scene: Scene, moved_cm: np.ndarray | float = 0.0) -> np.ndarray:
    with mock.patch.object(demo_photos, "CHART_LIGHT_CM", demo_photos.CHART_LIGHT_CM + moved_cm):
        return chart_light(scene.chart, radiance(NM), camera_sensitivities(), SIZE)


def _moved(scene: Scene, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    direction = rng.standard_normal(3)
    return scene.box, _chart(scene, MOVED_CM * direction / np.linalg.norm(direction))


FAULTS: dict[str, Fault] = {
    "none": lambda scene, rng: (scene.box, _chart(scene)),
    f"lamp {WEAKER:.0%} weaker": lambda scene, rng: ((1 - WEAKER) * scene.box, _chart(scene)),
    f"shutter {SHUTTER:.0%} short": lambda scene, rng: ((1 - SHUTTER) * scene.box, _chart(scene)),
    f"lamp {10 * MOVED_CM:.0f} mm off at the chart": _moved,
    f"glare {GLARE:.0%}": lambda scene, rng: (scene.box + GLARE * scene.box.mean(axis=(0, 1)),
                                              _chart(scene)),
}


def held(scene: Scene) -> dict[str, dict[str, dict[str, list[float]]]]:
    """Coverage and width of each material's band, by fault, before and now."""
    rng, answers = np.random.default_rng(scene.seed), {}
    config = read_session(scene.folder)
    traced: list[TracedView] = []
    for fault, spoilt in FAULTS.items():
        box, chart = spoilt(scene, rng)
        for name, light, target in (("box", box, demo_session.BOX_EXPOSURE),
                                    ("chart", chart, demo_session.CHART_EXPOSURE)):
            path = scene.folder / "photos" / f"{name}.dng"
            path.unlink()
            exposure = exposure_for(scene.box if name == "box" else light, target)
            take_photo(path, light, exposure, rng)
        answers[fault] = _of_photos(config, scene, traced)
    return answers


def _of_photos(config: SessionConfig, scene: Scene,
               traced: list[TracedView]) -> dict[str, dict[str, list[float]]]:
    """Of the photos as they lie in the folder; the first call traces the light."""
    stored = run_stages(config, device="cpu", only=None, force=False,
                        progress=lambda *_: None, before="reconstruct").stored
    views, settings = views_of(config, stored, None), settings_of(config)
    if not traced:
        traced += trace_views(views, settings, lambda *_: None)
    for view, first in zip(views, traced, strict=True):     # compared at the same pixels
        vars(view).update(surface=first.view.surface, used=first.view.used)
    given = [replace(one, view=view, nuisances=nuisances(view, settings))
             for one, view in zip(traced, views, strict=True)]
    solution = solve_traced(given, settings, region_picture)
    joint = with_errors(config, stored, None, reconstruction_of(
        [one.view for one in given], solution.fit, solution.answers, settings))
    calibrations = calibrations_of(config, stored)
    rows: dict[str, dict[str, list[float]]] = {}
    for kind, said in (("before", without_budget(joint)), ("now", joint)):
        rows[kind] = {}
        for index, name in enumerate(joint.materials):
            drawn = prior_spectra(measurement_of(calibrations, said, index), DRAWS, index,
                                  load_prior()).spectra
            low, high = np.quantile(drawn, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
            inside = (scene.truths[name] >= low) & (scene.truths[name] <= high)
            rows[kind][name] = [float(inside.mean()), float((high - low).mean())]
    return rows


def without_budget(joint: JointReconstruction) -> JointReconstruction:
    """The reconstruction as if nothing were stated of light, shutter, lamp and stray light."""
    views = tuple(replace(view, light_scale=LightScale(
        view.light_scale.value, error_of_each_band(view.light_scale), view.light_scale.residuals,
        view.light_scale.source)) for view in joint.views)
    return replace(joint, views=views, stray_light=())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=5, help="of the first scene")
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    arguments = parser.parse_args()
    start_mitsuba("cpu")
    scenes = []
    for number in range(arguments.scenes):
        with tempfile.TemporaryDirectory() as folder:
            scenes.append(held(painted_box(Path(folder) / "box", arguments.seed + number)))
    if arguments.json:
        print(json.dumps(scenes))
        return 0
    print(f"{'fault':<32}{'before: holds':>14}{'worst':>7}{'width':>7}"
          f"{'now: holds':>12}{'worst':>7}{'width':>7}")
    for fault in FAULTS:
        line = f"{fault:<32}"
        for kind, room in (("before", 14), ("now", 12)):
            coverage, width = np.array([pair for scene in scenes
                                        for pair in scene[fault][kind].values()]).T
            line += f"{coverage.mean():>{room}.3f}{coverage.min():>7.2f}{width.mean():>7.3f}"
        print(line)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
