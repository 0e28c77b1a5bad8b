"""Every driver reads its recordings through its own pyserial code; all recordings here are
synthetic.
"""
import dataclasses
import time
from typing import ClassVar

import numpy as np
import pytest

from spectrabox.capture.meter.instruments.drivers import DRIVERS, driver_named
from spectrabox.capture.meter.instruments.instrument_errors import (
    NoReplyError,
    RefusedError,
    UntrustedReadingError,
    WrongInstrumentError,
)
from spectrabox.capture.meter.serial_line import Pace, SerialLine
from spectrabox.capture.transcripts.player import TranscriptPlayer, replay_transcript
from spectrabox.capture.transcripts.transcript import Event, read_transcript
from spectrabox.fixtures.meter_transcripts import FOLDER, all_meters, clean_meters
from spectrabox.radiometry.appearance import luminance_of
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.readings import ReadingOutcome

from tests.transcript_trials import measure_played

CLEAN = [meter.name for meter in clean_meters()]
FAST = Pace(0.002, shortest_limit_s=0.2)


def recording(name):
    return read_transcript(FOLDER / f"{name}.transcript")


def measured(transcript, name=None, pace=FAST, **options):
    with TranscriptPlayer(transcript, time_scale=0.0, **options) as player:
        reading = measure_played(transcript, player.port, pace, name)
    return reading, player


def replaced(transcript, sent, reply):
    """The recording with every reply to ``sent`` replaced."""
    events, after = [], False
    for event in transcript.events:
        if event.direction == ">":
            after = event.data == sent
            events.append(event)
            if after:
                events.append(Event("<", 0.0, reply))
        elif not after:
            events.append(event)
    return dataclasses.replace(transcript, events=tuple(events))


@pytest.mark.parametrize("meter", all_meters(), ids=lambda meter: meter.name)
def test_the_stored_recordings_are_those_the_script_makes(meter):
    assert (FOLDER / f"{meter.name}.transcript").read_text(encoding="ascii") == meter.text()
    assert "synthetic" in recording(meter.name).facts


@pytest.mark.parametrize("meter, over_socket", [
                             *((meter, False) for meter in clean_meters()),
                             *((meter, True) for meter in clean_meters()[::2])],
                         ids=lambda value: getattr(value, "name", "socket" if value
                                                   else "terminal"))
def test_a_recording_is_read_as_its_true_spectrum(meter, over_socket):
    (reading, *_), problems = replay_transcript(recording(meter.name), over_socket=over_socket)
    assert not problems
    assert reading.outcome is ReadingOutcome.MEASURED and reading.quantity is Quantity.RADIANCE
    np.testing.assert_array_equal(reading.spectrum.values, meter.values)
    np.testing.assert_array_equal(reading.spectrum.grid.nm, meter.nm)
    # The instrument states four digits: half a unit of the fourth.
    assert reading.luminance == pytest.approx(luminance_of(meter.nm, meter.values), rel=5e-4)


@pytest.mark.parametrize("meter", [meter for meter in all_meters() if meter.values is None],
                         ids=lambda meter: meter.name)
def test_too_dark_and_too_bright_are_results_with_a_reason_and_no_spectrum(meter):
    reading = replay_transcript(recording(meter.name))[0][0]
    assert reading.spectrum is None and reading.quantity is None
    assert reading.outcome.name.lower().replace("_", "-") in meter.name
    assert not reading.outcome.has_spectrum


# what is said of an instrument that says nothing, with the limits of its driver
SILENT = {"cs2000": r"no complete reply within 10 s \(nothing came\); check",
          "cr250": r"no complete reply within 5 s \(nothing came\); check",
          "pr655": r"no complete reply within 10 s \(nothing came\); check",
          "pr650": "the PR-650 is silent; it listens only within 5 s",
          "specbos1211": "no answer at 921600, 115200, 38400 baud; check",
          "specbos2501": "no answer at 921600, 115200 baud; check"}


