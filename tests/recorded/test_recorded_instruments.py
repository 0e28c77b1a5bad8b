"""What every driver sends, when, on which line, and what it makes of each reply: recorded.

The simulated instruments answer from the manuals and refuse what these do not allow, so that a
driver and a recording that make the same mistake are told apart.
"""
import os
import re

import numpy as np
import pytest
from simulated_instruments import (
    BAUD,
    SIMULATED,
    light,
    obeyed,
    plain,
    session,
    settings_of_port,
)

from spectrabox.capture.meter.instruments import interface, jeti, pr655
from spectrabox.capture.meter.instruments.catalogue import ALIASES, DRIVERS, driver_named
from spectrabox.capture.meter.instruments.interface import MeterSettings
from spectrabox.capture.meter.measurement import measure_once
from spectrabox.capture.meter.serial_line import Pace
from spectrabox.capture.transcripts.player import TranscriptPlayer
from spectrabox.capture.transcripts.replay import record, settings_of, settings_text
from spectrabox.capture.transcripts.transcript import Event, Transcript, read_transcript
from spectrabox.fixtures.meter_transcripts import all_meters, changed_meters
from spectrabox.radiometry.errors import InputError, SpectraboxError

NOTHING = MeterSettings()
WANTED = {"nothing": NOTHING, "exposure": MeterSettings(integration_ms=131.27),
          "averages": MeterSettings(averages=3), "sync": MeterSettings(sync_hz=59.94),
          "all": MeterSettings(421.6, 7, 117.5)}


def _carried_out(monkeypatch, name, replies, wanted=NOTHING, **options):
    return session(monkeypatch, name, replies, wanted, options.pop("baud", BAUD[name]), **options)


@pytest.mark.parametrize("asked", WANTED)
@pytest.mark.parametrize("name", SIMULATED)
def test_all_that_passes_in_a_measurement(monkeypatch, recorded, name, asked):
    result = _carried_out(monkeypatch, name, SIMULATED[name](), WANTED[asked], readings=2)
    if "averages" in result.get("error", ["", "", ""])[2]:      # a CS-2000 has none
        assert name == "cs2000"
    else:
        for reading in result["readings"]:
            # what the manual's digits leave of the light: half a unit of the fourth or fifth
            np.testing.assert_allclose(reading["values"], light(reading["nm"]), rtol=6e-4)
            assert (reading["nm"][0], reading["nm"][-1]) == (380, 780)
        assert not result["not put back"] and not result["unread"]
        second = result["readings"].pop()
        np.testing.assert_array_equal(second["values"], result["readings"][0]["values"])
    recorded({**result, "line": settings_of_port()})


@pytest.mark.parametrize("pattern, wrong", [
    (r"SPMS,3,\d+,[01]\n", "SPMS,3,4999,0\n"), (r"SPMS,3,\d+,[01]\n", "SPMS,3,250000,2\n"),
    (r"SCMS,1,\d+\n", "SCMS,1,1999\n")])
def test_a_simulated_instrument_refuses_what_its_manual_does(pattern, wrong):
    assert obeyed(wrong) == "ER17\n"


# what the manuals allow a computer to send, of each instrument
SENT = {
    "cs2000": r"(RMTS,[012]|MSWE,[01]|IDDR|SPMR|SCMR|SPMS,[01],[012]|SPMS,[24],\d+,[012]"
              r"|SPMS,3,\d+,[01]|SCMS,[02]|SCMS,1,\d{4,5}|MEAS,[01]|MEDR,0,0,1|MEDR,1,0,[1-4]"
              r"|MEDR,2,0,00)\n",
    "cr250": r"(|R[CSM] [A-Za-z]+|SM [A-Za-z]+ [\d.]+|M|E)\r",
    "pr655": r"(PHOTO|Q|(D\d+|M\d+|S[UENSK]\d+|C|E)\r)",
    "pr650": r"(b[0-3]|d110|d120|d5|d2|m0|s01,,,,[\d.]*,\d+,\d\d,[01])\n",
    "specbos1211": r"(\*(idn\?|vers\?|para:spnum\?|stat:err\?|INIT|FETCH:(SPRAD|XYZ|PHOTO|CHROMXY)"
                   r"|CONTR:(LASER [01]|MHEAD\?)|CONF:(WRAN 380 780 1|FUNC 6|FORM [47]|EXPO [012]"
                   r"|TINT [\d.]+|AVER \d+|CYCMOD 1|CYCTIM \d+|DEFAULT))|\x1b)\r?",
    "specbos2501": r"(\*(idn\?|vers\?|stat:err\?|para:(spnum|form|wran|syncmod|syncfreq)\?"
                   r"|para:(form [012]|syncmod \d|syncfreq [\d.]+)|MEAS:LIGHT [\d.]+ \d+ [012]"
                   r"|CALC:SPRAD|calc:(PHOTOmetric|CHROMXY)))\r"}
