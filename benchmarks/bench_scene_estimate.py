"""Boxes whose lamp, camera or lens is not as their scene says: what the spectra lose by it.

The box of the demo with drawn paints, white known, curves and lamp known, photographed by a stock
Mitsuba path tracer from spectra at 1 nm. Paints are published test colours; with ``--imagined``
they are formulas, of which the bands hold less however well their signals are known. What is wrong
of each photo:

* ``none``: nothing.
* ``beam``: the lamp, stated as an even ball, is 40 to 70 % a spot of Mitsuba's before the ball (in
  it, the ball would shade it). It looks into the box, up to 12 cm beside its middle, and falls off
  linearly to 85 degrees.
* ``spot``: the same with a spot that falls off to 45 degrees.
* ``lamp``: it stands 2 cm from where the scene has it, in a drawn direction.
* ``camera``: it is turned by half a degree about a drawn axis.
* ``vignetting``: the corners are 20 to 40 % darker, and there is no flat field.
* ``all``: the wide beam, lamp, camera and vignetting at once.
* ``uneven``: nothing, but every paint is lighter and darker by up to 8 % from place to place.
* ``tone``: nothing but a tone curve of the photo, of the power .45 to .6.

    python -m benchmarks.bench_scene_estimate --photos FOLDER [--seed 53] [--cases 4]
        [--kinds KIND ...] [--imagined]

Photos are kept in FOLDER for the next run of the same seed and paints. "Exact" is the share that
bands hold of the same paints where their signals are known to .0005 of white: what is missing there
is not the scene's. "Stated" is the share of paints whose signals lie within the 95 % ellipsoid of
what the fit says of their errors.
"""
from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

import spectrabox as sb
from spectrabox.fixtures.demos import box_render, demo_scenes
from spectrabox.fixtures.paints import NM
from spectrabox.reconstruct.scene.surfaces import hits_of

from benchmarks.ledger import boxes, simulated

KINDS = ("none", "beam", "lamp", "camera", "vignetting", "all", "tone", "spot", "uneven")
SEED, PAINTS = 53, ("green", "red", "cube")
SIZE, SPP, WIDTH = (208, 312), 64, 96
MOVED_CM, TURNED_DEG = 2.0, 0.5
CUTOFF_DEG, NARROW_DEG, EVEN_DEG = 85.0, 45.0, 10.0     # of spots; within the last they are even
BEFORE = 1.01           # radii of the lamp's ball, from its middle to the spot
UNEVEN, PATCHES = 0.08, 4       # of a paint, to either side; its field is drawn on so many squared
EXACT = 0.0005          # of white: error of a signal that is known
LEVEL = 0.95            # of what is stated of signals
MIDDLE_CM = np.array([0.0, 16.5, -20.0])
SPOT = """
    <emitter type="spot" id="beam">
        <float name="cutoff_angle" value="{cutoff}"/><float name="beam_width" value="{width}"/>
        <transform name="to_world"><lookat origin="{origin}" target="{target}" up="0, 1, 0"/>
        </transform>{intensity}
    </emitter>
</scene>"""
CAMERA = '<lookat origin="0, 16.5, 69" target="0, 16.5, 0" up="0, 1, 0"/>'


