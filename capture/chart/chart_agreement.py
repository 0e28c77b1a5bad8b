"""Whether quadrilaterals in a photo look like the patches of a chart, and in which order.

First up to the gain of each band, the contrast of the file, and light that changes evenly across
the chart: this finds the order of the patches. Then up to any mixture of the reference's three
bands, which takes up the camera and the light: what is left is a few per cent for a chart (0.03, at
most 0.14, over 40 measured cameras under 2300 to 9000 K and lamps with lines; up to 0.35 in JPEGs)
and more than 1 for other colours.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spectrabox.capture.chart.patches import pixels_inside
from spectrabox.radiometry.chart import AS_ASKED, CLASSIC, Chart, table_orders
from spectrabox.radiometry.records.photos import MIN_PATCHES, LinearImage

PATCH = 40.0                     # side of a patch in the units of this room: mm on the Classic

ACCEPTED_RESIDUAL = 0.45         # relative rms; charts reach 0.35, other colours begin at 1.1
WORST_PATCH = 0.65               # in a raw: 0.37 in 99 of 100 charts, 0.72 in half of the covered
WORST_ENCODED_PATCH = 1.3        # in a file that may have a tone curve and a colour matrix in it
DARKEST_SHARE = 0.03             # of the brightest patch, in the denominator of relative misfits
MIN_RANK_CORRELATION = 0.8       # of the neutral patches
MIN_NEUTRALS = 3                 # to be ranked
LEFT_OUT = 0.1                   # of the log residuals, the worst
HOPELESS_RESIDUAL = 1.0          # rms of the log residual above which no mixture of bands is tried
MIN_CONTRAST = 0.2
WORST_LEFT_OUT = 12              # one patch in so many
MIXTURE_STEPS = 6
BRIGHT_PERCENTILE = 99.0         # of a band's signals, that is taken for its brightest
MIXED_BANDS = 3                  # more would fit 24 patches whatever their colours
VEILS = np.arange(0.0, 0.31, 0.01)   # of the brightest patch: veiling glare that is tried
# Powers of the light: below the first a veil is tried, which must then leave the second (sRGB under
# a veil of 0.1 leaves 0.58), and alone fit the patches nearly as well (curves: 3 to 6 times worse).
CURVED, VEILED = 0.8, 0.65
VEIL_MISFIT, VEIL_STEP_MISFIT = 1.6, 0.01       # factor, and what the steps of the veil may leave


# Signals of an ordinary camera for the Classic, to recognise it by; not to measure with. They are
# ``radiometry.chart.typical_camera_signals`` of the reflectances "BabelColor Average" under even
# light, a perfect reflector giving 1 in each band, so that detecting a chart does not wait for the
# library of reflectances.
TYPICAL_SIGNALS = np.array([  # (24, 3) red, green, blue; dark skin first
    (0.1347, 0.0866, 0.0631), (0.4499, 0.3137, 0.2445), (0.1540, 0.2136, 0.3081),
    (0.1209, 0.1280, 0.0671), (0.2355, 0.2546, 0.3884), (0.2989, 0.4755, 0.4336),
    (0.4812, 0.2103, 0.0610), (0.0924, 0.1491, 0.3314), (0.3584, 0.1355, 0.1214),
    (0.0868, 0.0632, 0.1190), (0.4036, 0.4152, 0.1299), (0.5752, 0.3242, 0.0773),
    (0.0415, 0.0860, 0.2380), (0.1643, 0.2463, 0.1114), (0.2864, 0.0714, 0.0459),
    (0.7122, 0.4965, 0.1086), (0.3545, 0.1615, 0.2672), (0.1078, 0.2598, 0.3682),
    (0.9164, 0.9093, 0.8743), (0.5852, 0.5892, 0.5827), (0.3568, 0.3599, 0.3580),
    (0.1890, 0.1917, 0.1912), (0.0881, 0.0899, 0.0904), (0.0320, 0.0320, 0.0324),
])


class Agreement(NamedTuple):
    """How well I signals fit a chart, in the order that fits best."""

    residual: float      # relative rms of the patches, the worst twelfth left out
    contrast: float      # power of the light: 1 in a linear photo
    order: np.ndarray    # (I,) index of the proposed quadrilateral of the first patch, ...
    misfit: np.ndarray   # (I,) relative misfit of each patch, in chart order
    light: np.ndarray    # (I,) on each patch as far as it changes evenly, geometric mean 1


def chart_units(chart: Chart, points: np.ndarray | None = None) -> np.ndarray:
    """Points (n, 2) of a chart in units of which a patch's side is 40.

    From the outer corner of the first patch.

    Parameters
    ----------
    chart : Chart
    points : (n, 2) array or None
        In the chart's own unit; None: the centres of its patches.
    """
    scale = unit_scale(chart)
    points = chart.centres if points is None else points
    return points * scale - chart.centres[0] * scale + chart.sizes[0] * scale / 2


def in_one_band(signals: np.ndarray) -> np.ndarray:
    """Signals (..., 1) in which all bands count alike: a chart in bands of any number is recognised
    by how light its patches are, for through a narrow filter no camera's colours are left.

    Parameters
    ----------
    signals : (..., K) array
    """
    brightest = np.percentile(signals, BRIGHT_PERCENTILE, axis=tuple(range(signals.ndim - 1)))
    weights = 1 / np.maximum(brightest, 1e-6 * max(brightest.max(), np.finfo(np.float32).tiny))
    return np.asarray(signals @ weights.astype(signals.dtype) / len(weights))[..., None]


def unit_scale(chart: Chart) -> float:
    """Such units in one of the chart's own.

    Parameters
    ----------
    chart : Chart
    """
    return PATCH / float(np.sqrt(np.median(chart.sizes.prod(axis=1))))


def chart_agreement(image: LinearImage, quads_px: np.ndarray, reference: np.ndarray,
                    chart: Chart = CLASSIC, excluded: np.ndarray | None = None) -> Agreement:
    """Agreement of the signals of a chart's patches with a reference, in the order that fits best.

    Parameters
    ----------
    image : LinearImage
    quads_px : (I, 4, 2) array
        Quadrilaterals in sensor pixels.
    reference : (I, 3) or (I, K) array
        Signals that an ordinary camera would read, in chart order. In other bands than three the
        lightness of the patches is compared, a mixture of the three.
    chart : Chart
    excluded : (I,) bool array, optional
        Patches that say nothing of the chart: their misfit is 0.
    """
    return _agreement(_patch_medians(image, quads_px), reference, chart, excluded)


def wrong_neutral(image: LinearImage, quads_px: np.ndarray, reference: np.ndarray, chart: Chart,
                  accepted: float, excluded: np.ndarray | None = None
                  ) -> tuple[int, Agreement] | None:
    """The neutral patch without which patches agree with a chart that do not agree with it, and how
    they do: a single misprinted one puts the greys out of order. None where no single one is.

    Parameters
    ----------
    image, quads_px, reference, chart, excluded
        As of ``chart_agreement``.
    accepted : float
        Residual up to which patches and reference agree.
    """
    medians = _patch_medians(image, quads_px)
    out = np.zeros(len(chart.names), bool) if excluded is None else excluded
    left = [patch for patch in chart.neutrals if not out[patch]]
    if medians is None or len(left) <= MIN_NEUTRALS or len(out) - out.sum() <= MIN_PATCHES:
        return None
    fits = [(patch, _agreement(medians, reference, chart, out | (np.arange(len(out)) == patch)))
            for patch in left]
    patch, best = min(fits, key=lambda fit: fit[1].residual)
    return (patch, best) if best.residual <= accepted else None


def _agreement(medians: np.ndarray | None, reference: np.ndarray, chart: Chart,
               excluded: np.ndarray | None) -> Agreement:
    kept, colours = _kept(chart, excluded), reference
    if medians is not None and medians.shape[1] != MIXED_BANDS:
        medians, reference = in_one_band(medians), in_one_band(reference)
    # as proposed, turned by 180 degrees, and in two mirrors
    grid = np.arange(len(chart.names)).reshape(chart.rows, chart.columns)
    orders = [order.ravel() for order in (grid, grid[::-1, ::-1], grid[:, ::-1], grid[::-1])]
    patches = len(chart.names)
    if medians is None:
        return Agreement(np.inf, np.nan, orders[0], np.full(patches, np.inf), np.ones(patches))
    fits = [(*_log_fit(medians[order], reference, chart, kept), order) for order in orders]
    residual, contrast, order = min(fits, key=lambda fit: fit[0])
    if not residual < HOPELESS_RESIDUAL:
        if not np.isfinite(residual):       # by how much, in the order that fits best all the same
            residual = max(HOPELESS_RESIDUAL, min(_rms(_mixture_fit(
                medians[order], _mixed(colours, reference), 1.0, chart, kept)[0], kept)
                for order in orders))
        return Agreement(residual, contrast, order, np.full(patches, np.inf), np.ones(patches))
    signals = medians[order]
    if contrast < CURVED:       # a tone curve, or a veil: a curve bends, a veil adds a constant
        veil, power, both = veil_fit(signals, reference, chart, excluded=excluded)
        if power >= VEILED and (veil_fit(signals, reference, chart, 1.0, excluded)[2]
                                < VEIL_MISFIT * both + VEIL_STEP_MISFIT):
            signals, contrast = signals - veil * signals.max(axis=0), power
    misfit, light = _mixture_fit(signals, _mixed(colours, reference), contrast, chart, kept)
    return Agreement(_rms(misfit, kept), contrast, order, misfit, light)


def _kept(chart: Chart, excluded: np.ndarray | None) -> np.ndarray:
    """Patches (I,) that count: all, where too few would be left."""
    kept = np.ones(len(chart.names), bool) if excluded is None else ~np.asarray(excluded, bool)
    return kept if np.count_nonzero(kept) >= MIN_PATCHES else np.ones_like(kept)


def _mixed(colours: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """What the bands of a photo may mix: the three of the reference where there are three."""
    return colours if colours.shape[1] == MIXED_BANDS else reference


def _rms(misfit: np.ndarray, kept: np.ndarray) -> float:
    """Root mean square over patches, the worst twelfth left out."""
    counted = np.sort(misfit[kept])
    return float(np.sqrt(np.mean(counted[:-(counted.size // WORST_LEFT_OUT) or None] ** 2)))


def reading_of_reference(image: LinearImage, quads_px: np.ndarray, reference: np.ndarray,
                         chart: Chart, accepted: float) -> str | None:
    """How a reference has to be read to agree with patches that lie in chart order.

    Parameters
    ----------
    image, quads_px, reference, chart
        As of ``chart_agreement``.
    accepted : float
        Residual up to which patches and reference agree.

    Returns
    -------
    str or None
        One of ``table_orders`` in words; None where no order agrees.
    """
    orders = table_orders(chart.rows, chart.columns)
    for table in (orders[AS_ASKED], orders["column by column"]):
        agreement = chart_agreement(image, quads_px, reference[table], chart)
        if agreement.residual <= accepted:
            read = table[np.argsort(agreement.order)]
            return next(words for words, order in orders.items() if np.array_equal(order, read))
    return None


def _patch_medians(image: LinearImage, quads_px: np.ndarray) -> np.ndarray | None:
    """Median signals (I, K), or None where a patch holds no pixel of the photo."""
    height, width = image.signal.shape[:2]
    if not np.all(np.isfinite(quads_px)):
        return None
    medians = []
    for quad in quads_px:
        y, x = pixels_inside(quad, image.sensor_step, height, width)
        if y.size == 0:
            return None
        medians.append(np.median(image.signal[y, x], axis=0))
    return np.array(medians)


def _log_fit(signals: np.ndarray, reference: np.ndarray, chart: Chart,
             kept: np.ndarray) -> tuple[float, float]:
    """Rms residual and contrast of log signals (I, K) = contrast x log reference + gain of the
    band + plane in x, y.

    The residual is in log reference, that is, divided by the contrast. The tenth that fits worst is
    left out, so that a covered or glossy patch does not decide. Infinite where the neutral row is
    out of order or nothing is bright.
    """
    brightness = signals.sum(axis=1)
    if brightness[kept].max() <= 0:
        return np.inf, np.nan
    neutrals = [patch for patch in chart.neutrals if kept[patch]]
    ranks, expected = np.argsort(np.argsort([brightness[neutrals],
                                             reference[neutrals].sum(axis=1)]))
    if len(neutrals) >= MIN_NEUTRALS and np.corrcoef(ranks, expected)[0, 1] < MIN_RANK_CORRELATION:
        return np.inf, np.nan
    bands = signals.shape[1]
    # dark patches may read 0 or less
    floor = 1e-3 * np.maximum(signals[kept].max(axis=0), np.finfo(np.float32).tiny)
    logs = np.log(np.maximum(signals[kept], floor)).ravel()
    centres = chart_units(chart)
    position = np.repeat(centres[kept] / centres.max(), bands, axis=0)
    terms = np.column_stack([np.log(reference[kept]).ravel(),
                             np.tile(np.eye(bands), (int(kept.sum()), 1)), position])
    solution = np.linalg.lstsq(terms, logs, rcond=None)[0]
    contrast = float(solution[0])
    if contrast <= MIN_CONTRAST:
        return np.inf, contrast
    fitting = np.sort(np.abs(logs - terms @ solution))[:int((1 - LEFT_OUT) * logs.size)]
    return float(np.sqrt(np.mean(fitting**2))) / contrast, contrast


def veil_fit(signals: np.ndarray, reference: np.ndarray, chart: Chart,
             contrast: float | None = None,
             excluded: np.ndarray | None = None) -> tuple[float, float, float]:
    """Veiling glare as a share of the brightest patch, the power of the light beneath it, and the
    relative rms misfit, the worst tenth left out.

    signal = gain of the band x plane in x, y x reference ** contrast + veil x brightest, with
    relative errors that count less beyond twice their median. A veil lifts dark patches and leaves
    bright ones as they are; a tone curve changes every ratio.

    Parameters
    ----------
    signals : (I, K) array
        In chart order.
    reference : (I, K) array
        Signals that an ordinary camera would read.
    chart : Chart
    contrast : float or None
        Where it is known: 1 of a camera raw.
    excluded : (I,) bool array, optional
        As of ``chart_agreement``.
    """
    kept, centres = _kept(chart, excluded), chart_units(chart)
    signals, reference, position = signals[kept], reference[kept], centres[kept] / centres.max()
    # a band may be dark
    brightest = np.maximum(signals.max(axis=0), 1e-6 * signals.max())
    measured = np.maximum(signals, 1e-3 * brightest)
    logs = np.log(reference).ravel()
    terms = np.column_stack([np.tile(np.eye(signals.shape[1]), (len(signals), 1)),
                             np.repeat(position, signals.shape[1], axis=0)])
    known = np.zeros(logs.size) if contrast is None else contrast * logs
    if contrast is None:
        terms = np.column_stack([terms, logs])
    best = (0.0, 1.0, np.inf)
    for veil in VEILS:
        bare = np.maximum(measured - veil * brightest, 1e-3 * brightest)
        # of the logarithm of what is left once the veil is off, in relative errors of the signal
        share, weights, error = (bare / measured).ravel(), np.ones(logs.size), np.zeros(logs.size)
        for _ in range(MIXTURE_STEPS):
            weighted = share * np.sqrt(weights)
            solution = np.linalg.lstsq(terms * weighted[:, None],
                                       (np.log(bare).ravel() - known) * weighted, rcond=None)[0]
            error = np.exp(known + terms @ solution) / measured.ravel() + (
                veil * brightest / measured).ravel() - 1
            weights = _huber_weights(np.abs(error))
        fitting = np.sort(np.abs(error))[:int((1 - LEFT_OUT) * error.size)]
        misfit = float(np.sqrt(np.mean(fitting**2)))
        if misfit < best[2]:
            best = (float(veil), float(solution[-1]) if contrast is None else contrast, misfit)
    return best


def _mixture_fit(signals: np.ndarray, reference: np.ndarray, contrast: float, chart: Chart,
                 kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Relative misfit (I,) of each patch and the light (I,) on it, bands mixing the reference's.

    Alternates between the mixture, by least squares of relative errors in which misfits count less
    (Huber's weights at twice the median), and a light that changes exponentially across the chart.
    """
    brightest = signals[kept].max(axis=0)
    # a band may be dark
    floor = 1e-3 * np.maximum(brightest, max(1e-6 * brightest.max(), np.finfo(float).tiny))
    linear = np.maximum(signals, floor) ** (1 / contrast)
    darkest = DARKEST_SHARE * linear[kept].max(axis=0)
    light, centres = np.ones(len(linear)), chart_units(chart)
    weights = np.repeat(kept[:, None].astype(float), linear.shape[1], axis=1)
    plane = np.column_stack([np.ones(len(linear)), (centres - centres.mean(axis=0))
                             / centres.max()])
    error = np.zeros_like(linear)
    for _ in range(MIXTURE_STEPS):
        predicted = _mixed_bands(linear, light[:, None] * reference, weights, darkest)
        error = (linear - predicted) / (np.abs(predicted) + darkest)
        error[~kept] = 0
        weights = kept[:, None] * _huber_weights(np.abs(error), kept)
        ratio = np.log(linear.sum(axis=1) / np.maximum(predicted.sum(axis=1), darkest.sum() / 100))
        near = kept & (np.abs(ratio) <= np.quantile(np.abs(ratio[kept]), 1 - LEFT_OUT))
        slope = np.linalg.lstsq(plane[near], ratio[near], rcond=None)[0]
        light = light * np.exp(plane[:, 1:] @ slope[1:])
    return np.sqrt(np.mean(error**2, axis=1)), light


