"""The methods paragraph of a paper, filled with the numbers of one session of flat samples."""
from __future__ import annotations

from spectrabox.session.flat.flat_results import FlatResults
from spectrabox.session.report.methods import camera_words, capture_words, sampling_words
from spectrabox.session.report.words import listed, percent


def flat_methods(results: FlatResults) -> list[str]:
    """Paragraphs that can be pasted into a paper."""
    return [capture_words(results, "Flat samples were"), camera_words(results), _light(results),
            sampling_words(results)]


def _light(results: FlatResults) -> str:
    errors = [error for photo in results.photos for _, error in photo.light.values()]
    known = [region.name for region in results.materials if region.summary is None]
    given = f" Regions of known spectrum ({listed(known)}) corrected it." if known else ""
    flat = any(row.get("role") == "flat-field photo" for row in results.inputs)
    card = " The photos were divided by one of a white card." if flat else ""
    return ("Signals of regions were divided by what a perfect white would read there: the white "
            "level and the quadratic light field of the chart fit, the field carried from the "
            "chart to the regions by regression over arrangements of lamps at unknown distances "
            f"and the lens's fall-off.{card}{given} The light on the regions is known within "
            f"{percent(min(errors))} to {percent(max(errors))}.")
