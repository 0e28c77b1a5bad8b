"""Several exposures of one scene to one linear image, each where it is best.

Each photo is scaled to the exposure of the shortest, by the ratio that neighbouring exposures show
where both are well exposed: cameras round the times they state (1/125 s is 1/128 s). Unsaturated
samples are averaged with weights 1 / variance, the variance being that of the line read + gain x
signal at the common estimate, not at the sample's own value: weights that follow a sample's own
noise would pull the mean down. Neighbours of saturated pixels are left out too: charge spills over.
"""
from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import LinearImage

MAX_DISAGREEMENT = 0.05      # of the ratio of two exposures: stated times are rounded by 2.4 %
MAX_CURVATURE = 0.03         # between ratios of dark and bright halves: more is not linear
MIN_SIGNAL = 0.02            # of full scale, in the shorter: below, black-level errors disturb
MIN_READ_SIGMAS = 70.0       # 20 steps of the file where nothing but its steps makes read noise
MAX_FLOODED_SHARE = 0.25     # of the picture saturated in some band: charge spills everywhere
MIN_SHARED = 200             # samples seen well in both exposures


def merge_exposures(images: Sequence[LinearImage],
                    spills: bool = False) -> tuple[LinearImage, tuple[Finding, ...]]:
    """One image at the shortest exposure, and how well each pair of exposures agrees.

    Photos of the same exposure are averaged. A pixel is saturated where every exposure is; it then
    keeps the value of the shortest.

    Parameters
    ----------
    images : sequence of LinearImage
        Of one camera at one ISO and f-number.
    spills : bool
        Whether to leave out a pixel and its neighbours in all bands where one is saturated: for
        CCDs, whose charge spills into pixels of other colours, and for photos that were scaled
        down.

    Raises
    ------
    InputError
        If the photos differ in camera, ISO, f-number or size, or an exposure is unknown.
    CheckError
        If two exposures disagree by more than 5 %, or the ratio of dark and bright parts by more
        than 3 %.
    """
    if not images:
        raise InputError("no photo was given to merge")
    if len(images) == 1:
        return images[0], ()
    _require_one_setting(images)
    ordered = sorted(images, key=lambda image: image.exposure_s or 0.0)
    flooded = [image.source for image in ordered[1:] if spills
               and image.saturated.any(axis=2).mean() > MAX_FLOODED_SHARE]
    ordered = [image for image in ordered if image.source not in flooded]
    if len(ordered) == 1:
        return ordered[0], _left_out(flooded)
    agreements = [_agreement(a, b, spills) for a, b in itertools.pairwise(ordered)]
    findings = [finding for _, finding in agreements]
    scales = [1 / float(factor)
              for factor in np.cumprod([1.0, *(ratio for ratio, _ in agreements)])]
    expected = _exposure_weighted(ordered, scales, spills)
    total = np.zeros_like(expected)
    weight_sum = np.zeros_like(expected)
    for image, scale in zip(ordered, scales, strict=True):
        read, gain = variance_line(image)
        variance = (read + gain * np.maximum(expected / np.float32(scale),
                                             0)) * np.float32(scale**2)
        usable = ~near_saturated(image.saturated, spills)
        weight = (usable / np.maximum(variance, np.finfo(np.float32).tiny)).astype(np.float32)
        total += weight * image.signal * np.float32(scale)
        weight_sum += weight
    lost = (weight_sum == 0) & ordered[0].saturated
    # saturated next door even in the shortest, and still the best there is
    alone = (weight_sum == 0) & ~lost
    weight_sum[alone] = 1 / ordered[0].variance[alone]
    total[alone] = ordered[0].signal[alone] / ordered[0].variance[alone]
    safe = np.where(lost, 1, weight_sum)
    signal = np.where(lost, ordered[0].signal, total / safe).astype(np.float32)
    variance = np.where(lost, ordered[0].variance, 1 / safe).astype(np.float32)
    names = " + ".join(image.source for image in ordered)
    return dataclasses.replace(ordered[0], signal=signal, variance=variance, saturated=lost,
                               source=f"bracket of {names}"), (*findings, *_left_out(flooded))


def _left_out(flooded: Sequence[str]) -> tuple[Finding, ...]:
    return tuple(Finding("bracket.left-out", Severity.NOTE, source, {"limit": MAX_FLOODED_SHARE})
                 for source in flooded)


def variance_line(image: LinearImage) -> tuple[np.ndarray, np.ndarray]:
    """Read noise and gain (K,) of an image whose variance is read + gain x signal.

    Parameters
    ----------
    image : LinearImage
        As ``linear_image`` makes it.
    """
    bands = image.signal.shape[2]
    read, gain = np.empty(bands, np.float32), np.empty(bands, np.float32)
    stride = max(1, int(np.sqrt(image.signal[..., 0].size / 100_000)))
    for band in range(bands):
        # A mean of photos that were all saturated somewhere keeps the variance of one of them
        # there, off the line.
        kept = ~image.saturated[::stride, ::stride, band]
        kept |= not kept.any()
        signal = np.maximum(image.signal[::stride, ::stride, band][kept], 0).astype(float)
        variance = image.variance[::stride, ::stride, band][kept].astype(float)
        centred = signal - signal.mean()
        spread = float(centred @ centred)
        slope = float(centred @ variance) / spread if spread > 0 else 0.0
        gain[band] = max(slope, 0.0)
        read[band] = max(float(variance.mean()) - float(gain[band]) * float(signal.mean()),
                         float(np.finfo(np.float32).tiny))
    return read, gain


