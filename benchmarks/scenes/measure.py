"""Scenes inverted by ``spectrabox.reconstruct_scene``, from the files of their folders."""
from __future__ import annotations

import time
from pathlib import Path

import numpy as np

import spectrabox as sb
from spectrabox.radiometry.errors import SpectraboxError

from benchmarks.scenes import made, render, score

WIDTH, DRAWS = 64, 1000         # of the view that is compared with the photo; spectra of a band
HEAD = (*score.HEAD, "verdict", "seconds of processor")


def photographed(name: str, folder: Path) -> None:
    """Write a scene with its photo; whatever is there already stays."""
    if not (folder / render.PHOTO).exists():
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
        folder / render.PHOTO, scene=folder / "scene.xml", light=(nm, light["value"]),
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