def write_box(folder: Path, kind: str, number: int, seed: int, imagined: bool) -> None:
    """Photo, scene and truth of one box."""
    rng = np.random.default_rng([seed, KINDS.index(kind), number])
    truth, light, curves = boxes.drawn_box(rng)
    if not imagined:
        truth.update(zip(PAINTS, simulated.surfaces_of("faultless", rng), strict=False))
    lamp = np.array(demo_scenes.BOX_LIGHT_CM)
    facts: dict[str, Any] = {}
    if kind in ("lamp", "all"):
        direction = rng.standard_normal(3)
        facts["lamp_cm"] = (MOVED_CM * direction / np.linalg.norm(direction)).tolist()
        lamp = lamp + facts["lamp_cm"]
    share = rng.uniform(0.4, 0.7) if kind in ("beam", "spot", "all") else 0.0
    cutoff = NARROW_DEG if kind == "spot" else CUTOFF_DEG
    aim = MIDDLE_CM + rng.uniform(-12, 12, 3)
    before = lamp + BEFORE * demo_scenes.LIGHT_RADIUS_CM * (aim - lamp) / np.linalg.norm(aim - lamp)
    axis = rng.standard_normal(3)
    turn = np.radians(TURNED_DEG) * axis / np.linalg.norm(axis)

    def edited(xml: str) -> str:
        xml = replaced(xml, point(demo_scenes.BOX_LIGHT_CM), point(lamp))
        if kind in ("camera", "all"):
            xml = replaced(xml, CAMERA, turned(turn))
        if share and 'id="light"' in xml:
            xml = replaced(xml, "</scene>", SPOT.format(
                cutoff=cutoff, width=EVEN_DEG, origin=point(before), target=point(aim),
                intensity=demo_scenes.regular_spectrum(
                    "intensity", NM, share * np.pi * demo_scenes.LIGHT_RADIUS_CM**2 * light)))
        return with_uneven_paints(xml, truth, fields)
    fields = uneven_fields(folder.with_name(folder.name + "-fields"), tuple(truth), rng
                           ) if kind == "uneven" else {}
    seen = box_render.box_light(NM, truth, (1 - share) * light, curves, size=SIZE, spp=SPP,
                                seed=number + 1, edited=edited)
    if kind in ("vignetting", "all"):
        facts["corner"] = rng.uniform(0.6, 0.8)
        seen = seen * falloff(SIZE, facts["corner"])[..., None]
    if kind == "tone":
        facts["power"] = rng.uniform(0.45, 0.6)
        peak = np.percentile(seen, 99, axis=(0, 1))
        seen = peak * (seen / peak) ** facts["power"]
    if share:
        facts["beam"] = range_of_beam(lamp, aim, share, cutoff)
    folder.mkdir(parents=True)
    boxes.take(folder / "box.dng", seen, 0.7, rng)
    (folder / "box.xml").write_text(demo_scenes.box_scene(SIZE), encoding="utf-8")
    np.savez(folder / "truth.npz", light=light, curves=curves, **truth)
    (folder / "facts.json").write_text(json.dumps(facts), encoding="utf-8")


def uneven_fields(folder: Path, paints: tuple[str, ...],
                  rng: np.random.Generator) -> dict[str, Path]:
    """A picture by paint, of how much of its lighter part is where, from 0 to 1."""
    mi = box_render.renderer()
    folder.mkdir(parents=True, exist_ok=True)
    fields = {paint: (folder / f"{paint}.exr").resolve() for paint in paints}
    for picture in fields.values():
        field = rng.uniform(0, 1, (PATCHES, PATCHES, 1))
        mi.Bitmap(field.astype(np.float32)).write(str(picture))
    return fields


def with_uneven_paints(xml: str, truth: dict[str, np.ndarray], fields: dict[str, Path]) -> str:
    """The scene with paints that are mixed, by their fields, of a lighter and a darker one.

    Parameters
    ----------
    xml : str
    truth : paint -> (P,) reflectance at ``NM``
    fields : paint -> picture
    """
    for paint, picture in fields.items():
        start = xml.find(f'<bsdf type="diffuse" id="{paint}"')
        if start < 0:
            continue
        end = xml.index("</bsdf>", start) + len("</bsdf>")
        both = "".join('<bsdf type="diffuse">' + demo_scenes.regular_spectrum(
            "reflectance", NM, np.minimum(factor * truth[paint], 1)) + "</bsdf>"
            for factor in (1 - UNEVEN, 1 + UNEVEN))
        xml = (f'{xml[:start]}<bsdf type="blendbsdf" id="{paint}"><texture name="weight" '
               f'type="bitmap"><string name="filename" value="{picture}"/><boolean name="raw" '
               f'value="true"/></texture>{both}</bsdf>{xml[end:]}')
    return xml


