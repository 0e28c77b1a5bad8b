"""Figure 1: from a photo of one object to its spectrum, with uncertainty, and again after two
readings.

Upper row as in the paper: descent through the renderer, draws of a box around its answer (Sec.
3.2), the best of them by readings at 400 and 700 nm (Eq. 9). Lower row: traced light transport, the
learnt prior, conditioned on the same two.
"""
from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.fixtures.object_views import cameras, object_mesh, view_xml, write_ply
from spectrabox.radiometry.grid import basis_matrix
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.records.scenes import Reconstruction
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.shape.shape_fit import with_mesh
from spectrabox.reconstruct.view import MaterialSpec, PhotoView
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.published.baselines import best_by_signals
from spectrabox.sampling.published.per_axis_box import sample_per_axis
from spectrabox.sampling.spectral_measurement import spline_operator

from benchmarks.paper.figure_4 import spectra_behind
from benchmarks.paper.synthetic_photo import (
    BANDS,
    GRID,
    measured_camera,
    photograph,
    plain_settings,
    scene_of,
)

WIDTH, PHOTO_SPP, COEFFICIENTS, STEPS, STEP_SPP = 48, 512, 7, 120, 16
SAMPLE = 20     # of CES99, counted from 0: a yellow that the prior was not trained on
DRAWS, KEPT = 10_000, 1_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("figure_1.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    start_mitsuba("cpu")
    truth = test_reflectances(GRID)["CES99"][SAMPLE]
    photo, found = inverted(truth)
    as_published, ours = (SpectralMeasurement(GRID, camera_response(), answer.signal[0],
                                              np.zeros((3, 3)))
                          for answer in found)
    box, _ = sample_per_axis(spline_operator(as_published, COEFFICIENTS),
                             np.clip(found[0].coefficients[0], 0, 1), DRAWS, 0)
    spectra = box @ basis_matrix(PRIOR_GRID.nm, COEFFICIENTS).T
    best = best_by_signals(spectra[:, [0, 60]], np.interp((400.0, 700.0), GRID.nm, truth),
                            KEPT)
    draws = {("paper", False): spectra, ("paper", True): spectra[best]}
    for readings in (False, True):
        draws["ours", readings] = spectra_behind("prior", readings, ours, truth, COEFFICIENTS)
    table = rows(truth, found, draws)
    picture(photo, truth, found, draws, arguments.out)
    if arguments.json:
        print(json.dumps({"rows": table, "picture": str(arguments.out)}))
        return
    print("Paper: two more readings reduce the uncertainty and bring the mean to the measured "
          "spectrum.")
    print(f"{'whose':<6} {'spectrum':<28} {'RMSE':>7} {'sd':>7}")
    for row in table:
        print(f"{row['whose']:<6} {row['spectrum']:<28} {row['rmse']:7.4f} "
              f"{row['standard_deviation']:7.4f}")


def camera_response() -> np.ndarray:
    """Response (3, P) of the camera under its light, rows summing to 1."""
    camera = measured_camera()
    response = camera.sensitivity.curves * camera.light.values * GRID.weights_nm
    return response / response.sum(axis=1, keepdims=True)


def inverted(truth: np.ndarray) -> tuple[LinearImage, list[Reconstruction]]:
    """The photo, and what the paper's descent and the transport engine find in it."""
    camera, scale = measured_camera(), LightScale(1.0, None, None, "given")
    scene = scene_of(view_xml(cameras(12)[5], WIDTH))
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "object.ply"
        write_ply(mesh, *object_mesh())
        blank = photograph(scene, {"paint": truth}, camera, 8)
        view = with_mesh(PhotoView("photo", scene, blank, camera, BANDS,
                                   (MaterialSpec("paint", "paint"),), scale), "object", mesh)
        photo = photograph(view.scene_file, {"paint": truth}, camera, PHOTO_SPP)
        return photo, [reconstruct(replace(view, photo=photo),
                                   plain_settings(COEFFICIENTS, engine, STEPS, STEP_SPP),
                                   lambda done, what: None) for engine in ("gradient", "transport")]


def rows(truth: np.ndarray, found: list[Reconstruction],
         draws: dict[tuple[str, bool], np.ndarray]) -> list[dict[str, Any]]:
    """RMSE of every answer, and the mean standard deviation of the draws."""
    at = np.interp(PRIOR_GRID.nm, GRID.nm, truth)
    table = [{"whose": name, "spectrum": "inverse rendering", "standard_deviation": float("nan"),
              "rmse": float(np.sqrt(np.mean((answer.spectra[0] - truth) ** 2)))}
             for name, answer in zip(("paper", "ours"), found, strict=True)]
    for (name, readings), spectra in draws.items():
        table.append({"whose": name,
                      "spectrum": f"mean of draws{', with readings' if readings else ''}",
                      "rmse": float(np.sqrt(np.mean((spectra.mean(axis=0) - at) ** 2))),
                      "standard_deviation": float(spectra.std(axis=0).mean())})
    return sorted(table, key=lambda row: row["whose"], reverse=True)


def picture(photo: LinearImage, truth: np.ndarray, found: list[Reconstruction],
            draws: dict[tuple[str, bool], np.ndarray], path: Path) -> None:
    """Photo, answers with their standard deviation, and thirty draws before and after the
    readings.
    """
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    nm = PRIOR_GRID.nm
    figure, axes = plt.subplots(2, 4, figsize=(13, 5.6))
    bright = np.percentile(photo.signal, 99.5)
    for row, (name, answer) in enumerate(zip(("paper", "ours"), found, strict=True)):
        image = photo.signal if row == 0 else answer.rendered
        axes[row, 0].imshow(np.clip(image / bright, 0, 1) ** (1 / 2.2))
        axes[row, 0].set(title=("photo", "rendered with our spectrum")[row], xticks=[], yticks=[])
        axes[row, 1].plot(GRID.nm, answer.spectra[0], label="inverse rendering", color="tab:orange")
        for readings, colour in ((False, "tab:green"), (True, "tab:red")):
            spectra, when = draws[name, readings], "after" if readings else "before"
            axes[row, 1].plot(nm, spectra.mean(axis=0), color=colour, label=f"mean, {when}")
            axes[row, 1].plot(nm, spectra.std(axis=0), color=colour, linestyle=":",
                              label=f"deviation, {when}")
            axis = axes[row, 3 if readings else 2]
            axis.fill_between(nm, spectra.min(axis=0), spectra.max(axis=0), color="0.9")
            axis.plot(nm, spectra[:30].T, linewidth=0.6)
            axis.set_title(f"{name}: draws {when} two readings", fontsize=9)
        for axis in axes[row, 1:]:
            axis.plot(GRID.nm, truth, color="black", linewidth=1.5)
            axis.set(ylim=(0, 1), xlabel="wavelength (nm)")
        axes[row, 1].legend(fontsize=7, framealpha=0.5)
        axes[row, 1].set_title(f"{name} (black: measured)", fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=80)


if __name__ == "__main__":
    main()
