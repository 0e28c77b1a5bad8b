"""Small files as public reports of bugs describe them (``field5`` of the measured data): each is
right, read as it is or refused by what it is, or wrong.

One table of cases by file, of photos and of spectra: another file is another line.
"""
from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from spectrabox.session.cli import app

from benchmarks.ledger.task import Task

FOLDER = "field5"
USAGE = 2       # exit code: the words of a command are wrong, which is no answer
GREEN = 0.2507  # reflectance of the green paint of most spectra at 470 nm
WHITE = 0.7539  # signal in green of white 9.5 in all photos of the chart, as the control has it


@dataclass(frozen=True)
class Case:
    """What is expected of a file.

    Attributes
    ----------
    words : tuple of str
        Of a command, PATH for the file and FOLDER for a folder to write to.
    value : tuple of float, optional
        Of spectra: a wavelength in nm, and the value there that one of them has, as a fraction
        where the file is read as per cent.
    white : float, optional
        Of a photo of a chart: signal of the white patch in its brightest band.
    refused : tuple of str
        Words of a refusal that names what the file is, each of them; empty: it is read.
    says : tuple of str
        Words among what a command says of a file that it reads, each of them.
    never : tuple of str
        Words that must not be there: a cause that is none.
    """

    words: tuple[str, ...]
    value: tuple[float, float] | None = None
    white: float | None = None
    refused: tuple[str, ...] = ()
    says: tuple[str, ...] = ()
    never: tuple[str, ...] = ()


def _chart(**expected: object) -> Case:
    return Case(("chart", "PATH", "--json"), **expected)    # type: ignore[arg-type]


def _shown(nm: float, value: float, **expected: object) -> Case:
    return Case(("spectrum", "show", "PATH", "--json"), (nm, value),
                **expected)     # type: ignore[arg-type]


PHOTOS: dict[str, tuple[Case, ...]] = {
    "black_delta_with_masked_area/delta_masked.dng": (_chart(white=WHITE),),
    "tiff_states_black_level/black4800.tif": (_chart(white=WHITE, says=("4800",)),),
    "dual_iso/dual_iso.dng": (
        _chart(refused=("two gains",)),
        Case(("develop", "PATH", "--out", "FOLDER/out.exr"), refused=("two gains",))),
    "linear_dng_four_planes/rgb_plus_one.dng": (_chart(refused=("4 planes",)),),
    "linear_rec709_exr/nuke_709.exr": (
        _chart(says=("converted colour space, not camera signal",), never=("chart.glare",)),),
    "one_misprinted_patch/patch12_mag.dng": (
        _chart(refused=("patch 12", "--leave-out 12")),
        Case(("chart", "PATH", "--leave-out", "12", "--json"), white=WHITE),
        Case(("camera", "fit", "PATH", "--light", "unknown", "--leave-out", "12", "--out",
              "FOLDER/curves.csv", "--json"), says=('"verdict": "pass"',))),
    "one_misprinted_patch/patch12_wrong.dng": (
        _chart(says=("patches.unlike-reference", '"patch": "orange yellow"')),)}

SPECTRA: dict[str, tuple[Case, ...]] = {
    "axis-unit-in-header/angstrom.csv": (_shown(470.0, GREEN),),
    "axis-unit-in-header/frequency_thz.csv": (_shown(470.0, GREEN),),
    "axis-unit-in-header/wavenumber.csv": (_shown(470.0, GREEN),),
    "cxf3/two.cxf": (_shown(420.0, 0.22),),
    "decimal-comma-blanks/blanks_decimal_comma.txt": (_shown(470.0, GREEN),),
    "decimal-comma-blanks/blanks_decimal_comma_intnm.txt": (_shown(470.0, GREEN),),
    "envi-overlap-and-flags/gain.hdr": (_shown(470.0, GREEN),),
    "envi-overlap-and-flags/bbl.hdr": (_shown(550.0, 0.5, says=(" bad ",)),),
    "envi-overlap-and-flags/overlap.hdr": (_shown(470.0, GREEN, says=("overlap",)),),
    "envi-overlap-and-flags/usgs_deleted.hdr": (_shown(470.0, GREEN, says=("deleted",),
                                                       never=("1.23",)),),
    "micrometres-and-percent-stated/ascending.spectrum.txt": (_shown(470.0, GREEN),),
    "micrometres-and-percent-stated/descending.spectrum.txt": (_shown(470.0, GREEN),),
    # no unit of the values is stated
    "table-under-a-preamble/end_marker.txt": (_shown(470.0, 100 * GREEN),),
    "impossible-colour": (Case(
        ("sample", "--xyz", "0,29.33989,29.33989", "--json"),
        says=("no surface has this colour", "nearest that can be reached")),),
    "uplift-side-9/rgb.png": (Case(
        ("uplift", "PATH", "--encoded", "--out", "FOLDER/out", "--side", "9", "--full", "--json"),
        never=('"warnings": []',)),)}


def tasks(data: Path) -> Iterator[Task]:
    """One task for each file that the data have."""
    for block, table in (("real/reported photos", PHOTOS), ("real/reported spectra", SPECTRA)):
        for file, cases in table.items():
            if (data / FOLDER).is_dir():
                yield Task(block, Path(file).name, read_right, (data / FOLDER / file, cases))


def read_right(path: Path, cases: Sequence[Case]) -> dict[str, float]:
    """Whether a file gives what is expected of it, in every case."""
    return {"read right": float(not any(wrong(path, case) for case in cases))}


def wrong(path: Path, case: Case) -> str:
    """What is wrong with what a command says of a file; empty where it is right."""
    with tempfile.TemporaryDirectory() as folder:
        words = [word.replace("PATH", str(path)).replace("FOLDER", folder) for word in case.words]
        ran = CliRunner().invoke(app, words)
    said = f"{ran.stdout}\n{ran.stderr}"
    told = " ".join(said.split())
    if ran.exit_code == 1 or ran.exit_code == USAGE:
        return f"it ended in {ran.exit_code}: {told}"
    lacking = [one for one in (*case.refused, *case.says) if one not in told]
    if lacking or any(one in told for one in case.never):
        return f"{lacking or case.never}: {told}"
    if case.refused:
        facts = _facts(ran.stdout)
        return "" if ran.exit_code and facts.get("verdict", "refused") == "refused" \
            else f"it is not refused: {told}"
    facts = _facts(ran.stdout)
    if case.white is not None and not np.isclose(facts.get("white_signal", np.nan), case.white,
                                                 rtol=2e-3):
        return f"white reads {facts.get('white_signal')}, not {case.white}: {told}"
    if case.value is not None:
        nm, value = case.value
        found = [np.interp(nm, facts["wavelengths_nm"], np.array(one["values"], float))
                 / (100 if one.get("unit") == "percent" else 1) for one in facts.get("spectra", [])]
        if not np.isclose(found, value, rtol=1e-3).any():
            return f"{found} at {nm} nm, not {value}: {told}"
    return ""


def _facts(stdout: str) -> dict[str, object]:
    """The JSON that a command printed; nothing where it printed none."""
    try:
        facts = json.loads(stdout)
    except ValueError:
        return {}
    return facts if isinstance(facts, dict) else {}
