"""What ``spectrabox match`` answers: which spectra of libraries could give a session's signals."""
from __future__ import annotations

import io
from typing import Any

import numpy as np

from spectrabox.measure.surface_signals import measurement
from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.judge.identification import Identification, identify
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.session.commands.requests import MatchRequest
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import load_finished
from spectrabox.session.signals.spectral_library import SpectralLibrary, read_spectral_libraries
from spectrabox.session.stages.surface_signals import surface_signals

SHOWN, NAMED = 10, 3    # rows of a table, and sentences on spectra left out
LIKELY_NONE = 0.95      # probability from which another surface is called more likely


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
    signals = surface_signals(config, load_finished(config).stored)
    unknown = [name for name, known in zip(signals.names, signals.known, strict=True) if not known]
    for name in request.surface:
        if name not in unknown:
            raise InputError(f"{name!r} is no surface of unknown spectrum in this session; these "
                             f"are {', '.join(unknown) or 'none'}")
    chosen = request.surface or tuple(unknown)
    if not chosen:
        raise InputError("every surface of this session has a known spectrum: there is nothing to "
                         "identify")
    library = read_spectral_libraries(request.library, signals.grid)
    facts: dict[str, Any] = {"matches": [], "indistinguishable": 0, "surfaces": []}
    texts = []
    for name in chosen:
        prior = of_families(load_prior(), config.surfaces[name].families)
        found = identify(measurement(signals, signals.names.index(name)), library.spectra, prior,
                         standard_error=library.standard_error, variation=request.variation,
                         evidence_ratio=request.ratio)
        surface = _surface(name, found, library)
        facts["surfaces"].append(surface)
        facts["matches"] += [{"surface": name, **match} for match in surface["matches"]]
        facts["indistinguishable"] += surface["indistinguishable"]
        texts.append(_table(surface))
    facts |= {"variation": request.variation, "spectra": len(library.names),
              "left_out": list(library.left_out)}
    return facts, "\n\n".join(texts + _left_out(library))


def _surface(name: str, found: Identification, library: SpectralLibrary) -> dict[str, Any]:
    matches = [{"name": library.names[index], "library": library.libraries[index],
                "log_evidence": float(found.log_evidence[index]),
                "misfit": float(found.misfit[index]), "p_value": float(found.p_value[index]),
                "indistinguishable": bool(found.indistinguishable[index])}
               for index in np.argsort(-found.log_evidence, kind="stable")]
    return {"surface": name, "matches": matches,
            "indistinguishable": int(found.indistinguishable.sum()),
            "evidence_ratio": found.evidence_ratio,
            "log_evidence_of_none": found.log_evidence_of_none,
            "probability_of_none": found.probability_of_none,
            "none_fits": not found.indistinguishable.any(), "says": _sentence(found, library)}


def _sentence(found: Identification, library: SpectralLibrary) -> str:
    count, best = int(found.indistinguishable.sum()), int(np.argmin(found.misfit))
    if not count:
        return (f"none of {len(library.names)} spectra fits: the nearest, {library.names[best]}, "
                f"misses the signal by {found.misfit[best]:.1f} standard errors; it is another "
                "material, a mixture, or varies more than was said (--variation)")
    if found.probability_of_none > LIKELY_NONE:
        return (f"{count} of {len(library.names)} spectra would pass, but another surface is more "
                f"likely (probability {found.probability_of_none:.3f} at even odds)")
    if count == 1:
        alone = library.names[int(np.argmax(found.indistinguishable))]
        return f"of {len(library.names)} spectra only {alone} gives this signal"
    return (f"{count} of {len(library.names)} spectra give this signal and cannot be told apart: a "
            "photo under another light may part them (spectrabox plan)")


def _table(surface: dict[str, Any]) -> str:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=surface["surface"], title_justify="left", title_style="bold")
    for heading in ("spectrum", "library", "evidence", "misfit", "by chance", ""):
        table.add_column(heading, justify="right" if heading in ("evidence", "misfit",
                                                                 "by chance") else "left")
    best = surface["matches"][0]["log_evidence"]
    for match in surface["matches"][:SHOWN]:
        table.add_row(match["name"], match["library"],
                      f"{np.exp(match['log_evidence'] - best):.2g}", f"{match['misfit']:.1f}",
                      f"{match['p_value']:.2g}",
                      "may be it" if match["indistinguishable"] else "")
    stream = io.StringIO()
    Console(file=stream, width=110).print(table)
    lines = [stream.getvalue().rstrip(), surface["says"]]
    hidden = surface["indistinguishable"] - sum(match["indistinguishable"]
                                                for match in surface["matches"][:SHOWN])
    if hidden:
        lines.insert(1, f"and {hidden} more that may be it (--json lists all)")
    return "\n".join(lines)


def _left_out(library: SpectralLibrary) -> list[str]:
    sentences = [f"left out: {sentence}" for sentence in library.left_out[:NAMED]]
    if len(library.left_out) > NAMED:
        sentences.append(f"left out: {len(library.left_out) - NAMED} more (--json lists all)")
    return ["\n".join(sentences)] if sentences else []
