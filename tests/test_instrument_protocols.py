"""Each driver holds to its instrument's manual: units, codes and consistency, with both readings of
the result alike, so that no second reading covers up for the first.
"""
import dataclasses
from types import SimpleNamespace

import pytest

from spectrabox.capture.meter.instruments.drivers import DRIVERS
from spectrabox.capture.meter.instruments.instrument_errors import (
    LineFaultError,
    RefusedError,
    UntrustedReadingError,
)
from spectrabox.capture.meter.instruments.interface import Instrument, MeterSettings
from spectrabox.capture.meter.serial_line import Pace
from spectrabox.capture.transcripts.player import TranscriptPlayer
from spectrabox.capture.transcripts.transcript import Event, Transcript
from spectrabox.fixtures.meter_transcripts import changed_meters, clean_meters
from spectrabox.radiometry.spectra.readings import ReadingOutcome

from tests.transcript_trials import measure_played

# Every reply comes, so that no limit may cut it off, however busy the computer.
FAST = Pace(0.002, shortest_limit_s=60.0)
CLEAN = {meter.driver: meter for meter in clean_meters()}
CHANGED = {meter.driver: meter for meter in changed_meters()}
BRIGHT, DARK, LOW = (ReadingOutcome.TOO_BRIGHT, ReadingOutcome.TOO_DARK, ReadingOutcome.LOW_LIGHT)
NO_SYNC, UNSTEADY, GOOD = (ReadingOutcome.NO_SYNC, ReadingOutcome.UNSTEADY,
                           ReadingOutcome.MEASURED)


@pytest.fixture(autouse=True)
def no_measurement_goes_on(monkeypatch):
    """Whatever was replied, a played instrument is done: nobody need wait for it before leaving."""
    monkeypatch.setattr(Instrument, "_finish", lambda self: self.line.drain(0.3))


def conversation(meter, replies=None):
    """What an instrument says, with the given replies in place of its own, every time."""
    events = []
    for sent, answers in meter.exchanges:
        events.append(Event(">", 0.0, sent))
        answer = [reply for _, reply in answers]
        for command, reply in (replies or {}).items():
            if sent == command:
                answer = [reply(b"".join(answer)) if callable(reply) else reply]
        events += [Event("<", 0.0, reply) for reply in answer]
    return Transcript({"instrument": meter.driver, "line": meter.line, "settings": meter.settings},
                      tuple(events), meter.name)


def measured(meter, replies=None):
    transcript = conversation(meter, replies)
    with TranscriptPlayer(transcript, time_scale=0.0, strict=False) as player:
        reading = measure_played(transcript, player.port, FAST)
    return reading, player


@pytest.mark.parametrize("name, sent", [
    # 250 ms, two readings, 50 Hz (59.94 Hz for the CS-2000), each in the unit of the manual
    ("cs2000", [b"SPMS,3,250000,0\n", b"SCMS,1,5994\n"]),                   # us, hundredths of Hz
    ("cr250", [b"SM ExposureMode 1\r", b"SM Exposure 250\r", b"SM ExposureX 2\r",
               b"SM SyncMode 2\r", b"SM SyncFreq 50\r"]),                   # ms, Hz
    ("pr655", [b"SU1\r", b"SE00250\r", b"SN02\r", b"SS3\r", b"SK050\r"]),   # ms, Hz
    ("pr650", [b"s01,,,,50,250,02,1\n"]),                                   # Hz, ms
    ("specbos1211", [b"*CONF:TINT 250\r", b"*CONF:EXPO 2\r", b"*CONF:AVER 2\r",
                     b"*CONF:CYCMOD 1\r", b"*CONF:CYCTIM 20000\r"]),        # ms, us
    ("specbos2501", [b"*para:syncmod 1\r", b"*para:syncfreq 50\r",
                     b"*MEAS:LIGHT 250 2 0\r"])])                           # Hz, ms
def test_settings_are_sent_in_the_units_of_the_manual(name, sent):
    reading, player = measured(CHANGED[name])
    assert reading.outcome is GOOD
    asked = [command for command in player.obeyed if command in sent]
    assert asked == sent


