"""Boxes photographed with real-life faults: what the bands hold, and what the verdict says.

The demo's box with other paints in every case: its walls and its cube neutral, two walls of
published test colours. Its photos are rendered from spectra at 1 nm, once as the session states the
scene, and once with each fault; the chart is a copy of its own, of the edition since 2014, and its
photo is as stated but for that. The exposure is 5 % off, to either
side; the lamp stands 2 cm from where it was measured, or shines as if dimmed by 5 %; a veil adds
2 % of the brightest signal everywhere; every surface mirrors 3 % of the light evenly, or is a rough
plastic of refractive index 1.49 whose lobe is broad ("eggshell", 2 to 4 % of the light where lamp
and camera stand), narrower ("semi-gloss"), or only the cube is; the box is 2 % wider than measured.

A session is photographed by one of four protocols: the chart elsewhere and nothing known in the box
("chart"); besides it a grey card in the box whose spectrum was measured to 1 %, and which stands
2 mm and 1.5 degrees from where it is stated ("card"); with the walls' spectrum known ("walls"); or
with the card and a second photo, the lamp in another place ("moved"), where the fault is in the
first alone, but gloss in both.

"Neutrals" are walls and cube; "below" are sessions that hold less than 90 % of all surfaces, or of
a neutral, "wrong" those of them with the verdict PASS, and "unnamed" those of these whose verdict
does not say that it assumes what is wrong: no condition after its "if" is that of the fault.

    python -m benchmarks.bench_scene_faults [--cases 12] [--faults ...] [--protocols ...]
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
from spectrabox.fixtures.demos.demo_photos import (
    camera_sensitivities,
    chart_light,
    exposure_for,
    take_photo,
)
from spectrabox.fixtures.demos.demo_scenes import BOX_LIGHT_CM, regular_spectrum
from spectrabox.fixtures.demos.demo_session import BOX_EXPOSURE, CHART_EXPOSURE, write_demo_session
from spectrabox.fixtures.paints import NM, chart_copy
from spectrabox.radiometry.chart import REFERENCES
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra.named_spectra import test_reflectances

FAULTS = ("none", "exposure 5 %", "lamp moved 2 cm", "lamp dimmed 5 %", "veil 2 %", "gloss 3 %",
          "eggshell", "eggshell cube", "semi-gloss", "side 2 % wrong")
PROTOCOLS = ("chart", "card", "walls", "moved")
SIZE, SPP, WIDTH = (208, 312), 16, 40       # of the photo, and of the rendering that is compared
NEUTRALS = ("white", "cube")
NEUTRAL = 0.12                          # standard deviation over wavelengths, of the mean
BRIGHT = 0.33                           # of walls: least mean reflectance
MOVED_CM, DIMMED, VEIL, GLOSS, WIDER = 2.0, 0.95, 0.02, 0.03, 1.02
LOBES = {"eggshell": 0.5, "eggshell cube": 0.5, "semi-gloss": 0.3}      # roughness of the plastic
CARD_CM, CARD_HALF_CM, CARD_REFLECTANCE = np.array([12.0, 4.6, -12.0]), 4.5, 0.48
CARD_ERROR, CARD_OFF_CM, CARD_TILT_DEG = 0.01, 0.2, 1.5
SECOND_LAMP_CM = np.array([-14.0, 22.0, 34.0])
# what the verdict has to name if it passes: the condition that does not hold
NAMED = {"exposure 5 %": "condition.scene-light", "lamp moved 2 cm": "condition.light-place",
         "lamp dimmed 5 %": "condition.scene-light", "gloss 3 %": "condition.scene-gloss",
         "eggshell": "condition.scene-gloss", "eggshell cube": "condition.scene-gloss",
         "semi-gloss": "condition.scene-gloss", "side 2 % wrong": "condition.geometry"}
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


def lamp_at(centre_cm: np.ndarray) -> Callable[[str], str]:
    """Edit of the scene that puts its lamp to a place (3,)."""
    def text(centre: np.ndarray) -> str:
        return 'name="center" value="' + ", ".join(f"{value:g}" for value in centre)
    return lambda xml: _replaced(xml, text(BOX_LIGHT_CM), text(centre_cm))


def wider_box(xml: str) -> str:
    """The scene with its side walls farther apart, and floor, ceiling and back wall as wide."""
    for sign in ("-", ""):
        xml = _replaced(xml, f'<translate x="{sign}24"', f'<translate x="{sign}{24 * WIDER}"')
    return _replaced(xml, '<scale x="24"', f'<scale x="{24 * WIDER}"')


def plastic(roughness: float, material: str = "") -> Callable[[str], str]:
    """Edit of the scene that makes a rough plastic of one paint or all, with the paint as its base.
    """
    def edit(xml: str) -> str:
        first, *others = xml.split('<bsdf type="diffuse" id="')
        return first + "".join(_plastic(other, roughness) if other.startswith(material) else
                               f'<bsdf type="diffuse" id="{other}' for other in others)
    return edit


def _plastic(text: str, roughness: float) -> str:
    return '<bsdf type="roughplastic" id="' + text.replace(
        'name="reflectance"', 'name="diffuse_reflectance"', 1).replace(
        '</bsdf>', f'<float name="alpha" value="{roughness}"/></bsdf>', 1)


def base_of_plastic(roughness: float) -> float:
    """Radiance factor at 45/0 of a rough plastic without its mirrored light, over its base's."""
    mi = renderer()
    base = mi.load_dict({"type": "roughplastic", "alpha": roughness, "specular_reflectance": 0.0,
                         "diffuse_reflectance": 0.5})
    hit = mi.SurfaceInteraction3f()
    hit.wi, half = mi.Vector3f(0, 0, 1), float(np.sqrt(0.5))
    value = np.array(base.eval(mi.BSDFContext(), hit, mi.Vector3f(half, 0, half))).ravel()[0]
    return float(value * np.pi / np.sqrt(0.5) / 0.5)


