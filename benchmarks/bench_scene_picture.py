"""A spectrum for every pixel of a scene: ``spectrabox run`` with ``[picture]`` on photos of a box
whose side walls and cube carry patterns of published test colours, against the truth.

Rendered by Mitsuba's own path tracer at 1 nm with blends of plain BSDFs; chart, light and camera as
of the demo, whose chart calibrates the session. ``mixed``: patterns of any colours and white walls
between them; ``saturated``: red and green patterns and yellow walls. The light is taken as found,
the light from other surfaces as grey, and none of it (engine "single-bounce"); the same pixels are
scored under each, so none is masked as a highlight or penumbra under light that is not the right
one. Pixels without any light are counted as "no answer". ``flat`` is what the same pixels would
give on a flat sample under the same noise and calibration.

``--megapixels N`` times the picture alone, after its trace, and its memory.
"""
from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.demos.painted_box import (
    SHAPE_OF,
    Pattern,
    chequered,
    painted_truth,
    write_chart_session,
)
from spectrabox.fixtures.paints import NM, paint
from spectrabox.measure.pictures import scene_light
from spectrabox.measure.pictures.lit_photo import LitPhoto
from spectrabox.radiometry.error_model import Errors
from spectrabox.radiometry.grid import FINE_GRID as FINE
from spectrabox.radiometry.grid import grid_from_nm, interpolation_matrix
from spectrabox.radiometry.interreflection import relative_response
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.prior.uplift_table import uplift_signals
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages

NM_10 = np.arange(400, 701, 10)
SIGMAS_95 = 1.96
SPP_TIMED = 32              # fewer have lone bright pixels, for whose sake the rest is dark
INDIRECT = (0.3, 0.5)       # shares of the light: pixels with more are scored apart
FIELDS = {"green": 6, "red": 6, "cube": 3}
YELLOW = 0.08 + 0.72 / (1 + np.exp(-(NM - 530) / 12))
TOML = """\
[photos]
object = "photos/box.dng"
chart = "photos/chart.dng"
flat = "photos/flat.dng"
[chart]
scene = "scene/chart.xml"
[light]
spectrum = "spectra/light.csv"
[scene]
file = "scene/box.xml"
[materials.white]
[materials.green]
[materials.red]
[materials.cube]
[sampling]
draws = 1000
[picture]
"""


def surfaces() -> np.ndarray:
    """Published test colours (n, P)."""
    sets = test_reflectances(grid_from_nm(NM[20:-30]))
    return np.pad(np.clip(np.vstack(list(sets.values())), 0, 1), ((0, 0), (20, 30)), "edge")


def patterns_of(kind: str, seed: int) -> dict[str, Pattern]:
    """Patterns of both walls and the cube, of four colours each."""
    every, rng = surfaces(), np.random.default_rng(seed)
    red = every[:, NM > 600].mean(axis=1) - every[:, NM < 560].mean(axis=1)
    green = every[:, (NM > 490) & (NM < 570)].mean(axis=1) \
        - (every[:, NM < 460].mean(axis=1) + every[:, NM > 620].mean(axis=1)) / 2
    among = {name: np.arange(len(every)) for name in FIELDS}
    if kind == "saturated":
        among |= {"red": np.argsort(-red)[:24], "green": np.argsort(-green)[:24]}
    return {name: chequered(every[rng.choice(among[name], 4, replace=False)], fields, seed)
            for name, fields in FIELDS.items()}


def write_session(folder: Path, kind: str, size: tuple[int, int], spp: int, seed: int) -> None:
    """Photos, light and scenes of a session whose picture has this size."""
    plain = YELLOW if kind == "saturated" else paint("white_wall")[1]
    write_chart_session(folder, patterns_of(kind, seed), plain, TOML, size=size, spp=spp, seed=seed)


def run(folder: Path, progress: Callable[[str, float, str], None] = lambda *_: None,
        **more: Any) -> Any:
    """As ``spectrabox run``."""
    return run_stages(read_session(folder), device="cpu",
                      **{"only": None, "force": False, **more}, progress=progress)


def stored(folder: Path, name: str) -> np.ndarray:
    """Layers (H, W, C) of one of the picture's files."""
    file = oiio.ImageInput.open(str(folder / "results/picture" / name))
    layers = [number for number, channel in enumerate(file.spec().channelnames)
              if channel.startswith("T.")]
    return np.asarray(file.read_image("float"))[..., layers]