ROW = {"cr250": r"\d\.\d{3}e[+-]\d\d", "pr655": r"\n\d{3},\d\.\d{3}e[+-]\d\d",
       "pr650": r"\d{4}\.,\d\.\d{3}E[+-]\d\d", "specbos1211": r"\d{3}\t\d\.\d{4}E[+-]\d\d",
       "specbos2501": r"\d{3}\t\d\.\d{4}E[+-]\d\d"}
FIRST = {  # replies as the manuals print them
    "cs2000": {b"RMTS,2": rb"OK00\n", b"IDDR": rb"OK00,.{9},[12],\d{7,8}\n",
               b"SPMR": rb"OK00,0,2\n",
               b"MEDR,0,0,1": rb"OK00,\d,\d,\d{9},\d,\d,\d,\d,\d\d\n"},
    "cr250": {b"RC ID": rb"OK:0:RC ID:[A-Z]\d{5}\r\n", b"M\r": rb"(OK:0|ER:-305):M:[A-Za-z ]+\r\n",
              b"SM ": rb"OK:0:SM [A-Za-z]+:No errors\r\n",
              b"RM Exposure": rb"OK:0:RM Exposure:\d+\.\d{3} msec\r\n",
              b"RM Radiometric": rb"OK:0:RM Radiometric:[0-3],[\d.e+-]+,[\d.e+-]+\r\n"},
    "pr655": {b"PHOTO": rb" REMOTE MODE\r\n", b"D111": rb"00000,PR-6\d\d\r\n", b"S": rb"0000\r\n",
              b"D602": rb"00000(,[^,]+){15}\r\n",
              b"D120": rb"00000,101,\d\.\d\d,380,780,4,256,7,247\r\n",
              b"D5": rb"00000,0,\d\.\d{3}e\+000,\d\.\d{3}e[+-]\d\d,\d\.\d{3}e[+-]\d\d\r\n(?s:.*)",
              b"D2": rb"00000,0(,\d\.\d{3}e[+-]\d\d){3}\r\n"},
    "pr650": {b"b1": rb"000\r\n", b"d120": rb"0101,008\.0,0380\.,0780\.,004\.\r\n",
              b"d5": rb"00,0\r\n\d\.\d{3}E[+-]\d\d\r\n(?s:.*)"},
    "specbos1211": {b"*CON": rb"\x06|mhead: 0\r", b"*INIT": rb"\x06[\x07\x15]",
                    b"*para:spnum": rb"spectrometer number: \d+\r"},
    "specbos2501": {b"*MEAS:LIGHT": rb"\x06[\x07\x15]", b"*CALC:SPRAD": rb"\x02(?s:.*)\r\x03",
                    b"*para:wran?": rb"380 780 1\r"}}


