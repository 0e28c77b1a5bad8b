"""The CR30's driver on what a genuine one said: recordings of another program's traffic, the same
bytes over a pseudo-terminal, and damaged.
"""
import csv
import dataclasses
import re

import numpy as np
import pytest

import spectrabox as sb
from spectrabox.capture.meter.instruments.cr30 import display_lab, is_packet, request
from spectrabox.capture.meter.instruments.instrument_errors import (
    InstrumentError,
    LineLostError,
    RefusedError,
    UntrustedReadingError,
    WrongInstrumentError,
)
from spectrabox.capture.meter.instruments.interface import MeterSettings
from spectrabox.capture.meter.measurement import open_instrument, take_reading, trusted_identity
from spectrabox.capture.meter.measurement_files import read_reading, store_reading
from spectrabox.capture.meter.serial_line import Pace
from spectrabox.capture.transcripts.cr30_traffic import cr30_traffic
from spectrabox.capture.transcripts.player import TranscriptPlayer, replay_transcript
from spectrabox.capture.transcripts.sniffed_traffic import read_recording
from spectrabox.capture.transcripts.transcript import Event, Transcript
from spectrabox.fixtures.line_faults import Fault, FaultKind, distortion
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.given_spectra import as_reflectance
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum

from tests.cr30_player import FOLDER, cr30_player, steps_of

GREEN = FOLDER / "Test_Sample_36.61_-20.75_-2.86.spm"
MANY = FOLDER / "param_change-and-measure.spm"
CALIBRATED = FOLDER / "Calibrate_White_and_Black_and_Test_Target.spm"
BUTTON = FOLDER / "button_presses_and_disconnected_presses.spm"
FAST = Pace(0.01, shortest_limit_s=0.3)
STATED = {  # L*a*b* of the display, in the file's name or in the notes of dump.txt
    GREEN.name: [(36.61, -20.75, -2.86)], CALIBRATED.name: [(90.52, -0.98, 0.06)],
    BUTTON.name: [(38.68, -19.64, -7.89)],
    "dump.txt": [(90.52, -0.98, 0.06), (90.52, -0.98, 0.06), (36.62, -20.74, -2.87),
                 (36.61, -20.75, -2.86), (38.68, -19.64, -7.89)]}


def labs(readings):
    return [reading.lab for reading in readings]


@pytest.mark.parametrize("name, stated", STATED.items())
def test_a_genuine_recording_gives_the_colour_that_the_display_showed(name, stated):
    recording = read_recording(FOLDER / name)
    readings, _ = replay_transcript(recording)
    # the display's last digit: its rounding, and a* of the white that it divides by, within .004
    np.testing.assert_allclose(labs(readings), stated, atol=0.01)
    assert all(reading.quantity is Quantity.REFLECTANCE and reading.spectrum.grid.nm.size == 31
               for reading in readings)
    assert "synthetic" not in recording.facts


def test_measurements_in_a_row_have_the_colours_that_its_program_saved_with_seven_digits():
    with (FOLDER / "param_change-and-measure.csv").open() as stream:
        saved = [[float(cell) for cell in row[1:]] for row in list(csv.reader(stream))[1:]]
    readings, problems = replay_transcript(read_recording(MANY))
    assert len(saved) == 22 and not problems
    np.testing.assert_allclose(labs(readings), saved, atol=0.004)
    assert {reading.serial_number for reading in readings} == {"CM443L0787"}
    assert readings[0].firmware == "V10.0.0.0 0.0.20231219 V11.3."


def test_what_a_recording_lacks_is_said():
    _, problems = replay_transcript(read_recording(BUTTON))
    assert problems == ["5 measurements have no spectrum in the recording: it was not asked for"]
    readings, problems = replay_transcript(read_recording(FOLDER / "experiments.spm"))
    assert not readings and problems[-1] == "the recording holds no whole measurement"
    assert "1 measurements lack the parts 10, 12, 13 of their spectrum" in problems


def test_our_requests_are_those_that_its_program_sent():
    sent = {event.data for name in ("Connect.spm", MANY.name, CALIBRATED.name)
            for event in read_recording(FOLDER / name).events if event.direction == ">"}
    ours = {event.data for step in [*steps_of(CALIBRATED), *steps_of(FOLDER / "Connect.spm")]
            for event in step if event.direction == ">"}
    assert len(ours) == 13 and ours <= sent


