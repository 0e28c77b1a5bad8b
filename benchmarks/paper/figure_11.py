"""Figure 11: the paper's physical box, its photos with a grey and with a yellow cube, run as two
sessions.

The photos come from the authors' repository and went through the camera's colour processing; README
and report say what does not fit. White is given, as a lab would that has measured one paint; green,
red and the cube are found and compared with their measured spectra over 430-670 nm. Each photo is
run twice: as a session runs, and with the paper's descent (N = 7), whose answers then get the
paper's draws. The data carry no licence: nothing of them is kept, no picture is shipped.
"""
from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.spectra import Quantity, SpectralMeasurement
from spectrabox.radiometry.spectra.spectrum_files import (
    SpectralTable,
    on_grid,
    read_curves,
    read_spectrum,
    read_table,
    spectrum_on_grid,
)
from spectrabox.sampling.draw_methods import draw_spectra
from spectrabox.sampling.prior.mixture import PRIOR_GRID

FINE = visible_grid(1)
DESCENT = 'engine = "gradient"\ncoefficients = 7\nsteps = 200'
COLUMNS = ("inverse rendering", "mean", "lower 0.95", "upper 0.95")
MATERIALS = {"white": ("white", "white_wall"), "green": ("green", "green_wall"),
             "red": ("red", "red_wall")}
SESSION = """
[session]
name = "the paper's box with the {cube} cube"
[photos]
object = "photos/{cube}_downsampled.exr"
[light]
spectrum = {{ file = "spectra/light.csv", column = 2 }}
[sensitivity]
from = "spectra/fitted_sensitivity.csv"
relative_error = 0.05
[scale]
from = "material"
[scene]
file = "scene/cbox_spectral_{cube}.xml"
[reconstruct]
width = {width}
{descent}
[sampling]
draws = 2000
"""


def write_session(data: Path, folder: Path, cube: str, width: int, descent: str = "") -> None:
    """A session folder of one photo: white known, everything else with its measured spectrum as
    truth.
    """
    for name, part in (("photos", f"{cube}_downsampled.exr"), ("spectra", "light.csv"),
                       ("spectra", "fitted_sensitivity.csv"), ("spectra", "materials.csv"),
                       ("scene", f"cbox_spectral_{cube}.xml")):
        (folder / name).mkdir(parents=True, exist_ok=True)
        shutil.copyfile(data / part, folder / name / part)
    text = SESSION.format(cube=cube, width=width, descent=descent)
    for name, (bsdf, column) in {**MATERIALS, "cube": ("cubecolor", f"{cube}_cube")}.items():
        use = "known" if name == "white" else "truth"
        text += (f'[materials.{name}]\nbsdf = "{bsdf}"\n'
                 f'{use} = {{ file = "spectra/materials.csv", column = "{column}" }}\n')
    (folder / "session.toml").write_text(text, encoding="utf-8")


def run(folder: Path) -> SpectralTable:
    """The table of spectra that a run of the session leaves, as an operator gets it."""
    ended = subprocess.run([sys.executable, "-m", "spectrabox", "run", str(folder), "--device",
                            "cpu"], check=False, capture_output=True, text=True)
    if not (folder / "spectra.csv").is_file():
        raise SystemExit(f"the session of {folder.name} did not run: {ended.stderr.strip()[-500:]}")
    return read_table(folder / "spectra.csv")


def judged(found: dict[str, np.ndarray], truth: np.ndarray, inside: np.ndarray) -> dict[str, float]:
    """RMSE of the one spectrum and of the mean, and coverage of the band, at the wavelengths that
    are inside.
    """
    expected, lower, upper = truth[inside], found["lower 0.95"][inside], found["upper 0.95"][inside]
    errors = {f"rmse_{name.replace(' ', '_')}": float(
                  np.sqrt(np.mean((found[name][inside] - expected)**2)))
              for name in ("inverse rendering", "mean")}
    return {**errors, "coverage": float(np.mean((expected >= lower) & (expected <= upper))),
            "width": float(np.mean(upper - lower))}


def camera(folder: Path) -> np.ndarray:
    """Response (3, 301) of the published curves under the lamp, rows summing to 1."""
    nm, _, curves = read_curves(folder / "fitted_sensitivity.csv")
    lamp = spectrum_on_grid(read_spectrum(folder / "light.csv", role=Quantity.RELATIVE, column=2),
                            FINE)
    response = on_grid(nm, curves, FINE, "fitted_sensitivity.csv") * lamp * FINE.weights_nm
    return response / response.sum(axis=1, keepdims=True)


