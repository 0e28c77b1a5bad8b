"""Every instrument against every fault of a line: no wrong spectrum is accepted, and the instrument
is given back.
"""
from concurrent.futures import ThreadPoolExecutor

import pytest

from spectrabox.capture.transcripts.transcript import read_transcript
from spectrabox.fixtures.line_faults import Fault, FaultKind
from spectrabox.fixtures.meter_transcripts import FOLDER, clean_meters

from tests.transcript_trials import (
    DEADLINE_S,
    TOO_FAST,
    WRONG_SPEED,
    run_all,
    run_trial,
    subject_of,
)

PLACES = 3                  # of each fault in a recording
METERS = [meter.name for meter in clean_meters()]
FAULTS = [kind.value for kind in FaultKind] + [WRONG_SPEED, TOO_FAST]


@pytest.fixture(scope="module")
def subjects():
    return [subject_of(read_transcript(FOLDER / f"{meter.name}.transcript"), meter.values,
                       meter.change, meter.leave) for meter in clean_meters()]


@pytest.fixture(scope="module")
def matrix(subjects):
    return run_all(subjects, PLACES, workers=8)


def test_the_matrix_covers_every_instrument_and_fault(matrix):
    tried = {(trial.instrument, trial.fault) for trial in matrix}
    assert tried == {(name, fault) for name in METERS for fault in FAULTS}
    assert len(matrix) >= 300


@pytest.mark.parametrize("fault", FAULTS)
def test_no_wrong_reading_is_ever_accepted(matrix, fault):
    assert not [trial for trial in matrix if trial.fault == fault and trial.wrong]


@pytest.mark.parametrize("name", METERS)
def test_the_instrument_is_given_back_after_every_fault_that_leaves_the_line_alive(matrix, name):
    assert not [trial for trial in matrix if trial.instrument == name and not trial.left]


def test_every_trial_ends_within_its_deadline(matrix):
    assert not [trial for trial in matrix if trial.seconds > DEADLINE_S]


def test_every_error_is_a_sentence_that_says_what_to_do(matrix):
    for trial in matrix:
        assert len(trial.sentence) > 30 or trial.result == "spectrum"


def test_a_line_that_always_fails_ends_in_an_error_and_a_free_instrument(subjects):
    kinds = [FaultKind.NOISE, FaultKind.ZERO_BYTE, FaultKind.TRUNCATE, FaultKind.DROP,
             FaultKind.DUPLICATE, FaultKind.ECHO_BEFORE]
    cases = [(subject, kind.value, Fault(kind, step, 0.6, every=True)) for subject in subjects
             for kind in kinds
             for step in (0, 20)]
    with ThreadPoolExecutor(8) as pool:
        trials = list(pool.map(lambda case: run_trial(*case), cases))
    assert not [trial for trial in trials if trial.wrong or not trial.left or trial.seconds
                > DEADLINE_S]
    # A doubled last reply comes after all that is needed: the PR-650's spectrum is right. All
    # others are refused.
    assert {(t.instrument, t.fault) for t in trials
            if t.result == "spectrum"} <= {("pr650", "duplicate")}


@pytest.mark.parametrize("fault", [FaultKind.STALL.value, FaultKind.DRIBBLE.value])
def test_a_slow_line_is_waited_for(matrix, fault):
    # A computer that is itself too busy to serve the line within 0.25 s may fail a trial: one in
    # six may.
    chosen = [trial.result for trial in matrix if trial.fault == fault]
    assert chosen.count("spectrum") >= 5 * len(chosen) / 6


def test_a_fault_in_a_held_result_is_repaired_by_reading_again(matrix):
    repaired = [trial for trial in matrix if trial.fault == FaultKind.CHANGE_DIGIT.value
                and trial.result == "spectrum"]
    assert len(repaired) >= 3