def near_saturated(saturated: np.ndarray, spills: bool = False) -> np.ndarray:
    """Saturated pixels (H, W, K) and their eight neighbours in the same band.

    Parameters
    ----------
    saturated : (H, W, K) bool array
    spills : bool
        Whether charge spills: then neighbours in all bands.
    """
    if spills:
        saturated = np.broadcast_to(saturated.any(axis=2, keepdims=True), saturated.shape)
    padded = np.pad(saturated, ((1, 1), (1, 1), (0, 0)))
    across = padded[:, :-2] | padded[:, 1:-1] | padded[:, 2:]
    return across[:-2] | across[1:-1] | across[2:]


def _exposure_weighted(images: Sequence[LinearImage], scales: Sequence[float],
                       spills: bool) -> np.ndarray:
    """Sum of unsaturated signals / sum of their exposures: no weight depends on a sample's
    noise.
    """
    total, exposure = np.zeros_like(images[0].signal), np.zeros_like(images[0].signal)
    for image, scale in zip(images, scales, strict=True):
        left_out = near_saturated(image.saturated, spills)
        total += np.where(left_out, 0, image.signal)
        exposure += np.where(left_out, 0, np.float32(1 / scale))
    return np.where(exposure > 0, total / np.where(exposure > 0, exposure, 1),
                    images[0].signal).astype(np.float32)


def _agreement(shorter: LinearImage, longer: LinearImage, spills: bool) -> tuple[float, Finding]:
    """Ratio of two exposures and how it was found; as stated where they share too few samples."""
    stated = float(longer.exposure_s or 1) / float(shorter.exposure_s or 1)
    read_sigma = np.sqrt(variance_line(shorter)[0])
    least = np.maximum(MIN_SIGNAL, MIN_READ_SIGMAS * read_sigma)
    usable = ~near_saturated(shorter.saturated | longer.saturated, spills)
    shared = usable & (longer.signal > least * np.float32(stated))
    if np.count_nonzero(shared) < MIN_SHARED:
        return stated, Finding("bracket.ratio-unknown", Severity.NOTE, values={
            "shorter": shorter.source, "longer": longer.source})
    a, b = shorter.signal[shared].astype(float), longer.signal[shared].astype(float)
    ratio = float(b.sum() / a.sum())
    pair = (f"{shorter.source} ({shorter.exposure_s:g} s) and {longer.source} "
            f"({longer.exposure_s:g} s)")
    if abs(ratio / stated - 1) > MAX_DISAGREEMENT:
        raise CheckError(f"the exposures {pair} differ by a factor of {ratio:.3f} in signal and "
                         f"{stated:.3f} in time; the light, the aperture or the scene changed "
                         "between them, or a file is not linear: take the bracket again on a "
                         "tripod, with manual exposure and steady light")
    order = np.argsort(b)  # of the longer one, which has less noise
    dark, bright = order[:b.size // 2], order[b.size // 2:]
    curvature = float(b[bright].sum() / a[bright].sum() / (b[dark].sum() / a[dark].sum()) - 1)
    if abs(curvature) > MAX_CURVATURE:
        raise CheckError(f"the exposures {pair} have a ratio that changes by {curvature:+.1%} from "
                         "dark to bright parts; the sensor or the file is not linear there: keep "
                         "the brightest parts below the clip point, give raw files, or subtract a "
                         "dark frame")
    return ratio, Finding("bracket.ratio", Severity.INFO, values={
        "shorter": shorter.source, "shorter_s": shorter.exposure_s, "longer": longer.source,
        "longer_s": longer.exposure_s, "measured": ratio, "stated": stated,
        "curvature": curvature})


def _require_one_setting(images: Sequence[LinearImage]) -> None:
    first = images[0]
    for other in images:
        if other.exposure_s is None:
            raise InputError(f"photo {other.source} does not state its exposure time; a bracket "
                             "needs it")
        for name, a, b in (("camera", first.camera, other.camera), ("ISO", first.iso, other.iso),
                           ("f-number", first.f_number, other.f_number),
                           ("size", first.signal.shape, other.signal.shape),
                           ("kind", first.kind.value, other.kind.value)):
            if a != b:
                raise InputError(f"photos {first.source} and {other.source} differ in {name} "
                                 f"({a or 'unknown'} and {b or 'unknown'}); a bracket is one "
                                 "camera at one setting, but for the exposure time")
