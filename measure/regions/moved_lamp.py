"""One sample under a lamp in two places: what differs between its photos is gloss or level.

    signal (K,) of a photo = response @ reflectance x (1 + level) + gloss + errors

The chart is in both photos, so that light of another strength or colour is in white already. A
gloss adds the same to all bands, a level multiplies all: of a sample that is not grey they look
different. What both photos have in common looks like neither.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.special import chdtrc

from spectrabox.radiometry import error_model, findings, gloss
from spectrabox.radiometry.records import spectra

LEVEL = "level"
# Relative: mean and standard deviation of how far the light on a sample is off what the chart's
# gives, where it is beyond the usual error: half of them shadows, .90 +- .05 of the light, half
# samples that lie otherwise than the chart, 1 +- .10; and how often, of one photo or of all
DARKER, OFF, OFF_IN_ONE, OFF_IN_ALL = -0.05, 0.09, 0.16, 0.04
# Which light a lobe sends to the camera goes with the lamp's place: share of pairs of places in
# which a sample mirrors nearly the same, which no comparison shows, and the correlation there; in
# others its kind is all that they have in common
EQUAL, ALIKE = 0.5, 0.98
CONTRADICTION = 1e-3    # probability of what two photos differ by, below which it is named
NAMED_LEVEL, NAMED_GLOSS, SURE = 0.05, 0.01, 2.5    # and in standard errors, likewise
SAME = 1e-9             # of white: responses closer than this are one


def gloss_and_level(stated: str | None, signal: np.ndarray, places: Sequence[str],
                    plane: np.ndarray) -> spectra.CaptureStates:
    """What a sample may mirror, and how far the light on it may be from what the chart's gives, in
    each place of the lamps.

    Parameters
    ----------
    stated : str or None
        What is stated of its surface, as of ``gloss.gloss_states``.
    signal : (J,) array
        Relative to white; not a number in bands that do not show it.
    places : sequence of J str
        Of the lamp of each band.
    plane : (J, J) array
        Covariance of the signal by the usual error of the light in its plane.
    """
    seen, distinct = np.nan_to_num(signal), list(dict.fromkeys(places))
    of_place = np.array([[place == at for at in distinct] for place in places], float)
    relative = np.divide(np.diag(plane), seen**2, out=np.zeros(seen.size), where=seen != 0)
    usual = np.array([relative[column > 0].max() for column in of_place.T])
    return spectra.independent_states(_gloss(stated, places), _level(seen[:, None] * of_place,
                                                                     usual))


def _gloss(stated: str | None, places: Sequence[str]) -> spectra.CaptureStates:
    """What a sample may mirror in each place of the lamps."""
    once = gloss.gloss_states(stated, places)
    count, variances = len(once.names), np.diagonal(once.covariances, axis1=1, axis2=2)
    covariances = [np.sqrt(own[:, :, None] * own[:, None]) * (alike + (1 - alike) * np.eye(count))
                   for own, alike in ((variances, 0.0), (variances, ALIKE))]
    return dataclasses.replace(
        once, kinds=once.kinds * 2, weights=np.r_[(1 - EQUAL) * once.weights, EQUAL * once.weights],
        means=np.tile(once.means, (2, 1)), covariances=np.concatenate(covariances))


def _level(pattern: np.ndarray, usual: np.ndarray) -> spectra.CaptureStates:
    """How far the light may be off: as usual in all places, beyond it in one, or in all.

    Parameters
    ----------
    pattern : (J, places) array
        The signal in the bands of each place.
    usual : (places,) array
        Relative variance.
    """
    count = usual.size
    off = np.vstack([np.zeros(count), np.eye(count), np.ones(count)])
    return spectra.CaptureStates(
        tuple(LEVEL if number == 0 else f"{LEVEL} {number + 1}" for number in range(count)),
        (error_model.SAMPLE_PLANE,) * count, pattern, np.full(count, -1.0), ("",) * len(off),
        np.r_[1 - OFF_IN_ONE - OFF_IN_ALL, np.full(count, OFF_IN_ONE / count), OFF_IN_ALL],
        DARKER * off, np.array([np.diag(usual + row * OFF**2) for row in off]))


def found_in_places(signals: spectra.SurfaceSignals, index: int,
                    found: spectra.StateEstimate | None) -> list[dict[str, Any]]:
    """Gloss and level of a sample in each place of a moved lamp, as JSON has them: "photo", the
    title of the first with the lamp there; "gloss", the share of white that the sample mirrors;
    "level", the light on it against what the chart's gives, relative; and the standard errors
    "gloss_error" and "level_error". None where none was moved.

    Parameters
    ----------
    signals : SurfaceSignals
    index : int
        Of the sample.
    found : StateEstimate or None
        What its signal says.
    """
    if found is None or LEVEL not in found.names:
        return []
    values = list(zip(found.mean.tolist(), found.standard_deviation.tolist(), strict=True))
    count = len(values) // 2
    first = [int(np.flatnonzero(column)[0]) for column in signals.states[index].pattern.T[:count]]
    return [{"photo": signals.bands[band].rsplit(": ", 1)[0], "gloss": gloss,
             "gloss_error": gloss_error, "level": level, "level_error": level_error}
            for band, (gloss, gloss_error), (level, level_error)
            in zip(first, values[:count], values[count:], strict=True)]


def differences_of_photos(signals: spectra.SurfaceSignals,
                          photos: Sequence[str]) -> tuple[findings.Finding, ...]:
    """Samples that differ between photos with the lamp in two places, each with the likely cause.

    Parameters
    ----------
    signals : SurfaceSignals
        With the states of ``gloss_and_level``.
    photos : sequence of str
        Titles, as ``signals.view_of_band`` numbers them.
    """
    return tuple(one for index, name in enumerate(signals.names) if not signals.known[index]
                 for first, other in _pairs(signals, index)
                 for one in _compared(signals, index, name, first, other, photos))


def _pairs(signals: spectra.SurfaceSignals, index: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Bands (K,) of a photo, and the same bands of a later one, where both show a sample."""
    seen = np.isfinite(signals.signal[index])
    views = list(dict.fromkeys(signals.view_of_band.tolist()))
    for number, later in enumerate(views):
        for earlier in views[:number]:
            first, other = (np.flatnonzero(signals.view_of_band == view)
                            for view in (earlier, later))
            if not np.allclose(signals.response[first], signals.response[other], rtol=0, atol=SAME):
                continue
            both = seen[first] & seen[other]
            if both.sum() > 1:
                yield first[both], other[both]


