"""A known texture in a scene: unknown walls beside a known, patterned one.

The Cornell box with squares of three paints, or of their blends, on its back wall, rendered by
Mitsuba's path tracer with the texture itself; the other walls' spectra are estimated with the wall
cut into known materials by ``sb.split_texture``, and with the mean of its texels as its one known
spectrum. The known wall tells the strength of the light.

    python -m benchmarks.bench_known_texture [--squares 3] [--width 64] [--json]
"""
from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np

import spectrabox as sb
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.fixtures.cornell_box import cornell_box_xml
from spectrabox.radiometry.chart import PATCH_NAMES, chart_reflectances
from spectrabox.radiometry.interreflection import response_matrix, white_signal
from spectrabox.radiometry.spectra.spectral_layers import layer_names
from spectrabox.reconstruct.rendering.renderer import (
    load_scene,
    register_spectral_texture,
    render,
    start_mitsuba,
)
from spectrabox.reconstruct.scene.scene_file import scene_of_text
from spectrabox.reconstruct.scene.scene_xml import scene_xml

from benchmarks.paper.synthetic_photo import BANDS, GRID, measured_camera

CAMERA, WALL, SPP, DEPTH = "Nikon 5100 (NPL)", "back", 1024, 5
BLENDED = 24
PAINTS = ("orange", "blue", "white 9.5")
TRUTH = {"white": "neutral 8", "green": "green", "red": "red"}


def patch(name: str) -> np.ndarray:
    """Reflectance (P,) of a chart's patch."""
    return np.asarray(chart_reflectances("BabelColor Average", GRID)[PATCH_NAMES.index(name)])


def pattern(squares: int) -> np.ndarray:
    """Reflectances (squares, squares, P) of the wall: of three paints, or with ``BLENDED`` squares
    of blends of them, no two alike.
    """
    row, column = np.mgrid[:squares, :squares]
    paints = np.array([patch(name) for name in PAINTS])
    if squares != BLENDED:
        return paints[(row + 2 * column + row * column) % 3]
    places = np.stack([row, column], axis=-1) / squares
    weights = np.exp(-np.linalg.norm(places[..., None, :] - [(0.2, 0.2), (0.3, 0.8), (0.8, 0.5)],
                                     axis=-1) / 0.15)
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True) @ paints)


def box(folder: Path, squares: int, width: int, spp: int = SPP) -> np.ndarray:
    """Photo (H, W, 3) of the box; its scene ``box.xml`` and texture ``wall.exr`` go into the
    folder.

    Parameters
    ----------
    folder : Path
    squares : int
        Along each side of the wall.
    width, spp : int
        Pixels along each side of the photo, and paths of each.
    """
    text = cornell_box_xml(width, DEPTH).replace(
        f'id="{WALL}"><ref id="white"/>', f'id="{WALL}"><ref id="picture"/>').replace(
        '<bsdf type="diffuse" id="white">', '<bsdf type="diffuse" id="picture"><spectrum '
        'name="reflectance" value="0.5"/></bsdf>\n    <bsdf type="diffuse" id="white">')
    (folder / "box.xml").write_text(text, encoding="utf-8")
    pixels = pattern(squares)
    write_exr(folder / "wall.exr", np.dstack([pixels[..., :3], pixels]).astype(np.float32),
              ["R", "G", "B", *layer_names(GRID.nm)])
    camera = measured_camera()
    xml = scene_xml(scene_of_text(text, folder / "box.xml"), integrator="path",
                    reflectances={name: patch(own) for name, own in TRUTH.items()} | {
                        "picture": patch("white 9.5")},
                    light=np.ones(GRID.nm.size), range_nm=(GRID.nm[0], GRID.nm[-1]),
                    bands=dict(zip(BANDS, camera.sensitivity.curves, strict=True)),
                    size=(width, width), textures={WALL: folder / "wall.exr"})
    register_spectral_texture()
    return render(load_scene(xml), spp, 1, 4)[0]


def measured(squares: int, width: int) -> list[dict[str, object]]:
    """Rows of the table: the wall cut into its paints, and of one mean spectrum."""
    light, response = (GRID.nm, np.ones(GRID.nm.size)), measured_camera()
    relative = response_matrix(GRID, response.sensitivity.curves, np.ones(GRID.nm.size))
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        photo = box(folder, squares, width)
        cut, paints, left_out = sb.split_texture(folder / "box.xml", WALL, folder / "wall.exr")
        for wall, scene, known in (
                (f"cut into {len(paints)} known materials", cut, paints),
                ("its mean spectrum", folder / "box.xml",
                 {"picture": (GRID.nm, pattern(squares).mean(axis=(0, 1)))})):
            error = left_out if known is paints else pattern(squares).std(axis=(0, 1))
            start = time.process_time()
            found = sb.reconstruct_scene(photo, scene=scene, camera=CAMERA, light=light,
                                         materials=dict.fromkeys(TRUTH) | known, width=width,
                                         progress=False)
            seconds = time.process_time() - start
            off = [100 * (found[each].measurement.signal / (
                relative @ patch(own) / white_signal(relative)) - 1)
                for each, own in TRUTH.items()]
            rows.append({
                "squares": squares, "wall": wall, "verdict": found.verdict,
                "signal_off_percent": float(np.sqrt(np.mean(np.square(off)))),
                "largest_percent": float(np.abs(off).max()),
                "rmse": float(np.sqrt(np.mean([np.mean((np.interp(
                    GRID.nm, found[each].nm, found[each].mean) - patch(own)) ** 2)
                    for each, own in TRUTH.items()]))),
                "held": float(np.mean([np.mean((
                    np.interp(GRID.nm, found[each].nm, found[each].band()[0]) <= patch(own))
                    & (patch(own) <= np.interp(GRID.nm, found[each].nm, found[each].band()[1])))
                    for each, own in TRUTH.items()])),
                "paint_error": float(np.sqrt(np.mean(np.square(error)))), "processor_s": seconds})
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--squares", type=int, nargs="+", default=[3, 12, BLENDED])
    parser.add_argument("--width", type=int, default=64)
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    start_mitsuba("cpu")
    rows = [row for squares in arguments.squares for row in measured(squares, arguments.width)]
    if arguments.json:
        print(json.dumps(rows))
        return
    print("| squares | known wall | its texels off, rms | signals off, rms, % | at most, % | "
          "RMSE of spectra | held | verdict | processor, s |\n|--|--|--|--|--|--|--|--|--|")
    for row in rows:
        print(f"| {row['squares']} x {row['squares']} | {row['wall']} | "
              f"{row['paint_error']:.3f} | "
              f"{row['signal_off_percent']:.2f} | {row['largest_percent']:.2f} | "
              f"{row['rmse']:.4f} | {row['held']:.3f} | {row['verdict']} | "
              f"{row['processor_s']:.0f} |")


if __name__ == "__main__":
    main()
