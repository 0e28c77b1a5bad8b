"""Which measured spectra of a library could give a signal, and what that says of the surface."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spectrabox.measure import texts
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling.evaluation import identification
from spectrabox.sampling.evaluation.identification import SpectralLibrary
from spectrabox.sampling.prior.mixture import LogitMixture
from spectrabox.sampling.spectral_measurement import without_states

LIKELY_NONE = 0.95      # probability from which another surface is called more likely
MAX_VARIATION = 0.5     # of white
MATCH = ("name", "library", "log_evidence", "misfit", "p_value", "indistinguishable")
HEADINGS = ("spectrum", "library", "evidence", "misfit", "by chance", "")


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceMatch:
    """A surface's signal against n spectra, the most evident first."""

    surface: str
    names: tuple[str, ...]
    libraries: tuple[str, ...]          # that each is of
    log_evidence: np.ndarray            # (n,) nats
    misfit: np.ndarray                  # (n,) Mahalanobis distance, in standard errors
    p_value: np.ndarray                 # (n,) of a misfit at least as large, by chance
    may_be: np.ndarray                  # (n,) bool: not rejected, and near the best
    evidence_ratio: float
    log_evidence_of_none: float
    probability_of_none: float
    findings: tuple[Finding, ...]

    @property
    def indistinguishable(self) -> int:
        """How many cannot be told apart."""
        return int(self.may_be.sum())

    @property
    def none_fits(self) -> bool:
        """Whether the surface is none of them."""
        return not self.may_be.any()

    @property
    def says(self) -> str:
        """What the match says of the surface, and what was not stated of its signal."""
        return "\n".join(map(texts.says, self.findings))

    def facts(self) -> dict[str, Any]:
        """As ``spectrabox match --json`` names them."""
        rows = zip(self.names, self.libraries, self.log_evidence.tolist(), self.misfit.tolist(),
                   self.p_value.tolist(), self.may_be.tolist(), strict=True)
        return {"surface": self.surface,
                "matches": [dict(zip(MATCH, row, strict=True)) for row in rows],
                "indistinguishable": self.indistinguishable, "evidence_ratio": self.evidence_ratio,
                "log_evidence_of_none": self.log_evidence_of_none,
                "probability_of_none": self.probability_of_none, "none_fits": self.none_fits,
                "findings": [texts.facts(one) for one in self.findings], "says": self.says}

    def rows(self, most: int) -> list[tuple[str, ...]]:
        """The best matches as words of a table, under HEADINGS; the evidence is over the best's."""
        ratio = np.exp(self.log_evidence - self.log_evidence[0])
        return [(self.names[row], self.libraries[row], f"{ratio[row]:.2g}",
                 f"{self.misfit[row]:.1f}", f"{self.p_value[row]:.2g}",
                 "may be it" if self.may_be[row] else "")
                for row in range(min(most, len(self.names)))]

    def __repr__(self) -> str:
        return f"<SurfaceMatch {self.surface!r}: {self.says}>"


def facts_of_matches(surfaces: Sequence[SurfaceMatch], library: SpectralLibrary,
                     variation: float) -> dict[str, object]:
    """Matches of several surfaces with one library, as ``spectrabox match --json`` names them."""
    facts = [one.facts() for one in surfaces]
    return {"matches": [{"surface": one["surface"], **match}
                        for one in facts for match in one["matches"]],
            "indistinguishable": sum(one.indistinguishable for one in surfaces),
            "surfaces": facts, "variation": variation,
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
    prior : LogitMixture
        What else the surface may be.
    variation : float
        Standard deviation between samples of one material, of white.
    evidence_ratio : float, optional
        How much less evident than the best a spectrum may be and still not be told apart from it,
        above 1; ``usual_ratio`` by default.

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
    measurement = without_states(measurement)
    log_evidence, misfit, p_value = identification.evidence(measurement, library, variation)
    ratio = identification.usual_ratio(len(measurement.signal)) \
        if evidence_ratio is None else evidence_ratio
    allowed = p_value >= identification.REJECTED
    near = np.max(log_evidence, where=allowed, initial=-np.inf) - np.log(ratio)
    may_be = allowed & (log_evidence >= near)
    of_none, probability = identification.evidence_of_none(measurement, log_evidence, prior)
    fits = np.flatnonzero(may_be)
    nearest = int(fits[0] if fits.size == 1 else misfit.argmin())
    code = ("match.none" if not fits.size else
            "match.another-likelier" if probability > LIKELY_NONE else
            "match.one" if fits.size == 1 else "match.several")
    matched = Finding(code, Severity.INFO, values={
        "spectra": len(misfit), "fits": fits.size, "nearest": library.names[nearest],
        "misfit": float(misfit[nearest]), "probability": probability})
    order = np.argsort(-log_evidence, kind="stable")
    return SurfaceMatch(surface, tuple(library.names[row] for row in order),
                        tuple(library.libraries[row] for row in order), log_evidence[order],
                        misfit[order], p_value[order], may_be[order], ratio, of_none, probability,
                        (matched,))
