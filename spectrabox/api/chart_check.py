"""How well the patches of a chart are predicted by calibrations that never saw them."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.calibrate import chart_findings
from spectrabox.measure import texts
from spectrabox.measure.results.calibration_facts import poor_patches
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.calibration import HeldOutPatches


@dataclass(frozen=True, eq=False)
class ChartCheck:
    """Each patch of a chart, its reflectance from its own signal and a fit without it.

    Attributes
    ----------
    names : tuple of I str
        Of the patches.
    patches : HeldOutPatches
        Spectra (I, P) at ``grid.nm``: the estimates ``mean`` with their band ``lower`` and
        ``upper``, and the ``reference``.
    findings : tuple of Finding
        Patches that are not what the others make of them by more than chance, and their cause.

    References
    ----------
    docs/explanation/calibration.md, "Patches left out".

    Examples
    --------
    >>> check = sb.fit_camera("mybox/photos/chart.dng", light="mybox/spectra/light.csv").chart_check
    >>> check.rmse, check.inside, check.expected
    >>> check.delta_e00[check.patches.counted].mean()
    >>> check.poor
    """

    names: tuple[str, ...]
    patches: HeldOutPatches
    findings: tuple[Finding, ...] = ()

    @property
    def rmse(self) -> np.ndarray:
        """Error (I,) of each patch's reflectance, root mean square over wavelengths."""
        return self.patches.rmse

    @property
    def delta_e00(self) -> np.ndarray:
        """CIEDE2000 (I,) between each patch's estimated spectrum and its reference, under D65."""
        return chart_findings.patch_differences(self.patches)

    @property
    def inside(self) -> np.ndarray:
        """Share (I,) of wavelengths at which the 95 % band holds the reference."""
        return self.patches.inside

    @property
    def expected(self) -> np.ndarray:
        """What ``inside`` (I,) would be if photo and calibration had not erred at all."""
        return self.patches.expected

    @property
    def means(self) -> tuple[float, float, float]:
        """Means of rmse, inside and expected; saturated patches do not count."""
        return self.patches.means

    @property
    def saturated(self) -> tuple[str, ...]:
        """Patches that are saturated and were left out."""
        return tuple(np.array(self.names)[~self.patches.judged].tolist())

    @property
    def poor(self) -> dict[str, str]:
        """Patches of which less than 85 % is inside, the worst first, with the likely reason."""
        return poor_patches(self.patches, self.names)

    @property
    def notes(self) -> tuple[str, ...]:
        """The findings in sentences."""
        return tuple(map(texts.says, self.findings))

    def __repr__(self) -> str:
        rmse, inside, expected = self.means
        counted = self.delta_e00[self.patches.counted]
        return (f"<ChartCheck of {len(self.names)} patches: error {rmse:.3f}, {inside:.1%} inside, "
                f"{expected:.1%} expected, CIEDE2000 {counted.mean():.1f} on average, "
                f"{np.percentile(counted, 90):.1f} at 90%>")