def range_of_beam(lamp: np.ndarray, aim: np.ndarray, share: float, cutoff: float) -> float:
    """By how much the lamp shines more at the brightest than at the darkest place that the photo
    shows.

    Parameters
    ----------
    lamp, aim : (3,) arrays
    share : float
        Of the spot, along its axis.
    cutoff : float
        Degrees at which the spot ends.
    """
    mi = box_render.renderer()
    scene = mi.load_string(demo_scenes.box_scene(SIZE))
    row, column = (each.ravel() for each in np.indices((SIZE[0] // 4, SIZE[1] // 4)))
    places = hits_of(scene, (SIZE[1] // 4, SIZE[0] // 4), row, column)[0] - lamp
    away = places[np.isfinite(places).all(axis=1)]
    cosine = away @ (aim - lamp) / np.linalg.norm(away, axis=1) / np.linalg.norm(aim - lamp)
    angle = np.degrees(np.arccos(cosine.clip(-1, 1)))
    shining = 1 - share + share * ((cutoff - angle) / (cutoff - EVEN_DEG)).clip(0, 1)
    return float(shining.max() / shining.min() - 1)


def point(place: np.ndarray) -> str:
    """A point as XML holds it."""
    return ", ".join(f"{value:g}" for value in np.asarray(place, dtype=float).round(6))


def replaced(xml: str, old: str, new: str) -> str:
    """The text with one part exchanged, which must be there."""
    assert old in xml, old
    return xml.replace(old, new)


def turned(turn: np.ndarray) -> str:
    """The camera's lookat, turned by a rotation vector (3,) about its own axes, in radians."""
    from scipy.spatial.transform import Rotation
    rotation = Rotation.from_rotvec(turn)
    target, up = np.array([0, 16.5, 69]) + rotation.apply([0, 0, -69]), rotation.apply([0, 1, 0])
    return f'<lookat origin="0, 16.5, 69" target="{point(target)}" up="{point(up)}"/>'


def falloff(size: tuple[int, int], corner: float) -> np.ndarray:
    """Light (H, W) that a lens lets through: 1 in the middle, ``corner`` in the corners, as of
    lenses whose aperture clips from half of the way on.
    """
    height, width = size
    y, x = np.mgrid[:height, :width]
    radius = np.hypot(x - (width - 1) / 2, y - (height - 1) / 2) / np.hypot(
        (width - 1) / 2, (height - 1) / 2)
    return np.asarray(1 - (1 - corner) * (0.5 * radius**2 + 0.5 * radius**3))


def measure(folder: Path) -> dict[str, Any]:
    """Figures of one box, by what users call."""
    with np.load(folder / "truth.npz") as stored:
        truth = {name: stored[name] for name in ("white", *PAINTS)}
        light, curves = stored["light"], stored["curves"]
    start = time.process_time()
    found = sb.reconstruct_scene(
        folder / "box.dng", scene=folder / "box.xml", camera=(NM, curves), light=(NM, light),
        materials=dict.fromkeys(truth) | {"white": (NM, truth["white"])}, width=WIDTH,
        draws=1000, device="cpu", progress=False)
    rows = {name: dict(zip(simulated.FIGURES, map(float, simulated.figures_of_one(
        found[name], truth[name])), strict=True)) for name in PAINTS}
    seconds = time.process_time() - start
    exact = held_of_exact({name: truth[name] for name in PAINTS}, light, curves)
    joint = found.reconstruction
    made = joint.views[0]
    for name, row in rows.items():
        true = joint.response @ np.interp(joint.grid.nm, NM, truth[name])
        number = joint.materials.index(name)
        off = joint.signal[number] - true
        stated = joint.signal_covariance[number] + joint.model_covariance[number] * np.outer(
            joint.signal[number], joint.signal[number])
        row["signal"] = float(np.sqrt(np.mean(off**2)))
        row["squares"] = float(off @ np.linalg.solve(stated, off))
        row["exact"] = exact[name]
    return {"kind": folder.name.split("-")[0], "box": folder.name, "seconds": seconds,
            "surfaces": rows, "verdict": found.verdict,
            "headline": found.found.verdict.headline,
            "findings": [(one.code, one.subject, dict(one.values))
                         for one in getattr(made, "findings", ())],
            "facts": json.loads((folder / "facts.json").read_text(encoding="utf-8"))}


def held_of_exact(truth: dict[str, np.ndarray], light: np.ndarray,
                  curves: np.ndarray) -> dict[str, float]:
    """Share that the bands hold of each paint whose signals are known."""
    weights = curves * light / np.sum(curves * light, axis=1, keepdims=True)
    signals = np.array([one @ weights.T for one in truth.values()])
    found = sb.sample(signals, camera=(NM, curves), light=(NM, light), white=np.ones(len(curves)),
                      noise=np.full(len(curves), EXACT), draws=1000)
    return {name: simulated.figures_of_one(one, truth[name])[0]
            for name, one in zip(truth, found.values(), strict=True)}


def table(rows: list[dict[str, Any]]) -> str:
    """Rows of a table in Markdown: medians and means over the surfaces of each kind's boxes."""
    from scipy.special import chdtri

    limit = chdtri(3, 1 - LEVEL)
    lines = ["| what is wrong | boxes | signals off, median | stated | RMSE, median | bands hold | "
             "exact | width | PASS, WARN, FAIL | seconds of processor |",
             "|--|--|--|--|--|--|--|--|--|--|"]
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        values = {figure: np.array([one[figure] for row in own for one in row["surfaces"].values()])
                  for figure in ("signal", "squares", *simulated.FIGURES)}
        held, exact = (np.array([np.mean([one[figure] for one in row["surfaces"].values()])
                                 for row in own]) for figure in ("held", "exact"))
        verdicts = [sum(row["verdict"] == word for row in own) for word in ("pass", "warn", "fail")]
        lines.append(
            f"| {kind} | {len(own)} | {np.median(values['signal']):.4f} | "
            f"{np.mean(values['squares'] < limit):.2f} | {np.median(values['RMSE']):.4f} | "
            f"{held.mean():.3f} ± {error_of(held):.3f} | {exact.mean():.3f} ± "
            f"{error_of(exact):.3f} | {values['width'].mean():.3f} | "
            f"{', '.join(map(str, verdicts))} | {np.median([row['seconds'] for row in own]):.0f} |")
    return "\n".join(lines)


def error_of(values: np.ndarray) -> float:
    """Standard error of a mean."""
    return float(values.std(ddof=1) / np.sqrt(values.size)) if values.size > 1 else float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, required=True, help="folder that keeps the photos")
    parser.add_argument("--cases", type=int, default=4, help="boxes of each kind")
    parser.add_argument("--kinds", nargs="*", default=KINDS, choices=KINDS)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--imagined", action="store_true", help="paints by formulas")
    parser.add_argument("--json", type=Path, help="file that takes all figures")
    arguments = parser.parse_args()
    rows = []
    for kind in arguments.kinds:
        for number in range(arguments.cases):
            folder = arguments.photos / f"{kind}-{number}"
            if not folder.exists():
                write_box(folder, kind, number, arguments.seed, arguments.imagined)
            rows.append(measure(folder))
            row = rows[-1]
            print(row["box"], {name: (round(one["signal"], 4), round(one["held"], 2)) for name, one
                               in row["surfaces"].items()}, row["verdict"], row["headline"],
                  row["facts"], row["findings"], f"{row['seconds']:.0f} s", flush=True)
            if arguments.json:
                arguments.json.write_text(json.dumps(rows), encoding="utf-8")
    print(table(rows))


if __name__ == "__main__":
    main()
