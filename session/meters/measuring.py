"""Readings of one thing or of many in order, by an operator who points or holds the instrument, and
what they come to.
"""


from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from spectrabox.capture.meter import measurement_files, measurement_series
from spectrabox.capture.meter.instruments import instrument_errors, interface
from spectrabox.measure import texts
from spectrabox.radiometry import errors, files
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.readings import ReadingSeries, SpectralReading
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.meters import readers

USES = {"light": "name it in session.toml, or give it with --light",
        "white": "surfaces that are measured now are divided by it",
        "paint": "give it with --truth NAME=FILE, or name it in session.toml",
        "chart": "give it with --reference FILE, or name it in session.toml"}


def write_result(
        task: Task, calibrations: Sequence[measurement_series.MeterCalibration],
        standard: Spectrum | None = None) -> tuple[Path, Spectrum]:
    """Write the mean, or the reflectance where a white standard was measured; gives the file and
    one spectrum.

    Parameters
    ----------
    task : Task
    calibrations : sequence of MeterCalibration
    standard : Spectrum, optional
        Reflectance of the white standard; sintered PTFE by default.

    Raises
    ------
    CheckError, InputError
    """
    stored = {
        name:
        measurement_files.stored_readings(measurement_files.readings_folder(task.spectra, name))
        for name in task.names
    }
    readings = [reading for name in task.names for reading in stored[name]]
    reflects = any(reading.quantity is Quantity.REFLECTANCE for reading in readings)
    white = [] if reflects else white_readings(task.spectra, task.role)
    makers = measurement_series.makers_of([*readings, *white])
    measurement_series.require_comparable(makers, calibrations, task.title)
    if white and len(makers) == 1:
        calibrations = ()       # one instrument's factor divides out, and so does its error

    def mean(name: str, readings: Sequence[SpectralReading]) -> Spectrum:
        instruments = measurement_series.named(measurement_series.makers_of(readings)) + (
            ", each by its calibration" if calibrations else "")
        return measurement_series.series_spectrum(
            measurement_series.series_of(readings, name, calibrations),
            f"{instruments}, {name}, mean of {len(readings)}")

    require_measured(task)
    results = [mean(name, stored[name]) for name in task.names]
    if white:
        divisor = mean("white", white)
        results = [
            measurement_series.reflectance_from(
                result, divisor, standard or measurement_series.white_standard(None), result.source)
            for result in results
        ]
    path = measurement_files.result_file(task.spectra, task.role, task.names[0],
                                         results[0].quantity)
    if task.role == "chart":
        columns = {measurement_files.chart_and_patch(name)[1]: result.values
                   for name, result in zip(task.names, results, strict=True)}
    else:
        columns = {"value": results[0].values}
        if results[0].standard_error is not None:
            columns["standard_error"] = results[0].standard_error
    files.write_text_whole(
        path,
        table_text(results[0].grid.nm, columns, quantity=results[0].quantity,
                   source=results[0].source + _calibration_words(readings)))
    return path, results[0]


def series_of_all(
    task: Task, calibrations: Sequence[measurement_series.MeterCalibration]
) -> dict[str, ReadingSeries]:
    """Mean, spread, drift and findings of each thing's readings.

    Parameters
    ----------
    task : Task
    calibrations : sequence of MeterCalibration
    """
    return {name: measurement_series.series_of(
        measurement_files.stored_readings(measurement_files.readings_folder(task.spectra, name)),
        name, calibrations) for name in task.names}


def _calibration_words(readings: Sequence[SpectralReading]) -> str:
    stated = dict.fromkeys(reading.calibration for reading in readings if reading.calibration)
    return f"; calibration of the instrument: {'; '.join(stated)}" if stated else ""


# ---- measuring -----------------------------------------------------------------------------------

UNDO, SKIP = "u", "s"


class Start(Enum):
    """How the next reading begins, or what is wanted in its place."""

    COMMAND = "command"
    BUTTON = "button"
    UNDO = "undo"
    STOP = "stop"


