"""Spectra of a photo's parts, and the result of what is marked now, as the page shows them."""


from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from spectrabox.measure import captured, conditions, opened_photos, rules, texts
from spectrabox.measure.records import MeasuredChart
from spectrabox.measure.regions.pointing import PointedSample
from spectrabox.measure.regions.white import PhotoWhite
from spectrabox.measure.results.flat_result import FlatResult, flat_result
from spectrabox.measure.steps import declared_steps, measurement, photos, signals
from spectrabox.measure.steps.work import Work
from spectrabox.measure.surfaces.colour_comparison import LIGHTS, compare_colours
from spectrabox.measure.surfaces.surface_signals import errors_by_cause
from spectrabox.radiometry import appearance, errors, findings, grid
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.records.spectra import Spectrum, SpectrumSummary
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.sampling.prior.mixture import PRIOR_GRID

POINTED_DRAWS = 300     # behind the error of the colour under the pointer: 4 % of it
MENTIONED = 0.02        # share of a family or cause that is listed


def answered_or_refused(estimate: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """An estimate for the page, or why there is none: pixels that are clipped, say."""
    try:
        return estimate()
    except errors.SpectraboxError as error:
        return {"refused": str(error)}


def described_charts(capture: captured.FlatCapture,
                     charts: Mapping[str, MeasuredChart]) -> dict[str, Any]:
    """Of each photo with a chart, by the title of its role: patches, and whether to use it."""
    described = {}
    for view in capture.views_with_chart:
        chart = charts[view.name]
        role = view.title if view.shows_chart else f"{view.name} chart".strip()
        described[role] = {"patches": np.round(chart.detection.corners_px, 1).tolist(),
                           "verdict": "RE-SHOOT" if findings.faults(chart.findings) else "GOOD",
                           "reasons": texts.reasons(chart.findings),
                           "findings": [texts.facts(finding) for finding in chart.findings]}
    return described


def described_region(sample: PointedSample, whites: Sequence[PhotoWhite],
                     summary: SpectrumSummary) -> dict[str, Any]:
    """The spectrum of a region of the session for the page, as its report has it."""
    answer = described_spectrum(summary.grid.nm, summary.mean) | described(
        whites, summary.lower, summary.upper,
        appearance.reflectance_to_lab(summary.draws.grid.nm, summary.draws.spectra),
        summary.family_shares, summary.variance_shares) | {"next_nm": summary.next_measurement_nm}
    if (truth := sample.capture.regions[whites[0].samples.names[0]].truth) is not None:
        answer["truth"] = described_truth(truth, summary.grid.nm, summary.mean)
    return answer


def described_truth(truth: Spectrum, nm: np.ndarray, mean: np.ndarray) -> dict[str, Any]:
    """A measured spectrum beside an estimate, and how far their colours are apart."""
    measured = spectrum_on_grid(truth, grid.FINE_GRID)
    return {"nm": grid.FINE_GRID.nm[::5].tolist(), "values": _rounded(measured[::5]),
            "lab": _rounded(appearance.reflectance_to_lab(grid.FINE_GRID.nm, measured)),
            "delta_e00": round(appearance.delta_e00(grid.FINE_GRID.nm, measured,
                                         np.interp(grid.FINE_GRID.nm, nm, mean)), 2)}


def described_part(sample: PointedSample, region: captured.Surface) -> dict[str, Any]:
    """The same of any part of a photo, in closed form."""
    signals, whites, posterior = sample.pointed(region)
    nm = PRIOR_GRID.nm
    return described_spectrum(nm, posterior.mean) | described(
        whites, *posterior.band(sample.capture.sampling.level),
        appearance.reflectance_to_lab(nm, posterior.draws(POINTED_DRAWS, 1)),
        posterior.family_shares, posterior.variance_shares(errors_by_cause(signals, 0)))


def described_comparison(sample: PointedSample,
                         picked: Sequence[tuple[str, captured.Surface]]) -> dict[str, Any]:
    """Two parts of photos beside each other, each with its title."""
    (first, region), (second, other) = picked
    pointed = [sample.pointed(region), sample.pointed(other)]
    both = compare_colours([signals for signals, _, _ in pointed],
                           [posterior for _, _, posterior in pointed])
    return {"names": [first, second], "distinct": both.distinct, "says": both.sentence,
            "spectra": [{"nm": PRIOR_GRID.nm.tolist(), "mean": _rounded(mean)}
                        for mean in both.means],
            "lights": [{"light": light, "hex": [hex_colour(colour) for colour in both.srgb(light)],
                        "delta_e00": round(value, 2), "lower": round(lower, 2),
                        "upper": round(upper, 2)}
                       for light, (value, lower, upper) in ((light, both.delta_e(light))
                                                            for light in LIGHTS)]}


def described(whites: Sequence[PhotoWhite], lower: np.ndarray, upper: np.ndarray, labs: np.ndarray,
              families: Mapping[str, float], causes: Mapping[str, float]) -> dict[str, Any]:
    """What an estimate adds to its spectrum: band, error of the colour from draws (T, 3), causes;
    and what the photos say of the first of their regions.
    """
    first, notes = whites[0], []
    name, scatter = first.samples.names[0], float(first.samples.scatter[0].max())
    edge = next((white.samples.edges[name] for white in whites if name in white.samples.edges),
                None)
    if edge is not None:
        notes.append(texts.says(rules.edge_in(name, edge)))
    elif scatter > photos.UNEVEN:
        notes.append(texts.says(photos.uneven_region(name, scatter)))
    return {"lower": _rounded(lower), "upper": _rounded(upper),
            "lab_error": _rounded(labs.std(axis=0)), "families": _largest(families),
            "causes": _largest(causes),
            "light": [float(np.exp(first.log_field[0])), float(first.field_error[0])],
            "notes": notes,
            "larger_part": None if edge is None or edge.larger_part_px is None
            else edge.larger_part_px.tolist()}


def described_spectrum(nm: np.ndarray, reflectance: np.ndarray) -> dict[str, Any]:
    """A reflectance (P,) and its colour under D65."""
    return {"nm": nm.tolist(), "mean": _rounded(reflectance),
            "lab": _rounded(appearance.reflectance_to_lab(nm, reflectance)),
            "hex": hex_colour(appearance.reflectance_to_srgb(nm, reflectance))}


def hex_colour(srgb: np.ndarray) -> str:
    """Encoded sRGB (3,), 0 to 1, as CSS writes it."""
    return "#" + "".join(f"{round(255 * float(value)):02x}" for value in srgb)


def _largest(shares: Mapping[str, float]) -> list[tuple[str, float]]:
    """Shares that are large enough to be listed, the largest first."""
    return sorted(((name, round(share, 3)) for name, share in shares.items()
                   if share >= MENTIONED), key=lambda each: -each[1])


def _rounded(values: np.ndarray, decimals: int = 5) -> list[float]:
    return [round(float(value), decimals) for value in values]


# ---- the result of what is marked now, before any report: its verdict, and what it rests on ------

class PhotosAtHand(opened_photos.OpenPhotos):
    """Photos of a capture that are developed already.

    Parameters
    ----------
    capture : FlatCapture
    images : mapping
        By view.
    """

    def __init__(self, capture: captured.FlatCapture, images: Mapping[str, LinearImage]) -> None:
        super().__init__(capture)
        self._images = [(view.photo, images[view.name]) for view in capture.views]

    def developed(self,
                  photo: captured.PhotoFiles) -> tuple[LinearImage, tuple[findings.Finding, ...]]:
        """The photo; what else showed of it is the report's."""
        return next(image for files, image in self._images if files == photo), ()


def result_now(sample: PointedSample,
               drawn: Callable[[str], SpectrumSummary]) -> FlatResult:
    """What a run would find of the regions that are marked now, but for the picture.

    Parameters
    ----------
    sample : PointedSample
        With a region that is not known.
    drawn : callable
        The spectrum of a region by its name.

    Raises
    ------
    SpectraboxError
        As the steps.
    """
    capture, records = sample.capture, sample.records
    keeper = measurement.MemoryKeeper(kept={"chart": records.charts,
                                            "calibrate": records.calibrate})
    work = Work(PhotosAtHand(capture, sample.images), lambda share, message: None)
    keeper.keep(declared_steps.FLAT_PHOTOS, lambda progress, folder: photos.measure_flat_photos(
        capture, keeper.records, work))
    keeper.keep(declared_steps.SIGNALS,
                lambda progress, folder: signals.find_signals(capture, keeper.records, work))
    keeper.keep(declared_steps.FLAT_SPECTRA, lambda progress, folder: {
        name: drawn(name) for name, region in capture.regions.items() if region.known is None})
    return flat_result(capture, keeper.records)


def described_result(found: FlatResult) -> dict[str, Any]:
    """Verdict and conditions for the page, as the report has them."""
    return {"status": found.verdict.word, "condition": found.verdict.condition,
            "says": found.verdict.says,
            "findings": [texts.facts(one) for one in found.findings],
            "conditions": [conditions.facts(one) for one in found.conditions]}
