"""Spectroradiometers that answer as the notes on their manuals say, on a clock of their own.

Nothing waits: whoever reads an empty port moves the clock on by the port's time-out, so that limits
and pauses are seen in the instrument's own seconds, the same on every machine. Replies are written
here from the manuals' texts, not taken from the recordings that the project plays.
"""
import itertools
import re
from types import SimpleNamespace

import numpy as np
import serial

from spectrabox.capture.meter import serial_line
from spectrabox.capture.meter.instruments import interface
from spectrabox.capture.meter.measurement import open_instrument, take_reading, trusted_identity
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.spectra.luminous import tristimulus_of

HC = 6.62607015e-34 * 299792458 * 1e9       # J nm


class Clock:
    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


class Port:
    """What pyserial opens; ``replies`` are those of the instrument by command."""

    def __init__(self, clock, replies, baud, options):
        self.clock, self.replies, self.listens_at = clock, replies, baud
        self.timeout = options["timeout"]
        self._baudrate = options.get("baudrate")
        self.heard, self.waiting, self.pending = [], [], b""
        self._rts, self.reads = True, 0

    baudrate = property(lambda self: self._baudrate)

    @baudrate.setter
    def baudrate(self, baud):
        self._note(f"speed {baud}")
        self._baudrate = baud

    rts = property(lambda self: self._rts)

    @rts.setter
    def rts(self, level):
        self._note(f"RTS {'high' if level else 'low'}")
        self._rts = level

    @property
    def in_waiting(self):
        return sum(len(data) for due, data in self.waiting if due <= self.clock.now + 1e-9)

    def read(self, size):
        self.reads += 1
        assert self.reads < 100_000, "this conversation never ends"
        if not self.in_waiting:
            self.clock.now += self.timeout
        taken = b""
        while len(taken) < size and self.waiting and self.waiting[0][0] <= self.clock.now + 1e-9:
            due, data = self.waiting.pop(0)
            part = data[:size - len(taken)]
            if data[len(part):]:
                self.waiting.insert(0, (due, data[len(part):]))
            taken += part
        return taken

    def write(self, data):
        if self.heard and self.heard[-1][1] == "typed":
            self.heard[-1][2] += data
            self.heard[-1][3] = self.clock.now
        else:
            self.heard.append([self.clock.now, "typed", data, self.clock.now])
        if self._baudrate not in (None, self.listens_at):
            self._say([(0.01, b"\xf8\x9f")])
            return
        self.pending += data
        reply = self.replies.get(self.pending)
        if reply is None and self.pending[-1:] in (b"\r", b"\n"):
            reply = one(obeyed(self.pending.decode("latin-1")))
        if reply is not None:
            self.heard[-1][1] = "sent"
            self.pending = b""
            self._say(reply.pop(0) if len(reply) > 1 else reply[0])

    def close(self):
        self._note("closed")

    def _say(self, parts):
        due = self.clock.now
        for delay, data in parts:
            due += delay
            self.waiting.append((due, data))
        self.waiting.sort(key=lambda arrival: arrival[0])

    def _note(self, words):
        self.heard.append([self.clock.now, words, b"", self.clock.now])


def session(monkeypatch, name, replies, wanted, baud, readings=1, address="/dev/ttyACM3"):
    """Everything that happened between the computer and an instrument, with its seconds."""
    clock, opened, limits = Clock(), [], []
    fake_time = SimpleNamespace(monotonic=clock.monotonic, sleep=clock.sleep)
    monkeypatch.setattr(serial_line, "time", fake_time)
    monkeypatch.setattr(interface, "time", fake_time)

    def serial_for_url(url, **options):
        opened.append((url, options))
        return Port(clock, {command: list(said) for command, said in replies.items()}, baud,
                    options)
    monkeypatch.setattr(serial_line.serial, "serial_for_url", serial_for_url)
    wait = serial_line.Pace.limit_s
    monkeypatch.setattr(serial_line.Pace, "limit_s", lambda self, seconds: limits.append(
        seconds) or wait(self, seconds))
    log, result = [], {}
    instrument = None
    try:
        with open_instrument(name, address, lambda *passed: log.append(passed)) as instrument:
            identity = trusted_identity(instrument)
            instrument.settings(wanted)
            result["readings"] = [plain(take_reading(instrument, identity))
                                  for _ in range(readings)]
        result["identity"] = identity
    except SpectraboxError as error:
        result["error"] = [type(error).__name__, error.exit_code, str(error)]
    port = instrument.line._port
    result |= {"opened": [[url, sorted(f"{key}={value}" for key, value in options.items())]
                          for url, options in opened],
               "heard": [_line(*event) for event in port.heard],
               "limits": " ".join(f"{len(list(same))}x{seconds:g}"
                                  for seconds, same in itertools.groupby(limits)),
               "received": sum(len(data) for way, data in log if way == "<"),
               "not put back": [command.decode() for command in instrument.restore],
               "unread": port.in_waiting}
    return result