def recut(events, rng):
    """The bytes of each direction in pieces of other lengths, in the same order."""
    for event in events:
        edges = np.sort(rng.integers(0, len(event.data) + 1, rng.integers(0, 4)))
        pieces = [bytes(event.data[start:end]) for start, end in
                  zip([0, *edges], [*edges, len(event.data)], strict=True)]
        yield from (Event(event.direction, 0.0, piece) for piece in pieces if piece)


def said_in_steps(recording):
    return [event.data for _, events in cr30_traffic(recording)[0]
            for event in events if event.direction == "<"]


@pytest.mark.parametrize("seed", range(4))
def test_however_the_bytes_were_cut_the_readings_are_the_same(seed):
    recording = read_recording(MANY)
    cut = dataclasses.replace(recording, events=tuple(recut(recording.events,
                                                            np.random.default_rng(seed))))
    assert said_in_steps(cut) == said_in_steps(recording)


def test_packets_that_were_noted_twice_count_once():
    recording = read_recording(MANY)
    twice = tuple(event for event in recording.events for _ in range(2))
    readings, problems = replay_transcript(dataclasses.replace(recording, events=twice))
    assert len(readings) == 22 and not problems


def test_a_recording_that_begins_within_a_packet_is_read_from_the_next():
    recording = read_recording(MANY)
    first = next(number for number, event in enumerate(recording.events)
                 if event.direction == "<")
    late = Event("<", 0.0, recording.events[first].data[17:])
    readings, problems = replay_transcript(dataclasses.replace(
        recording, events=(late, *recording.events[first + 1:])))
    assert len(readings) == 22 and "43 bytes" in problems[0]
    assert {reading.serial_number for reading in readings} == {"not recorded"}


def test_a_recording_that_was_cut_off_gives_what_is_whole(tmp_path):
    (tmp_path / "cut.spm").write_bytes(MANY.read_bytes()[:-300])
    assert len(replay_transcript(read_recording(tmp_path / "cut.spm"))[0]) == 21


@pytest.mark.parametrize("content, words", [
    (b"Eltima Software Serial mon.v_4\n" + bytes(100), "version '4'.*export it as text"),
    (GREEN.read_bytes().replace(b"\xbb", b"\xba"), "holds no packet of a CR30"),
    (b"Eltima Software Serial mon.v_3\n" + b"\xff" * 500, "holds no packet"),
    (b"", "its first line must be")])
def test_what_is_no_recording_of_a_cr30_is_refused(tmp_path, content, words):
    (tmp_path / "a.spm").write_bytes(content)
    with pytest.raises(InputError, match=words):
        replay_transcript(read_recording(tmp_path / "a.spm"))


def test_one_changed_byte_never_passes():
    packet = next(event.data for event in read_recording(GREEN).events
                  if event.data.startswith(b"\xbb\x01\x10") and event.direction == "<")
    assert is_packet(packet)
    changed = [packet[:at] + bytes([packet[at] ^ bit]) + packet[at + 1:]
               for at in range(60) for bit in (1, 2, 4, 8, 16, 32, 64, 128)]
    assert not any(is_packet(each) for each in changed)


def test_a_perfect_reflector_is_white_and_colours_are_those_of_the_ten_degree_observer():
    # the display divides by 94.81, 100, 107.32; the sum over its bands is 94.78, 100, 107.35
    np.testing.assert_allclose(display_lab(np.ones(31)), (100, 0, 0), atol=0.06)


# ---- over a pseudo-terminal ----------------------------------------------------------------------


def measured(player, *, button=False, calibrate=()):
    with open_instrument("cr30", player.port, lambda direction, data: None, FAST) as meter, player:
        identity = trusted_identity(meter)
        meter.settings(MeterSettings())
        for which in calibrate:
            meter.calibrate(which)
        meter.by_button = button
        if button:
            assert meter.pressed(2.0)
        return take_reading(meter, identity)


