"""Commands for spectroradiometers: which ports there are, who answers, measure into a session, play
a recording.
"""
from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.system.words import is_whole_number
from spectrabox.session.terminal.command_help import Commands
from spectrabox.session.terminal.command_line import (
    Answer,
    Command,
    Folder,
    check_ending,
)

if TYPE_CHECKING:
    from spectrabox.capture.meter.instruments.interface import Instrument, MeterSettings
    from spectrabox.capture.meter.measurement_series import SeriesSummary
    from spectrabox.capture.meter.meter_calibration import Maker, MeterCalibration
    from spectrabox.capture.meter.serial_line import Log, Pace
    from spectrabox.radiometry.records.spectra import Spectrum
    from spectrabox.radiometry.spectra.readings import SpectralReading

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
REPLAY_LIMIT_S = 2.0
# What takes a reading, once it knows who reads and the check does not object; and what opens that.
Check: TypeAlias = "Callable[[Maker], None]"
Taker: TypeAlias = "Callable[[Check], SpectralReading]"
Source: TypeAlias = "Callable[[Path], contextlib.AbstractContextManager[Taker]]"


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    meter = Commands(name="meter", help="Spectroradiometers on the serial line.")
    for function in (identify, measure, replay):
        meter.command()(function)
    meter.command("list")(list_of_ports)
    app.add_typer(meter)


@Command
def list_of_ports() -> Answer:
    """List the serial ports of this computer, without opening any."""
    from spectrabox.capture.meter.serial_line import list_ports
    ports = list_ports()
    lines = [f"{each.port:<16} {each.usb or '':<10} {each.manufacturer or ''} "
             f"{each.description or ''}" for each in ports]
    return Answer({"ports": ports},
                  "\n".join(lines) or "no serial ports: plug the instrument in and switch it on")


@Command
def identify(port: Port, instrument: Meter) -> Answer:
    """Ask the instrument who it is, then leave it as found."""
    from spectrabox.capture.meter.measurement import trusted_identity
    with _instrument(instrument, port, lambda direction, data: None) as meter:
        identity = trusted_identity(meter)
    return Answer({"instrument": identity.model, "serial_number": identity.serial_number,
                   "firmware": identity.firmware, "port": port},
                  f"{identity.model}, serial number {identity.serial_number}, firmware "
                  f"{identity.firmware or 'not stated'}")


@Command
def measure(
    folder: Folder,
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
        "--as", metavar="light|white|paint|chart", help="What is measured; white is the white "
        "standard.")] = "light",
    name: Annotated[str | None, typer.Option(
        metavar="NAME", help="Of a paint: its file becomes spectra/NAME.csv.")] = None,
    repeat: Annotated[int, typer.Option(min=1, max=999, help="Readings of each thing.")] = 1,
    integration_ms: Annotated[float | None, typer.Option(
        min=0.1, help="Fixed exposure in milliseconds; automatic by default.")] = None,
    averages: Annotated[int | None, typer.Option(
        min=1, max=99,
        help="Readings that the instrument averages; its own setting by default.")] = None,
    sync_hz: Annotated[float | None, typer.Option(
        min=10, help="Flicker frequency of the light.")] = None,
    white_reflectance: Annotated[float, typer.Option(
        min=0.01, max=1.1, help="Reflectance of the white standard.")] = 1.0,
    calibration: Annotated[tuple[str, ...], typer.Option(
        metavar="SERIAL=FILE", help="Factors of an instrument by wavelength; of each, where "
        "readings of several are to be compared.")] = (),
    again: Annotated[bool, typer.Option(
        "--again", help="Start a new series; earlier readings are kept aside.")] = False,
    wait: Annotated[bool, typer.Option(
        "--wait/--no-wait", help="Ask before each patch of a chart.")] = True,
    draw: Drawn = False,
    plot: Png = None,
) -> Answer:
    """Measure into a session. Every reading is on disk before it is shown; a broken series goes on
    where it stopped.
    """
    check_ending(plot, {".png": "a picture of the spectrum"}, "--plot")
    from spectrabox.capture.meter.instruments.interface import MeterSettings
    from spectrabox.capture.meter.measurement_files import claim
    from spectrabox.capture.meter.meter_calibration import read_calibration
    names = _names(role, name)
    wanted = MeterSettings(integration_ms, averages, sync_hz)
    source = _source(port, instrument, program, ambient, wanted)
    calibrations = [read_calibration(text) for text in calibration]
    spectra = folder / "spectra"
    claim(spectra, role, names)
    if again:
        _set_aside(spectra, names)
    readings = _measure_all(spectra, role, names, source, repeat, calibrations,
                            wait and role == "chart")
    written, spectrum = _write_result(spectra, role, names, white_reflectance,
                                      calibrations)
    series = _series(spectra, names, calibrations)
    if plot is not None and spectrum is not None:
        from spectrabox.capture.meter.measurement_plot import png_plot
        png_plot(spectrum, plot)
    return Answer({"taken": len(readings), "file": written, "series": series,
                   "png": plot},
                  _measured_text(written, series, spectrum if draw else None))