def with_card(reflectance: str, off_cm: np.ndarray | None = None,
              tilt_deg: np.ndarray | None = None) -> Callable[[str], str]:
    """Edit of the scene that puts a matt grey card into it.

    Parameters
    ----------
    reflectance : str
        XML of its reflectance.
    off_cm : (3,) array, optional
        From where it is stated.
    tilt_deg : (2,) array, optional
        About x and y.
    """
    at = CARD_CM if off_cm is None else CARD_CM + off_cm
    turned = np.zeros(2) if tilt_deg is None else tilt_deg
    card = (f'<bsdf type="diffuse" id="card">{reflectance}</bsdf><shape type="rectangle" '
            f'id="grey_card"><ref id="card"/><transform name="to_world"><scale '
            f'value="{CARD_HALF_CM}"/><rotate x="1" angle="{turned[0]:.3f}"/><rotate y="1" '
            f'angle="{turned[1]:.3f}"/><translate x="{at[0]:.4f}" y="{at[1]:.4f}" '
            f'z="{at[2]:.4f}"/></transform></shape></scene>')
    return lambda xml: _replaced(xml, "</scene>", card)


def _replaced(xml: str, old: str, new: str) -> str:
    assert old in xml, old
    return xml.replace(old, new)


def write_session(folder: Path, case: int, walls: np.ndarray, protocol: str) -> None:
    """Session folder with a chart photo as stated; photos of the box are written for each fault.

    The verdict must not know the truth: only spectra of the card or of the walls are stated.
    """
    write_demo_session(folder, case, size=SIZE, spp=4, card=False)
    path, rng = folder / "session.toml", np.random.default_rng([case, 5])
    text = path.read_text(encoding="utf-8").replace("width = 96", f"width = {WIDTH}").replace(
        "draws = 4000", "draws = 1000")
    text = "".join(line for line in text.splitlines(True)
                   if "spectra/truth_" not in line and not line.startswith("reference = "))
    chart = chart_light(chart_copy(rng), lamp.radiance(NM), camera_sensitivities(), SIZE)
    take_photo(folder / "photos/chart.dng", chart, exposure_for(chart, CHART_EXPOSURE), rng)
    scene = (folder / "scene/box.xml").read_text(encoding="utf-8")
    if protocol == "walls":
        _write_spectrum(folder / "spectra/walls.csv", walls)
        text = _replaced(text, 'bsdf = "white"', 'bsdf = "white"\nknown = "spectra/walls.csv"')
    elif protocol != "chart":
        _write_spectrum(folder / "spectra/card.csv", card_reflectance() * (
            1 + CARD_ERROR * rng.standard_normal()))
        scene = with_card('<rgb name="reflectance" value="0.5, 0.5, 0.5"/>')(scene)
        text += '\n[materials.card]\nknown = "spectra/card.csv"\n'
    (folder / "scene/box.xml").write_text(scene, encoding="utf-8")
    if protocol == "moved":
        (folder / "scene/second.xml").write_text(lamp_at(SECOND_LAMP_CM)(scene), encoding="utf-8")
        text += '\n[views.second]\nphoto = "photos/second.dng"\nscene = "scene/second.xml"\n'
    path.write_text(text, encoding="utf-8")