def _mixed_bands(signals: np.ndarray, illuminated: np.ndarray, weights: np.ndarray,
                 darkest: np.ndarray) -> np.ndarray:
    """Signals (I, K) predicted by mixing the bands of the reference under the light (I, K), by
    weighted least squares of relative errors; band by band where there are not three.
    """
    predicted = np.empty_like(signals)
    for band in range(signals.shape[1]):
        columns = (illuminated if illuminated.shape[1] == MIXED_BANDS
                   else illuminated[:, band:band + 1])
        weight = weights[:, band] / (signals[:, band] + darkest[band])
        mixture = np.linalg.lstsq(columns * weight[:, None], signals[:, band] * weight,
                                  rcond=None)[0]
        predicted[:, band] = columns @ mixture
    return predicted


def _huber_weights(misfit: np.ndarray, kept: np.ndarray | None = None) -> np.ndarray:
    """Weights by which misfits beyond twice their median count less."""
    median = np.median(misfit if kept is None else misfit[kept])
    return np.asarray(1 / np.maximum(1, misfit / (2 * median + np.finfo(float).tiny)))


def white_excess(signals: np.ndarray, reference: np.ndarray, light: np.ndarray,
                 white: int = CLASSIC.neutrals[0],
                 excluded: np.ndarray | None = None) -> np.ndarray:
    """White light (I,) added to each patch, as a share of the white patch's signal: glare.

    The least of the bands counts: a reflection of the lamp adds to all of them. Where the whole
    chart is veiled the mixture takes up part of it, so that veiling glare is underestimated.

    Parameters
    ----------
    signals : (I, K) array
        Linear, in chart order.
    reference : (I, K) array
        Signals that an ordinary camera would read.
    light : (I,) array
        On each patch, as ``Agreement.light``.
    white : int
        Index of the white patch.
    excluded : (I,) bool array, optional
        Patches of which nothing is said.
    """
    kept = np.ones(len(signals), bool) if excluded is None else ~excluded
    illuminated, brightest = light[:, None] * reference, signals[white]
    darkest = DARKEST_SHARE * brightest
    weights = np.repeat(kept[:, None].astype(float), signals.shape[1], axis=1)
    excess = np.zeros_like(signals)
    for _ in range(MIXTURE_STEPS):
        excess = signals - _mixed_bands(signals, illuminated, weights, darkest)
        weights = kept[:, None] * _huber_weights(np.abs(excess) / (np.abs(signals) + darkest), kept)
    return np.where(kept, np.maximum((excess / brightest).min(axis=1), 0.0), 0.0)
