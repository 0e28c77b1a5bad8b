"""Spectra of a painted box from two photos, against measured paints: ours beside the paper's
method.

Data: the paper's own physical experiment (folder with two photos, their scenes, the paints and the
flash measured with a spectroradiometer, and the sensitivities that the authors fitted). RMSE over
430-670 nm. Nothing is chosen by the measured paints: the errors of light and geometry are read off
the photo itself, where surfaces of one paint disagree; the prior on spectra was learnt from other
reflectances; the band mixing is allowed because the photos are JPEGs. "photo aligned" moves the
camera's principal point by the shift that the edges show, white known. "curve undone" takes the
photo as a tone curve of the power that its edges of one paint show, and undoes it.

"white known" gives every method the white paint's spectrum, which sets the light scale. "nothing
known" gives it the light scale that "white known" found with the same method, and no spectrum; "no
scale" not even that: interreflection and the prior must tell brightness of light from brightness of
paint. Band mixing needs a known surface: without one it cannot be told from the colours of the
paints, so its row "nothing known" is there to show just that.
"""
from __future__ import annotations

import argparse
import copy
import json
import time
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.chart_calibration import calibration_from_curves
from spectrabox.capture.photo.linear import open_photo
from spectrabox.capture.photo.preview import bin_image, render_size
from spectrabox.measure import rules, texts
from spectrabox.radiometry.findings import Severity, at_least
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.scenes import LearntSpectra, Reconstruction
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves, read_spectrum
from spectrabox.reconstruct.agreement import edge_shift, scene_errors
from spectrabox.reconstruct.fit.transport_fit import TracedView, fit_traced, spectrum_prior
from spectrabox.reconstruct.inverse_rendering import reconstruct, reconstruct_views
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.scene.surfaces import block_regions
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.transport_engine import nuisances, trace_view, unit_scene
from spectrabox.reconstruct.view import MaterialSpec, PhotoView
from spectrabox.sampling.prior.mixture import load_prior, reflectance_moments

GRID = visible_grid()
JUDGED = (GRID.nm >= 430) & (GRID.nm <= 670)
PHOTOS = ("grey", "yellow")
PAINTS = {"white": "white_wall", "green": "green_wall", "red": "red_wall"}
WIDTH = 96
LEARNT, MIXED = "ours: + learnt prior", "ours: + band mixing"
MIXING = 0.1            # a camera's colour matrix departs from the identity by tenths


def read_box(folder: Path, which: str) -> tuple[PhotoView, dict[str, np.ndarray]]:
    """One photo with its scene, materials left out, and the measured paints by BSDF id; the cube is
    ``grey_cube`` or ``yellow_cube``.
    """
    scene = read_scene(folder / f"cbox_spectral_{which}.xml")
    cube = f"{which}_cube"
    # the two cubes are two materials, though both scenes call theirs "cubecolor"
    for node in scene.root.iter():
        if node.get("id") == "cubecolor":
            node.set("id", cube)
    scene = replace(scene, surfaces={shape: cube if bsdf == "cubecolor" else bsdf
                                     for shape, bsdf in scene.surfaces.items()})
    photo = open_photo(folder / f"{which}_downsampled.exr")
    height, width = photo.signal.shape[:2]
    nm, names, values = read_curves(folder / "materials.csv")
    paints = dict(zip(names, on_grid(nm, values, GRID, "materials.csv"), strict=True))
    nm, bands, curves = read_curves(folder / "fitted_sensitivity.csv")
    curves = np.maximum(on_grid(nm, curves, GRID, "fitted_sensitivity.csv"), 0.0)
    light = read_spectrum(folder / "light.csv", role=Quantity.RELATIVE, column=2)
    view = PhotoView(which, scene, bin_image(photo, *render_size(width, height, WIDTH)),
                     calibration_from_curves(GRID, curves / curves.max(), light, 0.05), bands, ())
    return view, {name: paints[column] for name, column in PAINTS.items()} | {cube: paints[cube]}


def learnt_spectra() -> LearntSpectra:
    """Mean and covariance of the reflectances that the sampling stage's prior was trained on."""
    prior = load_prior()
    return LearntSpectra(np.asarray(prior.nm), *reflectance_moments(prior))


