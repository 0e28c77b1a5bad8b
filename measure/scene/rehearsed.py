"""What a rehearsal says of a scene's bands: coverage of known truths, by material."""
from __future__ import annotations

from dataclasses import dataclass

TOLERATED = 0.02         # of coverage: less is not worth a warning


@dataclass(frozen=True)
class RehearsedMaterial:
    """One material over all rehearsals."""

    name: str
    coverage: float                     # mean share of wavelengths inside the band
    coverage_standard_error: float
    rmse: float                         # mean
    width: float                        # mean, of the band
    ranks: tuple[int, ...]              # counts of the truth's rank among the draws


@dataclass(frozen=True)
class Rehearsed:
    """Rehearsals of one session with known truths."""

    level: float                        # of the bands
    seed: int
    times: int
    materials: tuple[RehearsedMaterial, ...]

    @property
    def worst(self) -> RehearsedMaterial:
        """The material whose bands hold least."""
        return min(self.materials, key=lambda each: each.coverage)

    @property
    def too_narrow(self) -> bool:
        """Whether some material's bands hold less than they state, beyond two standard errors and
        two percent.
        """
        return any(each.coverage + 2 * each.coverage_standard_error < self.level - TOLERATED
                   for each in self.materials)

    @property
    def sentence(self) -> str:
        """Whether bands hold as stated, by the worst material."""
        said = (f"rehearsed {self.times} times with known truths, the {self.level:.0%} band of the "
                f"worst material ({self.worst.name}) holds {self.worst.coverage:.1%}")
        return said + (": too narrow for this session" if self.too_narrow else ": as stated")

    @property
    def text(self) -> str:
        """A table for a person."""
        lines = [f"{self.times} rehearsals with known truths; {self.level:.0%} of wavelengths "
                 "should lie inside the bands",
                 f"{'material':<16} {'band holds':>18} {'RMSE':>8} {'width':>8}   truths by rank"]
        for each in self.materials:
            share = f"{each.coverage:.1%} +- {each.coverage_standard_error:.1%}"
            ranks = " ".join(f"{count:d}" for count in each.ranks)
            lines.append(f"{each.name:<16} {share:>18} {each.rmse:>8.3f} {each.width:>8.3f}   "
                         f"{ranks}")
        return "\n".join([*lines, self.sentence])
