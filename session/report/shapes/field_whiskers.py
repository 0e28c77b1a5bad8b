"""The fitted light on each region as a mark with its error, all on one scale."""
from __future__ import annotations

from collections.abc import Mapping

from markupsafe import Markup

WIDTH, HEIGHT = 120.0, 16.0     # in the drawing's own unit
SIGMA = 2.0
CHART = 1.0                     # mean of the light over the chart


def field_whiskers(light: Mapping[str, tuple[float, float]]) -> dict[str, Markup]:
    """Level and two standard errors of each region; a line stands for the mean over the chart.

    Parameters
    ----------
    light : dict
        Region to level, relative to the chart's mean, and standard error.
    """
    if not light:
        return {}
    ends = [level + side * SIGMA * error for level, error in light.values() for side in (-1, 1)]
    low, high = min(*ends, CHART), max(*ends, CHART)
    scale = (WIDTH - 6) / max(high - low, 1e-6)

    def at(value: float) -> float:
        return 3 + (value - low) * scale

    return {name: Markup(
        '<svg class="whisker" viewBox="0 0 {} {}" role="img" aria-label="{}"><path class="half" '
        'd="M{:.1f} 0V{}"/><path d="M{:.1f} {}H{:.1f}" stroke="currentColor"/><circle cx="{:.1f}" '
        'cy="{}" r="3" fill="currentColor"/></svg>').format(
            WIDTH, HEIGHT, f"{100 * level:.0f} % of the light on the chart, two standard errors "
            f"{200 * error:.1f} %", at(CHART), HEIGHT, at(level - SIGMA * error), HEIGHT / 2,
            at(level + SIGMA * error), at(level), HEIGHT / 2)
        for name, (level, error) in light.items()}
