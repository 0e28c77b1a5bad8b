"""What 95 % bands held of each family of surfaces while it was left out of the training.

Training makes the table (calibration.py) and it is kept with the prior, so that whoever shows a
band can say how far the surfaces at hand have been tested: on measured libraries, on reflectances
that theory made, or not at all.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spectrabox.radiometry.findings import Finding, Severity

CERTIFIED = 0.93        # of wavelengths within the 95 % band
MENTIONED = 0.05        # share from which a family that nobody stated is named
MOSTLY = 0.5            # share of families in doubt from which the terminal names them


@dataclass(frozen=True)
class FamilyCertificate:
    """How a family was judged, where it was stated and where it was not.

    Of 95 % bands there, ``coverage`` is the share of wavelengths that they held, of the part that
    was held least, and ``width`` the mean over parts.
    """

    measured: bool          # on measured libraries; if not, on what its models make
    parts: int              # libraries or models that were left out in turn; 0 if none was
    curves: int
    stated: Mapping[str, float]
    unstated: Mapping[str, float]


@dataclass(frozen=True)
class FamilyCoverage:
    """A family that a signal allows, and how its bands were certified, if they were."""

    name: str
    share: float                            # 0 to 1
    stated: bool
    certificate: FamilyCertificate | None

    @property
    def bands(self) -> Mapping[str, float | None]:
        """The figures that apply: with the family stated, or with none."""
        if self.certificate is None:
            return {"coverage": None, "width": None}
        return self.certificate.stated if self.stated else self.certificate.unstated

    @property
    def in_doubt(self) -> bool:
        """Whether the family was certified on theory alone, held too seldom, or not judged."""
        coverage = self.bands["coverage"]
        return (self.certificate is None or coverage is None or not self.certificate.measured
                or coverage < CERTIFIED)

    @property
    def tested_on(self) -> str | None:
        """"libraries" that were measured, "models", its "own-model"; None where it was not."""
        if self.certificate is None:
            return None
        return "libraries" if self.certificate.measured else \
            "models" if self.certificate.parts else "own-model"


def family_coverages(shares: Mapping[str, float], stated: Sequence[str],
              certificates: Mapping[str, FamilyCertificate]) -> tuple[FamilyCoverage, ...]:
    """The families that were stated, else those that a signal gives a share of 5 % or more.

    Parameters
    ----------
    shares : by family
        That the signal allows, 0 to 1.
    stated : names of families
    certificates : by family

    Returns
    -------
    tuple of FamilyCoverage
        The largest share first.
    """
    named = stated or [name for name in shares if shares[name] >= MENTIONED]
    return tuple(FamilyCoverage(name, shares.get(name, 0.0), bool(stated), certificates.get(name))
                 for name in sorted(named, key=lambda name: -shares.get(name, 0.0)))


def coverage_facts(families: Sequence[FamilyCoverage]) -> list[dict[str, Any]]:
    """Families and what 95 % bands of each held when it was judged, for JSON; None where it was
    not.

    Parameters
    ----------
    families : sequence of FamilyCoverage
    """
    return [{"name": one.name, "share": one.share, "stated": one.stated,
             "measured": one.certificate is not None and one.certificate.measured,
             **one.bands} for one in families]


def certified(families: Sequence[FamilyCoverage]) -> list[Finding]:
    """What the 95 % bands of these families held when they were judged, each once.

    Parameters
    ----------
    families : sequence of FamilyCoverage
    """
    rows = [{"name": one.name, "on": one.tested_on, **one.bands} for one in families]
    different = [row for index, row in enumerate(rows) if row not in rows[:index]]
    return [Finding("families.tested", Severity.INFO, values={"families": different})] \
        if different else []


def mostly_in_doubt(families: Sequence[FamilyCoverage]) -> bool:
    """Whether most of what a signal may be was not certified on measured surfaces.

    Parameters
    ----------
    families : sequence of FamilyCoverage
    """
    return sum(family.share for family in families if family.in_doubt) >= MOSTLY
