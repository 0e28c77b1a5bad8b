"""What measured data give: a real box, raw photos of charts by others, genuine files.

Runs where the folder of measured data is named; nothing of it is in the project.

``box``: the paper's own experiment, two photos of one painted box, as docs/how-to/real-box.md has
it: white known, everything else estimated, 430-670 nm. ``charts``: raw photos of ColorCheckers with
nothing stated, each patch by a fit without it. ``marked``: black, neutral 3.5 and white of the same
charts marked as samples; which copies these are nobody knows, the truth is the mean of five tables
(charts.npz). ``filters``: a chart through seven filters by an industrial camera, all its channels.
``genuine files``: one
of each kind, beside what other software reads there; ``reported photos`` and ``reported spectra``:
as public reports of bugs describe them (reported.py), each right (1) or wrong (0).
"""
from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.radiometry import appearance
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.session.cli import app

from benchmarks.ledger import reported
from benchmarks.ledger.simulated import CHARTS
from benchmarks.ledger.task import Task

JUDGED_NM = (430.0, 670.0)
WIDTH = 96                      # of the rendered view of the box
BOX = """\
[photos]
object = "photo.exr"
[light]
spectrum = { file = "spectra/light.csv", column = 2 }
[sensitivity]
from = "spectra/fitted_sensitivity.csv"
relative_error = 0.05
[scale]
from = "material"
[scene]
file = "scene.xml"
[materials.white]
known = { file = "spectra/materials.csv", column = "white_wall" }
[materials.green]
[materials.red]
[materials.cube]
bsdf = "cubecolor"
[reconstruct]
width = %d
"""
PAINTS = {"green": "green_wall", "red": "red_wall"}
PHOTOS = ("canon550d_dusk", "industrial_indoor1", "industrial_outdoor2", "industrial_outdoor4")
MARKED = {"white": 18, "neutral 3.5": 22, "black": 23}      # numbers of the patches
INNER = 0.8                     # of what `find_chart` samples, that a user marks


# genuine files: wavelength in nm, and the value that other software reads there (the
# bytes by the formats' published layouts, JSON and CSV by Python's own readers)
GENUINE = {
    "asd/v6sample00000.asd": (550.0, 7508.873580468189),
    "asd/v7sample00000.asd": (550.0, 7679.396110841033),
    "asd/v8sample00001.asd": (550.0, 13859.49813833025),
    "reflectance/kremer_pigments/__speclib_averages.hdr": (564.953127, 0.12755296),
    "reflectance/rawtoaces190/rawtoaces190.json": (550.0, 0.0305),
    "cameras/Nikon_D700_380_780_5.json": (550.0, 0.896),
    "chart_copies/beyondrgb_cc_classic.csv": (380.0, 0.106)}
RECORDING = "cr30/sniffer/Test_Sample_36.61_-20.75_-2.86.spm"      # L*a*b* that its display shows


def tasks(data: Path | None) -> Iterator[Task]:
    """One task for each photo and file; of folders that the data lack, none."""
    if data is None:
        return
    for cube in ("grey", "yellow"):
        if (data / "yale_box").is_dir():
            yield Task("real/box", cube, box, (data / "yale_box", cube))
    for name in PHOTOS if (data / "raw_charts").is_dir() else ():
        photo = data / "raw_charts" / f"{name}.dng"
        yield Task("real/charts", name, chart, (photo,))
        yield Task("real/marked", name, marked, (photo,))
    if (data / "flea3_chart").is_dir():
        yield Task("real/filters", "flea3", filters, (data / "flea3_chart",))
    if (data / "asd").is_dir():
        for file, (nm, value) in GENUINE.items():
            yield Task("real/genuine files", Path(file).name, read_right, (data / file, nm, value))
        yield Task("real/genuine files", Path(RECORDING).name, replayed, (data / RECORDING,))
    yield from reported.tasks(data)