def scores(off: np.ndarray, spread: np.ndarray) -> tuple[float, float, float]:
    """Mean over pixels of the RMSE, its pooled value, and the share that bands hold."""
    each = np.mean(off**2, axis=1)
    return (float(np.sqrt(each).mean()), float(np.sqrt(each.mean())),
            float(np.mean(np.abs(off[:, ::2]) <= SIGMAS_95 * spread)))


illumination, PENUMBRA_ERROR = scene_light.illumination, scene_light.PENUMBRA_ERROR


def as_grey(light: np.ndarray, to_signals: np.ndarray) -> Any:
    """Light of every pixel as strong as it is, in the lamp's own colour."""
    own = lamp.radiance(np.linspace(400, 700, light.shape[1]))
    return illumination(light.mean(axis=1, keepdims=True) * own / own.mean(), to_signals)


def flat_scores(folder: Path, finished: Any, pixels: LitPhoto, some: np.ndarray,
                true: np.ndarray, seed: int) -> tuple[float, float, float]:
    """The same pixels as those of a flat sample: true signals with the noise of each, under the
    lamp's own light, and the session's calibration.
    """
    rows = pixels.block(0, pixels.photo.signal.shape[0], direct=True)
    assert rows.white is not None and rows.variance is not None
    sensed = camera_sensitivities() * lamp.radiance(NM)
    noise = rows.variance[some] / rows.white.signal[some]**2
    signals = true @ (sensed / sensed.sum(axis=1, keepdims=True)).T
    signals += np.sqrt(noise) * np.random.default_rng(seed).standard_normal(signals.shape)
    signals = np.clip(signals, 1e-4, 1)
    kind = 0 if rows.light is None else int(np.bincount(rows.light[some]).argmax())
    covariance = noise[:, :, None] * np.eye(3) + pixels.errors.by_curves(signals, kind)
    calibration = next(iter(finished.records.calibrate.calibrations.values()))
    response = relative_response(calibration, FINE) @ interpolation_matrix(PRIOR_GRID.nm, FINE.nm)
    mean, deviation, _ = uplift_signals(pixels.errors.prior, response, signals,
                                        Errors.of_total(covariance, signals, None))
    at = np.searchsorted(PRIOR_GRID.nm, NM_10)
    return scores(mean[:, at] - at_10(true), deviation[:, at[::2]])


def at_10(spectra: np.ndarray) -> np.ndarray:
    """Spectra (n, P) at ``NM`` every 10 nm."""
    return np.array([np.interp(NM_10, NM, each) for each in spectra])


def quality(kind: str, size: tuple[int, int], spp: int, seed: int,
            folder: Path) -> list[dict[str, Any]]:
    """RMSE and coverage of the pixels of one photo, under its light as found, as grey, and direct.
    """
    write_session(folder, kind, size, spp, seed)
    truth = painted_truth(patterns_of(kind, seed), size)
    lit: list[LitPhoto] = []
    found = scene_light.converge_light

    def noted(*given: Any) -> Any:
        """The light; but the first masks no highlights: all lights are scored by the same pixels.
        """
        photo, *others = found(*given)
        if light != "as found":
            photo = replace(photo, highlights=False)
        lit.append(photo)
        return photo, *others

    answers = {}
    scene_light.converge_light = noted     # type: ignore[assignment]
    try:
        for light in ("as found", "as grey", "direct only"):
            if light == "as grey":
                scene_light.illumination = as_grey      # type: ignore[assignment]
            if light == "direct only":
                (folder / "session.toml").write_text(
                    TOML + '[reconstruct]\nengine = "single-bounce"\n', encoding="utf-8")
                scene_light.PENUMBRA_ERROR = np.inf
            only = "picture" if light == "as grey" else None
            finished = run(folder, only=only, force=only is not None)
            scene_light.illumination = illumination     # type: ignore[assignment]
            mean, spread = (stored(folder, f"{name}.exr") for name in ("mean",
                                                                       "standard_deviation"))
            answers[light] = mean, spread
            if light == "as found":
                seen = np.isfinite(mean[..., 0]) & np.isfinite(truth[..., 0])
                reasons = finished.records.picture.flag_shares
                rounds = finished.records.picture.rounds
                flat = flat_scores(folder, finished, lit[0], np.flatnonzero(seen), truth[seen],
                                   seed)
    finally:
        scene_light.converge_light, scene_light.illumination = found, illumination
        scene_light.PENUMBRA_ERROR = PENUMBRA_ERROR
    print(f"{kind}: without a spectrum {1 - reasons[0]:.1%}; changes of the light by rounds "
          f"{np.round(rounds, 4).tolist()}", file=sys.stderr)
    indirect = 1 - white_of(lit[-1], size) / white_of(lit[0], size)
    among = {"": seen, **{f"  {shape}": shown(name, size) for name, shape in SHAPE_OF.items()},
             **{f"  indirect > {share:.0%}": indirect > share for share in INDIRECT}}
    rows = [{"photo": kind, "seed": seed, "light": "flat, same noise", "pixels": int(seen.sum()),
             "no answer": 0} | named(flat)]
    for light, (mean, spread) in answers.items():
        for words, some in among.items():
            both = seen & some & np.isfinite(mean[..., 0])
            if both.any():
                rows.append({"photo": kind, "seed": seed, "light": words or light,
                             "pixels": int(both.sum()), "no answer": int((seen & some).sum()
                                                                         - both.sum())}
                            | named(scores(mean[both] - at_10(truth[both]), spread[both])))
    return rows


