"""Every instrument x every fault of a serial line x several places: is a wrong spectrum ever
accepted?

A naive driver, which believes the first reading that parses, is the alternative in the same run:
each trial in which only the second reading or the instrument's own figures showed the fault is one
that it would have got wrong. Then every instrument x every way in which it can send a spectrum
other than the one it computed its figures from, time and again.

    python benchmarks/bench_fault_matrix.py [--places 8] [--json]
"""
from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from unittest import mock

from spectrabox.capture.meter import measurement
from spectrabox.capture.transcripts.transcript import read_transcript
from spectrabox.fixtures.meter_transcripts import (
    FOLDER,
    SPECTRUM_FAULTS,
    clean_meters,
    faulty_meters,
)

from benchmarks.transcript_trials import (
    DEADLINE_S,
    Subject,
    Trial,
    run_all,
    spectrum_trial,
    subject_of,
)


def subjects() -> list[Subject]:
    """The synthetic recordings with their truth."""
    return [subject_of(read_transcript(FOLDER / f"{meter.name}.transcript"), meter.values,
                       meter.change, meter.leave) for meter in clean_meters() if meter.values
            is not None]


def cell(trials: list[Trial]) -> str:
    """One cell of the table: spectra / errors, and what went wrong in words."""
    good = sum(trial.result == "spectrum" for trial in trials)
    marks = "".join(sign for sign, bad in (("W", any(t.wrong for t in trials)),
                                           ("L", not all(t.left for t in trials)),
                                           ("T", any(t.seconds > DEADLINE_S for t in trials)))
                    if bad)
    return f"{good}/{len(trials) - good}{marks}"


def table(trials: list[Trial]) -> str:
    """Faults down, instruments across; each cell counts right spectra / errors."""
    instruments = list(dict.fromkeys(trial.instrument for trial in trials))
    rows = [f"{'spectra/errors':<28}" + "".join(f"{name:>13}" for name in instruments)]
    for fault in dict.fromkeys(trial.fault for trial in trials):
        cells = [[t for t in trials if (t.fault, t.instrument) == (fault, name)]
                 for name in instruments]
        rows.append(f"{fault:<28}" + "".join(f"{cell(chosen):>13}" for chosen in cells))
    return "\n".join(rows)


def naive_run(places: int, workers: int) -> list[Trial]:
    """The same trials with the first parsed reading believed and no luminance check."""
    with mock.patch.object(measurement, "_read_twice", lambda instrument: instrument.read()), \
            mock.patch.object(measurement, "check_stated", lambda *spectrum_and_figures: None):
        return run_all(subjects(), places, workers)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--places", type=int, default=8,
                        help="places in the exchange for each fault")
    parser.add_argument("--workers", type=int, default=8, help="trials at a time; they mostly wait")
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    arguments = parser.parse_args()
    started = time.monotonic()
    trials = run_all(subjects(), arguments.places, arguments.workers)
    seconds = time.monotonic() - started
    naive = naive_run(arguments.places, arguments.workers)
    consistent = [spectrum_trial(meter, fault) for fault in SPECTRUM_FAULTS
                  for meter in faulty_meters(fault)]
    unseen = {(name, fault.name) for fault in SPECTRUM_FAULTS for name in fault.unseen_by}
    accepted = {(trial.instrument, trial.fault) for trial in consistent if trial.wrong}
    facts = {"trials": len(trials), "wrong_spectra": sum(trial.wrong for trial in trials),
             "not_given_back": sum(not trial.left for trial in trials),
             "past_deadline": sum(trial.seconds > DEADLINE_S for trial in trials),
             "longest_s": round(max(trial.seconds for trial in trials), 2),
             "right_spectra": sum(trial.result == "spectrum" and not trial.wrong
                                  for trial in trials),
             "naive_wrong_spectra": sum(trial.wrong for trial in naive),
             "naive_right_spectra": sum(trial.result == "spectrum" and not trial.wrong
                                        for trial in naive),
             "errors": dict(Counter(trial.result for trial in trials if trial.result
                                    != "spectrum")),
             "consistent_faults": len(consistent),
             "consistent_faults_that_replies_show": len(consistent) - len(unseen),
             "wrong_spectra_of_those": len(accepted - unseen),
             "wrong_spectra_that_no_reply_shows": len(accepted & unseen),
             "seconds": round(seconds, 1)}
    if arguments.json:
        print(json.dumps({**facts, "matrix": [vars(trial) for trial in trials]}))
    else:
        print(table(trials))
        print(table(consistent))
        print("W wrong spectrum accepted   L instrument not given back   T past its deadline\n")
        print("\n".join(f"{key:<36} {value}" for key, value in facts.items()))
    return int(bool(facts["wrong_spectra"] or accepted - unseen or facts["not_given_back"]
                    or facts["past_deadline"]))


if __name__ == "__main__":
    sys.exit(main())