def _line(start, word, data, end):
    told = repr(data.decode("latin-1")) if data else word
    typing = f" typed by {end:.2f}" if end > start + 1e-9 else ""
    return f"{start:.2f} {told}{typing}" + (" cut off" if word == "typed" else "")


def plain(reading):
    """A reading without the moment it was taken."""
    spectrum = reading.spectrum
    return {"outcome": reading.outcome.name, "quantity": reading.quantity,
            "nm": None if spectrum is None else spectrum.grid.nm,
            "values": None if spectrum is None else spectrum.values,
            "source": None if spectrum is None else spectrum.source.partition(",")[0],
            "instrument": reading.instrument, "serial_number": reading.serial_number,
            "firmware": reading.firmware, "integration_ms": reading.integration_ms,
            "luminance": reading.luminance, "flags": reading.flags}


def settings_of_port():
    """bytesize, parity, stop bits and flow control that pyserial has unless it is told others."""
    port = serial.Serial()
    return [port.bytesize, port.parity, port.stopbits, port.xonxoff, port.dsrdtr]


def obeyed(command):
    """The answer to a command that sets something, by the ranges of the manuals."""
    return next((answer(*match.groups()) for pattern, answer in MANUAL
                 if (match := re.fullmatch(pattern, command))), "")


def _within(text, low, high):
    return re.fullmatch(r"\d+(\.\d+)?", text) is not None and low <= float(text) <= high


def _cs2000(good):
    return "OK00\n" if good else "ER17\n"


def _cr250(key, code, good):
    return f"OK:0:SM {key}:No errors\r\n" if good else f"ER:{code}:SM {key}:Out of range\r\n"


def _pr650_setup(primary, sync, integration, averages, units):
    good = (primary == "01" and (sync in ("", "1") or _within(sync, 40, 250))
            and (integration in ("", "0") or _within(integration, 10, 6000))
            and len(averages) == 2 and averages != "00" and units in "01")
    return "000\r\n" if good else ""


ACK, NAK = "\x06", "\x15"
MANUAL = (  # what a command must look like, and what answers it
    (r"SPMS,([01]),([012])\n", lambda speed, nd: _cs2000(True)),
    (r"SPMS,[24],(\d+),([012])\n", lambda seconds, nd: _cs2000(_within(seconds, 1, 16))),
    (r"SPMS,3,(\d+),(\d)\n", lambda us, nd: _cs2000(_within(us, 5000, 120_000_000)
                                                   and nd in "01")),
    (r"SCMS,1,(\d+)\n", lambda centihertz: _cs2000(_within(centihertz, 2000, 20000))),
    (r"SCMS,[02]\n", lambda: _cs2000(True)),
    (r"[A-Z]{4}(?:,.*)?\n", lambda: "ER00\n"),
    (r"SM (ExposureMode) (\S+)\r", lambda key, to: _cr250(key, -518, to in "01")),
    (r"SM (Exposure) (\S+)\r", lambda key, to: _cr250(key, -519, _within(to, 1, 30000))),
    (r"SM (ExposureX) (\d+)\r", lambda key, to: _cr250(key, -514, _within(to, 1, 50))),
    (r"SM (SyncMode) (\d)\r", lambda key, to: _cr250(key, -521, to in "02345")),
    (r"SM (SyncFreq) (\S+)\r", lambda key, to: _cr250(key, -522, _within(to, 10, 10000))),
    (r"([RS][CMS] ?.*)\r", lambda command: f"ER:-500:{command}:Invalid command\r\n"),
    (r"SE(\d{5})\r", lambda ms: "0000\r\n"),
    (r"SN(\d\d)\r", lambda cycles: "0000\r\n" if cycles != "00" else "-5\r\n"),
    (r"SK(\d{3})\r", lambda hz: "0000\r\n" if _within(hz, 20, 400) else "-3\r\n"),
    (r"S[SU][0-3]\r", lambda: "0000\r\n"),
    (r"s(\d\d),,,,([\d.]*),(\d*),(\d+),(\d)\n", _pr650_setup),
    (r"\*CONF:(?:TINT|AVER|CYCTIM) (\S+)\r",
     lambda number: ACK if _within(number, 1, 120_000) else NAK),
    (r"\*para:sync(?:mod|freq) (\S+)\r",
     lambda number: ACK if _within(number, 0, 10_000) else NAK),
    (r"\*MEAS:LIGHT (\S+) (\d+) [012]\r",
     lambda ms, averages: ACK + "\x07" if _within(ms, 0, 60_000) else NAK),
    (r"\*stat:err\?\r", lambda: "Error Code: 10 argument 1\r"),
    (r"\*.*\r", lambda: NAK))


