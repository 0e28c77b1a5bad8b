"""Figure 6: shape and spectrum of one object from photos around it, starting from a grey sphere.

Twelve photos of 48 x 48 pixels with a flash beside the camera. Silhouettes are compared in the
views that were used and in six others; the spectrum that the transport engine finds on the found
shape with the one on the true shape.
"""
from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import spectrabox as sb
from spectrabox.fixtures.object_views import (
    GUESS_RADIUS,
    cameras,
    object_mesh,
    view_xml,
    write_ply,
)
from spectrabox.radiometry.chart import PATCH_NAMES, chart_reflectances
from spectrabox.radiometry.interreflection import white_signal
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.reconstruct.inverse_rendering import reconstruct_views
from spectrabox.reconstruct.rendering.renderer import render, start_mitsuba
from spectrabox.reconstruct.shape.mesh import silhouette
from spectrabox.reconstruct.shape.shape_fit import with_mesh
from spectrabox.reconstruct.shape.start import light_on_card
from spectrabox.reconstruct.view import MaterialSpec, PhotoView
from spectrabox.sampling.draw_methods import draw_spectra
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior

from benchmarks.paper.synthetic_photo import (
    BANDS,
    GRID,
    measured_camera,
    photograph,
    plain_settings,
    scene_of,
    spectrum_rmse,
)

WIDTH, VIEWS, OTHERS, PHOTO_SPP, COEFFICIENTS = 48, 12, 6, 256, 9
PAINT = "orange"
MATERIALS = (MaterialSpec(PAINT, "paint"),)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("figure_6.png"))
    parser.add_argument("--mesh", type=Path,
                        help="where the found mesh goes; without it beside the picture")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the text")
    arguments = parser.parse_args()
    mesh = arguments.mesh or arguments.out.with_suffix(".ply")
    start_mitsuba("cpu")
    with tempfile.TemporaryDirectory() as folder:
        result = measure(Path(folder) / "true.ply", mesh, arguments.out)
    if arguments.json:
        print(json.dumps(result | {"picture": str(arguments.out), "mesh": str(mesh)}))
        return
    print("Paper: from a black sphere, shape and appearance are found, matching the photos' "
          "colours.")
    print(f"{result['seconds']:.0f} s for {result['steps']} steps; {result['outcome']}")
    for name in ("used", "other"):
        mean, least = result[f"iou_{name}"]
        print(f"silhouettes, {name} views: IoU mean {mean:.4f}, least {least:.4f} "
              f"(start {result[f'start_iou_{name}']:.3f})")
    print("spectrum RMSE: " + ", ".join(f"{name} {value:.4f}" for name,
                                        value in result["rmse"].items()))
    print("learnt prior on the found shape: 95 % of draws hold the truth at "
          f"{result['coverage_95']:.3f} of wavelengths, standard deviation "
          f"{result['standard_deviation']:.4f}")


def measure(true_mesh: Path, found_mesh: Path, out: Path) -> dict[str, Any]:
    """All figures; writes the found mesh and the picture."""
    write_ply(true_mesh, *object_mesh())
    truth = chart_reflectances("BabelColor Average", GRID)[PATCH_NAMES.index(PAINT)]
    used, other = photos(cameras(VIEWS), true_mesh, truth), photos(cameras(OTHERS, 1.0), true_mesh,
                                                                   truth)
    start = time.perf_counter()
    found = fitted(used, true_mesh.parent)
    seconds = time.perf_counter() - start
    found.to_ply(found_mesh)
    spectra, drawn = {"descent": found.descent["object"]}, []
    for name, mesh in (("on the found shape", found_mesh), ("on the true shape", true_mesh)):
        answer = reconstruct_views([with_mesh(view, "object", mesh) for view in used],
                                   plain_settings(COEFFICIENTS), lambda done, what: None)
        spectra[name] = answer.spectra[0]
        measurement = SpectralMeasurement(GRID, answer.response[:3], answer.signal[0][:3],
                                          np.zeros((3, 3)))
        drawn.append(draw_spectra(measurement, "prior", 2000, 0, COEFFICIENTS,
                                  load_prior()).spectra)
        spectra[f"{name}, learnt prior"] = np.interp(GRID.nm, PRIOR_GRID.nm, drawn[-1].mean(axis=0))
    band, at = np.quantile(drawn[0], [0.025, 0.975], axis=0), np.interp(PRIOR_GRID.nm, GRID.nm,
                                                                        truth)
    result: dict[str, Any] = {"seconds": seconds, "steps": len(found.loss_history),
                              "outcome": "converged" if found.converged else "step limit",
                              "rmse": {name: spectrum_rmse(curve, truth) for name,
                                       curve in spectra.items()},
                              "coverage_95": float(np.mean((at >= band[0]) & (at <= band[1]))),
                              "standard_deviation": float(drawn[0].std(axis=0).mean())}
    for name, views in (("used", used), ("other", other)):
        overlap = [iou(view, found_mesh, true_mesh) for view in views]
        result[f"iou_{name}"] = [float(np.mean(overlap)), float(np.min(overlap))]
        result[f"start_iou_{name}"] = float(np.mean([iou(view, None, true_mesh) for view in views]))
    picture(used[::4], other[:1], found, found_mesh, true_mesh, spectra | {"truth": truth}, band,
            out)
    return result