@Command
def replay(
    transcript: Annotated[Path, typer.Argument(
        metavar="FILE", show_default=False, help="A transcript.")],
    speed: Annotated[float, typer.Option(
        min=0, help="1 as recorded, 10 ten times as fast, 0 at once.")] = 0,
    over_socket: Annotated[bool, typer.Option(
        "--over-socket", help="Through a socket in place of a pseudo-terminal.")] = False,
    draw: Drawn = False,
    plot: Png = None,
) -> Answer:
    """Play a recorded transcript to the driver's own code and show what it reads."""
    check_ending(plot, {".png": "a picture of the spectrum"}, "--plot")
    from spectrabox.capture.meter.measurement_files import reading_facts
    from spectrabox.capture.transcripts.sniffed_traffic import read_recording
    from spectrabox.capture.transcripts.transcript_replay import replay_transcript
    played = replay_transcript(read_recording(transcript), speed=speed,
                               over_socket=over_socket)
    spectra = [reading.spectrum for reading in played.readings if reading.spectrum is not None]
    if plot is not None and spectra:
        from spectrabox.capture.meter.measurement_plot import png_plot
        png_plot(spectra[-1], plot)
    facts = {"instrument": played.instrument, "synthetic": played.synthetic,
             "problems": list(played.problems),
             "readings": [reading_facts(reading) for reading in played.readings]}
    lines = [_reading_line(number, reading) for number, reading in enumerate(played.readings,
                                                                             1)]
    lines += [f"- {problem}" for problem in played.problems]
    if played.synthetic:
        lines += ["synthetic: built from protocol notes, not recorded from an instrument"]
    if draw and spectra:
        from spectrabox.capture.meter.measurement_plot import text_plot
        lines.append(text_plot(spectra[-1]))
    return Answer(facts, "\n".join(lines))


def _names(role: str, name: str | None) -> list[str]:
    from spectrabox.capture.meter.measurement_files import ROLES
    from spectrabox.radiometry.chart import PATCH_NAMES
    if role not in ROLES:
        raise typer.BadParameter(f"{role!r} is not one of {', '.join(ROLES)}", param_hint="--as")
    if role == "chart":
        return [f"chart-{number:02d}-{patch.replace(' ', '-')}" for number,
                patch in enumerate(PATCH_NAMES, 1)]
    if role == "paint" and name is None:
        raise typer.BadParameter("a paint needs a name, such as --name red", param_hint="--name")
    return [name or role]


def _set_aside(spectra: Path, names: list[str]) -> None:
    from spectrabox.capture.meter.measurement_files import readings_folder, set_aside
    for name in names:
        if (folder := readings_folder(spectra, name)).is_dir():
            set_aside(folder)


def _source(port: str | None, instrument: str | None, program: str | None, ambient: bool,
            wanted: MeterSettings) -> Source:
    """What opens the instrument that the options name."""
    if program is None:
        if port is None or instrument is None or ambient:
            raise typer.BadParameter("an instrument on a serial line needs --port and --instrument "
                                     "(--ambient is for --with spotread)")
        return lambda folder: _by_serial_line(folder, instrument, port, wanted)
    if program != "spotread" or instrument is not None or wanted != type(wanted)():
        raise typer.BadParameter("only spotread is known, without --instrument, --integration-ms, "
                                 "--averages and --sync-hz", param_hint="--with")
    if port is not None and not is_whole_number(port):
        raise typer.BadParameter(f"{port!r} is no number of an instrument in spotread's list",
                                 param_hint="--port")
    return lambda folder: _by_spotread(folder, int(port or 1), ambient)


@contextlib.contextmanager
def _by_serial_line(folder: Path, instrument: str, port: str,
                    wanted: MeterSettings) -> Iterator[Taker]:
    """An instrument on its own line, set as wanted once ``check`` lets it measure."""
    from spectrabox.capture.meter.measurement import take_reading, trusted_identity
    from spectrabox.capture.transcripts.transcript_replay import record
    with record(folder, instrument, wanted) as log, _instrument(instrument, port, log) as meter:
        identity = trusted_identity(meter)
        count = 0

        def take(check: Check) -> SpectralReading:
            nonlocal count
            if not count:
                check((identity.model, identity.serial_number))
                meter.settings(wanted)
            reading = take_reading(meter, identity, transcript=log.path.name)
            count += 1
            log.note("readings", str(count))
            return reading
        yield take