def one(*parts, delay=0.02):
    """The same reply, every time."""
    return [[(delay, part.encode("latin-1")) for part in parts]]


def light(nm, level=3e-3):
    """A lamp without symmetry, in W m-2 sr-1 nm-1."""
    return level * (0.15 + 0.4 * (nm - 370) / 400 + np.exp(-(((nm - 611) / 31) ** 2))
                    + 0.7 * np.exp(-(((nm - 452) / 17) ** 2)))


def pr_number(value, digits=3):
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"{mantissa}E{int(exponent):+03d}"


def km_number(value):
    mantissa, exponent = f"{value:.4e}".split("e")
    return f"{mantissa}e{int(exponent):+d}"


def cs2000(**other):
    """KM communication note: 380-780 nm by 1 nm in four blocks, 24 colour values."""
    nm = np.arange(380.0, 781.0)
    text = [km_number(value) for value in light(nm)]
    values = np.array(text, float)
    x, y, z = tristimulus_of(nm, values)
    colour = [values.sum(), y, x, y, z, x / (x + y + z), y / (x + y + z),
              *np.linspace(0.11, 0.87, 17)]
    replies = {"RMTS,2\n": one("OK00\n"), "MSWE,0\n": one("OK00\n"), "MSWE,1\n": one("OK00\n"),
               "RMTS,0\n": one("OK00\n"), "IDDR\n": one("OK00,CS-2000  ,2,7001234\n"),
               "SPMR\n": one("OK00,0,2\n"), "SCMR\n": one("OK00,1,6000\n"),
               "SPMS,0,2\n": one("OK00\n"), "SCMS,1,6000\n": one("OK00\n"),
               "MEAS,1\n": [[(3.1, b"OK00,007\n"), (7.2, b"OK00\n")]],
               "MEDR,0,0,1\n": one("OK00,3,1,000087654,1,0,0,0,00\n"),
               "MEDR,2,0,00\n": one(f"OK00,{','.join(map(km_number, colour))}\n")}
    for block, cut in enumerate((slice(0, 100), slice(100, 200), slice(200, 300),
                                 slice(300, 401)), 1):
        replies[f"MEDR,1,0,{block}\n"] = one(f"OK00,{','.join(text[cut])}\n", delay=0.1)
    return _coded(replies, other)