def fitted(used: Sequence[PhotoView], folder: Path) -> sb.ShapeSpectra:
    """Shape and spectrum by ``sb.fit_shape``, from a sphere of radius 1."""
    paths = []
    for number, position in enumerate(cameras(VIEWS)):
        paths.append(folder / f"view_{number}.xml")
        paths[-1].write_text(view_xml(position, WIDTH), encoding="utf-8")
    vertices = object_mesh()[0]
    white = white_signal(used[0].response) / np.pi * light_on_card(
        used[0].scene_file, (vertices.min(axis=0) + vertices.max(axis=0)) / 2)
    return sb.fit_shape([np.array(view.photo.signal) for view in used], paths,
                        start=((0.0, 0.0, 0.0), GUESS_RADIUS), white=white, width=WIDTH,
                        camera="Nikon 5100 (NPL)", light=(GRID.nm, np.ones(GRID.nm.size)),
                        progress=False)


def photos(positions: np.ndarray, mesh: Path, truth: np.ndarray) -> list[PhotoView]:
    """A view from each position whose scene holds a sphere and whose photo shows the true
    object.
    """
    camera, views = measured_camera(), []
    for number, position in enumerate(positions):
        scene = scene_of(view_xml(position, WIDTH))
        blank = photograph(scene, {"paint": truth}, camera, 8)
        view = PhotoView(f"view {number + 1}", scene, blank, camera, BANDS, MATERIALS,
                         LightScale(1.0, None, None, "given"))
        photo = photograph(with_mesh(view, "object", mesh).scene_file, {"paint": truth}, camera,
                           PHOTO_SPP, number)
        views.append(replace(view, photo=photo))
    return views


def outline(view: PhotoView, mesh: Path | None) -> np.ndarray:
    """Share (H, W) of each pixel that the mesh covers; None for the sphere of the start."""
    shown = view if mesh is None else with_mesh(view, "object", mesh)
    return silhouette(shown, "object")


def iou(view: PhotoView, mesh: Path | None, true_mesh: Path) -> float:
    """Intersection over union of two silhouettes, by area."""
    first, second = outline(view, mesh), outline(view, true_mesh)
    return float(np.minimum(first, second).sum() / np.maximum(first, second).sum())


def picture(used: Sequence[PhotoView], other: Sequence[PhotoView],
            found: sb.ShapeSpectra, mesh: Path, true_mesh: Path, spectra: dict[str, np.ndarray],
            band: np.ndarray, path: Path) -> None:
    """Photos, renderings of what was found, silhouettes (both white, true alone red, found alone
    blue), spectra.
    """
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    places: list[Any] = [[*(f"{row}, {column}" for column in range(4)), *3 * ["spectra"]]
                         for row in range(3)]
    figure, axes = plt.subplot_mosaic(places, figsize=(12.5, 5), layout="constrained")
    coefficients = np.linalg.lstsq(used[0].basis(COEFFICIENTS), found.descent["object"],
                                   rcond=None)[0]
    for column, view in enumerate([*used, *other]):
        shape = with_mesh(view, "object", mesh)
        rendered = render(shape.scene(coefficients[None]), 256, 3)[0]
        a, b = outline(view, mesh), outline(view, true_mesh)
        bright = np.percentile(view.photo.signal, 99.5)
        rows = [np.clip(image / bright, 0, 1) ** (1 / 2.2) for image in (view.photo.signal,
                                                                         rendered)]
        for row, image in enumerate([*rows, np.stack([b, np.minimum(a, b), a], axis=-1)]):
            axes[f"{row}, {column}"].imshow(image)
            axes[f"{row}, {column}"].set(xticks=[], yticks=[])
        axes[f"0, {column}"].set_title(view.name if column < len(used) else "view not used",
                                       fontsize=9)
    for row, name in enumerate(("photo", "found", "silhouettes")):
        axes[f"{row}, 0"].set_ylabel(name)
    axis = axes["spectra"]
    axis.fill_between(PRIOR_GRID.nm, *band, color="tab:green", alpha=0.2)
    for name, curve in spectra.items():
        axis.plot(GRID.nm, curve, label=name, color="black" if name == "truth" else None,
                  linestyle="--" if "true shape" in name else "-")
    axis.set(xlabel="wavelength (nm)", ylabel="reflectance", ylim=(0, 1))
    axis.set_title("band: 95 % of the learnt prior's draws, found shape", fontsize=9)
    axis.legend(fontsize=8)
    figure.savefig(path, dpi=80)


if __name__ == "__main__":
    main()