def paper_draws(response: np.ndarray, one: np.ndarray) -> dict[str, np.ndarray]:
    """One spectrum (301,), and mean and band (301,) of the paper's draws for its colour."""
    measurement = SpectralMeasurement(FINE, response, response @ one, np.zeros((3, 3)))
    spectra = draw_spectra(measurement, "paper", 2000, 0, 7).spectra
    lower, upper = np.quantile(spectra, [0.025, 0.975], axis=0)
    made = {"mean": spectra.mean(axis=0), "lower 0.95": lower, "upper 0.95": upper}
    return {"inverse rendering": one, **{key: np.interp(FINE.nm, PRIOR_GRID.nm, values) for key,
                                         values in made.items()}}


def picture(shown: dict[str, tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]],
            path: Path) -> None:
    """Mean and band, the paper's descent (dashed) and the measured spectrum of every unknown
    material.
    """
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(10, 5.4), sharex=True, sharey=True)
    for axis, (name, (nm, found, truth)) in zip(axes.ravel(), shown.items(), strict=False):
        axis.fill_between(nm, found["lower 0.95"], found["upper 0.95"], color="0.85")
        axis.plot(nm, found["mean"], color="tab:green")
        axis.plot(nm, found["descent"], color="tab:orange", linestyle="--")
        axis.plot(nm, truth, color="black")
        axis.set(title=name, xlim=(400, 700), ylim=(0, 1))
    figure.suptitle("black: measured; green, grey: mean and 95 % of our draws; dashed: the paper's "
                    "descent", fontsize=9)
    figure.supxlabel("wavelength (nm)", fontsize=9)
    figure.supylabel("reflectance", fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder with yale_box/")
    parser.add_argument("--width", type=int, default=96, help="of the rendering, in pixels")
    parser.add_argument("--out", type=Path, default=Path("figure_11.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    if arguments.data is None or not (arguments.data / "yale_box").is_dir():
        print("skipped: the photos of the physical box are not here; give the folder that holds "
              "yale_box with --data")
        return
    truths = read_table(arguments.data / "yale_box" / "materials.csv")
    response = camera(arguments.data / "yale_box")
    rows: list[dict[str, Any]] = []
    shown = {}
    for cube in ("grey", "yellow"):
        with tempfile.TemporaryDirectory() as scratch:
            tables = []
            for name, descent in (("ours", ""), ("paper", DESCENT)):
                folder = Path(scratch) / name
                write_session(arguments.data / "yale_box", folder, cube, arguments.width, descent)
                tables.append(run(folder))
        table, published = tables
        inside = (table.nm >= 430) & (table.nm <= 670)
        for name, column in (("green", "green_wall"), ("red", "red_wall"),
                             ("cube", f"{cube}_cube")):
            truth = np.interp(table.nm, truths.nm, truths.values[truths.names.index(column)])
            found = {key: table.values[table.names.index(f"{name} {key}")] for key in COLUMNS}
            one = published.values[published.names.index(f"{name} inverse rendering")]
            paper = judged(paper_draws(response, np.interp(FINE.nm, published.nm, one)),
                           np.interp(FINE.nm, table.nm, truth), (FINE.nm >= 430) & (FINE.nm <= 670))
            rows.append({"photo": cube, "material": name, **judged(found, truth, inside),
                         **{f"{key}_paper": value for key, value in paper.items()}})
            shown[f"{cube} photo: {name}"] = (table.nm, found | {"descent": one}, truth)
    picture(shown, arguments.out)
    if arguments.json:
        print(json.dumps({"rows": rows, "picture": str(arguments.out)}))
        return
    print("Paper: spectra of walls and cubes with uncertainty; errors are larger than in synthetic "
          "scenes. 430-670 nm:")
    print(f"{'photo':<7} {'material':<9} {'whose':<6} {'RMSE one spectrum':>18} {'RMSE mean':>10} "
          f"{'95 % holds':>11} {'width':>6}")
    for row in rows:
        for whose, key in (("ours", ""), ("paper", "_paper")):
            print(f"{row['photo']:<7} {row['material']:<9} {whose:<6} "
                  f"{row['rmse_inverse_rendering' + key]:18.3f} {row['rmse_mean' + key]:10.3f} "
                  f"{row['coverage' + key]:11.3f} {row['width' + key]:6.3f}")


if __name__ == "__main__":
    main()
