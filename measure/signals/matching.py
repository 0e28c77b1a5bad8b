"""Which measured spectra of a library could give a signal, and what that says of the surface."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from spectrabox.measure import texts
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling.evaluation.identification import (
    SpectralLibrary,
    SpectrumMatch,
    identify,
)
from spectrabox.sampling.prior.mixture import LogitMixture
from spectrabox.sampling.spectral_measurement import without_states

LIKELY_NONE = 0.95      # probability from which another surface is called more likely
MAX_VARIATION = 0.5     # of white
HEADINGS = ("spectrum", "library", "evidence", "misfit", "by chance", "")


@dataclass(frozen=True, repr=False)
class SurfaceMatch:
    """Matches of a surface's signal, the best first; fields are named as in ``--json``."""

    surface: str
    matches: list[SpectrumMatch]
    indistinguishable: int      # how many cannot be told apart
    evidence_ratio: float
    log_evidence_of_none: float
    probability_of_none: float
    none_fits: bool
    findings: tuple[Finding, ...]

    @property
    def says(self) -> str:
        """What the match says of the surface, and what was not stated of its signal."""
        return "\n".join(map(texts.says, self.findings))

    def facts(self) -> dict[str, Any]:
        """As ``spectrabox match --json`` names them."""
        return {**vars(self), "says": self.says,
                "findings": [texts.facts(one) for one in self.findings]}

    def rows(self, most: int) -> list[tuple[str, ...]]:
        """The best matches as words of a table, under HEADINGS; the evidence is over the best's."""
        best = self.matches[0].log_evidence
        return [(match.name, match.library, f"{np.exp(match.log_evidence - best):.2g}",
                 f"{match.misfit:.1f}", f"{match.p_value:.2g}",
                 "may be it" if match.indistinguishable else "") for match in self.matches[:most]]

    def __repr__(self) -> str:
        return f"<SurfaceMatch {self.surface!r}: {self.says}>"


def facts_of_matches(surfaces: Sequence[SurfaceMatch], library: SpectralLibrary,
                     variation: float) -> dict[str, object]:
    """Matches of several surfaces with one library, as ``spectrabox match --json`` names them."""
    return {"matches": [{"surface": one.surface, **asdict(match)}
                        for one in surfaces for match in one.matches],
            "indistinguishable": sum(one.indistinguishable for one in surfaces),
            "surfaces": [one.facts() for one in surfaces], "variation": variation,
            "spectra": len(library.names), "left_out": library.left_out}


def match_signal(surface: str, measurement: SpectralMeasurement, library: SpectralLibrary,
                 prior: LogitMixture, *, variation: float,
                 evidence_ratio: float | None = None) -> SurfaceMatch:
    """Compare every spectrum of a library with one signal.

    Parameters
    ----------
    surface : str
        Its name, for the answer.
    measurement : SpectralMeasurement
    library : SpectralLibrary
        On the measurement's wavelengths.
    prior, variation, evidence_ratio
        As in `sampling.evaluation.identification.identify`.

    Raises
    ------
    InputError
        For a variation or a ratio that cannot be.
    """
    if not 0 <= variation <= MAX_VARIATION:
        raise InputError(f"a variation of {variation:g} was given; 0 to {MAX_VARIATION:g} of white "
                         "is needed, such as 0.01")
    if evidence_ratio is not None and not 1 < evidence_ratio < np.inf:
        raise InputError(f"an evidence ratio of {evidence_ratio:g} was given; a number above 1 is "
                         "needed, such as 100")
    matches, ratio, log_evidence_of_none, probability = identify(
        without_states(measurement), library, prior, variation=variation,
        evidence_ratio=evidence_ratio)
    count = sum(match.indistinguishable for match in matches)
    return SurfaceMatch(surface, sorted(matches, key=lambda match: -match.log_evidence), count,
                        ratio, log_evidence_of_none, probability, not count,
                        (matched(matches, probability),))


def matched(matches: Sequence[SpectrumMatch], probability_of_none: float) -> Finding:
    """What the matches of a library say of the surface."""
    fits = [match for match in matches if match.indistinguishable]
    nearest = fits[0] if len(fits) == 1 else min(matches, key=lambda match: match.misfit)
    code = ("match.none" if not fits else
            "match.another-likelier" if probability_of_none > LIKELY_NONE else
            "match.one" if len(fits) == 1 else "match.several")
    return Finding(code, Severity.INFO, values={
        "spectra": len(matches), "fits": len(fits), "nearest": nearest.name,
        "misfit": nearest.misfit, "probability": probability_of_none})
