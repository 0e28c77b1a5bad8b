"""Readings on disk, each written whole before anyone sees it, and as plots."""


from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry import files, grid
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.readings import ReadingOutcome, SpectralReading
from spectrabox.radiometry.system import words

BLOCKS = " ▁▂▃▄▅▆▇█"
WIDTH, HEIGHT = 72, 12      # characters


def text_plot(spectrum: Spectrum) -> str:
    """A spectrum as columns of block characters; negative values stay empty.

    Parameters
    ----------
    spectrum : Spectrum
        Its largest value fills the height.
    """
    nm, values = spectrum.grid.nm, spectrum.values
    at = np.linspace(nm[0], nm[-1], WIDTH)
    top = float(values.max())
    levels = np.clip(np.interp(at, nm, values) / top, 0, 1) * HEIGHT if top > 0 else np.zeros(WIDTH)
    rows = []
    for row in range(HEIGHT - 1, -1, -1):
        filled = np.clip(np.round((levels - row) * 8), 0, 8).astype(int)
        label = f"{top:9.3g} " if row == HEIGHT - 1 else f"{0:9.3g} " if row == 0 else " " * 10
        rows.append(label + "".join(BLOCKS[level] for level in filled))
    rows.append(f"{'':10}{nm[0]:<8g}{f'{nm[-1]:g} nm':>{WIDTH - 8}}")
    return "\n".join(rows) + f"\n{'':10}{spectrum.quantity.name.lower()}, {spectrum.quantity.value}"


