"""Commands for instruments that measure spectra: which ports there are, who answers, measure into
a session, play a recording.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import is_whole_number
from spectrabox.session.terminal import command_help, command_line

if TYPE_CHECKING:
    from spectrabox.capture.meter.instruments.interface import MeterSettings
    from spectrabox.radiometry.chart import Chart
    from spectrabox.radiometry.records.spectra import Spectrum
    from spectrabox.radiometry.spectra.readings import ReadingSeries
    from spectrabox.session.meters.readers import Source

Port = Annotated[str,
                 typer.Option(
                     metavar="PORT",
                     help="Such as /dev/ttyACM0 or COM3; see 'spectrabox meter list'.",
                              show_default=False)]
METERS = "cs2000|cr250|cr30|pr655|pr650|specbos1211|specbos2501"
Meter = Annotated[str, typer.Option(metavar=METERS, help="Which instrument it is.",
                                    show_default=False)]
Drawn = Annotated[bool, typer.Option("--draw", help="Draw the spectrum in the terminal.")]
Png = Annotated[Path | None, typer.Option(
    "--plot", metavar="PNG", help="Draw the spectrum into this picture.")]


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    meter = command_help.Commands(name="meter",
                                  help="Instruments that measure spectra, on the serial line.")
    for function in (identify, measure, replay):
        meter.command()(function)
    meter.command("list")(list_of_ports)
    app.add_typer(meter)


@command_line.Command
def list_of_ports() -> command_line.Answer:
    """List the serial ports of this computer, without opening any."""
    from spectrabox.capture.meter.serial_line import list_ports
    ports = [{"port": each.device, "description": each.description,
              "manufacturer": each.manufacturer,
              "usb": None if each.vid is None else f"{each.vid:04x}:{each.pid:04x}",
              "serial_number": each.serial_number} for each in list_ports()]
    lines = [f"{each['port']:<16} {each['usb'] or '':<10} {each['manufacturer'] or ''} "
             f"{each['description'] or ''}" for each in ports]
    return command_line.Answer({"ports": ports},
                  "\n".join(lines) or "no serial ports: plug the instrument in and switch it on")


@command_line.Command
def identify(port: Port, instrument: Meter) -> command_line.Answer:
    """Ask the instrument who it is, then leave it as found."""
    from spectrabox.capture.meter.measurement import trusted_identity
    from spectrabox.session.meters.readers import operated_instrument
    with operated_instrument(instrument, port, lambda direction, data: None) as meter:
        identity = trusted_identity(meter)
    return command_line.Answer(
        {
            "instrument": identity.model, "serial_number": identity.serial_number, "firmware":
            identity.firmware, "port": port
        }, f"{identity.model}, serial number {identity.serial_number}, firmware "
        f"{identity.firmware or 'not stated'}")


@command_line.Command
def measure(
    folder: command_line.Folder,
    port: Annotated[str | None, typer.Option(
        metavar="PORT", show_default=False,
        help="Such as /dev/ttyACM0 or COM3; see 'spectrabox meter list'. With "
        "spotread: the instrument's number in its list.")] = None,
    instrument: Annotated[str | None, typer.Option(
        metavar=METERS, show_default=False, help="Which instrument it is.")] = None,
    program: Annotated[str | None, typer.Option(
        "--with", metavar="spotread", show_default=False, help="Measure with ArgyllCMS's spotread: "
        "i1Pro, ColorMunki, Spyder and others.")] = None,
    ambient: Annotated[bool, typer.Option(
        "--ambient", help="With spotread: irradiance, through the diffuser.")] = False,
    role: Annotated[str, typer.Option(
        "--as", metavar="light|white|paint|chart", help="What is measured; white is the "
        "white standard.")] = "light",
    name: Annotated[str | None, typer.Option(
        metavar="NAME", help="Of a paint: its file becomes spectra/NAME.csv.")] = None,
    layout: command_line.ChartLayout = "",
    repeat: Annotated[int, typer.Option(min=1, max=999, help="Readings of each thing.")] = 1,
    integration_ms: Annotated[float | None, typer.Option(
        min=0.1, help="Fixed exposure in milliseconds; automatic by default.")] = None,
    averages: Annotated[int | None, typer.Option(
        min=1, max=99,
        help="Readings that the instrument averages; its own setting by default.")] = None,
    sync_hz: Annotated[float | None, typer.Option(
        min=10, help="Flicker frequency of the light.")] = None,
    white_reflectance: Annotated[str | None, typer.Option(
        metavar="NAME|R|FILE", show_default=False, help="What the white standard reflects: PTFE, "
        "Spectralon, barium sulphate; 0.985 or 0.985+-0.005; or the file of its certificate. "
        "PTFE, 0.99 +- 0.005, where nothing is stated.")] = None,
    calibration: Annotated[tuple[str, ...], typer.Option(
        metavar="SERIAL=FILE", help="Factors of an instrument by wavelength; of each, where "
        "readings of several are to be compared.")] = (),
    again: Annotated[bool, typer.Option(
        "--again", help="Start a new series; earlier readings are kept aside.")] = False,
    calibrate: Annotated[bool, typer.Option(
        "--calibrate/--no-calibrate", help="Ask for the black and white calibration that a CR30 "
        "wants; without, the file says that there was none.")] = True,
    wait: Annotated[bool, typer.Option(
        "--wait/--no-wait", help="Ask before each patch of a chart, and before each thing that a "
        "CR30 is held on.")] = True,
    draw: Drawn = False,
    plot: Png = None,
) -> command_line.Answer:
    """Measure into a session. Every reading is on disk before it is shown; a broken series goes on
    where it stopped.
    """
    command_line.check_ending(plot, {".png": "a picture of the spectrum"}, "--plot")
    from spectrabox.capture.meter import measurement_files, measurement_series
    from spectrabox.capture.meter.instruments.interface import MeterSettings
    from spectrabox.session.meters.measuring import Task, measure_all, series_of_all, write_result
    chart = _chart(role, layout)
    names = _names(role, name, chart)
    wanted = MeterSettings(integration_ms, averages, sync_hz)
    source = _source(port, instrument, program, ambient, wanted)
    reflects = _reflects(instrument, role)
    factors = [measurement_series.read_calibration(text) for text in calibration]
    standard = measurement_series.white_standard(white_reflectance)
    task = Task(folder / "spectra", role, names, repeat,
                wait and (reflects or role == "chart"), calibrate, chart)
    if reflects and calibrate and not wait:
        raise typer.BadParameter("a calibration is asked for on the keyboard: leave out --no-wait, "
                                 "or say --no-calibrate to measure with the calibration that the "
                                 "instrument has", param_hint="--no-wait")
    measurement_files.claim(task.spectra, role, names, reflects=reflects)
    if again:
        _set_aside(task.spectra, names)
    readings = measure_all(task, source, factors)
    written, spectrum = write_result(task, factors, standard)
    series = series_of_all(task, factors)
    if plot is not None:
        from spectrabox.capture.meter.measurement_files import png_plot
        png_plot(spectrum, plot)
    return command_line.Answer({"taken": len(readings), "file": written,
                   "series": [_series_facts(*named) for named in series.items()], "png": plot},
                  _measured_text(written, role, series, spectrum if draw else None))


@command_line.Command
def replay(
    transcript: Annotated[Path, typer.Argument(
        metavar="FILE", show_default=False, help="A transcript.")],
    speed: Annotated[float, typer.Option(
        min=0, help="1 as recorded, 10 ten times as fast, 0 at once.")] = 0,
    out: Annotated[Path | None, typer.Option(
        "--out", "-o", metavar="CSV", help="Where to write the spectra that it reads, a column "
        "each.")] = None,
    draw: Annotated[bool, typer.Option(
        "--draw/--no-draw", help="Draw the last spectrum in the terminal.")] = True,
    plot: Png = None,
) -> command_line.Answer:
    """Play a recorded transcript to the driver's own code and show what it reads."""
    command_line.check_ending(out, {".csv": "the spectra"})
    command_line.check_ending(plot, {".png": "a picture of the spectrum"}, "--plot")
    from spectrabox.capture.transcripts import player, sniffed_traffic
    from spectrabox.session.meters.measuring import reading_line, shown_reading
    recording = sniffed_traffic.read_recording(transcript)
    readings, problems = player.replay_transcript(recording, speed=speed)
    instrument, synthetic = recording.facts["instrument"], "synthetic" in recording.facts
    spectra = [reading.spectrum for reading in readings if reading.spectrum is not None]
    if plot is not None and spectra:
        from spectrabox.capture.meter.measurement_files import png_plot
        png_plot(spectra[-1], plot)
    facts: dict[str, Any] = {
        "instrument": instrument, "synthetic": synthetic, "problems": problems,
        "readings": [shown_reading(reading) for reading in readings]}
    if out is not None:
        _write_spectra(out, spectra, f"{instrument}, {transcript.name}")
        facts["file"] = out
    lines = [reading_line(number, reading) for number, reading in enumerate(readings, 1)]
    lines += [f"- {problem}" for problem in problems]
    if synthetic:
        lines += ["synthetic: built from protocol notes, not recorded from an instrument"]
    if draw and spectra:
        from spectrabox.capture.meter.measurement_files import text_plot
        lines.append(text_plot(spectra[-1]))
    return command_line.Answer(facts, "\n".join(lines))