@pytest.mark.parametrize("hz", [50.0, 59.94, 100.0, 120.0])
def test_a_specbos_1211_is_given_the_period_of_the_light_in_microseconds(monkeypatch, hz):
    sent = []
    monkeypatch.setattr(DRIVERS["specbos1211"], "_set_to",
                        lambda instrument, command: sent.append(command))
    DRIVERS["specbos1211"](None).settings(MeterSettings(sync_hz=hz))
    period_us = float(sent[-1].removeprefix("*CONF:CYCTIM "))
    # whole microseconds: half of one
    assert period_us == pytest.approx(1e6 / hz, abs=0.5)


@pytest.mark.parametrize("name, milliseconds", [
    ("cs2000", 123.456),            # states 000123456 us
    ("cr250", 111.622), ("pr655", 111.0),
    ("pr650", None), ("specbos1211", None), ("specbos2501", None)])     # automatic: not stated
def test_the_exposure_is_recorded_in_milliseconds(name, milliseconds):
    assert measured(CLEAN[name])[0].integration_ms == milliseconds


@pytest.mark.parametrize("name, command, reply, outcome", [
    ("cr250", b"M\r", b"ER:-306:M:x\r\n", BRIGHT), ("cr250", b"M\r", b"ER:-305:M:x\r\n", DARK),
    ("cr250", b"M\r", b"ER:-304:M:x\r\n", DARK), ("cr250", b"M\r", b"ER:-303:M:x\r\n", UNSTEADY),
    ("cr250", b"M\r", b"ER:-302:M:x\r\n", NO_SYNC), ("cr250", b"M\r", b"ER:-301:M:x\r\n", NO_SYNC),
    ("cr250", b"M\r", b"ER:-300:M:x\r\n", NO_SYNC), ("cr250", b"M\r", b"OK:100:M:x\r\n", LOW),
    ("cr250", b"M\r", b"OK:101:M:x\r\n", GOOD), ("cr250", b"M\r", b"OK:102:M:x\r\n", LOW),
    ("cr250", b"M\r", b"OK:103:M:x\r\n", GOOD),
    ("cs2000", b"MEAS,1\n", b"ER10\n", BRIGHT), ("cs2000", b"MEAS,1\n", b"ER71\n", NO_SYNC),
    ("pr655", b"M1\r", b"-1\r\n", UNSTEADY), ("pr655", b"M1\r", b"-2\r\n", BRIGHT),
    ("pr655", b"M1\r", b"-3\r\n", NO_SYNC), ("pr655", b"M1\r", b"-8\r\n", DARK),
    ("pr655", b"M1\r", b"-0008\r\n", DARK), ("pr655", b"M1\r", b"-9\r\n", NO_SYNC),
    ("pr655", b"M1\r", b"-10\r\n", NO_SYNC), ("pr655", b"M1\r", b"-00010,\r\n", NO_SYNC),
    ("pr650", b"m0\n", b"007\r\n", NO_SYNC), ("pr650", b"m0\n", b"008\r\n", NO_SYNC),
    ("pr650", b"m0\n", b"010\r\n", DARK), ("pr650", b"m0\n", b"-1\r\n", DARK),
    ("pr650", b"m0\n", b"016\r\n", UNSTEADY), ("pr650", b"m0\n", b"018\r\n", LOW),
    ("pr650", b"m0\n", b"019\r\n", BRIGHT), ("pr650", b"m0\n", b"020\r\n", NO_SYNC)])
def test_a_code_means_what_the_manual_says(name, command, reply, outcome):
    # the PR-655's error state is cleared after a failure
    meter = dataclasses.replace(CLEAN[name], exchanges=(*CLEAN[name].exchanges, (b"C\r", [])))
    reading, _ = measured(meter, {command: reply})
    assert reading.outcome is outcome
    assert (reading.spectrum is not None) == (outcome in (GOOD, LOW))
    assert bool(reading.findings) == (b"OK:10" in reply)


@pytest.mark.parametrize("name", ["specbos1211", "specbos2501"])
@pytest.mark.parametrize("number, outcome", [(120, BRIGHT), (121, DARK), (123, UNSTEADY),
                                             (160, NO_SYNC), (161, NO_SYNC)])