def white_of(pixels: LitPhoto, size: tuple[int, int]) -> np.ndarray:
    """Signal (H, W) of a perfect white at every pixel, mean over bands."""
    white = pixels.block(0, size[0], direct=True).white
    assert white is not None
    return white.signal.mean(axis=1).reshape(size)


def named(values: tuple[float, float, float]) -> dict[str, float]:
    return dict(zip(("RMSE", "pooled", "held"), values, strict=True))


def shown(name: str, size: tuple[int, int]) -> np.ndarray:
    """Pixels (H, W) that show a pattern's surface: the thirds of the photo serve."""
    column = np.arange(size[1])[None] / size[1] * np.ones((size[0], 1))
    return {"green": column < 0.25, "red": column >= 0.75,
            "cube": (column >= 0.25) & (column < 0.75)}[name]


def speed(megapixels: float, folder: Path) -> dict[str, float]:
    """Seconds of the picture after its trace, of its trace, and memory, of a process of its own."""
    width = round((1e6 * megapixels * 1.5) ** 0.5)
    size = round(width / 3) * 2, width
    subprocess.run([sys.executable, "-m", "benchmarks.bench_scene_picture", "--write", str(folder),
                    "--size", *map(str, size)], check=True)
    done = subprocess.run([sys.executable, "-m", "benchmarks.bench_scene_picture", "--time",
                           str(folder)], check=True, stdout=subprocess.PIPE, text=True)
    return {"megapixels": size[0] * size[1] / 1e6} | json.loads(done.stdout)


def timed(folder: Path) -> dict[str, float]:
    """Run a session's picture alone."""
    started: dict[str, tuple[float, float]] = {}

    def note(stage: str, share: float, what: str) -> None:
        if stage == "picture":
            started.setdefault("light" if what.startswith("light from") else what,
                               (time.perf_counter(), time.process_time()))

    run(folder, note, only="picture", force=True)
    end = time.perf_counter(), time.process_time()
    begun, lit = started["tracing light"], started["light"]
    return {"trace s": lit[0] - begun[0], "trace processor s": lit[1] - begun[1],
            "after it s": end[0] - lit[0], "after it processor s": end[1] - lit[1],
            "GiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, nargs=2, default=(160, 240), help="rows and columns")
    parser.add_argument("--spp", type=int, default=1024, help="paths per pixel of the photo")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--photos", nargs="+", default=["mixed", "saturated"])
    parser.add_argument("--megapixels", type=float, help="time a picture of this size in place")
    parser.add_argument("--write", type=Path, help="only write and run a session without picture")
    parser.add_argument("--time", type=Path, help="only time the picture of such a session")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    if asked.write:
        write_session(asked.write, "mixed", tuple(asked.size), SPP_TIMED, 1)
        run(asked.write, before="picture")
        return
    if asked.time:
        print(json.dumps(timed(asked.time)))
        return
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        if asked.megapixels:
            rows.append(speed(asked.megapixels, Path(folder) / "session"))
        else:
            for kind in asked.photos:
                for seed in asked.seeds:
                    rows += quality(kind, tuple(asked.size), asked.spp, seed,
                                    Path(folder) / f"{kind}-{seed}")
    if asked.json:
        print(json.dumps(rows))
        return
    print("".join(f"{name:>19}" for name in rows[0]))
    for each in rows:
        print("".join(f"{value:>19}" if isinstance(value, str | int) else f"{value:19.4f}"
                      for value in each.values()))


if __name__ == "__main__":
    main()