@dataclass(frozen=True)
class Task:
    """What is to be measured: ``names`` of things of one role, each ``repeat`` times."""

    spectra: Path
    role: str
    names: tuple[str, ...]
    repeat: int
    wait: bool                  # ask before each
    calibrate: bool             # ask for the calibrations that the instrument wants
    chart: Chart = CLASSIC      # of the role "chart", which the names are the patches of

    @property
    def title(self) -> str:
        """Of all of it, for sentences."""
        return self.names[0] if len(self.names) == 1 else f"the {self.role}"


def measure_all(
        task: Task, source: readers.Source,
        calibrations: Sequence[measurement_series.MeterCalibration]) -> list[SpectralReading]:
    """Take the readings that are still missing; those on disk are not taken again.

    Parameters
    ----------
    task : Task
    source : function that opens what takes readings
    calibrations : sequence of MeterCalibration
        Factors of instruments that are to be compared.
    """
    stored = {
        name:
        measurement_files.stored_readings(measurement_files.readings_folder(task.spectra, name))
        for name in task.names
    }
    have = {name: sum(reading.spectrum is not None for reading in stored[name])
            for name in task.names}
    done = [name for name in task.names if have[name] >= task.repeat]
    todo = [name for name in task.names if name not in done]
    taken: list[SpectralReading] = []
    if not todo:
        print(f"{task.names[0]} has its {task.repeat} readings already; --again starts a new "
              "series", file=sys.stderr)
        return taken
    before = measurement_series.makers_of([
        *(reading for name in task.names for reading in stored[name]),
        *white_readings(task.spectra, task.role)
    ])

    def check(maker: measurement_series.Maker) -> None:
        measurement_series.require_comparable([*before, maker], calibrations, task.title)
    keyboard = readers.Keyboard()
    with source(task.spectra / "readings") as reader:
        reader.begin(check)
        if reader.meter is not None and task.calibrate \
                and not _calibrated(reader.meter, keyboard):
            return taken
        while todo:
            name = todo[0]
            start = _asked(task, name, len(done), reader.meter, keyboard) if task.wait \
                else Start.COMMAND
            if start is Start.STOP:
                break
            if start is Start.UNDO:
                if done:            # else there is nothing to undo
                    _undo(task.spectra, done[-1])
                    have[done[-1]] = 0
                    todo.insert(0, done.pop())
                continue
            for count in range(have[name], task.repeat):
                if reader.meter is not None:
                    reader.meter.by_button = start is Start.BUTTON and count == have[name]
                reading = reader.take()
                measurement_files.note_role(task.spectra, task.role, name)
                measurement_files.store_reading(
                    measurement_files.readings_folder(task.spectra, name), reading)
                taken.append(reading)
                print(f"{name}, {reading_line(count + 1, reading)}", file=sys.stderr, flush=True)
            _warn_of_another_patch(task, name, taken[-1])
            done.append(todo.pop(0))
    return taken


def white_readings(spectra: Path, role: str) -> list[SpectralReading]:
    """Readings of the white standard, where a result is divided by them.

    Parameters
    ----------
    spectra : Path
    role : str
    """
    return measurement_files.stored_readings(measurement_files.readings_folder(
        spectra, "white")) if role in ("paint", "chart") else []


def shown_reading(reading: SpectralReading) -> dict[str, Any]:
    """A reading for JSON: as its file holds it, with the sentences of its findings.

    Parameters
    ----------
    reading : SpectralReading
    """
    return measurement_files.reading_facts(reading) | {
        "sentence": texts.says(reading.outcome.finding),
        "flags": [texts.says(finding) for finding in reading.findings],
        "findings": [texts.facts(finding) for finding in reading.findings]}


def reading_line(number: int, reading: SpectralReading) -> str:
    """A reading as one line.

    Parameters
    ----------
    number : int
        Of the reading among those of its thing.
    reading : SpectralReading
    """
    stated = "" if reading.luminance is None else f", {reading.luminance:.4g} cd/m2 or lx"
    exposure = "" if reading.integration_ms is None else f", {reading.integration_ms:g} ms"
    lab = "" if reading.lab is None else \
        ", L*a*b* {:.2f} {:.2f} {:.2f} on its display (D65, 10 degrees)".format(*reading.lab)
    ended = texts.says(reading.outcome.finding).rstrip(".")
    return f"reading {number}: {ended}{stated}{exposure}{lab}"