def png_plot(spectrum: Spectrum, path: Path) -> None:
    """Write a picture of the spectrum with its standard error as a band.

    Parameters
    ----------
    spectrum : Spectrum
    path : Path

    Raises
    ------
    EnvironmentProblem
    """
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with style.context("default"):      # not as a matplotlibrc of the working folder has it
        figure = Figure(figsize=(7, 4), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        axes.plot(spectrum.grid.nm, spectrum.values, lw=1.2)
        if spectrum.standard_error is not None:
            axes.fill_between(spectrum.grid.nm, spectrum.values - 2 * spectrum.standard_error,
                              spectrum.values + 2 * spectrum.standard_error, alpha=0.3, lw=0,
                              label="± 2 standard errors")
            axes.legend()
        axes.set(xlabel="wavelength (nm)", ylabel=f"{spectrum.quantity.name.lower()} "
                 f"({spectrum.quantity.value})", title=spectrum.source)
        with files.whole_file(path) as unfinished:
            figure.savefig(unfinished, dpi=120, format="png")


# ---- readings on disk ----------------------------------------------------------------------------

READING = re.compile(r"(\d{3,})\.json")
FACTS = ("instrument", "serial_number", "firmware", "integration_ms", "luminance", "taken_at",
         "transcript")
# What a reading's findings hold, by code. Sentences of files written before findings are quoted.
NOTED = "meter.noted"
FINDINGS: dict[str, dict[str, type]] = {
    NOTED: {"note": str}, "meter.warning": {"number": int, "meaning": str},
    "meter.negative-values": {"negative": int, "values": int}, "meter.no-luminance": {},
    "meter.not-calibrated": {"missing": list}}
OF_REFLECTANCE = ("lab", "calibration")     # readings of a light may lack them


def readings_folder(spectra: Path, name: str) -> Path:
    """Folder of the readings of a target, such as spectra/readings/light.

    Parameters
    ----------
    spectra : Path
        The session's folder of spectra.
    name : str
        Of the target.

    Raises
    ------
    InputError
        If the name cannot be a folder's.
    """
    if (fault := words.name_fault(name)) is not None:
        raise InputError(f"the name {words.shortened(name)}: {fault}")
    if words.file_stem(name) != name:
        raise InputError(f"the name {name!r} must hold letters, digits, spaces, '-', '_', '.' "
                         f"only, since files are named after it: {words.file_stem(name)!r}, say")
    folder = spectra / "readings" / name
    for part in (spectra, folder.parent, folder):
        files.require_no_link(part)
    return folder


def stored_readings(folder: Path) -> list[SpectralReading]:
    """Every reading of a folder in the order it was taken; none where the folder does not exist.

    Parameters
    ----------
    folder : Path
    """
    return [read_reading(path) for _, path in _numbered(folder)]


def store_reading(folder: Path, reading: SpectralReading) -> Path:
    """Write the next reading of a folder; gives its file.

    Parameters
    ----------
    folder : Path
    reading : SpectralReading
    """
    number = max((number for number, _ in _numbered(folder)), default=0) + 1
    path = folder / f"{number:03d}.json"
    files.write_text_whole(path,
                           json.dumps(reading_facts(reading), allow_nan=False, indent=1) + "\n")
    return path


def set_aside(folder: Path) -> Path:
    """Rename a folder of readings so that a new series can start; nothing is deleted.

    Parameters
    ----------
    folder : Path
    """
    number = 1
    while (aside := folder.with_name(f"{folder.name}.before-{number}")).exists():
        number += 1
    try:
        folder.rename(aside)
    except OSError as error:
        raise EnvironmentProblem(f"{folder} cannot be renamed ({error.strerror}): change its "
                                 "permissions") from None
    return aside


def reading_facts(reading: SpectralReading) -> dict[str, Any]:
    """A reading as plain values, as its file holds them.

    Parameters
    ----------
    reading : SpectralReading
    """
    facts: dict[str, Any] = {name: getattr(reading, name) for name in (*FACTS, *OF_REFLECTANCE)}
    facts.update(outcome=reading.outcome.name.lower(), quantity=None, unit=None,
                 wavelengths_nm=None, values=None, findings=[
                     {"code": one.code, "severity": one.severity.name.lower(),
                      "values": dict(one.values)} for one in reading.findings])
    if reading.spectrum is not None and reading.quantity is not None:
        facts.update(quantity=reading.quantity.name.lower(), unit=reading.quantity.value,
                     wavelengths_nm=reading.spectrum.grid.nm.tolist(),
                     values=reading.spectrum.values.tolist())
    return facts


def read_reading(path: Path) -> SpectralReading:
    """A stored reading.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If the file is missing or was changed by hand so that it cannot be read.
    """
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        quantity = None if facts["quantity"] is None else Quantity[facts["quantity"].upper()]
        spectrum = None if quantity is None else Spectrum(
            grid.grid_from_nm(np.array(facts["wavelengths_nm"], dtype=float)),
            np.array(facts["values"], dtype=float), quantity,
            f"{facts['instrument']} {facts['serial_number']}, {facts['taken_at']}")
        if spectrum is not None and spectrum.values.shape != spectrum.grid.nm.shape:
            raise ValueError(f"{spectrum.values.size} values at {spectrum.grid.nm.size} "
                             "wavelengths")
        return SpectralReading(spectrum=spectrum, quantity=quantity,
                               outcome=ReadingOutcome[facts["outcome"].upper()],
                               findings=tuple(_findings_in(facts)),
                               lab=None if (lab := facts.get("lab")) is None else tuple(lab),
                               calibration=facts.get("calibration"),
                               **{name: facts[name] for name in FACTS})
    except FileNotFoundError:
        raise InputError(f"{path} is missing: give the file of a reading") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError,
            RecursionError) as error:
        raise InputError(f"{path} is no reading ({error}): move it away, or restore it") from None


def _findings_in(facts: dict[str, Any]) -> list[Finding]:
    """Findings of a stored reading; the sentences of older files are quoted.

    Raises
    ------
    ValueError, KeyError, TypeError, AttributeError
        If they are not as this program writes them.
    """
    if "findings" not in facts:
        return [Finding(NOTED, Severity.NOTE, values={"note": str(flag)})
                for flag in facts["flags"]]
    findings = []
    for one in facts["findings"]:
        code, given = one["code"], one["values"]
        values = {key: kind(given[key]) for key, kind in FINDINGS[code].items()}
        findings.append(Finding(code, Severity[one["severity"].upper()], values=values))
    return findings


def _numbered(folder: Path) -> list[tuple[int, Path]]:
    if not folder.is_dir():
        return []
    return sorted((int(match[1]), path) for path in folder.iterdir()
                  if (match := READING.fullmatch(path.name)))


# ---- what may be written -------------------------------------------------------------------------
# What a measurement may write: a file of another quantity or role is never replaced.

ROLES = ("light", "white", "paint", "chart")
ROLE_FILE = "role.txt"          # in a folder of readings
# names of a chart's patches: of the Classic chart-01-dark-skin, of others chart-digitalsg-001-A1
OF_PATCH = r"(chart(?:-[a-z0-9]+)?)-\d{2,3}-(.*)"
OF_CHART = rf"chart(-radiance|-irradiance)?|{OF_PATCH}"


