"""An instrument that the page measures a marked colour with, held open from step to step."""
from __future__ import annotations

import contextlib
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from spectrabox.capture.meter import measurement, measurement_files, serial_line
from spectrabox.capture.meter.instruments import cr30, instrument_errors, interface
from spectrabox.capture.transcripts.player import record
from spectrabox.measure import texts
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import file_stem, shortened
from spectrabox.session.meters import measuring, readers

PRESS_S = 2.0           # for which one request waits for the button


class PageMeter:
    """The CR30 on one port of this computer; its readings go into a session's folder.

    Parameters
    ----------
    folder : Path
        Of the session.
    named_ports : sequence of str
        Ports that it may open besides those that the computer lists.
    """

    def __init__(self, folder: Path, named_ports: Sequence[str] = ()) -> None:
        self._spectra, self._named = folder / "spectra", named_ports
        self._lock = threading.Lock()
        self._open = contextlib.ExitStack()
        self._port = ""
        self._meter: cr30.Cr30 | None = None
        self._identity: interface.Identity | None = None
        self._transcript = ""

    def state(self) -> dict[str, Any]:
        """Ports of this computer, the one that is held, and what to do for each calibration."""
        return {"ports": [{"port": port, "words": words} for port, words in self._ports().items()],
                "port": self._port, "calibrated": self._calibrated(),
                "calibrations": dict(cr30.Cr30.calibrations)}

    def _ports(self) -> dict[str, str]:
        """Ports that may be opened, and what each is."""
        return {**dict.fromkeys(self._named, ""),
                **{each.device: each.description or "" for each in serial_line.list_ports()}}

    def step(self, port: str, what: str, name: str) -> dict[str, Any]:
        """Calibrate, measure, or wait a moment for the button to be pressed.

        Parameters
        ----------
        port : str
        what : str
            One of its calibrations, "measure", or "press".
        name : str
            Of the marked colour.

        Returns
        -------
        dict
            What is calibrated; of a reading its file in the session and its colour.

        Raises
        ------
        InputError, InstrumentError
        """
        if what not in (*cr30.Cr30.calibrations, "measure", "press"):
            raise InputError(f"there is no step {shortened(what)}")
        with self._lock:
            try:
                return self._stepped(self._held(port), what, name)
            except instrument_errors.InstrumentError:
                self._close()       # opened anew, and calibrated anew, the next time
                raise

    def close(self) -> None:
        """Give the instrument back."""
        with self._lock:
            self._close()

    def _stepped(self, meter: cr30.Cr30, what: str, name: str) -> dict[str, Any]:
        if what in meter.calibrations:
            meter.calibrate(what)
        elif what == "measure" or meter.pressed(PRESS_S):
            meter.by_button = what == "press"
            return self._measured(meter, name) | {"calibrated": self._calibrated()}
        return {"calibrated": self._calibrated()}

    def _measured(self, meter: cr30.Cr30, name: str) -> dict[str, Any]:
        assert self._identity is not None
        stem = self._free_stem(file_stem(name))
        measurement_files.claim(self._spectra, "paint", [stem], reflects=True)
        reading = measurement.take_reading(meter, self._identity, transcript=self._transcript)
        measurement_files.note_role(self._spectra, "paint", stem)
        measurement_files.store_reading(measurement_files.readings_folder(self._spectra, stem),
                                        reading)
        path, _ = measuring.write_result(
            measuring.Task(self._spectra, "paint", (stem,), 1, False, False), ())
        return {"file": f"{self._spectra.name}/{path.name}", "lab": reading.lab,
                "flags": [texts.says(finding) for finding in reading.findings],
                "findings": [texts.facts(finding) for finding in reading.findings]}

    def _free_stem(self, stem: str) -> str:
        """A name under which nothing was measured and no file lies: an earlier one can come back.
        """
        number, free = 1, stem
        while (self._spectra / f"{free}.csv").exists() \
                or measurement_files.readings_folder(self._spectra, free).exists():
            number += 1
            free = f"{stem}-{number}"
        return free

    def _held(self, port: str) -> cr30.Cr30:
        """The instrument, opened where it is not held yet."""
        if self._meter is None or self._port != port:
            self._close()
            # pyserial takes addresses too, which write files and connect to other computers
            if port not in (ports := self._ports()):
                raise InputError(f"there is no port {shortened(port)} on this computer; "
                                 f"{'it has ' + ', '.join(ports) if ports else 'it has none'}. "
                                 "Plug the instrument in; a port that is not listed is named when "
                                 "the page is opened, with --meter-port")
            with contextlib.ExitStack() as opening:
                log = opening.enter_context(record(self._spectra / "readings", cr30.Cr30.name,
                                                   interface.MeterSettings()))
                meter = opening.enter_context(
                    measurement.open_instrument(cr30.Cr30.name, port, log, readers.meter_pace()))
                assert isinstance(meter, cr30.Cr30)
                self._identity = measurement.trusted_identity(meter)
                self._open = opening.pop_all()
            self._meter, self._port, self._transcript = meter, port, log.path.name
        return self._meter

    def _close(self) -> None:
        self._open.close()
        self._meter, self._port = None, ""

    def _calibrated(self) -> list[str]:
        return [] if self._meter is None else list(self._meter.calibrated)
