"""The answer of ``spectrabox match``: which spectra of libraries could give a session's signals."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.measure.signals.matching import SpectralLibrary, SurfaceMatch, match_signal
from spectrabox.measure.surface_signals import measurement
from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.judge.spectral_library import read_spectral_libraries
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.session.commands.requests import MatchRequest
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import load_finished
from spectrabox.session.terminal.json_values import to_json
from spectrabox.session.terminal.tables import text_table

SHOWN, NAMED = 10, 3    # rows of a table, and sentences on spectra left out


def match_answer(request: MatchRequest) -> tuple[dict[str, Any], str]:
    """JSON object and text of ``spectrabox match``.

    Raises
    ------
    InputError
    """
    if not 0 <= request.variation <= 0.5:
        raise InputError(f"a variation of {request.variation:g} was given; 0 to 0.5 of white is "
                         "needed, such as 0.01")
    if request.ratio is not None and not 1 < request.ratio < np.inf:
        raise InputError(f"an evidence ratio of {request.ratio:g} was given; a number "
                         "above 1 is needed, such as 100")
    config = read_session(request.folder, request.allow_outside)
    signals = load_finished(config).records.signals
    unknown = [name for name, known in zip(signals.names, signals.known, strict=True) if not known]
    for name in request.only:
        if name not in unknown:
            raise InputError(f"{name!r} is no surface of unknown spectrum in this session; these "
                             f"are {', '.join(unknown) or 'none'}")
    chosen = request.only or tuple(unknown)
    if not chosen:
        raise InputError("every surface of this session has a known spectrum: there is nothing to "
                         "identify")
    library = read_spectral_libraries(request.library, signals.grid)
    facts: dict[str, Any] = {"matches": [], "indistinguishable": 0, "surfaces": []}
    texts = []
    for name in chosen:
        match = match_signal(name, measurement(signals, signals.names.index(name)), library,
                             of_families(load_prior(), config.surfaces[name].families),
                             variation=request.variation, evidence_ratio=request.ratio)
        facts["surfaces"].append(to_json(match))
        facts["matches"] += [{"surface": name, **to_json(each)} for each in match.matches]
        facts["indistinguishable"] += match.indistinguishable
        texts.append(_table(match))
    facts |= {"variation": request.variation, "spectra": len(library.names),
              "left_out": list(library.left_out)}
    return facts, "\n\n".join(texts + _left_out(library))


def _table(surface: SurfaceMatch) -> str:
    best = surface.matches[0].log_evidence
    rows = [(match.name, match.library, f"{np.exp(match.log_evidence - best):.2g}",
             f"{match.misfit:.1f}", f"{match.p_value:.2g}",
             "may be it" if match.indistinguishable else "") for match in surface.matches[:SHOWN]]
    lines = [text_table(("spectrum", "library", "evidence", "misfit", "by chance", ""), rows,
                        text=("spectrum", "library", ""), title=surface.surface), surface.says]
    hidden = surface.indistinguishable - sum(match.indistinguishable
                                             for match in surface.matches[:SHOWN])
    if hidden:
        lines.insert(1, f"and {hidden} more that may be it (--json lists all)")
    return "\n".join(lines)


def _left_out(library: SpectralLibrary) -> list[str]:
    sentences = [f"left out: {sentence}" for sentence in library.left_out[:NAMED]]
    if len(library.left_out) > NAMED:
        sentences.append(f"left out: {len(library.left_out) - NAMED} more (--json lists all)")
    return ["\n".join(sentences)] if sentences else []