@pytest.mark.parametrize("meter", (*all_meters(), *changed_meters()), ids=lambda meter: meter.name)
def test_the_projects_own_recordings_hold_to_the_manuals(recorded, meter):
    held, allowed = {}, [SENT[meter.driver]]
    if meter.name.endswith("-changed") and "specbos" in meter.name:     # one table for both
        allowed = [SENT["specbos1211"], SENT["specbos2501"]]
    for sent, said in meter.exchanges:
        assert any(re.fullmatch(form, sent.decode("latin-1")) for form in allowed), sent
        answer = b"".join(part for _, part in said)
        for command, form in FIRST[meter.driver].items():
            if sent.startswith(command):
                assert re.fullmatch(form, answer), (sent, answer)
        if meter.driver == "cs2000" and sent.startswith(b"SPMS"):
            assert obeyed(sent.decode()) == "OK00\n"
        rows = re.findall(ROW.get(meter.driver, "no rows"), answer.decode("latin-1"))
        if len(rows) > 50:
            held |= {"rows": len(rows), "bytes of the spectrum": len(answer)}
        if sent.startswith(b"MEDR,"):
            held[sent.decode()] = len(answer)
    held["delays"] = [sum(delay for delay, _ in said) for _, said in meter.exchanges]
    recorded(held)
    # manuals and drivers in use count these bytes, with a return before each line feed of a KM
    counts = {"cs2000": {"MEDR,1,0,1\n": 1006 - 1, "MEDR,1,0,4\n": 1016 - 1},
              "cr250": {"bytes of the spectrum": 2249},
              "pr650": {"rows": 101, "bytes of the spectrum": 6 + 11 + 101 * 17},
              "pr655": {"rows": 101}, "specbos1211": {"rows": 401}, "specbos2501": {"rows": 401}}
    if meter.values is not None:
        assert counts[meter.driver].items() <= held.items()


@pytest.mark.parametrize("name", SIMULATED)
def test_a_line_at_another_speed(monkeypatch, recorded, name):
    found = {}
    for baud in (9600, 38400, 115200, 921600):
        result = _carried_out(monkeypatch, name, SIMULATED[name](), baud=baud)
        found[f"{baud}"] = {key: result.get(key)
                            for key in ("error", "heard", "identity", "not put back")}
    recorded(found)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="a pseudo-terminal is needed")
@pytest.mark.parametrize("meter", changed_meters(), ids=lambda meter: meter.driver)
def test_what_arrives_through_a_pseudo_terminal(recorded, meter):
    import termios
    events = [event for sent, said in meter.exchanges
              for event in (Event(">", 0.0, sent), *(Event("<", 0.0, part) for _, part in said))]
    flags = []

    def note(direction, passed):
        if not flags:
            control = termios.tcgetattr(player._line._slave)
            flags.append({name: bool(control[field] & getattr(termios, name)) for field, name in (
                (2, "CS8"), (2, "PARENB"), (2, "CSTOPB"), (2, "CRTSCTS"), (0, "IXON"))})
    transcript = Transcript({"instrument": meter.driver, "line": meter.line,
                             "settings": meter.settings}, tuple(events), meter.name)
    with TranscriptPlayer(transcript, time_scale=0.0, strict=False) as player:
        reading = measure_once(meter.driver, player.port, settings_of(transcript), note,
                               pace=Pace(0.002, shortest_limit_s=60.0))
    assert not player.problems
    recorded({"reading": plain(reading), "heard": bytes(player.heard).decode("latin-1"),
              "flags": flags, "speed": transcript.baud})
    np.testing.assert_array_equal(reading.spectrum.values, meter.values)


def test_settings_in_words_and_back(recorded):
    found = {}
    for text in ("", "integration_ms=250", "averages=2", "sync_hz=59.94",
                 "integration_ms=12.5 averages=11 sync_hz=47.25", "averages=2.5", "gain=3",
                 "averages", "sync_hz=fast"):
        try:
            wanted = settings_of(Transcript({"settings": text}, (), "a.transcript"))
            found[text] = [wanted, settings_text(wanted)]
            assert settings_text(wanted) == text
        except InputError as error:
            found[text] = str(error)
    recorded(found)


def test_what_is_noted_at_the_head_of_a_recording(recorded, tmp_path):
    found = {}
    for name in (*DRIVERS, "CS-2000A"):
        with record(tmp_path / name, name, MeterSettings(131.5, 3, 59.94)) as writer:
            writer(">", b'D111\r"\\\t\x00\xff')
            writer("<", b"00000,PR-655\r\n")
            writer.note("readings", "4")
        [file] = (tmp_path / name).iterdir()
        read = read_transcript(file)
        found[name] = [{key: value for key, value in read.facts.items() if key != "recorded"},
                       [[event.direction, event.data.decode("latin-1")] for event in read.events],
                       file.suffix, read.baud]
    recorded(found)