def _write_spectrum(path: Path, reflectance: np.ndarray) -> None:
    path.write_text("nm,reflectance\n" + "".join(
        f"{nm:g},{value:.6f}\n" for nm, value in zip(NM, reflectance, strict=True)),
        encoding="utf-8")


def card_reflectance() -> np.ndarray:
    """Reflectance (P,) of the grey card: nearly even, as they are."""
    return np.asarray(CARD_REFLECTANCE * (1 + 0.02 * np.sin((NM - 400) / 90)))


def photographs(surfaces: dict[str, np.ndarray], faults: tuple[str, ...], case: int,
                protocol: str) -> dict[str, dict[str, np.ndarray]]:
    """Light (H, W, 3) from the box by photo, under each fault; the paints are those of
    ``surfaces``.
    """
    rng = np.random.default_rng([case, 7])
    direction, sign = rng.standard_normal(3), rng.choice([-1, 1])
    moved = BOX_LIGHT_CM + MOVED_CM * direction / np.linalg.norm(direction)
    light, curves = lamp.radiance(NM), camera_sensitivities()
    off = CARD_OFF_CM * rng.standard_normal(3) / np.sqrt(3)
    tilt = CARD_TILT_DEG * rng.standard_normal(2) / np.sqrt(2)
    card = with_card(regular_spectrum("reflectance", NM, card_reflectance()), off, tilt)

    def rendered(paint: dict[str, np.ndarray] = surfaces, light: np.ndarray = light,
                 edited: Callable[[str], str] = lambda xml: xml, second: bool = False
                 ) -> np.ndarray:
        def edit(xml: str) -> str:
            xml = lamp_at(SECOND_LAMP_CM)(xml) if second else xml
            return card(edited(xml)) if protocol in ("card", "moved") else edited(xml)
        return box_light(NM, paint, light, curves, size=SIZE, spp=SPP, seed=case, edited=edit)

    def lobes(fault: str, second: bool = False) -> np.ndarray:
        only, base = "cube" if "cube" in fault else "", base_of_plastic(LOBES[fault])
        return rendered({name: np.minimum(each / base, 1) if name.startswith(only) else each
                         for name, each in surfaces.items()},
                        edited=plastic(LOBES[fault], only), second=second)

    def even_gloss(second: bool = False) -> np.ndarray:
        return rendered({name: np.minimum(each + GLOSS, 1) for name, each in surfaces.items()},
                        second=second)

    def photo(fault: str) -> np.ndarray:
        if fault in LOBES:
            return lobes(fault)
        return {"none": lambda: plain,
                "exposure 5 %": lambda: plain * (1 + 0.05 * sign),
                "lamp moved 2 cm": lambda: rendered(edited=lamp_at(moved)),
                "lamp dimmed 5 %": lambda: rendered(light=light * dimmed(NM)),
                "veil 2 %": lambda: plain + VEIL * np.percentile(plain, 99, axis=(0, 1)),
                "gloss 3 %": even_gloss,
                "side 2 % wrong": lambda: rendered(edited=wider_box)}[fault]()

    def second_photo(fault: str) -> np.ndarray:
        if fault in LOBES:
            return lobes(fault, second=True)
        if fault == "side 2 % wrong":
            return rendered(edited=wider_box, second=True)
        return even_gloss(second=True) if fault == "gloss 3 %" else plain_second

    plain = rendered()
    if protocol != "moved":
        return {fault: {"box": photo(fault)} for fault in faults}
    plain_second = rendered(second=True)
    return {fault: {"box": photo(fault), "second": second_photo(fault)} for fault in faults}


