"""Score answers to the ten scenes, whoever's they are.

    python -m benchmarks.scenes.score --scenes FOLDER --answers FOLDER

ANSWERS holds NAME.csv for each scene that was tried: ``wavelength_nm``, a column for each material
by its id and, where bands of 95 % are given, ``ID lower`` and ``ID upper``. Wavelengths are in nm,
from 400 or less to 700 or more; values between them are interpolated linearly. Every material of
truth.csv that known.csv does not give is needed.
"""
from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

GRID_NM = np.arange(400.0, 701.0, 5.0)          # every answer is compared there
WAVELENGTH, LOWER, UPPER = "wavelength_nm", " lower", " upper"
HEAD = ("scene", "materials", "RMSE", "its shape", "band holds", "width")


@dataclass(frozen=True)
class Score:
    """What the answer to a scene is worth.

    Attributes
    ----------
    materials : int
        That were to be found.
    rmse : float
        Of reflectance: root mean square over wavelengths, mean over materials.
    shape : float
        The same after one factor for all materials of the scene that fits best: where nothing is
        known, light and paints share a level that no photo tells.
    held, width : float
        Share of true values within the 95 % bands, and their mean width in reflectance; nan where
        there are none.
    """

    materials: int
    rmse: float
    shape: float
    held: float
    width: float

    def cells(self, name: str) -> tuple[str, ...]:
        """As a row of HEAD."""
        bands = ("-", "-") if np.isnan(self.held) else (f"{self.held:.3f}", f"{self.width:.3f}")
        return name, str(self.materials), f"{self.rmse:.4f}", f"{self.shape:.4f}", *bands


class AnswerError(Exception):
    """An answer that cannot be scored."""


def scored(nm: np.ndarray, answer: Mapping[str, np.ndarray], true_nm: np.ndarray,
           truth: Mapping[str, np.ndarray]) -> Score:
    """Compare an answer with the truth.

    Parameters
    ----------
    nm, true_nm : (P,) and (Q,) arrays
    answer : mapping
        Reflectances (P,) by material; bands, if any, under the material's name with LOWER and UPPER
        behind it.
    truth : mapping
        Reflectances (Q,) of the materials that were to be found.

    Raises
    ------
    AnswerError
        If a material is missing, has half a band, or is not given from 400 to 700 nm.
    """
    if nm[0] > GRID_NM[0] or nm[-1] < GRID_NM[-1]:
        raise AnswerError(f"{nm[0]:g} to {nm[-1]:g} nm are given; 400 to 700 nm are needed")
    missing = [name for name in truth if name not in answer]
    if missing:
        raise AnswerError(f"no column of {', '.join(missing)}; {', '.join(truth)} are needed")
    banded = [name for name in truth if name + LOWER in answer or name + UPPER in answer]
    halves = [name + side for name in (truth if banded else ()) for side in (LOWER, UPPER)
              if name + side not in answer]
    if halves:
        raise AnswerError(f"no column of {', '.join(halves)}; give bands of all materials, or none")

    def gridded(suffix: str) -> np.ndarray:
        return np.array([np.interp(GRID_NM, nm, answer[name + suffix]) for name in truth])
    true = np.array([np.interp(GRID_NM, true_nm, values) for values in truth.values()])
    found = gridded("")
    power = float(np.sum(found**2))
    factor = float(np.sum(found * true)) / power if power else 1.0
    held = width = np.nan
    if banded:
        lower, upper = gridded(LOWER), gridded(UPPER)
        held = float(np.mean((lower <= true) & (true <= upper)))
        width = float(np.mean(upper - lower))
    return Score(len(truth), rmse_of(found - true), rmse_of(factor * found - true), held, width)


def rmse_of(off: np.ndarray) -> float:
    """Root mean square of rows (n, P), mean over them."""
    return float(np.sqrt(np.mean(off**2, axis=1)).mean())


def to_find(scene: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Wavelengths and true spectra of the materials of a scene's folder that are not given."""
    nm, truth = read_spectra(scene / "truth.csv")
    _, known = read_spectra(scene / "known.csv")
    return nm, {name: values for name, values in truth.items() if name not in known}


def scored_file(answer: Path, scene: Path) -> Score:
    """Score a file of answers by the folder of its scene."""
    return scored(*read_spectra(answer), *to_find(scene))


def read_spectra(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Wavelengths (P,) in nm, ascending, and the other columns by name.

    Raises
    ------
    AnswerError
        If it is no table of finite numbers over wavelengths that rise.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            head, *rows = [[cell.strip() for cell in row] for row in csv.reader(file) if row]
        table = np.array(rows, dtype=float).reshape(len(rows), len(head))
    except (OSError, ValueError) as error:
        raise AnswerError(f"{path}: {error}; a row of names, then rows of numbers are needed"
                          ) from error
    if head[0] != WAVELENGTH or len(set(head)) != len(head):
        raise AnswerError(f"{path}: its columns are {', '.join(head)}; {WAVELENGTH} comes first, "
                          "and every name once")
    if len(table) < 2 or not np.all(np.isfinite(table)) or np.any(np.diff(table[:, 0]) <= 0):
        raise AnswerError(f"{path}: finite numbers at two rising wavelengths or more are needed")
    return table[:, 0], dict(zip(head[1:], table[:, 1:].T, strict=True))


def write_spectra(path: Path, nm: np.ndarray, spectra: Mapping[str, np.ndarray]) -> None:
    """Write columns of spectra (P,) over wavelengths (P,)."""
    table = np.column_stack([nm, *spectra.values()])
    lines = [",".join([WAVELENGTH, *spectra]),
             *(",".join(f"{value:.7g}" for value in row) for row in table)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join("| " + " | ".join(row) + " |"
                     for row in (head, ["--"] * len(head), *rows))


def main(words: list[str] | None = None) -> int:
    """Print the scores of every answer; 3 where one cannot be scored."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scenes.score", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=Path, required=True, help="folder of the scenes")
    parser.add_argument("--answers", type=Path, required=True, help="folder of NAME.csv")
    asked = parser.parse_args(words)
    rows, faults = [], list[str]()
    for scene in sorted(each.parent for each in asked.scenes.glob("*/truth.csv")):
        answer = asked.answers / f"{scene.name}.csv"
        if not answer.exists():
            continue
        try:
            rows.append(scored_file(answer, scene).cells(scene.name))
        except AnswerError as error:
            faults.append(f"{scene.name}: {error}")
    if not rows and not faults:
        faults = [f"{asked.answers} holds no answer to a scene of {asked.scenes}: NAME.csv is "
                  "needed, with the name of a scene's folder"]
    if rows:
        print(markdown(HEAD, rows))
    for fault in faults:
        print(fault, file=sys.stderr)
    return 3 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