def test_a_jetis_error_number_means_what_the_manual_says(name, number, outcome):
    meter = dataclasses.replace(CLEAN[name], exchanges=(
        *CLEAN[name].exchanges, (b"*stat:err?\r", [(0.0, f"Error Code: {number} x\r".encode())])))
    start = b"*INIT\r" if name == "specbos1211" else b"*MEAS:LIGHT 0 1 0\r"
    reading, _ = measured(meter, {start: b"\x06\x15"})
    assert reading.outcome is outcome and reading.spectrum is None


@pytest.mark.parametrize("name, command, reply, error", [
    # the word and the sign of the code contradict each other
    ("cr250", b"M\r", b"OK:-305:M:No errors\r\n", LineFaultError),
    ("cr250", b"M\r", b"ER:0:M:No errors\r\n", LineFaultError),
    ("cr250", b"M\r", b"ER:102:M:No errors\r\n", LineFaultError),
    ("cr250", b"RM XYZ\r", lambda reply: reply.replace(b"OK:0", b"OK:-331"), LineFaultError),
    ("cr250", b"RM Exposure\r", lambda reply: reply.replace(b"OK:0", b"ER:0"), LineFaultError),
    ("cs2000", b"MEAS,1\n", b"OK10,005\n", LineFaultError),
    ("cs2000", b"MEDR,2,0,00\n", lambda reply: b"OK05" + reply[4:], LineFaultError),
    ("pr655", b"M1\r", b"00008,0,1.0e+00,0.3,0.3\r\n", RefusedError),
    ("pr655", b"D5\r", lambda reply: b"-4" + reply[5:], RefusedError),
    ("pr655", b"D2\r", lambda reply: b"-8\r\n", RefusedError),
    # the answer to another question
    ("cr250", b"RM XYZ\r", b"OK:0:RM xy:0.4,0.4,0.2\r\n", LineFaultError),
    # an announced duration that cannot be
    ("cs2000", b"MEAS,1\n", b"OK00,999\n", LineFaultError),
    ("cs2000", b"MEDR,1,0,2\n", lambda reply: reply[:-10] + b"-9.9999e9\n", UntrustedReadingError),
    ("specbos1211", b"*CONTR:MHEAD?\r", b"mhead: 1\r", LineFaultError)])
def test_a_reply_that_contradicts_itself_is_refused_though_it_is_repeated(name, command, reply,
                                                                          error):
    with pytest.raises(error):
        measured(CLEAN[name], {command: reply})


@pytest.mark.parametrize("reply, error", [
    (b"0000\r\n", None), (b"00000\r\n", None), (b"-14\r\n", RefusedError),
    (b"00000,0,1.0e+00\r\n", LineFaultError),      # a report that comes late is no answer
    (b"000\r\n", LineFaultError)])
def test_a_pr655_confirms_a_setting_with_a_code_that_stands_alone(reply, error):
    if error is None:
        assert measured(CLEAN["pr655"], {b"SU1\r": reply})[0].outcome is GOOD
    else:
        with pytest.raises(error):
            measured(CLEAN["pr655"], {b"SU1\r": reply})


@pytest.mark.parametrize("quality", [-1, 1, 7, 8, 10, 16, 17, 19, 20, 29, 30, 77])
def test_a_pr650_spectrum_of_bad_quality_is_refused_though_both_readings_say_so(quality):
    code = b"%02d" % quality
    with pytest.raises(RefusedError, match=f"'d5' with error {quality}: "):
        measured(CLEAN["pr650"], {b"d5\n": lambda reply: code + reply[2:],
                                  b"d2\n": lambda reply: code + reply[2:]})


def test_a_pr650_spectrum_at_low_light_is_one_and_one_of_two_qualities_is_none():
    low = {command: lambda reply: b"18" + reply[2:] for command in (b"d5\n", b"d2\n")}
    assert measured(CLEAN["pr650"], {b"m0\n": b"018\r\n", **low})[0].outcome is LOW
    with pytest.raises(LineFaultError, match="is no reply to 'd2'"):
        measured(CLEAN["pr650"], {b"d5\n": low[b"d5\n"]})


