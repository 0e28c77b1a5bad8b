"""Where a sensor really clips, from the histogram: a stated white level may be wrong for this ISO.

Where light noise spreads one brightness over several DN, many samples at one DN at the very top of
the histogram, and few just below, can only be clipping.
"""
from __future__ import annotations

import numpy as np

from spectrabox.capture.photo.noise import PhotonTransfer
from spectrabox.radiometry.records import RawFrame

SAMPLES = 1_000_000          # of each colour, enough for a histogram
MIN_PILED = 50               # samples at the top
TIMES_BELOW = 10.0           # what a value just below holds on average
VALUES_BELOW = 16            # DN that are compared
MAX_SHARE_OF_PICTURE = 0.5   # a plain picture piles up without clipping
MIN_SIGMA_DN = 1.5           # noise that would have spread the pile


def clip_points(frame: RawFrame) -> np.ndarray:
    """DN (K,) at which each colour seems to clip: the white level, or a pile of samples below it.

    Parameters
    ----------
    frame : RawFrame
    """
    clips = []
    rows, columns = frame.cfa.shape
    for band in range(int(frame.cfa.max()) + 1):
        # about SAMPLES samples, from whole rows of tiles spread over the picture
        positions = np.argwhere(frame.cfa == band)
        stride = max(1, int(frame.mosaic.size * len(positions) / frame.cfa.size / SAMPLES))
        samples = np.concatenate([frame.mosaic[y::rows * stride, x::columns].ravel()
                                  for y, x in positions])
        counts = np.bincount(samples)
        top = counts.size - 1
        below = counts[max(top - VALUES_BELOW, 0):top]
        piled = (below.size and counts[top] >= MIN_PILED
                 and TIMES_BELOW * np.mean(below) < counts[top]
                 and counts[top] <= MAX_SHARE_OF_PICTURE * samples.size)
        clips.append(float(top) if piled and top < frame.white_level else float(frame.white_level))
    return np.array(clips)


def piles_up(frame: RawFrame, clip: float, band: int, noise: PhotonTransfer) -> bool:
    """Whether noise would have spread the samples at ``clip``, so that the pile is clipping.

    Parameters
    ----------
    frame : RawFrame
    clip : float
        DN.
    band : int
    noise : PhotonTransfer
    """
    if clip >= frame.white_level:
        return True
    chosen = frame.cfa == band
    scale = frame.white_level - float(frame.black_level[chosen].mean())
    level = (clip - float(frame.black_level[chosen].mean())) / scale
    return float(np.sqrt(noise.read[band] + noise.gain[band] * level)) * scale >= MIN_SIGMA_DN
