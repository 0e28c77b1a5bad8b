"""What left-out patches of a chart and the light it tells are said to be, in numbers and words."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from spectrabox.radiometry.appearance import ciede2000, reflectance_to_lab
from spectrabox.radiometry.chart import COPIES_BEFORE_2014, COPIES_SINCE_2014
from spectrabox.radiometry.records.calibration import (
    Calibration,
    ChartCopy,
    HeldOutPatches,
    LightPosterior,
)

TWO_SIGMA = 2.0
CHANCE = 0.05           # of naming any patch of a chart of which nothing is wrong
POOR = 0.85             # of a patch's band: below it a reason is given
DARK = 0.12             # mean reflectance below which glare may be what changes a patch's level
LARGE_DEPARTURE = 0.03  # of a patch from copies of its edition, that matters
NEAR = 1.0              # standard errors: a level that is nearer explains nothing
CURVE_DECIMALS = 5      # of reflectances among plain numbers
SINCE, BEFORE = "since November 2014", "before November 2014"      # when a ColorChecker was made
# Nats from which an edition is told: beyond it 95 of 100 simulated charts are of the edition named,
# and beyond more no larger a share (benchmarks/bench_editions.py).
TOLD = 2.0


@dataclass(frozen=True)
class DifferenceSummary:
    """CIEDE2000 over several patches."""

    mean: float
    median: float
    percentile_90: float
    largest: float


def patch_differences(patches: HeldOutPatches) -> np.ndarray:
    """CIEDE2000 (I,) between the estimated spectrum of each patch and its reference, under D65.

    Parameters
    ----------
    patches : HeldOutPatches
    """
    return ciede2000(*(reflectance_to_lab(patches.grid.nm, one)
                       for one in (patches.mean, patches.reference)))


def difference_summary(patches: HeldOutPatches) -> DifferenceSummary:
    """Their mean, median, 90th percentile and maximum over the patches that are judged.

    Parameters
    ----------
    patches : HeldOutPatches
    """
    each = patch_differences(patches)[patches.judged]
    return DifferenceSummary(float(each.mean()), float(np.median(each)),
                             float(np.percentile(each, 90)), float(each.max()))


def chart_level_notes(patches: HeldOutPatches, names: Sequence[str]) -> tuple[str, ...]:
    """Patches that are darker or brighter in all bands than the other patches make them, by more
    than chance: at most once in 20 charts is one named of which nothing is wrong. Those that were
    kept out of the fit are not named.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str
    """
    named = np.flatnonzero(_beyond_chance(patches) & ~patches.excluded.astype(bool)).tolist()
    if not named:
        return ()
    each = "; ".join(f"{names[patch]} {_reason(patches, patch)}" for patch in named)
    return (f"{each}; photograph the chart again without, or leave these patches out "
            "(chart.leave_out)",)


def chart_copy_notes(copy: ChartCopy, names: Sequence[str],
                     light: str = "") -> tuple[str, ...]:
    """Patches that are lighter, darker or of another tint than in copies of the chart's edition, by
    more than chance and by enough to matter.

    Parameters
    ----------
    copy : ChartCopy
    names : sequence of I str
    light : str
        As of ``chart_at_fault``.
    """
    said, white = [], int(copy.reflectances.mean(axis=1).argmax())
    for size, error, words in (
            (copy.level, copy.level_error, ("low", "high")),
            (copy.tint, copy.tint_error, ("low in the blue against the red (yellower)",
                                          "high in the blue against the red (bluer)"))):
        # white is looked at for itself; of the others the worst of all is named only beyond chance
        limit = np.where(np.arange(size.size) == white, TWO_SIGMA, -ndtri(CHANCE / 2 / size.size))
        named = np.flatnonzero((np.abs(size) > LARGE_DEPARTURE) & (np.abs(size) > limit * error))
        said += [f"{names[patch]} reads {abs(size[patch]):.0%} ± {error[patch]:.0%} "
                 f"{words[int(size[patch] > 0)]}" for patch in named.tolist()]
    if not said:
        return ()
    by_light = f"the light may not be the stated one ({light}), or the chart is of " \
        if light and any(" in the blue" in one for one in said) else ""
    return (f"this chart is not as copies of its edition are: {'; '.join(said)}: {by_light}another "
            "edition, worn or dirty; measure it (chart.reference) or replace it",)


def evidence_since(copy: ChartCopy) -> float | None:
    """Nats by which a photo speaks for a chart made since November 2014 against one made before;
    None where only one edition could be meant.

    Parameters
    ----------
    copy : ChartCopy
    """
    return None if COPIES_BEFORE_2014 not in copy.evidence or len(copy.evidence) == 1 \
        else copy.evidence[COPIES_SINCE_2014] - copy.evidence[COPIES_BEFORE_2014]


def edition_told(copy: ChartCopy) -> str | None:
    """When a chart was made, as its photo alone tells; None where it tells too little.

    Parameters
    ----------
    copy : ChartCopy
    """
    nats = evidence_since(copy)
    return None if nats is None or abs(nats) < TOLD else SINCE if nats > 0 else BEFORE


def evidence_words(copy: ChartCopy) -> str:
    """What a photo says of the edition of its chart, in a sentence; empty where only one could be
    meant.

    Parameters
    ----------
    copy : ChartCopy
    """
    nats, told = evidence_since(copy), edition_told(copy)
    if nats is None:
        return ""
    if told is None:
        return (f"cannot be told: the photo speaks for {SINCE if nats > 0 else BEFORE} by "
                f"{abs(nats):.1f} nats, and {TOLD:g} are needed for 19 of 20 charts to be right")
    return (f"{told}: the photo speaks for it by {abs(nats):.1f} nats (from {TOLD:g} on, 19 of 20 "
            "charts are of the edition named)")


def edition_sentence(copy: ChartCopy) -> str:
    """Of which edition a chart is taken to be, and what the photo says of that.

    Parameters
    ----------
    copy : ChartCopy
    """
    taken = f"chart reference {copy.edition}, each patch within what copies differ by"
    said, told = evidence_words(copy), edition_told(copy)
    if told is not None and told not in copy.edition:
        said += ", too little against 19 of 20 charts in use being of the other"
    return f"{taken}; edition {said}" if said else taken


def copy_facts(copy: ChartCopy | None, names: Sequence[str]) -> dict[str, object] | None:
    """The copy of a chart as plain numbers: ``chart_generation`` of docs/reference/json.md.

    Parameters
    ----------
    copy : ChartCopy or None
        None where reflectances were stated.
    names : sequence of I str
        Of the patches.
    """
    if copy is None:
        return None
    columns = (copy.level, copy.level_error, copy.tint, copy.tint_error)
    rows = [{"name": name, "level": level, "level_error": level_error, "tint": tint,
             "tint_error": tint_error}
            for name, level, level_error, tint, tint_error in zip(
                names, *(column.tolist() for column in columns), strict=True)]
    return {"reference": copy.edition, "probability": copy.probability,
            "edition": edition_told(copy), "says": evidence_words(copy),
            "log_evidence": copy.evidence, "notes": list(chart_copy_notes(copy, names)),
            "patches": rows}


def chart_at_fault(patches: HeldOutPatches, names: Sequence[str], light: str = "") -> str:
    """What is wrong with the chart itself, in sentences: patches whose level or colour is off by
    more than chance; empty where none is but those that were kept out of the fit.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str
    light : str
        The one that was stated, which colours may be off by as well; empty where it is unknown.
    """
    fitted = ~patches.excluded.astype(bool)
    level, colour = _beyond_chance(patches) & fitted, _other_colour(patches) & fitted
    named = np.flatnonzero(level | colour).tolist()
    if not named:
        return ""
    glare = [patch for patch in np.flatnonzero(level).tolist() if _brighter(patches, patch)[0] > 0]
    each = "; ".join(f"{names[patch]} {_reason(patches, patch)}" for patch in named)
    if glare == named:
        return f"Glare lies on the chart: {each}. Turn the chart or the lamp."
    if light and colour.any():
        return (f"The chart does not agree with its reference under the stated light, {light}: "
                f"{each}. Either the light is another: measure it, or state it as unknown; or the "
                "chart is of another edition, worn or soiled, or light glares on it: measure it "
                "and give that file as reference, replace it, or leave these patches out "
                "(chart.leave_out).")
    return (f"The chart is not as its reference says: {each}. It is of another edition, worn or "
            "soiled, or light glares on it: measure it and give that file as reference, replace "
            "it, or leave these patches out (chart.leave_out).")


def poor_patches(patches: HeldOutPatches, names: Sequence[str]) -> dict[str, str]:
    """Patches whose band holds less than 85 % of the reference, each with its likely reason.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str

    Returns
    -------
    dict
        From names to reasons, the worst first.
    """
    if patches.brighter is None:
        return {}
    poor = np.flatnonzero(patches.judged & (patches.inside < POOR))
    return {names[patch]: _reason(patches, int(patch))
            for patch in poor[np.argsort(patches.inside[poor], kind="stable")]}


def _reason(patches: HeldOutPatches, patch: int) -> str:
    brighter, error = _brighter(patches, patch)
    level = f"reads {_level(patches, patch)} {'brighter' if brighter > 0 else 'darker'}"
    dark = patches.reference[patch].mean() < DARK
    if _beyond_chance(patches)[patch]:
        cause = ("a reflection lies on it" if brighter > 0 else
                 "a shadow lies across it, or it is soiled")
        if dark:
            cause += ", or glare is not the same all over the chart"
        return f"{level} in all bands than the others make it: {cause}"
    if _other_colour(patches)[patch]:
        return ("its colour is not that of the reference: soiled, faded, of another generation of "
                "the chart, or lit by a coloured reflection")
    outside = patches.grid.nm[(patches.reference[patch] < patches.lower[patch])
                              | (patches.reference[patch] > patches.upper[patch])]
    where = f"its spectrum is unusual for its signals at {outside[0]:g} to {outside[-1]:g} nm"
    if abs(brighter) > NEAR * error:
        return f"{level} than the others make it, within chance; {where}"
    return f"its signals agree with the reference; {where}"


def _brighter(patches: HeldOutPatches, patch: int) -> tuple[float, float]:
    assert patches.brighter is not None and patches.brighter_error is not None
    return float(patches.brighter[patch]), float(patches.brighter_error[patch])


def _level(patches: HeldOutPatches, patch: int) -> str:
    brighter, error = _brighter(patches, patch)
    return f"{abs(brighter):.0%} ± {error:.0%}"


def _beyond_chance(patches: HeldOutPatches) -> np.ndarray:
    """Whether the level of each patch (I,) is off by more than the worst of I is by chance."""
    if patches.brighter is None or patches.brighter_error is None:
        return np.zeros(len(patches.mean), bool)
    limit = -ndtri(CHANCE / 2 / len(patches.mean))
    return np.asarray(patches.judged & (np.abs(patches.brighter) > limit * patches.brighter_error))


def _other_colour(patches: HeldOutPatches) -> np.ndarray:
    """Whether the colour of each patch (I,) is off by more than the worst of I is by chance."""
    if patches.colour_chance is None:
        return np.zeros(len(patches.mean), bool)
    return np.asarray(patches.judged & (patches.colour_chance < CHANCE / len(patches.mean)))


def held_out_sentence(patches: HeldOutPatches) -> str:
    """One sentence on all patches.

    Parameters
    ----------
    patches : HeldOutPatches
    """
    rmse, inside, expected = patches.means
    return (f"each patch from the others: reflectance within {rmse:.3f} (rms), "
            f"{inside:.0%} of it inside the {patches.level:.0%} band ({expected:.1%} expected "
            "for chart colours)")


def difference_sentence(patches: HeldOutPatches) -> str:
    """One sentence on the colours of all patches, as their estimated spectra have them.

    Parameters
    ----------
    patches : HeldOutPatches
    """
    size = difference_summary(patches)
    return (f"these spectra against the chart's reference: CIEDE2000 {size.mean:.1f} on average, "
            f"{size.median:.1f} in the median, up to {size.percentile_90:.1f} for 90% of the "
            f"patches, {size.largest:.1f} at most")


def light_facts(calibration: Calibration) -> dict[str, object]:
    """What is known of the light by itself: kind, wavelengths, mean and band, as plain numbers.

    Parameters
    ----------
    calibration : Calibration
    """
    if calibration.light_posterior is not None:
        return posterior_facts(calibration.light_posterior)
    light = calibration.light
    error = np.zeros(light.grid.nm.size) if light.standard_error is None else light.standard_error
    return {"kind": "stated", "wavelengths_nm": light.grid.nm.tolist(),
            "mean": light.values.tolist(), "lower": (light.values - TWO_SIGMA * error).tolist(),
            "upper": (light.values + TWO_SIGMA * error).tolist()}


def posterior_facts(light: LightPosterior) -> dict[str, object]:
    """What a chart says of an unknown light.

    Parameters
    ----------
    light : LightPosterior
    """
    return {"kind": light.kinds[int(light.probabilities.argmax())],
            "kinds": dict(zip(light.kinds, light.probabilities.tolist(), strict=True)),
            "wavelengths_nm": light.grid.nm.tolist(), "mean": light.mean.tolist(),
            "lower": light.lower.tolist(), "upper": light.upper.tolist(), "level": light.level,
            "sentences": list(light.sentences)}


def held_out_facts(patches: HeldOutPatches, names: Sequence[str]) -> dict[str, object]:
    """Patches left out as plain numbers: ``left_out`` of docs/reference/json.md.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str
        Of the patches.
    """
    reasons, differences = poor_patches(patches, names), patch_differences(patches)
    curves = {"estimate": patches.mean, "lower": patches.lower, "upper": patches.upper,
              "reference": patches.reference}
    rows = [{"patch": number + 1, "name": names[number],
             "delta_e00": float(differences[number]), "rmse": float(patches.rmse[number]),
             "inside": float(patches.inside[number]),
             "expected": float(patches.expected[number]),
             "kept_out": bool(patches.excluded[number]),
             "saturated": not patches.judged[number], "reason": reasons.get(names[number]),
             **{name: np.round(curve[number], CURVE_DECIMALS).tolist()
                for name, curve in curves.items()}}
            for number in range(len(patches.mean))]
    rmse, inside, expected = patches.means
    return {"rmse_mean": rmse, "coverage_95": inside, "expected_95": expected,
            "level": patches.level, "delta_e00": vars(difference_summary(patches)),
            "wavelengths_nm": patches.grid.nm.tolist(), "patches": rows}