def cr250(step=2, unit=0, **other):
    """CR protocol manual 1.36: `OK:<code>:<command>:<result>`."""
    nm = np.arange(380.0, 781.0, step)
    text = [f"{value:.3e}" for value in light(nm)]
    values = np.array(text, float)
    x, y, z = tristimulus_of(nm, values)
    said = {"RC Model": "CR-250" if step == 2 else "CR-300", "RC InstrumentType": "2",
            "RC ID": "A00417", "RC Firmware": "1.26",
            "RM XYZ": f"{x:.3e},{y:.3e},{z:.3e}",
            "RM Radiometric": f"{unit},{step * values.sum():.3e},"
                              f"{step * (values * nm).sum() / HC:.3e}",
            "RM Exposure": "87.125 msec", "RS ExposureMode": "0 Auto", "RS Exposure": "100 msec",
            "RS ExposureX": "1", "RS SyncMode": "0 None", "RS SyncFreq": "60.00 Hz"}
    replies = {f"{command}\r": one(f"OK:0:{command}:{result}\r\n")
               for command, result in said.items()}
    replies |= {"\r": [[]], "M\r": [[(2.5, b"OK:0:M:No errors\r\n")]]}
    replies |= {f"SM {key} {value}\r": one(f"OK:0:SM {key}:No errors\r\n")
                for key, value in (("ExposureMode", 0), ("Exposure", 100), ("ExposureX", 1),
                                   ("SyncMode", 0), ("SyncFreq", "60.00"))}
    rows = "".join(f"{cell}\r\n" for cell in text)
    replies["RM Spectrum\r"] = one(
        f"OK:0:RM Spectrum:380.0,780.0,{step:.1f},{nm.size}\r\n{rows}", delay=0.1)
    return _coded(replies, other)


D602 = ("MS-75,None,None,None,1 deg,English,Adaptive,0 msec,Normal,1 cycles,2 deg,No Smart Dark,"
        "No Sync,Standard Sensitivity,60.00 Hertz")


def pr655(step=4, unit=0, **other):
    """PR-655/670 manual: reports by number, each begun by five digits, settings answered by
    four."""
    nm = np.arange(380.0, 781.0, step)
    text = [f"{value:.3e}" for value in light(nm)]
    values = np.array(text, float)
    x, y, z = tristimulus_of(nm, values)
    said = {"D111": "PR-655" if step == 4 else "PR-670", "D110": "65210417", "D114": "2.21",
            "D602": D602,
            "D120": f"{nm.size},0.00,380,780,{step},256,7,247",
            "D2": f"{unit},{x:.3e},{y:.3e},{z:.3e}", "D13": "Normal gain,0217 msec"}
    replies = {f"{command}\r": one(f"00000,{result}\r\n") for command, result in said.items()}
    rows = "".join(f"{wavelength:.0f},{cell}\r\n"
                   for wavelength, cell in zip(nm, text, strict=True))
    replies |= {"Q": [[]], "PHOTO": one(" REMOTE MODE\r\n", delay=0.4), "C\r": one("0000\r\n"),
                "E\r": [[]],
                "M1\r": [[(4.2, f"00000,{unit},{y:.3e},0.4012,0.3881\r\n".encode())]],
                "D5\r": one(f"00000,{unit},0.000e+000,{values.sum() * step:.3e},5.147e+01\r\n"
                            f"{rows}", delay=0.1)}
    replies |= {f"{command}\r": one("0000\r\n")
                for command in ("SU1", "SU0", "SE00000", "SN01", "SS0", "SS3", "SK060")}
    return _coded(replies, other)


def pr650(unit=0, end="\r\n", **other):
    """PR-650: rows of 17 bytes, quality and unit before them."""
    nm = np.arange(380.0, 781.0, 4)
    text = [pr_number(value) for value in light(nm)]
    values = np.array(text, float)
    xyz = ",".join(map(pr_number, tristimulus_of(nm, values)))
    rows = "".join(f"{wavelength:04.0f}.,{cell}\r\n"
                   for wavelength, cell in zip(nm, text, strict=True))
    replies = {"b1\n": one("000\r\n"), "d110\n": one("60964417\r\n"), "m0\n": [[(5.5, b"000\r\n")]],
               "s01,,,,,0,01,1\n": one("000\r\n"),
               "d120\n": one("0101,008.0,0380.,0780.,004.\r\n"),
               "d5\n": one(f"00,{unit}{end}{pr_number(values.sum() * 4)}\r\n{rows}", delay=0.1),
               "d2\n": one(f"00,{unit},{xyz}\r\n")}
    return _coded(replies, other)