def one_run(folder: Path, lights: dict[str, np.ndarray], exposure: Fraction,
            surfaces: dict[str, np.ndarray], seed: int) -> dict[str, Any]:
    """Figures of the photos of the box, by the session that users run."""
    for number, (name, light) in enumerate(lights.items()):
        take_photo(folder / f"photos/{name}.dng", light, exposure,
                   np.random.default_rng([seed, number]))
    session = sb.Session(folder)
    session.run(device="cpu")
    row: dict[str, Any] = {"verdict": session.verdict, "inside": {}, "width": {}, "off": {},
                           "rmse": {}, "named": [
                               one.code for one in session.spectra.found.verdict.conditions]}
    for name, estimate in session.items():
        if session.config.materials[name].known is None:
            lower, upper = estimate.band(LEVEL)
            truth = np.interp(estimate.nm, NM, surfaces[name])
            row["inside"][name] = float(np.mean((lower <= truth) & (truth <= upper)))
            row["width"][name] = float(np.mean(upper - lower))
            row["rmse"][name] = float(np.sqrt(np.mean((estimate.mean - truth) ** 2)))
            row["off"][name] = float(np.mean(estimate.mean) / np.mean(truth) - 1)
    return row


def measure(cases: int, faults: tuple[str, ...], protocol: str) -> dict[str, list[dict[str, Any]]]:
    """Figures of every case by fault.

    Parameters
    ----------
    cases : int
    faults : tuple of str
        Of FAULTS.
    protocol : str
        Of PROTOCOLS.
    """
    rows: dict[str, list[dict[str, Any]]] = {fault: [] for fault in faults}
    for case in range(cases):
        surfaces = paints(np.random.default_rng([case, 3]))
        with tempfile.TemporaryDirectory() as written:
            folder = Path(written) / "box"
            write_session(folder, case, surfaces["white"], protocol)
            photos = photographs(surfaces, ("none", *faults), case, protocol)
            exposure = exposure_for(photos["none"]["box"], BOX_EXPOSURE)
            for fault in faults:
                rows[fault].append(one_run(folder, photos[fault], exposure, surfaces, case))
        print(f"{protocol} {case + 1}/{cases}", file=sys.stderr, flush=True)
    return rows


def table(rows: dict[str, list[dict[str, Any]]]) -> str:
    """A line for every fault, as Markdown; errors are those of means over cases."""
    lines = ["| fault | bands hold | RMSE | width | neutrals | worst neutral | below | PASS | "
             "wrong | unnamed | WARN, FAIL |", "|" + "--|" * 11]
    for fault, each in rows.items():
        inside = np.array([np.mean(list(row["inside"].values())) for row in each])
        neutral = np.array([[row["inside"][name] for name in NEUTRALS if name in row["inside"]]
                            for row in each])
        rmse, width = (np.mean([value for row in each for value in row[key].values()])
                       for key in ("rmse", "width"))
        passed = np.array([row["verdict"] == "pass" for row in each])
        below = (inside < 0.9) | (neutral.min(axis=1) < 0.9)
        wrong = passed & below
        unnamed = [is_wrong and NAMED.get(fault) not in row["named"]
                   for is_wrong, row in zip(wrong, each, strict=True)]
        error = inside.std(ddof=1) / np.sqrt(len(each)) if len(each) > 1 else np.nan
        lines.append(f"| {fault} | {inside.mean():.3f} +- {error:.3f} | {rmse:.4f} | {width:.3f} | "
                     f"{neutral.mean():.3f} | {neutral.min():.2f} | {below.sum()} | "
                     f"{passed.sum()} | {wrong.sum()} | {sum(unnamed)} | {np.sum(~passed)} |")
    return "\n".join(lines)


def main() -> None:
    """Print a table of the faults for each protocol."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--faults", nargs="*", default=list(FAULTS), choices=FAULTS)
    parser.add_argument("--protocols", nargs="*", default=list(PROTOCOLS), choices=PROTOCOLS)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    for protocol in asked.protocols:
        with threadpool_limits(1, "blas"):
            rows = measure(asked.cases, tuple(asked.faults), protocol)
        print(json.dumps({protocol: rows}) if asked.json else f"{protocol}\n\n{table(rows)}\n",
              flush=True)


if __name__ == "__main__":
    main()
