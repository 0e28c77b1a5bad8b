"""Statistics of the patches of a chart that was detected in a photo."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.errors import CheckError, ClippedPhotoError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records import photos, spectra

MIN_SAMPLES = 16
CLIP_SIGMA = 3.0
VARIANCE_LEFT_BY_CLIPPING = 0.9733  # of a normal distribution cut at 3 sigma
SIGMA_PER_MAD = 1.4826              # of a normal distribution
MAX_CLIPPED = 8                     # one patch in so many may be clipped in a band
MIN_BANDS = 3                       # that must be left


def sample_patches(image: photos.LinearImage,
                   detection: photos.ChartDetection) -> photos.PatchSamples:
    """Mean, covariance of the mean, saturation and gradient of each patch.

    Over the pixels whose centre lies in the quadrilateral: a plane is fitted to each band, pixels
    further than 3 sigma from it in any band are dropped (dust, glints), and the rest are averaged.
    The covariance of the mean is that of the residuals about the plane divided by their number, so
    uneven light does not count as noise.

    Parameters
    ----------
    image : LinearImage
    detection : ChartDetection

    Raises
    ------
    CheckError
        If a patch leaves the photo or holds fewer than 16 pixels.
    """
    return patches_and_excluded(image, detection)[0]


def patches_and_excluded(
        image: photos.LinearImage,
        detection: photos.ChartDetection) -> tuple[photos.PatchSamples, np.ndarray]:
    """As ``sample_patches``, and the share (I,) of samples left out as dust or glints.

    Parameters
    ----------
    image : LinearImage
    detection : ChartDetection
    """
    patches = [_one_patch(image, quad, number)
               for number, quad in enumerate(detection.corners_px, start=1)]
    mean, covariance, pixels, saturated, gradient, excluded = (
        np.array(column) for column in zip(*patches, strict=True))
    # how far matrices depart from fitted curves is known of LibRaw's alone
    known = None if image.matrix_of_file else image.camera_from_xyz
    return photos.PatchSamples(mean=mean, covariance_of_mean=covariance, pixels=pixels,
                        saturated_fraction=saturated, gradient=gradient,
                        camera_from_xyz=known, taken_at=image.taken_at), excluded


def clipped_bands(samples: photos.PatchSamples, neutrals: Sequence[int] = ()) -> np.ndarray:
    """Bands (K,) in which too little of a chart can be read: more than an eighth of its patches are
    clipped, or the two lightest neutrals.

    Parameters
    ----------
    samples : PatchSamples
    neutrals : sequence of int
        Indices of the neutral patches, the lightest first.
    """
    clipped = samples.clipped
    lost = clipped.sum(axis=0) > len(clipped) // MAX_CLIPPED
    return lost | clipped[list(neutrals[:2])].all(axis=0) if len(neutrals) else lost


def require_unclipped(samples: photos.PatchSamples, names: Sequence[str], photo_name: str,
                      neutrals: Sequence[int] = (), bands: Sequence[str] = (), *,
                      bands_may_drop: bool = False) -> tuple[Finding, ...]:
    """Refuse a chart photo whose clipped patches leave too little in a band (``clipped_bands``).

    Fewer clipped signals are left out of every fit, band by band (``PatchSamples.clipped``).

    Parameters
    ----------
    samples : PatchSamples
    names : sequence of I str
        Of the patches.
    photo_name : str
    neutrals : sequence of int
        Indices of the neutral patches, the lightest first.
    bands : sequence of K str
        Names of the bands; none: those of bands that nobody named.
    bands_may_drop : bool
        Whether the photo may lose bands, as long as three are left.

    Returns
    -------
    tuple of Finding
        One if bands are lost.

    Raises
    ------
    ClippedPhotoError
        Naming the clipped patches and, of more than three, the bands.
    """
    lost = clipped_bands(samples, neutrals)
    if not lost.any():
        return ()
    patches = [names[patch] for patch in
               np.flatnonzero(samples.clipped[:, lost].any(axis=1)).tolist()]
    lost_bands = np.array(bands or spectra.default_band_names(lost.size))[lost].tolist()
    if bands_may_drop and np.count_nonzero(~lost) >= MIN_BANDS:
        return (Finding("chart.bands-lost", Severity.NOTE, photo_name, {
            "bands": lost_bands, "names": patches, "clipped": len(patches),
            "patches": len(names)}),)
    which = f" of {', '.join(lost_bands)}" if lost.size > MIN_BANDS else ""
    raise ClippedPhotoError(
        f"chart photo {photo_name}: {len(patches)} of {len(names)} patches are saturated "
        f"({', '.join(patches)}); halve the exposure{which}")


def pixels_inside(quad_px: np.ndarray, sensor_step: float, height: int,
                  width: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the image pixels whose centre lies in a convex quadrilateral.

    Parameters
    ----------
    quad_px : (4, 2) array
        Corners in sensor pixels, in either sense.
    sensor_step : float
        Sensor pixels per image pixel.
    height, width : int
        Of the image.
    """
    corners = image_from_sensor(quad_px, sensor_step)
    last = np.array([width - 1, height - 1])
    # a quadrilateral may lie outside
    left, top = np.clip(np.ceil(corners.min(axis=0)), 0, last + 1).astype(int)
    right, bottom = np.clip(np.floor(corners.max(axis=0)), -1, last).astype(int)
    y, x = np.mgrid[top:max(bottom + 1, top), left:max(right + 1, left)]
    edges = np.roll(corners, -1, axis=0) - corners
    sides = [edge[0] * (y - corner[1]) - edge[1] * (x - corner[0])
             for corner, edge in zip(corners, edges, strict=True)]
    # either sense of turning
    inside = np.all(np.array(sides) >= 0, axis=0) | np.all(np.array(sides) <= 0, axis=0)
    return y[inside], x[inside]