def box(data: Path, cube: str) -> dict[str, float]:
    """What the bands of three paints hold, and their RMSE."""
    truths = read_table(data / "materials.csv")
    paints = dict(zip(truths.names, truths.values, strict=True))
    with tempfile.TemporaryDirectory() as written:
        folder = Path(written)
        (folder / "spectra").mkdir()
        for name in ("light.csv", "fitted_sensitivity.csv", "materials.csv"):
            shutil.copy(data / name, folder / "spectra" / name)
        shutil.copy(data / f"{cube}_downsampled.exr", folder / "photo.exr")
        shutil.copy(data / f"cbox_spectral_{cube}.xml", folder / "scene.xml")
        (folder / "session.toml").write_text(BOX % WIDTH, encoding="utf-8")
        found = sb.Session(folder).run(device="cpu", progress=False).spectra
        figures = {}
        for name, column in {**PAINTS, "cube": f"{cube}_cube"}.items():
            estimate = found[name]
            lower, upper = estimate.band(0.95)
            seen = (estimate.nm >= JUDGED_NM[0]) & (estimate.nm <= JUDGED_NM[1])
            true = np.interp(estimate.nm, truths.nm, paints[column])[seen]
            inside = (lower[seen] <= true) & (true <= upper[seen])
            figures |= {f"held, {name}": float(inside.mean()),
                        f"RMSE, {name}": float(np.sqrt(np.mean((estimate.mean[seen] - true)**2))),
                        f"width, {name}": float(np.mean(upper[seen] - lower[seen]))}
    return figures


def chart(photo: Path) -> dict[str, float]:
    """What the bands of patches hold that the fit was not given, and their RMSE."""
    check = sb.fit_camera(photo, light="unknown").chart_check
    rmse, inside, _ = check.means
    differences = check.delta_e00[check.patches.counted]
    return {"held": inside, "RMSE": rmse, "dE00": float(differences.mean())}


def marked(photo: Path) -> dict[str, float]:
    """How far patches are off that are marked as samples of which nothing is stated."""
    corners = sb.find_chart(photo).corners
    middles = corners.mean(axis=1, keepdims=True)
    marks = middles + INNER * (corners - middles)
    result = sb.flat(photo, {name: marks[patch] for name, patch in MARKED.items()}, draws=1000,
                     progress=False)
    figures = {}
    for name, patch in MARKED.items():
        estimate = result[name]
        nm, true = estimate.nm, table_of_patch(patch, estimate.nm)
        weights = appearance.tristimulus_weights(nm, "D65")
        lightness = [appearance.lab_from_xyz(one @ weights.T, weights.sum(axis=1))[0]
                     for one in (estimate.mean, true)]
        lower, upper = estimate.band(0.95)
        figures |= {f"relative bias, {name}": float(estimate.mean.mean() / true.mean() - 1),
                    f"L* bias, {name}": float(lightness[0] - lightness[1]),
                    f"held, {name}": float(np.mean((lower <= true) & (true <= upper)))}
    return figures


def table_of_patch(patch: int, nm: np.ndarray) -> np.ndarray:
    """Mean reflectance (P,) of a patch by the tables of charts.npz."""
    with np.load(CHARTS) as tables:
        return np.mean([np.interp(nm, tables["nm"], tables[name][patch])
                        for name in tables.files if name != "nm"], axis=0)


def filters(folder: Path) -> dict[str, float]:
    """Patches by a calibration without them, against the chart's own measured spectra."""
    from benchmarks.bench_capture import seven_bands
    rmse, inside, _, _ = seven_bands(folder)["spectra"]["measured"]
    return {"held": inside, "RMSE": rmse}


def read_right(path: Path, nm: float, value: float) -> dict[str, float]:
    """Whether one of the spectra that ``spectrum show`` reads in a file has a value at a
    wavelength, to a thousandth of it.
    """
    shown = CliRunner().invoke(app, ["spectrum", "show", str(path), "--json"])
    if shown.exit_code:
        return {"read right": 0.0}
    table = json.loads(shown.stdout)
    found = [np.interp(nm, table["wavelengths_nm"], np.array(one["values"], float))
             for one in table["spectra"]]
    return {"read right": float(np.isclose(found, value, rtol=1e-3).any())}


def replayed(path: Path) -> dict[str, float]:
    """Whether the driver reads the colour in a recording that the instrument showed."""
    shown = CliRunner().invoke(app, ["meter", "replay", str(path), "--json"])
    if shown.exit_code:
        return {"read right": 0.0}
    stated = [float(word) for word in path.stem.split("_")[-3:]]
    found = [one["lab"] for one in json.loads(shown.stdout)["readings"]]
    return {"read right": float(bool(found) and np.allclose(found, stated, atol=0.01))}
