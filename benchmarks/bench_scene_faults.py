"""Boxes photographed with real-life faults: what the bands hold, and what the verdict says.

The demo's box with other paints in every case: its walls and its cube neutral, two walls of
published test colours. Its photo is rendered from spectra at 1 nm, once as the session states the
scene, and once with each fault; the chart photo is as stated. The exposure is 5 % off, to either
side; the lamp stands 2 cm from where it was measured, or shines as if dimmed by 5 %; a veil adds
2 % of the brightest signal everywhere; every surface mirrors 3 % of the light, or is a rough
plastic; the box is 2 % wider than measured. "Neutrals" are walls and cube; "wrong" are sessions
with the verdict PASS that hold less than 90 % of all surfaces, or of a neutral. With --known the
walls' spectrum is stated and tells the light scale; with --second there is one more photo of the
box, without the fault.

    python -m benchmarks.bench_scene_faults [--cases 12] [--faults ...] [--known] [--second]
"""
from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

import spectrabox as sb
from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.box_render import box_light, renderer
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities, exposure_for, take_photo
from spectrabox.fixtures.demos.demo_scenes import BOX_LIGHT_CM
from spectrabox.fixtures.demos.demo_session import BOX_EXPOSURE, write_demo_session
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.chart import REFERENCES
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra.named_spectra import test_reflectances

FAULTS = ("none", "exposure 5 %", "lamp moved 2 cm", "lamp dimmed 5 %", "veil 2 %", "gloss 3 %",
          "rough plastic", "side 2 % wrong")
SIZE, SPP, WIDTH = (208, 312), 16, 40       # of the photo, and of the rendering that is compared
NEUTRALS = ("white", "cube")
NEUTRAL = 0.12                          # standard deviation over wavelengths, of the mean
BRIGHT = 0.33                           # of walls: least mean reflectance
MOVED_CM, DIMMED, VEIL, GLOSS, WIDER, ROUGH = 2.0, 0.95, 0.02, 0.03, 1.02, 0.3
FILAMENT_K = 2900.0                     # whose dimming the light's colour follows
LEVEL = 0.95


