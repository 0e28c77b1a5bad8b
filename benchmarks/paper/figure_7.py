"""Figure 7: blue and yellow walls of a Cornell box, explained by direct light alone and with
interreflection.

The photo holds all bounces. Inverse rendering by the paper's descent (from black, 7 coefficients)
and by traced light transport; then spectra behind the colours that it found, by the paper's sampler
and by the learnt prior. The last rows sample the true colours. RMSE against the true spectra,
400-700 nm.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.fixtures.cornell_box import cornell_box_xml
from spectrabox.radiometry.chart import PATCH_NAMES, chart_reflectances
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.records.spectra import Outcome, SpectralMeasurement
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
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

WIDTH, BOUNCES, COEFFICIENTS, PHOTO_SPP = 48, 8, 7, 1024
# BSDF ids of the box, and what they wear
WALLS = {"white": "white 9.5", "green": "blue", "red": "yellow"}
STEPS, STEP_SPP, DRAWS = 120, 12, 2000
SAMPLERS = (("prior", "ours: learnt prior, mean"), ("paper", "paper: mean of its box"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("figure_7.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    start_mitsuba("cpu")
    table, curves, photo = rows()
    picture(curves, photo, arguments.out)
    if arguments.json:
        print(json.dumps({"rows": table, "picture": str(arguments.out)}))
        return
    print("Paper: with interreflection the walls' spectra are found more accurately than with "
          "direct light alone.")
    print(f"{'light':<20} {'method':<28} {'blue':>7} {'yellow':>7}")
    for row in table:
        print(f"{row['light']:<20} {row['method']:<28} {row['blue']:7.3f} {row['yellow']:7.3f}")
        for wall, outcome in row["warnings"].items():
            print(f"    the sampler on the {wall} wall's colour: {outcome}")


def rows() -> tuple[list[dict[str, Any]], dict[tuple[str, str], np.ndarray], LinearImage]:
    """The table, every spectrum (2, P) by light and method, and the photo."""
    chart, camera = chart_reflectances("BabelColor Average", GRID), measured_camera()
    truth = {bsdf: chart[PATCH_NAMES.index(patch)] for bsdf, patch in WALLS.items()}
    photo = photograph(scene_of(cornell_box_xml(WIDTH, BOUNCES + 1)), truth, camera, PHOTO_SPP)
    materials = tuple(MaterialSpec(WALLS[bsdf], bsdf, truth[bsdf] if bsdf == "white" else None)
                      for bsdf in WALLS)
    wanted = np.array([truth["green"], truth["red"]])
    response = camera.sensitivity.curves * GRID.weights_nm
    response /= response.sum(axis=1, keepdims=True)
    curves: dict[tuple[str, str], np.ndarray] = {("", "truth"): wanted}
    warnings: dict[tuple[str, str], dict[str, str]] = {}
    for light, bounces, engines in (("direct only", 1, ("gradient", "single-bounce")),
                                    ("interreflection", BOUNCES, ("gradient", "transport"))):
        box = scene_of(cornell_box_xml(WIDTH, bounces + 1))
        for engine in engines:
            settings = plain_settings(COEFFICIENTS, engine, STEPS, STEP_SPP)
            view = PhotoView("photo", box, photo, camera, BANDS, materials,
                             LightScale(1.0, None, None, "given"))
            found = reconstruct(view, settings, lambda done, what: None)
            name = "paper: descent" if engine == "gradient" else "ours: traced transport"
            curves[light, name] = found.spectra[1:]
            method, then = SAMPLERS[engine == "gradient"]
            curves[light, then], warnings[light, then] = sampled(response, found.signal[1:], method)
    for method, then in SAMPLERS[::-1]:
        key = "(true colour)", then
        curves[key], warnings[key] = sampled(response, wanted @ response.T, method)
    table = [{"light": light, "method": method, "blue": spectrum_rmse(found[0], wanted[0]),
              "yellow": spectrum_rmse(found[1], wanted[1]),
              "warnings": warnings.get((light, method), {})}
             for (light, method), found in curves.items() if method != "truth"]
    return table, curves, photo


def sampled(response: np.ndarray, signals: np.ndarray,
            method: str) -> tuple[np.ndarray, dict[str, str]]:
    """Mean (2, P) of the spectra behind each signal (K,), and what the sampler warns of, by
    wall.
    """
    means, warnings = [], {}
    for wall, signal in zip(("blue", "yellow"), signals, strict=True):
        measurement = SpectralMeasurement(GRID, response, signal, np.zeros((3, 3)))
        draws = draw_spectra(measurement, method, DRAWS, 0, COEFFICIENTS, load_prior())
        means.append(np.interp(GRID.nm, PRIOR_GRID.nm, draws.spectra.mean(axis=0)))
        if method == "prior" and draws.outcome is not Outcome.FAMILIAR:
            warnings[wall] = [one.code for one in draws.findings]
    return np.array(means), warnings


def picture(curves: dict[tuple[str, str], np.ndarray], photo: LinearImage, path: Path) -> None:
    """The photo, and the spectra of both walls for both lights."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(11, 6))
    axes[0, 0].imshow(np.clip(photo.signal / np.percentile(photo.signal, 98), 0, 1) ** (1 / 2.2))
    axes[0, 0].set(title="photo (camera signal)", xticks=[], yticks=[])
    axes[1, 0].axis("off")
    for row, light in enumerate(("direct only", "interreflection")):
        for wall, name in enumerate(("blue", "yellow")):
            axis = axes[row, wall + 1]
            axis.plot(GRID.nm, curves["", "truth"][wall], color="black", linewidth=2, label="truth")
            for (shown, method), found in curves.items():
                if shown == light:
                    axis.plot(GRID.nm, found[wall], label=method, linestyle="--"
                              if "paper" in method else "-")
            axis.set(title=f"{name} wall, {light}", ylim=(0, 1), xlabel="wavelength (nm)",
                     ylabel="reflectance")
    handles, labels = axes[0, 1].get_legend_handles_labels()
    axes[1, 0].legend(handles, labels, loc="center")
    figure.tight_layout()
    figure.savefig(path, dpi=80)


if __name__ == "__main__":
    main()
