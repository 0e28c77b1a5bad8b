"""Two examples of every command, which end its help; tests/test_docs.py runs them."""
from __future__ import annotations

from collections.abc import Iterable

DEMOS = {"mybox": "spectrabox demo mybox", "painting": "spectrabox demo painting --flat"}
CAMERA = '"Nikon 5100 (NPL)"'

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("spectrabox demo painting --flat", "spectrabox demo mybox"),
    "new": ("spectrabox new wall-painting --template flat", "spectrabox new tapebox --template "
    "box"),
    "check": ("spectrabox check mybox", "spectrabox check mybox --json"),
    "run": ("spectrabox run mybox", "spectrabox run mybox --until calibrate"),
    "status": ("spectrabox status mybox", "spectrabox status mybox --json"),
    "report": ("spectrabox report mybox", "spectrabox report mybox --json"),
    "doctor": ("spectrabox doctor", "spectrabox doctor --device cpu --json"),
    "open": ("spectrabox open painting/photos/painting.dng",
             "spectrabox open mybox --watch tethered"),
    "batch": ("spectrabox batch mybox", "spectrabox batch mybox --workers 1 --out today"),
    "flat": ("spectrabox flat painting/photos/painting.dng",
             "spectrabox flat painting/photos/painting.dng --session measured \\\n"
             "    --region wall=986,462,1073,537 --family wall=paint \\\n"
             "    --white-card 1006,751,1165,806=0.94"),
    "relight": ("spectrabox relight mybox --light FL11 --width 64",
                "spectrabox relight mybox --light A --width 64 --out evening.png"),
    "colour": ("spectrabox colour painting", "spectrabox colour painting --space p3 --out p3"),
    "draws": ("spectrabox draws mybox --out draws.npz",
              "spectrabox draws mybox --samples 100 --step 10 --out draws.csv"),
    "rehearse": ("spectrabox rehearse mybox", "spectrabox rehearse mybox --times 20 --seed 2"),
    "develop": ("spectrabox develop mybox/photos/box.dng --out box.exr",
                "spectrabox develop mybox/photos/box.dng \\\n"
                "    --flat-field mybox/photos/flat.dng --out even.exr"),
    "chart": ("spectrabox chart painting/photos/painting.dng",
              "spectrabox chart painting/photos/painting.dng \\\n"
              "    --overlay chart.png --out patches.csv"),
    "camera fit": ("spectrabox camera fit painting/photos/painting.dng --light unknown",
                   "spectrabox camera fit mybox/photos/chart.dng \\\n"
                   "    --light mybox/spectra/light.csv --out curves.csv"),
    "camera profile": (
        f"spectrabox camera profile {CAMERA} --camera \"Nikon D5100\"",
        f"spectrabox camera profile {CAMERA} --camera \"Nikon D5100\" \\\n"
        "    --out d5100.dcp --out d5100.json"),
    "camera prior": ("spectrabox camera prior measured-cameras --out mine.npz",
                     "spectrabox camera prior measured-cameras --out mine.npz \\\n"
                     "    --source \"my laboratory, 2026\" --licence \"CC BY 4.0\""),
    "camera add": ("spectrabox camera add measured-cameras",
                   "spectrabox camera add measured-cameras --json"),
    "camera list": ("spectrabox camera list", "spectrabox camera list --json"),
    "filter fit": ("spectrabox filter fit chart.dng chart-gel.dng --out gel.csv",
                   "spectrabox filter fit lamp.csv lamp-gel.csv --readings --out gel.csv"),
    "geometry board": ("spectrabox geometry board --board board.toml --out board.png",
                       "spectrabox geometry board --board board.toml --square-px 300 \\\n"
                       "    --out large.png"),
    "geometry lens": ("spectrabox geometry lens board1.dng board2.dng board3.dng \\\n"
                      "    --board board.toml --out lens.json",
                      "spectrabox geometry lens board1.dng board2.dng board3.dng \\\n"
                      "    --board board.toml --out lens.json --force --overlay seen"),
    "geometry pose": ("spectrabox geometry pose box.dng --scene scene.xml \\\n"
                      "    --points points.toml --out posed.xml",
                      "spectrabox geometry pose box.dng --scene scene.xml \\\n"
                      "    --board board.toml --lens lens.json --out by-board.xml"),
    "geometry box": ("spectrabox geometry box tapebox", "spectrabox geometry box tapebox --json"),
    "geometry undistort": (
        "spectrabox geometry undistort box.dng --lens lens.json --out box.exr",
        "spectrabox geometry undistort box.dng --lens lens.json --out box.exr --force"),
    "geometry light": ("spectrabox geometry light box.dng --scene posed.xml --light lamp.csv \\\n"
                       "    --sensitivity curves.csv --reflectances paints.csv --out lit.xml",
                       "spectrabox geometry light box.dng --scene posed.xml --light LED-B3 \\\n"
                       f"    --sensitivity {CAMERA} --reflectances paints.csv \\\n"
                       "    --out lit.xml --force --spp 512"),
    "geometry beam": ("spectrabox geometry beam wall.dng --wall wall.toml --out beam.csv",
                      "spectrabox geometry beam wall.dng --wall wall.toml --out beam.csv \\\n"
                      "    --flat-field white-card.dng --force"),
    "sample": (f"spectrabox sample --sensitivity {CAMERA} --light D65 \\\n"
               "    --signal 0.47,0.27,0.12 --noise 0.005 --reading 700:0.6:0.01",
               "spectrabox sample --srgb 200,100,50 --out colour.csv --plot colour.png"),
    "uplift": (f"spectrabox uplift painting/photos/painting.dng --sensitivity {CAMERA} \\\n"
               "    --light D65 --side 9 --out uplifted",
               f"spectrabox uplift painting/photos/painting.dng --sensitivity {CAMERA} \\\n"
               "    --light D65 --side 9 --to zarr --out arrays"),
    "advise": ("spectrabox advise painting",
               "spectrabox advise painting --lamps A,LED-B3"),
    "match": ("spectrabox match mybox CES99",
              "spectrabox match mybox \"BabelColor Average\" --only cube"),
    "meter list": ("spectrabox meter list", "spectrabox meter list --json"),
    "meter identify": ("spectrabox meter identify --port /dev/ttyACM0 --instrument pr655",
                       "spectrabox meter identify --port COM3 --instrument cr250"),
    "meter measure": ("spectrabox meter measure mybox --port /dev/ttyACM0 --instrument pr655 \\\n"
                      "    --as light --repeat 5",
                      "spectrabox meter measure mybox --with spotread --as paint --name red"),
    "meter replay": ("spectrabox meter replay fixtures/transcripts/cr250.transcript",
                     "spectrabox meter replay fixtures/transcripts/cr250.transcript --draw"),
    "spectrum show": ("spectrabox spectrum show mybox/spectra/light.csv --draw",
                      "spectrabox spectrum show mybox/spectra/light.csv --json"),
    "spectrum convert": (
        "spectrabox spectrum convert mybox/spectra/light.csv --out light.spdx --grid 400:700:5",
        "spectrabox spectrum convert mybox/spectra/truth_green.csv \\\n"
        "    mybox/spectra/truth_red.csv --out converted --to .sp"),
}


# what examples name that no demonstration writes
BROUGHT_ALONG = {
    "measured-cameras": "files of your cameras' measured curves",
    "measured-paints": "files of reflectances that you have measured",
    "chart-gel.dng": "the chart, photographed without and with the filter",
    "lamp-gel.csv": "spectra of a lamp, measured without and with the filter",
    "board.toml": "the columns, rows, square and marker of your printed board",
    "points.toml": "known points: [points.NAME] scene = [x, y, z], px = [x, y]",
    "lens.json": "'spectrabox geometry lens' writes it",
    "paints.csv": "reflectances of the scene's surfaces, a column for each",
    "wall.toml": "where the wall's rectangle and the lamp are",
    "fixtures/transcripts": "in the source of spectrabox"}


def origin_of_files(examples: Iterable[str]) -> list[str]:
    """What writes the files that examples name, or what they are, a line for each."""
    text = " ".join(examples)
    demos = [f"('{demo}' writes {folder})" for folder, demo in DEMOS.items()
             if f" {folder}" in text and demo not in text]
    return demos + [f"({name}: {what})" for name, what in BROUGHT_ALONG.items()
                    if name in text and f"--out {name}" not in text]