def paints(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Reflectances (P,) at ``NM`` by material: two neutrals, a bright one first, and two colours.
    """
    sets = test_reflectances(grid_from_nm(NM[20:-30]))
    some = np.vstack([rows for name, rows in sets.items() if name not in REFERENCES])
    some = np.pad(np.clip(some, 0.01, 0.97), ((0, 0), (20, 30)), mode="edge")
    neutral = some.std(axis=1) < NEUTRAL * some.mean(axis=1)
    bright = neutral & (some.mean(axis=1) > BRIGHT)
    chosen = rng.choice(np.flatnonzero(bright)), rng.choice(np.flatnonzero(neutral)), \
        *rng.choice(np.flatnonzero(~neutral), 2, replace=False)
    return dict(zip((*NEUTRALS, "green", "red"), some[list(chosen)], strict=True))


def dimmed(nm: np.ndarray) -> np.ndarray:
    """Factor (P,) on a lamp's light as of a filament that is dimmed to ``DIMMED`` at 560 nm."""
    def radiance(kelvin: float) -> np.ndarray:
        return 1 / np.expm1(1.4388e7 / (np.r_[560.0, nm] * kelvin))
    colder = radiance(FILAMENT_K * (1 + np.log(DIMMED) * 560 * FILAMENT_K / 1.4388e7))
    ratio = colder / radiance(FILAMENT_K)
    return np.asarray(DIMMED * ratio[1:] / ratio[0])


def moved_lamp(direction: np.ndarray) -> Callable[[str], str]:
    """Edit of the scene that moves its lamp along a unit vector (3,)."""
    def text(centre: np.ndarray) -> str:
        return 'name="center" value="' + ", ".join(f"{value:g}" for value in centre)
    return lambda xml: _replaced(xml, text(BOX_LIGHT_CM), text(BOX_LIGHT_CM + MOVED_CM * direction))


def wider_box(xml: str) -> str:
    """The scene with its side walls farther apart, and floor, ceiling and back wall as wide."""
    for sign in ("-", ""):
        xml = _replaced(xml, f'<translate x="{sign}24"', f'<translate x="{sign}{24 * WIDER}"')
    return _replaced(xml, '<scale x="24"', f'<scale x="{24 * WIDER}"')


def plastic(xml: str) -> str:
    """The scene with all paints as the base of a rough plastic."""
    return _replaced(xml, 'type="diffuse"', 'type="roughplastic"').replace(
        'name="reflectance"', 'name="diffuse_reflectance"').replace(
        '</bsdf>', f'<float name="alpha" value="{ROUGH}"/></bsdf>')


def base_of_plastic() -> float:
    """Radiance factor at 45/0 of a rough plastic without its mirrored light, over its base's."""
    mi = renderer()
    base = mi.load_dict({"type": "roughplastic", "alpha": ROUGH, "specular_reflectance": 0.0,
                         "diffuse_reflectance": 0.5})
    hit = mi.SurfaceInteraction3f()
    hit.wi, half = mi.Vector3f(0, 0, 1), float(np.sqrt(0.5))
    value = np.array(base.eval(mi.BSDFContext(), hit, mi.Vector3f(half, 0, half))).ravel()[0]
    return float(value * np.pi / np.sqrt(0.5) / 0.5)


def _replaced(xml: str, old: str, new: str) -> str:
    assert old in xml, old
    return xml.replace(old, new)


def write_session(folder: Path, case: int, walls: np.ndarray | None, second: bool) -> None:
    """Session folder with a chart photo as stated; the photo of the box is written for each fault.

    The verdict must not know the truth: only the walls' spectrum is stated, where it is given.
    """
    write_demo_session(folder, case, size=SIZE, spp=4)
    path = folder / "session.toml"
    text = path.read_text(encoding="utf-8").replace("width = 96", f"width = {WIDTH}").replace(
        "draws = 4000", "draws = 1000")
    text = "".join(line for line in text.splitlines(True) if "spectra/truth_" not in line)
    if walls is not None:
        (folder / "spectra/walls.csv").write_text("nm,reflectance\n" + "".join(
            f"{nm:g},{value:.6f}\n" for nm, value in zip(NM, walls, strict=True)),
            encoding="utf-8")
        text = _replaced(_replaced(text, 'bsdf = "white"', 'bsdf = "white"\nknown = '
                                   '"spectra/walls.csv"'), '[scale]\nfrom = "chart"',
                         '[scale]\nfrom = "material"')
    if second:
        text += '\n[views.second]\nphoto = "photos/second.dng"\n'
    path.write_text(text, encoding="utf-8")


def photographs(surfaces: dict[str, np.ndarray], faults: tuple[str, ...], case: int
                ) -> dict[str, np.ndarray]:
    """Light (H, W, 3) from the box under each fault; the paints are those of ``surfaces``."""
    rng = np.random.default_rng([case, 7])
    direction = rng.standard_normal(3)
    sign = rng.choice([-1, 1])
    light, curves = lamp.radiance(NM), camera_sensitivities()

    def rendered(paint: dict[str, np.ndarray] = surfaces, light: np.ndarray = light,
                 edited: Callable[[str], str] = lambda xml: xml) -> np.ndarray:
        return box_light(NM, paint, light, curves, size=SIZE, spp=SPP, seed=case, edited=edited)

    plain = rendered()
    base = base_of_plastic() if "rough plastic" in faults else 1.0
    photo: dict[str, Callable[[], np.ndarray]] = {
        "none": lambda: plain,
        "exposure 5 %": lambda: plain * (1 + 0.05 * sign),
        "lamp moved 2 cm": lambda: rendered(edited=moved_lamp(
            direction / np.linalg.norm(direction))),
        "lamp dimmed 5 %": lambda: rendered(light=light * dimmed(NM)),
        "veil 2 %": lambda: plain + VEIL * np.percentile(plain, 99, axis=(0, 1)),
        "gloss 3 %": lambda: rendered({name: np.minimum(each + GLOSS, 1)
                                       for name, each in surfaces.items()}),
        "rough plastic": lambda: rendered({name: np.minimum(each / base, 1)
                                           for name, each in surfaces.items()}, edited=plastic),
        "side 2 % wrong": lambda: rendered(edited=wider_box)}
    return {fault: photo[fault]() for fault in faults}


def one_run(folder: Path, light: np.ndarray, exposure: Fraction, surfaces: dict[str, np.ndarray],
            seed: int) -> dict[str, Any]:
    """Figures of one photo of the box, by the session that users run."""
    take_photo(folder / "photos/box.dng", light, exposure, np.random.default_rng(seed))
    session = sb.Session(folder)
    session.run(device="cpu")
    row: dict[str, Any] = {"verdict": session.verdict, "inside": {}, "width": {}, "off": {}}
    for name, estimate in session.items():
        if session.config.materials[name].known is None:
            lower, upper = estimate.band(LEVEL)
            truth = np.interp(estimate.nm, NM, surfaces[name])
            row["inside"][name] = float(np.mean((lower <= truth) & (truth <= upper)))
            row["width"][name] = float(np.mean(upper - lower))
            row["off"][name] = float(np.mean(estimate.mean) / np.mean(truth) - 1)
    return row


def measure(cases: int, faults: tuple[str, ...], known: bool,
            second: bool) -> dict[str, list[dict[str, Any]]]:
    """Figures of every case by fault.

    Parameters
    ----------
    cases : int
    faults : tuple of str
        Of FAULTS.
    known, second : bool
        Whether the spectrum of the walls is known and tells the light scale; whether there is a
        second photo, without the fault.
    """
    rows: dict[str, list[dict[str, Any]]] = {fault: [] for fault in faults}
    for case in range(cases):
        surfaces = paints(np.random.default_rng([case, 3]))
        with tempfile.TemporaryDirectory() as written:
            folder = Path(written) / "box"
            write_session(folder, case, surfaces["white"] if known else None, second)
            photos = photographs(surfaces, ("none", *faults), case)
            exposure = exposure_for(photos["none"], BOX_EXPOSURE)
            if second:
                take_photo(folder / "photos/second.dng", photos["none"], exposure,
                           np.random.default_rng([case, 2]))
            for fault in faults:
                rows[fault].append(one_run(folder, photos[fault], exposure, surfaces, case))
        print(f"{case + 1}/{cases}", file=sys.stderr, flush=True)
    return rows


def table(rows: dict[str, list[dict[str, Any]]]) -> str:
    """A line for every fault, as Markdown; errors are those of means over cases."""
    lines = ["| fault | all surfaces | width | neutrals | worst neutral | PASS | of these wrong |"
             " WARN, FAIL |", "|" + "--|" * 8]
    for fault, each in rows.items():
        inside = np.array([np.mean(list(row["inside"].values())) for row in each])
        neutral = np.array([[row["inside"][name] for name in NEUTRALS if name in row["inside"]]
                            for row in each])
        width = np.mean([value for row in each for value in row["width"].values()])
        passed = np.array([row["verdict"] == "pass" for row in each])
        wrong = passed & ((inside < 0.9) | (neutral.min(axis=1) < 0.9))
        error = inside.std(ddof=1) / np.sqrt(len(each)) if len(each) > 1 else np.nan
        lines.append(f"| {fault} | {inside.mean():.3f} +- {error:.3f} | {width:.3f} | "
                     f"{neutral.mean():.3f} | {neutral.min():.2f} | {passed.sum()} | {wrong.sum()}"
                     f" | {np.sum(~passed)} |")
    return "\n".join(lines)


def main() -> None:
    """Print a table of the faults."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--faults", nargs="*", default=list(FAULTS), choices=FAULTS)
    parser.add_argument("--known", action="store_true", help="state the spectrum of the walls")
    parser.add_argument("--second", action="store_true", help="one more photo, without the fault")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    with threadpool_limits(1, "blas"):
        rows = measure(asked.cases, tuple(asked.faults), asked.known, asked.second)
    print(json.dumps(rows) if asked.json else table(rows))


if __name__ == "__main__":
    main()