@contextlib.contextmanager
def _by_spotread(folder: Path, number: int, ambient: bool) -> Iterator[Taker]:
    """The installed spotread, which says who it is with its first reading."""
    from datetime import UTC, datetime

    from spectrabox.capture.meter.spotread import NAME, spotread_reading
    from spectrabox.capture.transcripts.transcript import TranscriptWriter
    from spectrabox.radiometry.records.spectra import Quantity
    from spectrabox.radiometry.system.words import plain
    now = datetime.now(UTC)
    log = TranscriptWriter(folder / f"{now:%Y%m%dT%H%M%S.%f}.transcript",
                           {"instrument": NAME, "recorded": now.isoformat(timespec="seconds")})
    taken: list[SpectralReading] = []

    def take(check: Check) -> SpectralReading:
        reading = spotread_reading(Quantity.IRRADIANCE if ambient else Quantity.RADIANCE, number,
                                   log, lambda text: print(plain(text), end="", file=sys.stderr,
                                                           flush=True),
                                   calibrated=bool(taken), transcript=log.path.name)
        check((reading.instrument, reading.serial_number))
        taken.append(reading)
        return reading
    with contextlib.closing(log):
        yield take


def _measure_all(spectra: Path, role: str, names: list[str], source: Source, repeat: int,
                 calibrations: list[MeterCalibration], wait: bool) -> list[SpectralReading]:
    """Take the readings that are still missing; those on disk are not taken again."""
    from spectrabox.capture.meter.measurement_files import (
        note_role,
        readings_folder,
        store_reading,
        stored_readings,
    )
    from spectrabox.capture.meter.meter_calibration import makers_of, require_comparable

    stored = {name: stored_readings(readings_folder(spectra, name)) for name in names}
    have = {name: sum(reading.spectrum is not None for reading in stored[name]) for name in names}
    missing = [name for name in names if have[name] < repeat]
    taken: list[SpectralReading] = []
    if not missing:
        print(f"{names[0]} has its {repeat} readings already; --again starts a new series",
              file=sys.stderr)
        return taken
    before = makers_of([*(reading for name in names for reading in stored[name]),
                        *_white_readings(spectra, role)])

    def check(maker: Maker) -> None:
        require_comparable([*before, maker], calibrations,
                           names[0] if role != "chart" else "the chart")
    with source(spectra / "readings") as take:
        for number, name in enumerate(missing, 1):
            if wait and not _ready(f"patch {number} of {len(missing)}, {name}"):
                break
            for count in range(have[name], repeat):
                reading = take(check)
                note_role(spectra, role, name)
                store_reading(readings_folder(spectra, name), reading)
                taken.append(reading)
                print(f"{name}, {_reading_line(count + 1, reading)}", file=sys.stderr, flush=True)
    return taken


@contextlib.contextmanager
def _instrument(name: str, port: str, log: Log) -> Iterator[Instrument]:
    """An open instrument that is left as it was found, or else the operator is told so."""
    from spectrabox.capture.meter.measurement import open_instrument
    from spectrabox.capture.meter.serial_line import shown
    from spectrabox.session.terminal.interruption import Interruptions
    opened: list[Instrument] = []
    try:
        with Interruptions() as interruptions, \
                open_instrument(name, port, log, _pace(), interruptions.held) as meter:
            opened.append(meter)
            try:
                yield meter
            except KeyboardInterrupt:
                print("interrupted: the instrument ends what it was told to do and gets its "
                      "settings back; its measurement may have to end first", file=sys.stderr,
                      flush=True)
                raise
    finally:
        if opened and opened[0].restore:
            commands = ", ".join(shown(command) for command in opened[0].restore)
            print(f"spectrabox: {port}: the {opened[0].family} did not confirm that its settings "
                  f"were put back ({commands}): look at its settings, or switch it off and on",
                  file=sys.stderr)