@pytest.mark.parametrize("over_socket", [False, True])
def test_it_is_calibrated_and_measures_by_command(over_socket):
    player = cr30_player(CALIBRATED, over_socket=over_socket)
    reading = measured(player, calibrate=("white", "black"))
    assert not player.problems and player.finished
    np.testing.assert_allclose(reading.lab, (90.52, -0.98, 0.06), atol=0.01)
    assert (reading.instrument, reading.serial_number) == ("CR30", "CM443L0787")
    assert re.fullmatch(r"white 2.*, black 2.*", reading.calibration) and not reading.findings


def test_it_measures_when_its_button_is_pressed():
    player = cr30_player(BUTTON)
    reading = measured(player, button=True)
    assert not player.problems
    np.testing.assert_allclose(reading.lab, (38.68, -19.64, -7.89), atol=0.01)


def test_a_reading_without_calibration_says_so_on_disk_too(tmp_path):
    reading = measured(cr30_player(GREEN))
    back = read_reading(store_reading(tmp_path, reading))
    assert back.calibration == "none before these readings"
    assert back.findings == reading.findings == (Finding(
        "meter.not-calibrated", Severity.NOTE, values={"missing": ["white", "black"]}),)
    assert back.lab == reading.lab and back.quantity is Quantity.REFLECTANCE


def test_a_press_that_nobody_waited_for_is_not_the_next_reading():
    press = next(event for event in read_recording(BUTTON).events if event.direction == "<")
    connect, green = steps_of(FOLDER / "Connect.spm")[0], steps_of(GREEN)[0]
    player = TranscriptPlayer(Transcript({"line": "9600"}, (*connect, press, *green), "test"),
                              time_scale=0.0)
    np.testing.assert_allclose(measured(player).lab, (36.61, -20.75, -2.86), atol=0.01)


def replies(transcript):
    return [step for step, event in enumerate(transcript.events) if event.direction == "<"]


DAMAGE = [FaultKind.DROP_BYTE, FaultKind.FLIP_BIT, FaultKind.TRUNCATE, FaultKind.DROP,
          FaultKind.NOISE, FaultKind.ZERO_BYTE, FaultKind.STALL, FaultKind.DRIBBLE,
          FaultKind.ECHO_BEFORE, FaultKind.ECHO_AFTER, FaultKind.DUPLICATE]


@pytest.mark.parametrize("kind", DAMAGE, ids=lambda kind: kind.value)
@pytest.mark.parametrize("number, position", [(1, 0.99), (6, 0.0), (8, 0.4), (10, 0.3)])
def test_a_fault_of_the_line_ends_in_the_true_reading_or_in_an_error(kind, position, number):
    clean = cr30_player(GREEN).transcript
    player = TranscriptPlayer(clean, time_scale=0.0, strict=False,
                              distort=distortion(Fault(kind, replies(clean)[number], position)))
    try:
        reading = measured(player)
    except InstrumentError:
        assert kind not in (FaultKind.STALL, FaultKind.DRIBBLE)
        return
    np.testing.assert_allclose(reading.lab, (36.61, -20.75, -2.86), atol=0.01)
    assert reading.serial_number == "CM443L0787"


def test_a_part_that_was_lost_once_is_asked_for_again():
    clean = cr30_player(GREEN).transcript
    fault = Fault(FaultKind.FLIP_BIT, replies(clean)[8])
    player = TranscriptPlayer(clean, time_scale=0.0, strict=False, distort=distortion(fault))
    np.testing.assert_allclose(measured(player).lab, (36.61, -20.75, -2.86), atol=0.01)


def test_a_check_byte_that_is_always_wrong_is_an_error():
    clean = cr30_player(GREEN).transcript
    fault = Fault(FaultKind.FLIP_BIT, replies(clean)[7], 0.999, every=True)
    player = TranscriptPlayer(clean, time_scale=0.0, strict=False, distort=distortion(fault))
    with pytest.raises(InstrumentError, match="its check byte or its beginning is wrong; check the "
                                              "cable"):
        measured(player)


@pytest.mark.parametrize("number", [0, 6, 8])
def test_a_cable_that_is_pulled_is_an_error(number):
    clean = cr30_player(GREEN).transcript
    fault = Fault(FaultKind.DISCONNECT, replies(clean)[number])
    player = TranscriptPlayer(clean, time_scale=0.0, strict=False, distort=distortion(fault))
    with pytest.raises(LineLostError, match="the line broke"):
        measured(player)