def specbos1211(head=0, label="\r\r", **other):
    """Argyll's notes: ACK, BEL, header and values closed by empty lines."""
    nm = np.arange(380.0, 781.0)
    text = [f"{value:.4E}" for value in light(nm)]
    x, y, z = tristimulus_of(nm, np.array(text, float))
    rows = "".join(f"{wavelength:.0f}\t{cell}\r"
                   for wavelength, cell in zip(nm, text, strict=True))
    kind = "Irradiance" if head else "Radiance"
    replies = {"*idn?\r": one("JETI_SB1211\r"), "*vers?\r": one("3.10\r"),
               "*para:spnum?\r": one("spectrometer number: 2010417\r"),
               "*INIT\r": [[(0.01, b"\x06"), (3.3, b"\x07")]],
               "*CONTR:MHEAD?\r": one(f"mhead: {head}\r"), "\x1b": [[]],
               "*FETCH:SPRAD\r": one(f"Spectral {kind}{label}W/(m^2*sr*nm)\r\r{rows}\r",
                                     delay=0.05),
               "*FETCH:XYZ\r": one(f" X: {x:.4E}\r Y: {y:.4E}\r Z: {z:.4E}\r"),
               "*FETCH:PHOTO\r": one(f"Luminance[cd/m^2]:\t{y:.4E}\r"),
               "*FETCH:CHROMXY\r": one(f"Chrom_x:\t{x / (x + y + z):.4f}\r"
                                       f"Chrom_y:\t{y / (x + y + z):.4f}\r")}
    replies |= {f"{command}\r": one("\x06") for command in
                ("*CONTR:LASER 0", "*CONF:WRAN 380 780 1", "*CONF:FUNC 6", "*CONF:FORM 7",
                 "*CONF:EXPO 1", "*CONF:EXPO 2", "*CONF:CYCMOD 1", "*CONF:DEFAULT")}
    return _coded(replies, other)


def specbos2501(wran="380 780 1", **other):
    """Argyll's and others' notes: text between STX and ETX."""
    first, last, step = map(float, wran.split())
    nm = np.arange(first, last + step / 2, step)
    text = [f"{value:.4E}" for value in light(nm)]
    x, y, z = tristimulus_of(nm, np.array(text, float))
    rows = "".join(f"{wavelength:.0f}\t{cell}\r"
                   for wavelength, cell in zip(nm, text, strict=True))
    replies = {"*idn?\r": one("JETI_SDCM3_2501\r"), "*vers?\r": one("2.07\r"),
               "*para:spnum?\r": one("2010419\r"), "*para:form?\r": one("1\r"), "\x1b": [[]],
               "*para:form 1\r": one("\x06"), "*para:form 2\r": one("\x06"),
               "*para:syncmod?\r": one("0\r"), "*para:syncmod 1\r": one("\x06"),
               "*para:syncmod 0\r": one("\x06"), "*para:syncfreq?\r": one("60.00\r"),
               "*para:syncfreq 60.00\r": one("\x06"), "*para:wran?\r": one(f"{wran}\r"),
               "*MEAS:LIGHT 0 1 0\r": [[(0.01, b"\x06"), (2.7, b"\x07")]],
               "*CALC:SPRAD\r": one(f"\x02{rows}\x03", delay=0.05),
               "*calc:PHOTOmetric\r": one(f"Luminance[cd/m^2]:\t{y:.4E}\r"),
               "*calc:CHROMXY\r": one(f"Chrom_x:\t{x / (x + y + z):.4f}\r"
                                      f"Chrom_y:\t{y / (x + y + z):.4f}\r")}
    return _coded(replies, other)


def _coded(replies, other):
    """Replies by the bytes of their command, some of them replaced."""
    replaced = {command: one(said) if isinstance(said, str) else said
                for command, said in other.get("said", {}).items()}
    return {command.encode("latin-1"): said for command, said in (replies | replaced).items()}


SIMULATED = {"cs2000": cs2000, "cr250": cr250, "pr655": pr655, "pr650": pr650,
             "specbos1211": specbos1211, "specbos2501": specbos2501}
BAUD = {"cs2000": 115200, "cr250": 115200, "pr655": 9600, "pr650": 9600, "specbos1211": 921600,
        "specbos2501": 921600}