@pytest.mark.parametrize("name, other", list(zip(CLEAN, [*CLEAN[1:], CLEAN[0]], strict=True)))
def test_a_wrong_instrument_on_the_port_is_an_error(name, other):
    baud = driver_named(other).baud
    transcript = recording(name)
    transcript = dataclasses.replace(transcript, facts={**transcript.facts, "line": str(baud)})
    # the two of JETI speak one language; the others do not understand each other
    error, words = ((WrongInstrumentError, "JETI specbos 2501 was asked for, but 'JETI_SB1211' "
                     "answers") if name == "specbos1211" else (NoReplyError, SILENT[other]))
    with pytest.raises(error, match=words):
        measured(transcript, other, strict=False)


@pytest.mark.parametrize("asked, sent, reply, hint", [
    ("cs2000", b"RMTS,2\n", b"OK:0:RC ID:A00102\r\n", "Colorimetry Research"),
    ("cr250", b"RC Model\r", b"ER00\r\n", "Konica Minolta"),
    ("pr650", b"b1\n", b"00000,PR-655\r\n", "PR-655 or PR-670"),
    ("specbos1211", b"*idn?\r", b"PECFIRM_JETI_1501\r", "spectraval")])
def test_an_answer_in_another_language_names_the_instrument_that_is_there(asked, sent, reply, hint):
    with pytest.raises(WrongInstrumentError, match=rf"this looks like .*{hint}.*--instrument"):
        measured(replaced(recording(asked), sent, reply), asked, strict=False)


@pytest.mark.parametrize("name", CLEAN)
def test_an_instrument_that_never_answers_is_named_within_its_limit(name):
    transcript = recording(name)
    mute = dataclasses.replace(transcript,
                               events=tuple(event for event in transcript.events if event.direction
                                            == ">"))
    with pytest.raises(NoReplyError, match=SILENT[name]):
        measured(mute)


@pytest.mark.parametrize("name, sent, reply", [
    ("cs2000", b"IDDR\n", b"OK00,CS-2000  ,1,1001234,V4.00,NEW\n"),
    ("pr655", b"D120\r", b"00000,101,0.00,380,780,4,256,7,247,1,2,3\r\n"),
    ("cr250", b"RM Radiometric\r", b"OK:0:RM Radiometric:0,2.612e+00,7.788e+18,1,2\r\n")])
def test_a_longer_reply_of_an_unknown_firmware_is_understood(name, sent, reply):
    reading, _ = measured(replaced(recording(name), sent, reply))
    assert reading.outcome is ReadingOutcome.MEASURED


@pytest.mark.parametrize("name, sent, reply, message", [
    ("cs2000", b"MEAS,1\n", b"ER83\n", "error 83: the aperture dial was moved"),
    ("cr250", b"M\r", b"ER:-331:M:Hardware\r\n", "error -331: its hardware failed"),
    ("pr655", b"M1\r", b"-12\r\n", "error -12: the automatic exposure took too long"),
    ("pr650", b"m0\n", b"017\r\n", "error 17: its battery is low")])
def test_an_instruments_own_error_is_said_in_words(name, sent, reply, message):
    with pytest.raises(RefusedError, match=message):
        measured(replaced(recording(name), sent, reply), strict=False)


def test_an_unlisted_error_code_is_still_an_error():
    with pytest.raises(RefusedError,
                       match="error 77: an error that its protocol notes do not list"):
        measured(replaced(recording("cs2000"), b"MEAS,1\n", b"ER77\n"), strict=False)


def test_old_konica_minolta_firmware_is_taken_under_control_with_its_own_command():
    text = recording("cs2000")
    events = [Event(">", 0, b"RMTS,2\n"), Event("<", 0, b"ER17\n"), Event(">", 0, b"RMTS,1\n"),
              *text.events[1:]]
    reading, player = measured(dataclasses.replace(text, events=tuple(events)))
    assert reading.spectrum is not None and bytes(player.heard).endswith(b"RMTS,0\n")


