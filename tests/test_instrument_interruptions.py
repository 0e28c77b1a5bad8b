"""However a measurement is broken off, the instrument has its own settings back."""
import os
import signal

import pytest

from spectrabox.capture.meter.measurement import open_instrument, trusted_identity
from spectrabox.capture.meter.serial_line import Pace
from spectrabox.capture.transcripts.player import TranscriptPlayer, settings_of
from spectrabox.fixtures.line_faults import Fault, FaultKind, distortion
from spectrabox.fixtures.meter_transcripts import changed_meters
from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.session.terminal.progress_display import SIGNALS, held, stop_on_signals

from tests.interrupted_instruments import conversation, interruptions, run, settings_left


@pytest.fixture(autouse=True)
def as_a_command_hears_signals():
    before = {number: signal.getsignal(number) for number in SIGNALS}
    stop_on_signals()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


METERS = {meter.driver: meter for meter in changed_meters()}
# Typed to character by character, a PR-655 has the most points at which a command can be cut.
POINTS = {"pr655": 16, "pr650": 4, "specbos1211": 4}
FAST = Pace(0.002, shortest_limit_s=0.2)


@pytest.mark.parametrize("name", METERS)
def test_an_instrument_interrupted_anywhere_is_left_as_it_was_found(name):
    trials = interruptions(METERS[name], POINTS.get(name, 7))
    # how often a port is read hangs on the computer: a late point may not be reached
    assert sum(trial.interrupted for trial in trials) > len(trials) / 2
    assert not [trial for trial in trials if not trial.left]


def test_the_settings_that_an_interruption_could_leave_are_seen_by_these_tests():
    changed = [b"PHOTO", b"SU1\r", b"SE00250\r", b"SU0\r", b"Q"]
    assert settings_left("pr655", changed) == {"remote": b"0", "SU": b"0", "SE": b"00250"}
    _, as_found, uses = run(METERS["cr250"], 0, signal.SIGINT)
    assert as_found == {"ExposureX": b"1", "ExposureMode": b"0", "Exposure": b"111.622",
                        "SyncMode": b"0", "SyncFreq": b"60"} and uses > 50


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_waits_for_the_end_of_a_command_and_comes_once(number):
    seen = []
    with pytest.raises(KeyboardInterrupt), held():
        with held():
            signal.raise_signal(number)
            signal.raise_signal(number)     # an impatient operator
            seen.append("inner")
        seen.append("outer")
    assert seen == ["inner", "outer"]
    with held():
        seen.append("again")
    assert seen[-1] == "again"


def opened(name, player, log=lambda direction, data: None):
    """As the command opens it."""
    return open_instrument(name, player.port, log, FAST, held)


@pytest.mark.parametrize("name", ["cs2000", "cr250", "pr655", "specbos2501"])
def test_a_full_disk_under_the_transcript_keeps_no_settings(name):
    transcript = conversation(METERS[name])
    full = []

    def log(direction, data):
        if full:
            raise EnvironmentProblem("no space")
    with TranscriptPlayer(transcript, time_scale=0.0, strict=False) as player, \
            pytest.raises(EnvironmentProblem), opened(name, player, log) as meter:
        trusted_identity(meter)
        meter.settings(settings_of(transcript))
        full.append(True)
        meter.measure()
    _, as_found, _ = run(METERS[name], 0, signal.SIGINT)
    assert settings_left(name, player.obeyed) == as_found


@pytest.mark.parametrize("kind", [FaultKind.DROP, FaultKind.NOISE])
@pytest.mark.parametrize("name", ["cs2000", "cr250", "pr655", "specbos2501"])
def test_what_was_not_confirmed_is_tried_again(name, kind):
    transcript = conversation(METERS[name])
    last = [step for step, event in enumerate(transcript.events) if event.direction == "<"
            and transcript.events[step - 1].data == METERS[name].leave]
    if name == "pr655":     # nothing answers its Q; SU0 is the last that is answered
        last = [step for step, event in enumerate(transcript.events) if event.direction == "<"
                and transcript.events[step - 1].data == b"SU0\r"]
    with TranscriptPlayer(transcript, time_scale=0.0, strict=False,
                          distort=distortion(Fault(kind, last[0]))) as player:
        with opened(name, player) as meter:
            trusted_identity(meter)
            meter.settings(settings_of(transcript))
        assert meter.restore == []
    command = transcript.events[last[0] - 1].data
    assert player.obeyed.count(command) == 2


def test_settings_that_nobody_confirms_are_named_and_were_still_sent_once():
    transcript = conversation(METERS["cr250"])
    with TranscriptPlayer(transcript, time_scale=0.0, strict=False) as player:
        with opened("cr250", player) as meter:
            trusted_identity(meter)
            meter.settings(settings_of(transcript))
            player.mute = True
        assert len(meter.restore) == 5 and b"SM ExposureX 1\r" in meter.restore
    assert settings_left("cr250", player.obeyed)["ExposureX"] == b"1"


def test_a_pulled_cable_names_all_that_was_not_put_back():
    transcript = conversation(METERS["cr250"])
    with TranscriptPlayer(transcript, time_scale=0.0, strict=False) as player, \
            opened("cr250", player) as meter:
        trusted_identity(meter)
        meter.settings(settings_of(transcript))
        player.unplug()
    assert len(meter.restore) == 5


def test_a_pr650_is_reset_on_leaving_as_it_has_no_other_way_back(monkeypatch):
    pulses = []
    transcript = conversation(METERS["pr650"])
    with TranscriptPlayer(transcript, time_scale=0.0, strict=False) as player, \
            opened("pr650", player) as meter:
        monkeypatch.setattr(meter.line, "pulse_rts", pulses.append)
        trusted_identity(meter)
        meter.settings(settings_of(transcript))
        pulses.clear()
    # RTS low for more than 50 ms resets it
    assert len(pulses) == 1 and pulses[0] > 0.05


def test_a_process_asked_to_end_is_not_killed_while_an_instrument_is_open():
    transcript = conversation(METERS["cs2000"])
    with TranscriptPlayer(transcript, time_scale=0.0, strict=False) as player, \
            pytest.raises(KeyboardInterrupt), opened("cs2000", player) as meter:
        trusted_identity(meter)
        os.kill(os.getpid(), signal.SIGTERM)
        meter.identify()
    assert settings_left("cs2000", player.obeyed) == {"RMTS": b"0", "MSWE": b"1"}