def _calibrated(meter: interface.Instrument, keyboard: readers.Keyboard) -> bool:
    """Ask for each calibration that the instrument wants; False if the operator stops here."""
    for which, advice in meter.calibrations.items():
        while which not in meter.calibrated:
            print(f"{which} calibration of the {meter.family}: {advice},\nthen press Enter "
                  f"({SKIP} Enter: measure without, and say so; {readers.NO_MORE} Enter: stop)",
                  file=sys.stderr, flush=True)
            answer = keyboard.line(None)
            if answer == readers.NO_MORE:
                return False
            if answer == SKIP:
                break
            try:
                meter.calibrate(which)
            except instrument_errors.RefusedError as error:
                print(error, file=sys.stderr, flush=True)
    return True


def _asked(task: Task, name: str, done: int, meter: interface.Instrument | None,
           keyboard: readers.Keyboard) -> Start:
    """What the operator does next: Enter, the instrument's button, or another wish."""
    button = meter is not None and meter.has_button
    if task.role == "chart":
        print(_picture(task, task.names.index(name)), file=sys.stderr)
    which = "" if len(task.names) == 1 else f"{done + 1} of {len(task.names)}, "
    what = f"patch {which}{name}" if task.role == "chart" else f"{which}{name}"
    how = "hold the instrument on it, press its button or Enter" if button else \
        "point the instrument at it and press Enter"
    undo = f"{UNDO} Enter: the last again, " if done else ""
    print(f"{what}: {how} ({undo}{readers.NO_MORE} Enter: stop)", file=sys.stderr, flush=True)
    while True:
        answer = keyboard.line(readers.LOOK_S / 2 if button else None)
        if answer is not None:
            return {UNDO: Start.UNDO, readers.NO_MORE: Start.STOP}.get(answer, Start.COMMAND)
        if meter is not None and meter.pressed(readers.LOOK_S / 2):
            return Start.BUTTON


def _picture(task: Task, following: int) -> str:
    measured: dict[int, Spectrum | None] = {}
    for index, name in enumerate(task.names):
        readings = [
            reading for reading in measurement_files.stored_readings(
                measurement_files.readings_folder(task.spectra, name))
            if reading.spectrum is not None
        ]
        if readings:
            reflects = readings[-1].lab is not None
            measured[index] = readings[-1].spectrum if reflects else None
    return readers.chart_picture(task.chart, measured, following, colours=sys.stderr.isatty())


def _undo(spectra: Path, name: str) -> None:
    aside = measurement_files.set_aside(measurement_files.readings_folder(spectra, name))
    print(f"{name}: its readings are kept aside in {aside.name}", file=sys.stderr, flush=True)


def _warn_of_another_patch(task: Task, name: str, reading: SpectralReading) -> None:
    """Say so where a reflectance looks like another patch of the chart."""
    if task.role != "chart" or reading.lab is None or reading.spectrum is None:
        return
    other = readers.nearer_patch(task.chart, task.names.index(name), reading.spectrum)
    if other is not None:
        print(f"- this looks like {task.names[other]} and not like {name}: if it was another "
              f"patch, {UNDO} and Enter", file=sys.stderr, flush=True)


def require_measured(task: Task) -> None:
    """Refuse to write a table of which something is not measured yet.

    Parameters
    ----------
    task : Task

    Raises
    ------
    CheckError
        With what comes next.
    """
    missing = [
        name for name in task.names if not measurement_series.makers_of(
            measurement_files.stored_readings(measurement_files.readings_folder(task.spectra,
                                                                                name)))
    ]
    if len(task.names) > 1 and missing:
        things = "patches" if task.role == "chart" else "things"
        raise errors.CheckError(
            f"{len(task.names) - len(missing)} of {len(task.names)} {things} are "
            "measured and kept; run the same command again to go on with "
            f"{missing[0]}")