def claim(spectra: Path, role: str, names: Sequence[str], *, reflects: bool = False) -> None:
    """Take names for a role, before anything is measured.

    Parameters
    ----------
    spectra : Path
        The session's folder of spectra.
    role : {"light", "white", "paint", "chart"}
    names : sequence of str
        Of the things to be measured.
    reflects : bool
        The instrument measures reflectance by itself.

    Raises
    ------
    InputError
        If a name is another role's, or its file was not written from readings under that name.
    """
    for name in names:
        folder = readings_folder(spectra, name)
        other = _role_of(folder) or _reserved(name)
        if other not in (None, role):
            raise InputError(
                f"{words.shortened(name)} is the name of something measured as {other}; "
                f"as {role}, give it another with --name")
    if any(folder.is_dir() or any(folder.parent.glob(f"{folder.name}.before-*"))
           for folder in (readings_folder(spectra, name) for name in names)):
        return
    by_white = role in ("paint", "chart") and readings_folder(spectra, "white").is_dir()
    for quantity in ([Quantity.REFLECTANCE] if by_white or reflects
                     else [Quantity.RADIANCE, Quantity.IRRADIANCE]):
        if (file := _file(spectra, role, names[0], quantity)).exists():
            raise InputError(f"{file} was not measured here and would be replaced: rename it"
                             + (", or choose another --name" if role in ("light", "paint", "white")
                                else ""))


def note_role(spectra: Path, role: str, name: str) -> None:
    """Store the role with the readings of a name.

    Parameters
    ----------
    spectra : Path
    role, name : str
    """
    folder = readings_folder(spectra, name)
    if _role_of(folder) != role:
        files.write_text_whole(folder / ROLE_FILE, f"{role}\n")


def result_file(spectra: Path, role: str, name: str, quantity: Quantity) -> Path:
    """The file of a result; a surface without a white standard has its quantity in the name.

    Parameters
    ----------
    spectra : Path
    role : {"light", "white", "paint", "chart"}
    name : str
        Of the thing; of a chart any of its patches.
    quantity : Quantity

    Raises
    ------
    InputError
        If that file holds another quantity.
    """
    path = _file(spectra, role, name, quantity)
    held = _quantity_in(path)
    if held not in (None, quantity.name.lower()):
        raise InputError(f"{path} holds {held}, which {quantity.name.lower()} must not replace: "
                         "rename it, or choose another --name; the readings are kept")
    return path


def _file(spectra: Path, role: str, name: str, quantity: Quantity) -> Path:
    stem = chart_and_patch(name)[0] if role == "chart" else name
    bare = role in ("light", "white") or quantity is Quantity.REFLECTANCE
    return spectra / (f"{stem}.csv" if bare else f"{stem}-{quantity.name.lower()}.csv")


def patch_names(chart: Chart) -> tuple[str, ...]:
    """Names of a chart's patches among all things that are measured, in their order: a chart of
    another layout than the Classic's has its own.

    Parameters
    ----------
    chart : Chart
    """
    plain = re.sub(r"[^a-z0-9]", "", chart.name.lower()).removeprefix("colorchecker")
    of = "" if chart.names == CLASSIC.names else f"-{plain or 'own'}"
    digits = len(f"{max(len(chart.names), 10)}")
    return tuple(f"chart{of}-{number:0{digits}d}-{words.file_stem(patch.replace(' ', '-'))}"
                 for number, patch in enumerate(chart.names, 1))


def chart_and_patch(name: str) -> tuple[str, str]:
    """The chart of one of ``patch_names``, as its file is called, and the patch with its number."""
    match = re.fullmatch(OF_PATCH, name)
    return (match[1], name[len(match[1]) + 1:]) if match else ("chart", name)


def _reserved(name: str) -> str | None:
    plain = name.casefold()
    if plain in ("light", "white"):
        return plain
    return "chart" if re.fullmatch(OF_CHART, plain) else None


def _role_of(folder: Path) -> str | None:
    try:
        role = (folder / ROLE_FILE).read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return None
    return role if role in ROLES else None


def _quantity_in(path: Path) -> str | None:
    """What a file says that it holds; None where there is no file."""
    try:
        with path.open(encoding="utf-8", errors="replace") as stream:
            head = stream.read(2000)
    except FileNotFoundError:
        return None
    stated = re.search(r"^# quantity: *(\w+)", head, re.MULTILINE)
    return stated[1] if stated else "something that was not measured here"
