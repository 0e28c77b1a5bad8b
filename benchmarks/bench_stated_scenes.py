"""Scenes with nothing known, with many materials and with a rough metal: what bands hold, and time.

"nothing known": the demo's box with other paints in every case, photographed in 3, 6 or 9 bands by
a camera of known curves under a known light spectrum; neither a chart nor a paint tells the level
of the light. "28 materials": the Cornell box with 25 patches on its back wall, 5 bounces; "103
materials": with 100 of them, 3 bounces, 128 pixels wide. "metal": the box with one wall of a rough
metal, 96 pixels wide. Photos are stock Mitsuba's, from spectra.

    python -m benchmarks.bench_stated_scenes [--cases 5]

With ``--cases 0`` the rows of times alone.
"""
from __future__ import annotations

import argparse
import re
import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

import spectrabox as sb
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.fixtures.cornell_box import cornell_box_xml
from spectrabox.fixtures.demos import box_render, demo_scenes
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.calibration import Calibration, LightScale, SensitivityFit
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind
from spectrabox.radiometry.records.spectra import Outcome, Quantity, Spectrum
from spectrabox.reconstruct import inverse_rendering
from spectrabox.reconstruct.rendering.renderer import load_scene, render, start_mitsuba
from spectrabox.reconstruct.scene.scene_file import scene_of_text
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.view import MaterialSpec, PhotoView

from benchmarks.ledger import boxes, simulated

NOISE, WIDTH, SPP = 0.003, 40, 16       # of the photo; of the view; paths per pixel of the photo
PATCH = ('<bsdf type="diffuse" id="m{0}"><spectrum name="reflectance" value="0.5"/></bsdf>'
         '<shape type="rectangle" id="s{0}"><transform name="to_world"><scale value="{3:.2f}"/>'
         '<translate x="{1:.2f}" y="{2:.2f}" z="-0.98"/></transform><ref id="m{0}"/></shape>')
PLAIN = '<bsdf type="diffuse" id="red"><spectrum name="reflectance" value="0.5"/></bsdf>'
METAL = ('<bsdf type="twosided" id="red"><bsdf type="roughconductor"><float name="alpha" '
         'value="0.25"/><spectrum name="specular_reflectance" value="0.5"/></bsdf></bsdf>')


def nothing_known(number: int, bands: int) -> tuple[float, float, float, str]:
    """Held, RMSE, error of the level and verdict of a box of which nothing is known."""
    rng = np.random.default_rng([simulated.SEED, 104, number])
    truth, light, _ = boxes.drawn_box(rng)
    centre = np.linspace(425, 675, bands)
    curves = np.exp(-0.5 * ((NM - centre[:, None]) / (300 / bands / 1.8)) ** 2)
    signal = box_render.box_light(NM, truth, light, curves, size=boxes.BOX_SIZE, spp=SPP,
                                  seed=number + 1)
    signal *= 0.8 / signal.max() * (1 + NOISE * rng.standard_normal(signal.shape))
    with tempfile.TemporaryDirectory() as written:
        folder = Path(written)
        write_exr(folder / "box.exr", signal.astype(np.float32), [f"b{k}" for k in range(bands)])
        (folder / "box.xml").write_text(demo_scenes.box_scene(boxes.BOX_SIZE), encoding="utf-8")
        found = sb.reconstruct_scene(
            folder / "box.exr", scene=folder / "box.xml", materials=list(truth),
            camera=(NM, curves), light=(NM, light), width=WIDTH, draws=1000, device="cpu",
            progress=False)
    rows = [simulated.figures_of_one(found[name], spectrum) for name, spectrum in truth.items()]
    held, rmse, *_ = np.mean(rows, axis=0)
    level = next(iter(found.reconstruction.views[0].light_scale.common_errors.values()))
    return float(held), float(rmse), level, found.verdict