def test_echo_left_on_is_switched_off_and_on_again():
    transcript = recording("cr250")
    events = (Event(">", 0, b"\r"), Event("<", 0, b"\r\n>"), Event(">", 0, b"E\r"),
              *transcript.events[1:],
              Event(">", 0, b"E\r"))
    reading, player = measured(dataclasses.replace(transcript, events=events))
    assert reading.spectrum is not None and not player.problems
    assert bytes(player.heard).endswith(b"SM ExposureX 1\rE\r")


def test_settings_are_put_back_as_they_were_found():
    _, player = measured(recording("cr250"))
    assert bytes(player.heard).index(b"SM ExposureX 2\r") < bytes(player.heard).index(
        b"SM ExposureX 1\r")


def test_a_fixed_exposure_is_put_back_to_automatic():
    transcript = recording("cs2000")
    start, rest = transcript.events[:8], transcript.events[8:]
    asked = [(b"SPMR\n", b"OK00,0,2\n")] * 2 + [(b"SPMS,3,250000,0\n", b"OK00\n")]
    extra = [event for sent, reply in asked
             for event in (Event(">", 0, sent), Event("<", 0, reply))]
    end = [Event(">", 0, b"SPMS,0,2\n"), Event("<", 0, b"OK00\n")]
    events = (*start, *extra, *rest[:-4], *end, *rest[-4:])
    facts = {**transcript.facts, "settings": "integration_ms=250"}
    _, player = measured(dataclasses.replace(transcript, events=events, facts=facts))
    assert not player.problems and bytes(player.heard).endswith(b"SPMS,0,2\nMSWE,1\nRMTS,0\n")


def test_irradiance_is_recorded_as_the_instrument_states_it():
    transcript = replaced(recording("cr250"), b"RM Radiometric\r",
                          b"OK:0:RM Radiometric:1,2.612e+00,7.788e+18\r\n")
    assert measured(transcript)[0].quantity is Quantity.IRRADIANCE


def test_a_spectrum_that_disagrees_with_the_reported_luminance_is_refused():
    transcript = replaced(recording("cr250"), b"RM XYZ\r",
                          b"OK:0:RM XYZ:1.700e+00,9.000e+02,1.800e+00\r\n")
    with pytest.raises(UntrustedReadingError, match=r"the spectrum's luminance is .* the "
                                                    r"instrument reports 900; they must agree "
                                                    r"within 9\.1"):
        measured(transcript)


def test_a_pr655_is_typed_to_one_character_at_a_time():
    class Port:
        in_waiting = 0
        sent: ClassVar = []

        def write(self, data):
            self.sent.append((time.monotonic(), data))
    line = SerialLine(Port(), "port", lambda direction, data: None, Pace(0.1),
                      character_pause_s=driver_named("pr655").character_pause_s)
    line.write(b"PHOTO")
    assert [data for _, data in Port.sent] == [b"P", b"H", b"O", b"T", b"O"]
    # sleep() never returns early, so 50 ms at scale 0.1 is a lower bound.
    assert np.diff([moment for moment, _ in Port.sent]).min() >= 0.005


def test_every_driver_has_a_recording_and_a_name_for_its_relatives():
    # the CR30's are genuine: tests/test_cr30.py
    assert set(DRIVERS) == {*CLEAN, "cr30"}
    assert driver_named("CS-2000A") is DRIVERS["cs2000"] and driver_named(
        "pr 670") is DRIVERS["pr655"]
    with pytest.raises(InputError, match=r"no driver for 'pr656'.*did you mean pr65"):
        driver_named("pr656")


@pytest.mark.parametrize("driver", DRIVERS.values(), ids=lambda driver: driver.name)
def test_no_driver_sends_a_command_that_harms(driver):
    # INIT wipes a CS-2000, E cannot be undone on a PR-650, *PARA:SAVE writes a JETI's flash.
    for name in CLEAN:
        sent = [event.data for event in recording(name).events if event.direction == ">"]
        assert not any(data in (b"INIT\n", b"E\n") or b"SAVE" in data.upper() for data in sent)