def methods(steps: int) -> dict[str, InversionSettings]:
    """What is compared, from the paper's method to all that the transport engine offers."""
    ours = InversionSettings(coefficients=9, engine="transport", spectrum_prior="smooth",
                             errors_from_scene=False)
    told = replace(ours, errors_from_scene=True)
    learnt = replace(told, spectrum_prior="learnt", learnt=learnt_spectra())
    return {"paper: gradient, 7 coefficients": InversionSettings(7, steps=steps, spp=16,
                                                                 engine="gradient"),
            "ours: smooth prior, 1 % gains": ours,
            "ours: errors from the scene": told,
            LEARNT: learnt,
            MIXED: replace(learnt, mixing_error=MIXING)}


def specs(truth: dict[str, np.ndarray], known: tuple[str, ...]) -> tuple[MaterialSpec, ...]:
    return tuple(MaterialSpec(name, name, paint if name in known else None) for name,
                 paint in truth.items())


def aligned(view: PhotoView, shift: tuple[float, float]) -> PhotoView:
    """The view with its camera's principal point moved, so that the rendering shifts by that many
    pixels.
    """
    root = copy.deepcopy(view.scene_file.root)
    sensor = root.find("sensor")
    assert sensor is not None
    height, width = view.photo.signal.shape[:2]
    for name, offset in (("x", -shift[0] / width), ("y", -shift[1] / height)):
        ET.SubElement(sensor, "float", name=f"principal_point_offset_{name}", value=f"{offset:.6f}")
    return replace(view, scene_file=replace(view.scene_file, root=root))


def without_curve(view: PhotoView, power: float) -> PhotoView:
    """The view with each band of its photo raised to 1 / power, about the mean of its white."""
    white = view.used & np.isin(view.surface, [
        index for index, bsdf in enumerate(view.scene_file.surfaces.values()) if bsdf == "white"])
    level = view.photo.signal[white].mean(axis=0)
    share = np.maximum(view.photo.signal / level, 1e-6)
    slope = share ** (1 / power - 1) / power
    return replace(view, photo=replace(
        view.photo, signal=(level * share ** (1 / power)).astype(np.float32),
        variance=(view.photo.variance * slope**2).astype(np.float32)))


def errors(found: Reconstruction, truth: dict[str, np.ndarray]) -> dict[str, float]:
    """RMSE of each unknown material."""
    return {name: rmse(found.spectra[place], truth[name]) for place,
            name in enumerate(found.materials)
            if not found.known[place]}


def rmse(spectrum: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((spectrum - truth)[JUDGED] ** 2)))


def one_photo(view: PhotoView, truth: dict[str, np.ndarray],
              settings: InversionSettings) -> list[dict[str, Any]]:
    """White known, then nothing known but the light scale that this gave."""
    rows = []
    for case, known in (("white known", ("white",)), ("nothing known", ())):
        start = time.perf_counter()
        found = reconstruct(replace(view, materials=specs(truth, known)), settings,
                            lambda done, what: None)
        seconds = time.perf_counter() - start
        view = replace(view, light_scale=found.light_scale)
        rows.append({"photo": view.name, "case": case, "seconds": seconds,
                     "rmse": errors(found, truth),
                     "scale": found.light_scale.value, "found": found})
    return rows


def without_scale(view: PhotoView, truth: dict[str, np.ndarray], given: Reconstruction,
                  settings: InversionSettings) -> dict[str, Any]:
    """Neither spectrum nor scale: what interreflection and the prior tell of the light scale."""
    start = time.perf_counter()
    view = replace(view, materials=specs(truth, ()))
    region, group = block_regions(view.surface, view.used)
    traced = trace_view(view, unit_scene(view, view.scene_file.max_depth - 1), region, group,
                        1, lambda done, what: None)
    shown = scene_errors(given.agreement, frozenset(), len(group))
    assert shown is not None
    free = replace(nuisances(view, settings), scale=None, brightness_error=shown.brightness,
                   surface_error=shown.colour, block_error=shown.block)
    fit = fit_traced([TracedView(view, traced, region, group, free)],
                     [spectrum_prior(settings, GRID)] * len(view.unknown))
    spectra = view.spectra(fit.coefficients)
    return {"photo": view.name, "case": "no scale", "seconds": time.perf_counter() - start,
            "scale": fit.views[0].scale, "scale_error": fit.views[0].scale_error,
            "rmse": {name: rmse(spectra[place], paint) for place,
                     (name, paint) in enumerate(truth.items())}}