def timed(xml: str, width: int) -> tuple[float, float, float, str]:
    """Forecast, processor time, rms error of the signals and engine of a scene of three bands."""
    grid = visible_grid(5)
    scene, rng = scene_of_text(xml, Path("box.xml")), np.random.default_rng(1)
    paints = {name: np.clip(rng.uniform(0.1, 0.7) + 0.2 * np.sin(
        (grid.nm - 400) / rng.uniform(30, 120)), 0.03, 0.95) for name in scene.bsdf_ids}
    curves = np.exp(-0.5 * ((grid.nm - np.array([[600.0], [540.0], [460.0]])) / 30) ** 2)
    fit = SensitivityFit(grid, curves, None, None, None, None, None, None, None, "given",
                         Outcome.CONVERGED)
    light = Spectrum(grid, 1 + (grid.nm - 400) / 300, Quantity.RADIANCE, "given")
    calibration = Calibration(fit, light, None, np.zeros((3, 3)), ())
    view = PhotoView("photo", scene, _photo(np.ones((width, width, 3))), calibration, ("R", "G",
                                                                                       "B"),
                     tuple(MaterialSpec(name, name) for name in scene.bsdf_ids),
                     LightScale(1.0, None, None, "given"))
    picture, _ = render(load_scene(view.xml(paints, integrator="path")), 64, 1)
    view = replace(view, photo=_photo(picture))
    settings = InversionSettings(errors_from_scene=False, spectrum_prior="smooth")
    _, foreseen, _ = inverse_rendering.forecast([view], settings)
    begun = time.process_time()
    found = inverse_rendering.reconstruct(view, settings, lambda done, what: None)
    seconds = time.process_time() - begun
    true = _signals(paints, found.materials, view)
    return (foreseen, seconds, float(np.sqrt(np.mean((found.signal - true) ** 2))),
            found.engine)


def box_with_patches(side: int, width: int, bounces: int) -> str:
    """The Cornell box without its cube, with side x side patches on its back wall."""
    at = (2 * np.arange(side) + 1) / side - 1
    patches = "".join(PATCH.format(number, at[number % side], at[number // side], 0.95 / side)
                      for number in range(side**2))
    empty = re.sub(r'<shape type="cube".*?</shape>', "", cornell_box_xml(width, bounces + 1),
                   flags=re.DOTALL)
    return empty.replace("</scene>", patches + "</scene>")


def _photo(signal: np.ndarray) -> LinearImage:
    variance = np.maximum(signal, 1e-4) * 1e-4
    return LinearImage(signal.astype(np.float32), variance.astype(np.float32),
                       np.zeros(signal.shape, dtype=bool), 1.0, None, None, None,
                       PhotoKind.LINEAR_FILE, "", "box.exr", "")


def _signals(paints: Mapping[str, np.ndarray], names: tuple[str, ...],
             view: PhotoView) -> np.ndarray:
    response = view.response / view.response.sum(axis=1, keepdims=True)
    return np.asarray(np.array([paints[name] for name in names]) @ response.T)


def main() -> None:
    """Print every row."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=5)
    cases = parser.parse_args().cases
    start_mitsuba("cpu")
    for name, xml, width in (
            ("28 materials, 5 bounces", box_with_patches(5, 96, 5), 96),
            ("103 materials, 3 bounces", box_with_patches(10, 128, 3), 128),
            ("rough metal, width 96", cornell_box_xml(96, 7).replace(PLAIN, METAL), 96)):
        foreseen, seconds, error, engine = timed(xml, width)
        print(f"{name}: {seconds:.1f} s of processor (forecast {foreseen:.1f}), signals within "
              f"{error:.4f} rms; {engine}", flush=True)
    for bands in (3, 6, 9) if cases else ():
        rows = [nothing_known(number, bands) for number in range(cases)]
        held, rmse, level = (np.array([row[index] for row in rows]) for index in range(3))
        print(f"nothing known, {bands} bands: held {held.mean():.3f} ± "
              f"{held.std(ddof=1) / np.sqrt(cases):.3f}, RMSE {rmse.mean():.4f} ± "
              f"{rmse.std(ddof=1) / np.sqrt(cases):.4f}, level known to {level.mean():.2f}, "
              f"verdicts {', '.join(row[3] for row in rows)}", flush=True)


if __name__ == "__main__":
    main()
