"""What 95 % bands hold when the light, the shutter, the lamp's position or the lens is not as
stated, with the error budget and without it, by material.

A demo session is rehearsed (spectrabox/measure/scene/rehearsal.py): photos of known truths through
its own light transport, the truths drawn by the models behind the prior's families. Curves of the
camera, the light's readings, the light scale's own error and the noise are drawn anew in each, as
in any rehearsal; what [repeatability] and [stray_light] state is not: in its place comes one fault
of the size given. The lamp is moved in the object photo's true scene alone, towards each axis in
turn. "Without" leaves out of the likelihood what is stated, as if the keys were 0; "with" is what a
session does. Truths and noise are the same under every fault, so that differences are known better
than what is held.

    python -m benchmarks.bench_budget [--times 40] [--seed 5] [--family skin] [--json]
"""
from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from spectrabox.fixtures.demos.demo_session import write_demo_session
from spectrabox.measure.scene.photo_errors import with_photo_errors
from spectrabox.measure.scene.rehearsal import Replays
from spectrabox.measure.surface_signals import measurement, scene_signals
from spectrabox.radiometry.error_model import error_of_each_band
from spectrabox.radiometry.records import JointReconstruction, LightScale
from spectrabox.reconstruct.engines.transport_engine import unit_scene
from spectrabox.reconstruct.replay import Truth, replay
from spectrabox.reconstruct.scene.edit_scene import with_light_moved
from spectrabox.reconstruct.tracer.transport import TracedTransport, trace_transport
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.prior.summaries import summaries
from spectrabox.sampling.spline_measurement import response_on
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages
from spectrabox.session.rehearsal import replays_of

SIZE, PATHS, WIDTH = (208, 312), 16, 40
MOVED_CM, LEVEL = 0.5, 0.95
KINDS = ("without", "with")


@dataclass(frozen=True)
class Fault:
    """What is not as stated."""

    light: float = 1.0          # factor of light or exposure between chart and object photo
    moved_cm: float = 0.0
    glare: float = 0.0          # of the mean signal


FAULTS = {"none": Fault(), "lamp 4 % weaker": Fault(0.96), "shutter 3 % long": Fault(1.03),
          "shutter 5 % short": Fault(0.95), "lamp moved by 5 mm": Fault(moved_cm=MOVED_CM),
          "glare 1 %": Fault(glare=0.01), "all of it": Fault(0.96 * 0.95, MOVED_CM, 0.01)}


def without_budget(joint: JointReconstruction) -> JointReconstruction:
    """The reconstruction as if nothing were stated of light, shutter, lamp and stray light."""
    views = tuple(replace(view, light_scale=LightScale(
        view.light_scale.value, error_of_each_band(view.light_scale), view.light_scale.residuals,
        view.light_scale.source)) for view in joint.views)
    return replace(joint, views=views, stray_light=())


@dataclass(frozen=True, eq=False)
class Faulty(Replays):
    """A session whose replays have one fault in place of what is stated."""

    fault: Fault
    moved: tuple[TracedTransport, ...]      # of the object photo, the lamp moved along each axis

    def truth(self, number: int, rng: np.random.Generator) -> Truth:
        plain = super().truth(number, rng)
        bands = plain.responses[0].shape[1]
        return replace(plain, responses=tuple(self.fault.light * each for each in plain.responses),
                       glare=(np.full(bands, self.fault.glare),), ambient=(0.0,),
                       transports=(self.moved[number % len(self.moved)],)
                       if self.fault.moved_cm else ())

    def both(self, number: int, seed: np.random.SeedSequence) -> tuple[JointReconstruction, ...]:
        """The reconstruction of one replay, without the budget and with it."""
        rng = np.random.default_rng(seed)
        found = replay(self.stage, self.truth(number, rng), rng)
        stated = with_photo_errors(found, self.errors.drift, self.errors.glare,
                                   self.errors.ambient)
        return without_budget(stated), stated

    def judged(self, joints: Sequence[JointReconstruction], name: str) -> np.ndarray:
        """Share held and width (T, 2) of one material's bands, as ``sample --signals`` makes them
        without draws.
        """
        prior, truth = self.priors[name], self.truths[name]
        seen = [measurement(scene_signals(joint, self.calibrations), joint.materials.index(name))
                for joint in joints]
        bands = summaries(prior, response_on(seen[0], PRIOR_GRID),
                          np.array([one.signal for one in seen]),
                          {"all": np.array([one.noise_covariance for one in seen])}, LEVEL)
        inside = (truth >= bands.lower) & (truth <= bands.upper)
        return np.stack([inside.mean(axis=1), (bands.upper - bands.lower).mean(axis=1)], axis=1)


