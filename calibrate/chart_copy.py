"""The copy of a chart that photos show, where nobody stated its reflectances."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spectrabox.calibrate import chart_equations, chart_photo, copy_errors, sensitivity
from spectrabox.radiometry.records import calibration, spectra

COPY_ERROR = 0.03   # relative, of the level of a patch: one copy against the mean of several


def of_edition(photo: chart_photo.ChartPhoto, name: str) -> chart_photo.ChartPhoto:
    """The photo with its chart taken to be of one of its editions.

    Parameters
    ----------
    photo : ChartPhoto
    name : str
    """
    ordered = tuple(sorted(photo.editions, key=lambda edition: edition.name != name))
    return replace(photo, reflectances=ordered[0].mean, editions=ordered)


def copy_of_chart(photos: Sequence[chart_photo.ChartPhoto], fit: sensitivity.PriorFit,
                  grid: spectra.WavelengthGrid) -> calibration.ChartCopy | None:
    """What photos say of the copy of their chart; None where its reflectances were stated.

    Parameters
    ----------
    photos : sequence of ChartPhoto
        As they were fitted.
    fit : PriorFit
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    used, _ = chart_photo.used_and_excluded(photos, grid)
    errors, (mine, *further) = chart_equations.copy_patterns(used), photos[0].editions or (None,)
    if errors is None or mine is None:
        return None
    others = np.zeros((len(further), len(errors)))
    if further:
        means = np.array([edition.mean for edition in further])
        others = np.concatenate([copy_errors.edition_errors(
            photo.signal, ~photo.readable, photo.reflectances, means[:, shown.used], photo.power,
            grid).reshape(len(further), -1) for photo, shown in zip(used, photos, strict=True)],
            axis=1)
    level_spread, tint_spread = copy_errors.copy_spread(mine, grid)
    errors, mine = copy_errors.with_level_of_fit(errors, mine, fit.posterior.best_error.common)
    terms, covariance = copy_errors.terms_of_copy(fit.explained, errors)
    (level, level_error), (tint, tint_error) = (
        (rows @ terms,
         np.sqrt(np.maximum(np.einsum("ir,rs,is->i", rows, covariance, rows), 0)))
        for rows in copy_errors.level_and_tint(mine, grid))
    log_odds = copy_errors.edition_log_odds(fit.explained, others)
    nats = {mine.name: 0.0, **dict(zip((edition.name for edition in further), log_odds.tolist(),
                                       strict=True))}
    editions = sorted(photos[0].editions, key=lambda edition: -edition.share)
    usual = nats[editions[0].name]
    nats = {edition.name: nats[edition.name] - usual for edition in editions}
    odds = np.array([np.log(edition.share) + nats[edition.name] for edition in editions])
    shares = np.exp(odds - odds.max()) / np.exp(odds - odds.max()).sum()
    likely = int(np.argmax(shares))
    return calibration.ChartCopy(editions[likely].name, editions[likely].made,
                                 float(shares[likely]), nats, level, level_error, tint, tint_error,
                                 mine.mean * np.exp(copy_errors.departure(mine, terms)),
                                 level_spread, tint_spread)