@pytest.mark.parametrize("answer, words", [
    (b"OK:0:RC Model:CR-250\r\n", "this looks like a Colorimetry Research CR-250"),
    (b"?\r\n", "CR30 was asked for, but '[?]"),
    (request("aa0a00"), "CR30 was asked for, but ''")])
def test_another_instrument_is_told_apart(answer, words):
    events = (Event(">", 0.0, request("aa0a00")), Event("<", 0.0, answer))
    with pytest.raises(WrongInstrumentError, match=words):
        measured(TranscriptPlayer(Transcript({"line": "9600"}, events, "test"), time_scale=0.0,
                                  strict=False))


def changed(clean, start, change):
    """A recording with the instrument's packets of a kind changed and their check bytes right."""
    events = []
    for event in clean.events:
        if event.direction == "<" and event.data.startswith(bytes.fromhex(start)):
            body = bytearray(event.data[:-1])
            change(body)
            event = Event("<", 0.0, bytes([*body, sum(body) % 256]))
        events.append(event)
    return dataclasses.replace(clean, events=tuple(events))


@pytest.mark.parametrize("source, start, at, value, error, words", [
    (CALIBRATED, "bb11", 6, 0, RefusedError, "did not confirm its white calibration.*white tile"),
    (CALIBRATED, "bb0109", 6, 20, UntrustedReadingError, "states 31 bands from 400 to 1000 nm"),
    (CALIBRATED, "bb0110", 8, 0, UntrustedReadingError, "not of one measurement"),
    (CALIBRATED, "bb0112", 9, 0x7F, UntrustedReadingError, "which cannot be; calibrate")])
def test_what_a_cr30_cannot_mean_is_refused(source, start, at, value, error, words):
    def change(body):
        body[at] = value
    transcript = changed(cr30_player(source).transcript, start, change)
    with pytest.raises(error, match=words):
        measured(TranscriptPlayer(transcript, time_scale=0.0, strict=False),
                 calibrate=("white", "black"))


def test_settings_that_it_has_not_are_refused():
    with open_instrument("cr30", cr30_player(GREEN).port, lambda direction, data: None,
                         FAST) as meter, pytest.raises(InputError, match="use --repeat"):
        meter.settings(MeterSettings(averages=3))


# ---- from Python ---------------------------------------------------------------------------------


def test_python_measures_a_spectrum_that_functions_take_as_a_truth(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr("builtins.input", asked.append)
    with cr30_player(CALIBRATED) as player:
        found = sb.measure_spectrum(player.port, "cr30", calibrate=True)
    assert len(asked) == 2 and "white tile" in asked[0]
    np.testing.assert_allclose(found.lab, (90.52, -0.98, 0.06), atol=0.01)
    assert found.quantity == "reflectance" and found.nm.size == 31 and not found.flags
    found.to_csv(tmp_path / "tile.csv")
    back = read_spectrum(tmp_path / "tile.csv", role=Quantity.REFLECTANCE)
    np.testing.assert_allclose(back.values, found.values, rtol=5e-9)
    assert "white 2" in back.source
    np.testing.assert_allclose(as_reflectance(found.spectrum, "tile"),
                               as_reflectance(tmp_path / "tile.csv", "tile"), rtol=5e-9)


@pytest.mark.parametrize("instrument, options, words", [
    ("cr30", {}, "say calibrate=True, or calibrate=False"),
    ("pr655", {"calibrate": True}, "no calibration to be made"),
    ("pr655", {"button": True}, "no reading by a button")])
def test_python_is_told_what_an_instrument_needs(instrument, options, words):
    with cr30_player(GREEN) as player, pytest.raises(InputError, match=words):
        sb.measure_spectrum(player.port, instrument, **options)


def test_a_radiance_is_no_reflectance():
    radiance = Spectrum(FINE_GRID, np.ones(301), Quantity.RADIANCE, "a lamp")
    with pytest.raises(InputError, match="vase is given as radiance"):
        as_reflectance(radiance, "vase")