@pytest.mark.parametrize("name, command, row", [("pr655", b"D5\r", 0), ("pr650", b"d5\n", 1)])
@pytest.mark.parametrize("factor, accepted", [(1.005, True), (0.995, True), (1.02, False),
                                              (0.98, False), (-1.0, False)])
def test_the_stated_integral_is_the_sum_of_the_values_times_the_step(name, command, row, factor,
                                                                      accepted):
    meter = CLEAN[name]
    total = factor * meter.values.sum() * 4

    def with_total(reply):
        lines = reply.split(b"\r\n")
        cells = lines[row].split(b",")
        cells[3 if name == "pr655" else 0] = f"{total:.3e}".encode()
        return b"\r\n".join([*lines[:row], b",".join(cells), *lines[row + 1:]])
    if accepted:
        assert measured(meter, {command: with_total})[0].outcome is GOOD
    else:
        with pytest.raises(UntrustedReadingError, match="the spectrum's sum is"):
            measured(meter, {command: with_total})


@pytest.mark.parametrize("name, command", [("pr655", b"D5\r"), ("pr650", b"d5\n")])
def test_wavelengths_other_than_the_stated_grid_are_refused_though_both_readings_agree(name,
                                                                                       command):
    with pytest.raises(UntrustedReadingError, match="wavelengths are not those"):
        measured(CLEAN[name], {command: lambda reply: reply.replace(b"384", b"385", 1)})


@pytest.mark.parametrize("name, grid, reply", [
    ("pr655", b"D120\r", b"00000,101,0.00,380,784,4,256,7,247\r\n"),
    ("pr650", b"d120\n", b"0100,008.0,0380.,0776.,004.\r\n"),
    ("cr250", b"RM Spectrum\r", lambda reply: reply.replace(b"780.0,2.0", b"780.0,4.0")),
    ("specbos2501", b"*para:wran?\r", b"380 780 5\r")])
def test_a_grid_that_cannot_be_is_refused(name, grid, reply):
    with pytest.raises((LineFaultError, UntrustedReadingError)):
        measured(CLEAN[name], {grid: reply})


@pytest.mark.parametrize("name, command, unit", [
    ("pr655", b"D5\r", b"2"), ("pr650", b"d5\n", b"2"), ("cr250", b"RM Radiometric\r", b"3")])
def test_a_quantity_that_is_neither_radiance_nor_irradiance_is_refused(name, command, unit):
    start = {"pr655": b"00000,", "pr650": b"00,", "cr250": b"OK:0:RM Radiometric:"}[name]

    def other(reply):
        assert reply.startswith(start + b"0")
        return start + unit + reply[len(start) + 1:]
    with pytest.raises(LineFaultError):
        measured(CLEAN[name], {command: other})


@pytest.mark.parametrize("averages", [1, 4])
@pytest.mark.parametrize("name, longest_s", [
    ("cr250", 75.0),                # slow speed
    ("pr655", 3 * 30.0),            # a trial for the exposure, the light, the dark
    ("specbos1211", 2 * 60.0), ("specbos2501", 2 * 60.0)])      # the light, the dark
def test_the_slowest_measurement_of_the_manual_is_waited_for(monkeypatch, name, longest_s,
                                                             averages):
    limits = []

    def measured_within(*arguments):
        limits.append(arguments[-1])
        raise RefusedError("not sent")
    monkeypatch.setattr(DRIVERS[name], "_set_to", lambda *_: None, raising=False)
    monkeypatch.setattr(DRIVERS[name], "_set", lambda *_: None, raising=False)
    monkeypatch.setattr(DRIVERS[name], "_ask", lambda *_: ",".join(["metric"] * 9 + ["1"]),
                        raising=False)
    monkeypatch.setattr(DRIVERS[name], "measuring", measured_within)
    instrument = DRIVERS[name](SimpleNamespace(pace=SimpleNamespace(sleep=lambda *_: None),
                                               name="port"))
    instrument.settings(MeterSettings(averages=averages))
    with pytest.raises(RefusedError):
        instrument.measure()
    assert limits[0] >= averages * longest_s