def moved_lamps(scene: Replays) -> tuple[TracedTransport, ...]:
    """The transport of the object photo's regions with the lamp moved along each axis."""
    traced = scene.stage.views[0]
    view = traced.view
    return tuple(trace_transport(
        unit_scene(replace(view, scene_file=with_light_moved(view.scene_file, 0, offset)),
                   view.scene_file.max_depth - 1), traced.region, spp=traced.traced.spp,
        seed=77 + axis, exponents=traced.traced.exponents)
        for axis, offset in enumerate(MOVED_CM * np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1]])))


def held_under(scene: Replays, moved: tuple[TracedTransport, ...], fault: Fault, times: int,
               seed: int) -> np.ndarray:
    """Shares held and widths (T, kinds, materials, 2)."""
    # what the session is sure of by itself: the truth's scale has no error that is stated
    own = {field.name: getattr(scene, field.name) for field in fields(Replays)}
    faulty = Faulty(**own | {"joint": without_budget(scene.joint)}, fault=fault, moved=moved)
    pairs = [faulty.both(number, one) for number, one
             in enumerate(np.random.SeedSequence(seed).spawn(times))]
    return np.stack([np.stack([faulty.judged(joints, name) for name in scene.priors], axis=1)
                     for joints in zip(*pairs, strict=True)], axis=1)


def lines_of(fault: str, found: np.ndarray, materials: Mapping[str, object]) -> list[str]:
    """Two rows of the table: coverage in total and by material, with standard errors."""
    def cell(values: np.ndarray) -> str:
        return f"{values.mean():.3f} +- {values.std(ddof=1) / np.sqrt(len(values)):.3f}"

    # materials of one photo share its scale: photos are the independent trials
    rows = []
    for index, kind in enumerate(KINDS):
        held, width = found[:, index, :, 0], found[:, index, :, 1]
        gain = cell(found[:, 1, :, 0].mean(axis=1) - held.mean(axis=1)) if index == 0 else ""
        rows.append(f"| {fault} | {kind} | {cell(held.mean(axis=1))} | {width.mean():.3f} | "
                    + " | ".join(cell(held[:, column]) for column in range(len(materials)))
                    + f" | {gain} |")
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=40, help="rehearsals of each fault")
    parser.add_argument("--seed", type=int, default=5, help="of the session, truths and noise")
    parser.add_argument("--family", help="that every surface is said to be of, and is")
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1, "blas"):
        session = Path(folder) / "box"
        write_demo_session(session, arguments.seed, size=SIZE, spp=PATHS)
        path = session / "session.toml"
        text = path.read_text(encoding="utf-8").replace("width = 96", f"width = {WIDTH}")
        if arguments.family:
            text = text.replace("\nbsdf = ", f'\nfamily = "{arguments.family}"\nbsdf = ')
        path.write_text(text, encoding="utf-8")
        config = read_session(session)
        run_stages(config, device="cpu", only=None, force=False, progress=lambda *_: None)
        scene = replays_of(config, arguments.times, arguments.seed, "cpu", lambda *_: None)
        moved = moved_lamps(scene)
        stated = {error.cause: error.relative
                  for error in scene.joint.views[0].light_scale.common_errors}
        found = {}
        if not arguments.json:
            print(f"stated: {stated}")
            print("| fault | budget | 95 % holds | width | " + " | ".join(scene.priors)
                  + " | gain by the budget |")
            print("|" + "--|" * (5 + len(scene.priors)))
        for name, fault in FAULTS.items():
            found[name] = held_under(scene, moved, fault, arguments.times, arguments.seed)
            if not arguments.json:
                print("\n".join(lines_of(name, found[name], scene.priors)), flush=True)
    if arguments.json:
        print(json.dumps({"stated": stated, "materials": list(scene.priors),
                          "held_and_width": {name: one.tolist() for name, one in found.items()}}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