def _compared(signals: spectra.SurfaceSignals, index: int, name: str, first: np.ndarray,
              other: np.ndarray, photos: Sequence[str]) -> Iterator[findings.Finding]:
    """What the difference of a sample's signals in two photos says, if anything."""
    states, signal = signals.states[index], signals.signal[index]
    contrast = np.zeros((first.size, signal.size))
    contrast[range(first.size), first] = 1
    contrast[range(first.size), other] = -1
    noise = np.sum([covariance[index] for covariance in signals.errors.values()], axis=0)
    noise = contrast @ np.nan_to_num(noise) @ contrast.T
    pattern = contrast @ states.pattern
    difference = contrast @ np.nan_to_num(signal)
    # what is looked for: the first photo less the other, in gloss and in level
    wanted = np.array([[_sign(states.pattern[:, row], first, other)
                        if variable.startswith(word) else 0.0
                        for row, variable in enumerate(states.names)]
                       for word in ("gloss", LEVEL)])
    log, least, means, variances = [], np.inf, [], []
    for weight, mean, covariance in zip(states.weights, states.means, states.covariances,
                                        strict=True):
        spread = noise + pattern @ covariance @ pattern.T
        off = difference - pattern @ mean
        misfit = float(off @ np.linalg.solve(spread, off))
        least = min(least, misfit)
        log.append(np.log(weight) - (misfit + np.linalg.slogdet(spread)[1]) / 2)
        gain = np.linalg.solve(spread, pattern @ covariance).T
        means.append(wanted @ (mean + gain @ off))
        variances.append(np.diag(wanted @ (covariance - gain @ pattern @ covariance) @ wanted.T))
    shares = np.exp(np.array(log) - max(log))
    shares /= shares.sum()
    mean = shares @ np.array(means)
    error = np.sqrt(shares @ (np.array(variances) + (np.array(means) - mean)**2))
    one, two = (photos[int(signals.view_of_band[bands[0]])] for bands in (first, other))
    if chdtrc(first.size, least) < CONTRADICTION:
        brighter = float(np.linalg.solve(noise, difference).sum() / np.linalg.inv(noise).sum())
        left = difference - brighter
        if chdtrc(first.size - 1, left @ np.linalg.solve(noise, left)) > CONTRADICTION:
            more, less = (one, two) if brighter > 0 else (two, one)
            yield findings.Finding("lamp.image-mirrored", findings.Severity.NOTE, name, {
                "share": abs(brighter), "more": more, "less": less})
            return
        worst = int(np.argmax(np.abs(difference / signal[other])))
        yield findings.Finding("lamp.unexplained", findings.Severity.NOTE, name, {
            "off": float(difference[worst] / signal[other][worst]),
            "band": signals.bands[first[worst]], "one": one, "other": two})
        return
    if abs(mean[0]) > max(NAMED_GLOSS, SURE * error[0]):
        more, less = (one, two) if mean[0] > 0 else (two, one)
        yield findings.Finding("lamp.gloss", findings.Severity.NOTE, name, {
            "share": float(abs(mean[0])), "error": float(error[0]), "more": more, "less": less})
    usual = np.sqrt(wanted[1] @ states.covariances[0] @ wanted[1])
    if abs(mean[1]) > max(NAMED_LEVEL, SURE * usual, SURE * error[1]):
        dark, right = (one, two) if mean[1] < 0 else (two, one)
        yield findings.Finding("lamp.darker", findings.Severity.NOTE, name, {
            "share": float(abs(mean[1])), "error": float(error[1]), "dark": dark,
            "right": right})


def _sign(pattern: np.ndarray, first: np.ndarray,
          other: np.ndarray) -> float:
    """1 for a variable of the first photo, -1 of the other, 0 of neither."""
    return float(pattern[first].any()) - float(pattern[other].any())