def _write_spectra(path: Path, spectra: Sequence[Spectrum], source: str) -> None:
    """Spectra of readings as a table."""
    import numpy as np

    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.radiometry.spectra.spectrum_files import table_text
    if not spectra:
        raise InputError("no reading of this recording holds a spectrum: there is nothing to write")
    first = spectra[0]
    if any(one.quantity is not first.quantity or not np.array_equal(one.grid.nm, first.grid.nm)
           for one in spectra):
        raise InputError("the spectra of this recording are of several quantities or wavelengths, "
                         "and no one table holds them; --json prints them all")
    write_text_whole(path, table_text(
        first.grid.nm, {f"reading {number}": one.values for number, one in enumerate(spectra, 1)},
        quantity=first.quantity, source=source))


def _chart(role: str, layout: str) -> Chart:
    """The chart that is measured; a ColorChecker Classic where none is named."""
    from spectrabox.session.camera.camera_files import read_layout
    if layout and role != "chart":
        raise typer.BadParameter("a layout is of a chart: measure it with --as chart",
                                 param_hint="--chart-layout")
    return read_layout(layout)


def _names(role: str, name: str | None, chart: Chart) -> tuple[str, ...]:
    from spectrabox.capture.meter.measurement_files import ROLES, patch_names
    if role not in ROLES:
        raise typer.BadParameter(f"{role!r} is not one of {', '.join(ROLES)}", param_hint="--as")
    if role == "chart":
        return patch_names(chart)
    if role == "paint" and name is None:
        raise typer.BadParameter("a paint needs a name, such as --name red", param_hint="--name")
    return (name or role,)