def image_from_sensor(xy: np.ndarray, sensor_step: float) -> np.ndarray:
    """Image coordinates (..., 2); image pixel i is centred at (i + 0.5) x step - 0.5.

    Parameters
    ----------
    xy : (..., 2) array
        Sensor pixels.
    sensor_step : float
        Sensor pixels per image pixel.
    """
    return (np.asarray(xy, dtype=float) + 0.5) / sensor_step - 0.5


def sensor_from_image(xy: np.ndarray, sensor_step: float) -> np.ndarray:
    """Sensor pixels of points in image coordinates; undoes ``image_from_sensor``.

    Parameters
    ----------
    xy : (..., 2) array
        Image coordinates.
    sensor_step : float
        Sensor pixels per image pixel.
    """
    return (np.asarray(xy, dtype=float) + 0.5) * sensor_step - 0.5


def _one_patch(image: photos.LinearImage, quad_px: np.ndarray,
               number: int) -> tuple[np.ndarray, ...]:
    height, width = image.signal.shape[:2]
    corners = image_from_sensor(quad_px, image.sensor_step)
    if np.any(corners < -0.5) or np.any(corners > np.array([width, height]) - 0.5):
        raise CheckError(f"photo {image.source}: patch {number} of the chart lies partly outside "
                         "the photo; photograph the whole chart")
    y, x = pixels_inside(quad_px, image.sensor_step, height, width)
    if y.size < MIN_SAMPLES:
        raise CheckError(f"photo {image.source}: the chart is too small, patch {number} has "
                         f"{y.size} pixels and at least {MIN_SAMPLES} are needed; move the "
                         "camera closer")
    samples = image.signal[y, x].astype(float)
    terms = np.column_stack([np.ones(y.size), x - x.mean(), y - y.mean()])
    # Fitted to what lies near the median first: one glint must not tilt the plane.
    kept = _within(samples - np.median(samples, axis=0), image.variance[y, x], 2 * CLIP_SIGMA)
    plane = np.linalg.lstsq(terms[kept], samples[kept], rcond=None)[0]
    kept = _within(samples - terms @ plane, image.variance[y, x], CLIP_SIGMA)
    plane = np.linalg.lstsq(terms[kept], samples[kept], rcond=None)[0]
    mean = samples[kept].mean(axis=0)
    residuals = samples[kept] - terms[kept] @ plane
    scatter = residuals.T @ residuals / (residuals.shape[0]
                                         - terms.shape[1]) / VARIANCE_LEFT_BY_CLIPPING
    covariance = scatter / residuals.shape[0]
    # A dark patch may average near 0: relative to less than its own noise a gradient has no
    # meaning.
    least = np.maximum(np.sqrt(np.diag(covariance)), np.finfo(np.float32).tiny)
    gradient = np.ptp(terms @ plane, axis=0) / np.maximum(np.abs(mean), least)
    excluded = np.array(1 - residuals.shape[0] / samples.shape[0])
    return (mean, covariance, np.array(residuals.shape[0]), image.saturated[y, x].mean(axis=0),
            gradient, excluded)


def _within(residuals: np.ndarray, variance: np.ndarray, limit: float) -> np.ndarray:
    """Which samples lie within a limit, in sigma, of their median in every band."""
    centred = np.abs(residuals - np.median(residuals, axis=0))
    # The stated noise is the least sigma: where most samples share one DN the median deviation is
    # 0.
    sigma = np.maximum(SIGMA_PER_MAD * np.median(centred, axis=0),
                       np.sqrt(np.median(variance, axis=0)))
    return np.all(centred <= limit * sigma, axis=1)
