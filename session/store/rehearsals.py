"""The last rehearsal of a session: kept among its results, and what it says."""
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from spectrabox.radiometry.files import write_text_whole
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.store.store import fingerprint, load_stage

TOLERATED = 0.02         # of coverage: less is not worth a warning
FILE = "rehearsal.json"


def rehearsal_text(answers: dict[str, Any]) -> str:
    """The facts for a person."""
    level = answers["level"]
    lines = [f"{answers['times']} rehearsals with known truths; {level:.0%} of wavelengths should "
             "lie inside the bands",
             f"{'material':<16} {'band holds':>18} {'RMSE':>8} {'width':>8}   truths by rank"]
    for each in answers["materials"]:
        share = f"{each['coverage']:.1%} +- {each['coverage_standard_error']:.1%}"
        ranks = " ".join(f"{count:d}" for count in each["ranks"])
        lines.append(f"{each['name']:<16} {share:>18} {each['rmse']:>8.3f} {each['width']:>8.3f}   "
                     f"{ranks}")
    return "\n".join([*lines, verdict_sentence(answers)])


def verdict_sentence(answers: dict[str, Any]) -> str:
    """Whether bands hold as stated, by the worst material."""
    level = answers["level"]
    worst = min(answers["materials"], key=lambda each: float(each["coverage"]))
    said = (f"rehearsed {answers['times']} times with known truths, the {level:.0%} band of the "
            f"worst material ({worst['name']}) holds {worst['coverage']:.1%}")
    return said + (": too narrow for this session" if too_narrow(answers) else ": as stated")


def too_narrow(answers: dict[str, Any]) -> bool:
    """Whether some material's bands hold less than they state, beyond two standard errors and
    two percent.
    """
    return any(each["coverage"] + 2 * each["coverage_standard_error"]
               < answers["level"] - TOLERATED for each in answers["materials"])


def save_rehearsal(config: SessionConfig, answers: dict[str, Any]) -> Path:
    """Keep the facts among the results, with what they are of."""
    path = config.results_folder / FILE
    write_text_whole(path, json.dumps(answers | {"of": _what(config)}, indent=1))
    return path


def stored_rehearsal(config: SessionConfig) -> dict[str, Any] | None:
    """Facts of the last rehearsal of these results; None where there is none, or of others."""
    try:
        answers = json.loads((config.results_folder / FILE).read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None
    fresh = isinstance(answers, dict) and answers.get("of") == _what(config)
    return answers if fresh else None


def _what(config: SessionConfig) -> str:
    stored = load_stage(config.results_folder, "sample")
    return "" if stored is None else fingerprint(stored.key)