def _set_aside(spectra: Path, names: Sequence[str]) -> None:
    from spectrabox.capture.meter.measurement_files import readings_folder, set_aside
    for name in names:
        if (folder := readings_folder(spectra, name)).is_dir():
            set_aside(folder)


def _source(port: str | None, instrument: str | None, program: str | None, ambient: bool,
            wanted: MeterSettings) -> Source:
    """What opens the instrument that the options name."""
    from spectrabox.session.meters.readers import line_reader, spotread_reader
    if program is None:
        if port is None or instrument is None or ambient:
            raise typer.BadParameter("an instrument on a serial line needs --port and --instrument "
                                     "(--ambient is for --with spotread)")
        return lambda folder: line_reader(folder, instrument, port, wanted)
    if program != "spotread" or instrument is not None or wanted != type(wanted)():
        raise typer.BadParameter("only spotread is known, without --instrument, --integration-ms, "
                                 "--averages and --sync-hz", param_hint="--with")
    if port is not None and not is_whole_number(port):
        raise typer.BadParameter(f"{port!r} is no number of an instrument in spotread's list",
                                 param_hint="--port")
    return lambda folder: spotread_reader(folder, int(port or 1), ambient)


def _reflects(instrument: str | None, role: str) -> bool:
    """Whether the instrument measures reflectance by itself; refused for the light."""
    from spectrabox.capture.meter.instruments.drivers import driver_named
    from spectrabox.radiometry.records.spectra import Quantity
    if instrument is None:
        return False
    driver = driver_named(instrument)
    reflects = driver.quantities == (Quantity.REFLECTANCE,)
    if reflects and role in ("light", "white"):
        raise InputError(f"a {driver.family} measures reflectance, no light, and needs no white "
                         "standard: measure with --as paint --name NAME, or --as chart")
    return reflects


def _series_facts(name: str, series: ReadingSeries) -> dict[str, Any]:
    """For JSON, with the sentences of its findings; None of what a few readings do not tell."""
    from spectrabox.measure import texts
    several = series.readings > 1
    return {
        "name": name, "readings": series.readings, "quantity": series.quantity.name.lower(),
        "relative_spread": series.relative_spread if several else None,
        "relative_drift": series.relative_drift if several else None,
        "relative_drift_error": series.relative_drift_error if series.readings > 2 else None,
        "findings": [texts.facts(finding) for finding in series.findings],
        "flags": [texts.says(finding) for finding in series.findings]}


def _measured_text(written: Path, role: str, series: Mapping[str, ReadingSeries],
                   spectrum: Spectrum | None) -> str:
    from spectrabox.measure import texts
    from spectrabox.session.meters.measuring import USES
    lines = []
    for name, each in series.items():
        spread = "" if each.readings < 2 else \
            f", spread {each.relative_spread:.2%}, drift {each.relative_drift:+.2%}"
        lines.append(f"{name}: {each.readings} readings of {each.quantity.name.lower()}{spread}")
        lines += [f"- {texts.says(finding)}" for finding in each.findings]
    if spectrum is not None:
        from spectrabox.capture.meter.measurement_files import text_plot
        lines.append(text_plot(spectrum))
    return "\n".join([*lines, f"wrote {written}: {USES[role]}"])
