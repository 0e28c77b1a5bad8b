"""Transcripts come back as they were written, and bad ones get one sentence."""
import dataclasses
import time
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.capture.meter import serial_line
from spectrabox.capture.meter.instruments.instrument_errors import (
    InstrumentError,
    NoReplyError,
    UntrustedReadingError,
)
from spectrabox.capture.meter.instruments.interface import Identity, MeterSettings
from spectrabox.capture.meter.measurement import open_instrument, take_reading, trusted_identity
from spectrabox.capture.transcripts import player as transcript_replay
from spectrabox.capture.transcripts.player import TranscriptPlayer, record, replay_transcript
from spectrabox.capture.transcripts.transcript import (
    Event,
    TranscriptWriter,
    escaped,
    read_transcript,
    unescaped,
)
from spectrabox.fixtures.meter_transcripts import FOLDER
from spectrabox.radiometry.errors import InputError

from tests.transcript_trials import measure_played

START = "# spectrabox transcript: 1\n# instrument: pr655\n# line: 9600\n"


def test_a_serial_number_that_changes_between_two_answers_is_refused():
    answers = iter([Identity("PR-655", "65123456", "1.19"), Identity("PR-655", "65123457", "1.19")])
    meter = SimpleNamespace(identify=lambda: next(answers), checks_bytes=False,
                            line=SimpleNamespace(name="COM3"))
    with pytest.raises(UntrustedReadingError, match="asked twice"):
        trusted_identity(meter)


def test_every_byte_survives_the_text_form():
    data = bytes(range(256)) + b'\\x41"\\"'
    assert unescaped(escaped(data)) == data and escaped(data).isascii()


def test_a_written_transcript_is_read_back(tmp_path):
    writer = TranscriptWriter(tmp_path / "a" / "t.transcript",
                              {"instrument": "pr655", "line": "9600"})
    writer(">", b"D111\r")
    writer("<", b"00000,PR-655\r\n\xff")
    writer.note("readings", "2")
    writer.close()
    transcript = read_transcript(tmp_path / "a" / "t.transcript")
    assert [(event.direction, event.data) for event in transcript.events] == [
        (">", b"D111\r"), ("<", b"00000,PR-655\r\n\xff")]
    assert transcript.facts["readings"] == "2" and transcript.baud == 9600


def test_what_passed_before_a_crash_is_kept(tmp_path):
    path = tmp_path / "t"
    writer = TranscriptWriter(path, {})
    writer(">", b"M\r")  # not closed: the process died here
    with path.open("a") as stream:
        stream.write('< 0.010 "OK:0')
    [event] = read_transcript(path).events      # after whatever time a busy computer took
    assert event == Event(">", event.delay_s, b"M\r")
    writer.close()


@pytest.mark.parametrize("text, message", [
    ("hello\n", "its first line must be"),
    (START, "holds no events"),
    (START + '> 0.0 "D111\\q"\n> 0.0 "x"\n', "line 4: .* is no event"),
    (START + '? 0.0 "D111"\n> 0.0 "x"\n', "line 4"),
    (START.replace("# instrument: pr655\n", "") + '> 0.0 "x"\n', "names no instrument"),
    (START.replace("# line: 9600\n", "") + '> 0.0 "x"\n', "'# line: 9600' is needed"),
    (START.replace("pr655", "pr999") + '> 0.0 "x"\n', "no driver for 'pr999'"),
    (START + '# settings: colour=red\n> 0.0 "Q"\n> 0.0 "PHOTO"\n', "the recording ends"),
    (START + '# readings: many\n> 0.0 "Q"\n', "states 'many' readings")])
def test_a_bad_transcript_gets_one_sentence(tmp_path, text, message):
    path = tmp_path / "t"
    path.write_text(text)
    with pytest.raises((InputError, InstrumentError), match=message):
        replay_transcript(read_transcript(path))


def test_recorded_times_are_kept():
    started = time.monotonic()
    replay_transcript(read_transcript(FOLDER / "cs2000.transcript"), speed=10)
    # The recording waits 2 s and 5 s for the measurement; sleep never returns early, so a tenth is
    # a lower bound.
    assert time.monotonic() - started >= 0.7


def test_a_driver_that_leaves_the_recording_is_told_where():
    text = read_transcript(FOLDER / "cr250.transcript")
    other = dataclasses.replace(text, facts={**text.facts, "settings": "averages=3"})
    with TranscriptPlayer(other, time_scale=0.0) as player, pytest.raises(NoReplyError):
        measure_played(other, player.port, serial_line.Pace(0.01, 0.3))
    assert any("the recording has b'SM ExposureX 2" in problem and "sent b'SM ExposureX "
               "3" in problem for problem in player.problems)


def test_a_missing_transcript_is_named(tmp_path):
    with pytest.raises(InputError, match="is missing: give the file of a transcript"):
        read_transcript(tmp_path / "none")


def test_a_recording_can_be_recorded_again_and_replayed(tmp_path):
    wanted = MeterSettings(averages=2)
    transcript = read_transcript(FOLDER / "cr250.transcript")
    with TranscriptPlayer(transcript, time_scale=0.0, strict=False) as player, \
            record(tmp_path, "cr250", wanted) as log, \
            open_instrument("cr250", player.port, log, serial_line.Pace(0.01, 2.0)) as meter:
        identity = trusted_identity(meter)
        meter.settings(wanted)
        first = [take_reading(meter, identity) for _ in range(3)]
        log.note("readings", "3")
    written = read_transcript(log.path)
    readings, problems = replay_transcript(written)
    assert len(readings) == 3 and not problems and "synthetic" not in written.facts
    for before, after in zip(first, readings, strict=True):
        np.testing.assert_array_equal(before.spectrum.values, after.spectrum.values)


@pytest.mark.parametrize("speed, expected", [(4.0, 0.25), (0.5, 2.0), (0.0, 0.0)])
def test_a_recording_plays_as_fast_as_is_asked(monkeypatch, speed, expected):
    """Waits of the instrument and limits of its driver alike; without a speed nobody waits."""
    player, make_pace, paces = transcript_replay.TranscriptPlayer, serial_line.Pace, []
    scales = []

    def play(transcript, time_scale, over_socket):
        scales.append(time_scale)
        return player(transcript, time_scale=0.0, over_socket=over_socket)

    def pace(scale, **limits):
        paces.append(scale)
        return make_pace(0.0, **limits)

    monkeypatch.setattr(transcript_replay, "TranscriptPlayer", play)
    monkeypatch.setattr(serial_line, "Pace", pace)
    replay_transcript(read_transcript(FOLDER / "pr655.transcript"), speed=speed)
    assert scales == [expected]
    assert paces == [expected] if expected else 0 < paces[0] < 0.1