def _ready(what: str) -> bool:
    """Ask the operator to point the instrument; False to stop here and go on another time."""
    print(f"{what}: point the instrument at it and press Enter (q and Enter to stop here)",
          file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    return bool(line) and line.strip().lower() != "q"


def _white_readings(spectra: Path, role: str) -> list[SpectralReading]:
    """Readings of the white standard, where a result is divided by them."""
    from spectrabox.capture.meter.measurement_files import readings_folder, stored_readings
    return stored_readings(readings_folder(spectra, "white")) if role in ("paint", "chart") else []


def _write_result(spectra: Path, role: str, names: list[str], white_reflectance: float,
                  calibrations: Sequence[MeterCalibration]) -> tuple[Path, Spectrum | None]:
    """Write the mean, or the reflectance where a white standard was measured; gives the file and
    one spectrum.
    """
    from spectrabox.capture.meter.measurement_files import (
        readings_folder,
        result_file,
        stored_readings,
    )
    from spectrabox.capture.meter.measurement_series import (
        reflectance_from,
        series_of,
        series_spectrum,
    )
    from spectrabox.capture.meter.meter_calibration import makers_of, named, require_comparable
    from spectrabox.radiometry.files import write_text_whole
    from spectrabox.radiometry.spectra.spectrum_files import table_text

    stored = {name: stored_readings(readings_folder(spectra, name)) for name in names}
    white_readings = _white_readings(spectra, role)
    makers = makers_of([*(reading for name in names for reading in stored[name]), *white_readings])
    require_comparable(makers, calibrations, names[0] if role != "chart" else "the chart")
    if white_readings and len(makers) == 1:
        calibrations = ()       # one instrument's factor divides out, and so does its error

    def mean(name: str, readings: list[SpectralReading]) -> Spectrum:
        instruments = named(makers_of(readings)) + (", each by its calibration" if calibrations
                                                    else "")
        return series_spectrum(series_of(readings, name, calibrations),
                               f"{instruments}, {name}, mean of {len(readings)}")

    measured = [name for name in names if makers_of(stored[name])]
    if role == "chart" and len(measured) < len(names):
        raise CheckError(f"{len(measured)} of {len(names)} patches are measured and kept; run the "
                         "same command again to go on with "
                         f"{next(name for name in names if name not in measured)}")
    results = [mean(name, stored[name]) for name in names]
    if white_readings:
        white = mean("white", white_readings)
        results = [reflectance_from(result, white, white_reflectance, result.source)
                   for result in results]
    path = result_file(spectra, role, names[0], results[0].quantity)
    columns = {"value": results[0].values} if role != "chart" else \
        {name.partition("-")[2]: result.values for name, result in zip(names, results, strict=True)}
    if role != "chart" and results[0].standard_error is not None:
        columns["standard_error"] = results[0].standard_error
    write_text_whole(path, table_text(results[0].grid.nm, columns, quantity=results[0].quantity,
                                 source=results[0].source))
    return path, results[0]


def _series(spectra: Path, names: list[str],
            calibrations: Sequence[MeterCalibration]) -> list[SeriesSummary]:
    from spectrabox.capture.meter.measurement_files import readings_folder, stored_readings
    from spectrabox.capture.meter.measurement_series import series_of, series_summary
    return [series_summary(series_of(stored_readings(readings_folder(spectra, name)), name,
                                     calibrations), name) for name in names]


def _measured_text(written: Path, series: list[SeriesSummary], spectrum: Spectrum | None) -> str:
    lines = []
    for each in series:
        spread = "" if each.relative_spread is None else \
            f", spread {each.relative_spread:.2%}, drift {each.relative_drift:+.2%}"
        lines.append(f"{each.name}: {each.readings} readings of {each.quantity}{spread}")
        lines += [f"- {flag}" for flag in each.flags]
    if spectrum is not None:
        from spectrabox.capture.meter.measurement_plot import text_plot
        lines.append(text_plot(spectrum))
    return "\n".join([*lines, f"wrote {written}: name it in session.toml"])


def _reading_line(number: int, reading: SpectralReading) -> str:
    stated = "" if reading.luminance is None else f", {reading.luminance:.4g} cd/m2 or lx"
    exposure = "" if reading.integration_ms is None else f", {reading.integration_ms:g} ms"
    lab = "" if reading.lab is None else \
        ", L*a*b* {:.2f} {:.2f} {:.2f} on its display (D65, 10 degrees)".format(*reading.lab)
    return f"reading {number}: {reading.outcome.value.rstrip('.')}{stated}{exposure}{lab}"


def _pace() -> Pace:
    """Real time; a recording played for a test may run faster."""
    import os

    from spectrabox.capture.meter.serial_line import Pace
    text = os.environ.get("SPECTRABOX_METER_PACE", "1")
    try:
        scale = float(text)
    except ValueError:
        raise InputError(
            f"SPECTRABOX_METER_PACE is {text!r}; a number such as 0.01 is needed") from None
    return Pace() if scale == 1 else Pace(scale, shortest_limit_s=REPLAY_LIMIT_S)