def test_names_of_instruments(recorded):
    found = {}
    for name in (*DRIVERS, *ALIASES, "CS-2000A", "pr 670", "Spectraval 1511", "pr656", "cs100", ""):
        try:
            driver = driver_named(name)
            found[name] = [driver.name, driver.family, driver.line_settings,
                           driver(None).longest_measurement_s()]
        except InputError as error:
            found[name] = str(error)
    recorded(found)


def test_the_instruments_that_answers_are_known_by(recorded):
    instrument = DRIVERS["pr650"](type("Line", (), {"name": "/dev/ttyACM3"})())
    said = ["OK:0:RC Model:CR-250", "ER:-500:RC Model:x", "OK00", "ER00", "OK00,CS-2000", "OK000",
            " REMOTE MODE", "00000,PR-655", "0000", "JETI_SDCM3_2501", "PECFIRM_JETI_1501",
            "JETI_SB1211", "SB05", "\x06", "\x15", "hello", "x" * 80]
    recorded({reply: str(instrument.wrong(reply)) for reply in said})


def test_numbers_and_grids_that_instruments_state(recorded):
    found = {}
    for text, count in (("1,2.5,-3e-4", 3), ("1,2", 3), ("1,2,3,4", 3), ("+.5", 1), ("5.", 1),
                        ("1e5,x", 2), ("", 1), ("1,,2", 3), (" 4 , 5 ", 2), ("0x1", 1),
                        ("nan", 1), ("inf", 1), ("1e", 1), ("1 2", 1)):
        found[f"{text} {count}"] = _outcome(lambda text=text, count=count: interface.numbers(
            text, count, "line"))
    for grid in ((101, 380, 780, 4), (401, 380, 780, 1), (101, 380, 784, 4), (101, 380, 780.03, 4),
                 (101, 380, 780.05, 4), (1, 380, 380, 4), (2, 380, 384, 4), (101, 99, 499, 4),
                 (101, 100, 500, 4), (101, 2600, 3000, 4), (101, 2601, 3001, 4),
                 (5000, 400, 899.9, 0.1), (5001, 400, 900, 0.1), (101, 780, 380, -4),
                 (101.5, 380, 782, 4), (0, 0, 0, 0)):
        found[f"{grid}"] = _outcome(lambda grid=grid: interface.stated_grid(*grid, "line"))
    for text in ("0,0,1.5,2,3", "1,2", "0,1.1e2,2.2e+1,x"):
        found[f"xyz {text}"] = _outcome(lambda text=text: interface.xyz_cells(text, "line"))
    for unit in (0, 1, 2, 0.5, -1):
        found[f"unit {unit}"] = _outcome(lambda unit=unit: DRIVERS["pr655"](type(
            "Line", (), {"name": "line"})()).quantity_of(unit, "mount another"))
    for text, label in ((" X: 1.5 Y: 2.5 Z: 3.5", "Y"), ("chrom_X:\t0.31", "Chrom_x"),
                        ("X 3e-2", "X"), ("Z: 1x", "Z"), ("", "X")):
        found[f"{text} {label}"] = _outcome(
            lambda text=text, label=label: jeti.after(text, label, "line"))
    found["sync"] = [pr655._sync_frequency(hz) for hz in (20, 59.94, 117.5, 400.4)]
    found["ms"] = [_outcome(lambda text=text: pr655._leading_integer(text, "line"))
                   for text in (" 250 msec", "12 cycles", "none", "")]
    found["last"] = [pr655._last_number(text) for text in ("x3 gain, 217.5 msec", "1,2,-3", "none")]
    recorded(found)


def _outcome(of):
    try:
        return of()
    except SpectraboxError as error:
        return f"{type(error).__name__}: {error}"
    except ValueError as error:
        return f"{type(error).__name__}: {error}"