def row(one: dict[str, Any]) -> str:
    """One line of the table; the mean is over the unknown materials."""
    values = one["rmse"]
    shown = " ".join(f"{name.split('_')[0]} {value:.3f}" for name, value in values.items())
    return (f"{one['method']:<36} {one['case']:<13} {one['photo']:<6} mean "
            f"{np.mean(list(values.values())):.3f}  {shown}"
            f"  {one['seconds']:.1f} s  scale {one['scale']:.0f}")


def inconsistencies(found: Reconstruction, bands: tuple[str, ...]) -> list[str]:
    """What photo and scene contradict each other in."""
    shift = edge_shift(found.measured, found.rendered)[0]
    lines = [f"shift of the photo against the rendering: {shift[0]:+.1f}, {shift[1]:+.1f} of "
             f"{WIDTH} pixels"]
    lines += [f"{name}: photo / rendering {' '.join(f'{value:.2f}' for value in ratio)}"
              for name, ratio in zip(found.agreement.names, found.agreement.ratio, strict=True)]
    noted = at_least((*rules.misfits_of(found, bands, ""), *found.findings), Severity.NOTE)
    return lines + [texts.sentence(one) for one in noted]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True,
                        help="the folder yale_box, or one that holds it")
    parser.add_argument("--steps", type=int, default=200, help="of the paper's gradient descent")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    folder = arguments.data / "yale_box" if (arguments.data / "yale_box").is_dir() \
        else arguments.data
    if not (folder / "materials.csv").exists():
        print(f"{folder} holds no materials.csv: nothing to compare with, skipped")
        return
    start_mitsuba("cpu")
    boxes = [read_box(folder, which) for which in PHOTOS]
    chosen, result, contradictions = methods(arguments.steps), [], {}
    for method, settings in chosen.items():
        for view, truth in boxes:
            rows = one_photo(view, truth, settings)
            contradictions[view.name] = inconsistencies(rows[0]["found"], view.bands)
            if method == LEARNT:
                rows.append(without_scale(view, truth, rows[1]["found"], settings))
                shift = edge_shift(rows[0]["found"].measured, rows[0]["found"].rendered)[0]
                rows.append(one_photo(aligned(view, shift), truth, settings)[0]
                            | {"case": "photo aligned"})
            if method in (LEARNT, MIXED):
                power = next(one.values["value"] for one in rows[0]["found"].findings
                             if one.code in ("scene.linear", "scene.not-linear"))
                rows.append(one_photo(without_curve(view, power), truth, settings)[0]
                            | {"case": "curve undone"})
            result += [{"method": method} | {key: value for key, value in one.items()
                                             if key != "found"}
                       for one in rows]
    truth = boxes[0][1] | boxes[1][1]
    for method in (LEARNT, MIXED):
        start = time.perf_counter()
        views = [replace(view, materials=specs(truth, ("white",))) for view, _ in boxes]
        joint = reconstruct_views(views, chosen[method], lambda done, what: None)
        seconds = time.perf_counter() - start
        result.append({"method": method, "photo": "both", "case": "white known", "seconds": seconds,
                       "scale": joint.views[0].light_scale.value,
                       "rmse": {name: rmse(joint.spectra[place], truth[name])
                                for place, name in enumerate(joint.materials)
                                if not joint.known[place]}})
    if arguments.json:
        print(json.dumps({"rows": result, "contradictions": contradictions}))
        return
    print("\n".join(row(one) for one in result))
    for name, lines in contradictions.items():
        print(f"\nWhat does not fit together in the {name} photo (white known, last method):")
        print("\n".join(f"  {line}" for line in lines))


if __name__ == "__main__":
    main()
