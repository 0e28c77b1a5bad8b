"""Make the ten scenes, render them, invert them by ``spectrabox.reconstruct_scene``, score.

    python -m benchmarks.scenes FOLDER [--only NAME ...] [--make]

FOLDER keeps scenes and photos, and in ``answers`` what was found, in the form that
``benchmarks.scenes.score`` takes. ``--make`` stops after the photos.
"""
from __future__ import annotations

import argparse
import multiprocessing
import time
from concurrent import futures
from pathlib import Path

import numpy as np

import spectrabox as sb
from spectrabox.radiometry.errors import SpectraboxError

from benchmarks.scenes import made, render, score

WIDTH, DRAWS = 64, 1000         # of the view that is compared with the photo; spectra of a band
HEAD = (*score.HEAD, "verdict", "seconds of processor")


def photographed(name: str, folder: Path) -> None:
    """Write a scene with its photo; whatever is there already stays."""
    if not (folder / "photo.exr").exists():
        made.write(name, folder)
        render.photograph(folder)


def inverted(folder: Path) -> tuple[np.ndarray, dict[str, np.ndarray], str]:
    """Wavelengths, columns of an answer and the verdict of a scene's folder."""
    _, truth = score.read_spectra(folder / "truth.csv")
    known_nm, known = score.read_spectra(folder / "known.csv")
    nm, curves = score.read_spectra(folder / "camera.csv")
    _, light = score.read_spectra(folder / "light.csv")
    unknown = [name for name in truth if name not in known]
    found = sb.reconstruct_scene(
        folder / "photo.exr", scene=folder / "scene.xml", light=(nm, light["value"]),
        camera=(nm, np.array(list(curves.values()))), width=WIDTH, draws=DRAWS, device="cpu",
        materials=dict.fromkeys(unknown) | {name: (known_nm, values)
                                            for name, values in known.items()}, progress=False)
    answer = dict[str, np.ndarray]()
    for name in unknown:
        lower, upper = found[name].band(0.95)
        answer |= {name: found[name].mean, name + score.LOWER: lower, name + score.UPPER: upper}
    return found[unknown[0]].nm, answer, found.verdict


def measured(name: str, folder: Path) -> tuple[str, ...]:
    """A row of HEAD; the answer is written beside the scenes."""
    answer_file = folder / "answers" / f"{name}.csv"
    try:
        nm, answer, verdict = inverted(folder / name)
    except SpectraboxError as error:
        return name, *["-"] * (len(score.HEAD) - 1), f"no answer: {error}", processor_seconds()
    score.write_spectra(answer_file, nm, answer)
    result = score.scored_file(answer_file, folder / name)
    return *result.cells(name), verdict.upper(), processor_seconds()


def processor_seconds() -> str:
    """Of this process, its start included."""
    return f"{time.process_time():.0f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scenes", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="+", choices=made.SCENES, metavar="NAME",
                        default=list(made.SCENES))
    parser.add_argument("--make", action="store_true", help="scenes and photos, no inversion")
    asked = parser.parse_args()
    (asked.folder / "answers").mkdir(parents=True, exist_ok=True)
    rows = []
    # a process for each, so that its seconds are those of one measurement from the start
    for name in asked.only:
        with futures.ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as maker:
            maker.submit(photographed, name, asked.folder / name).result()
        if not asked.make:
            with futures.ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as inverter:
                rows.append(inverter.submit(measured, name, asked.folder).result())
            print("  ".join(rows[-1]), flush=True)
    if rows:
        print(score.markdown(HEAD, rows))


if __name__ == "__main__":
    main()
