"""Signals of an ordinary camera for a ColorChecker Classic, to recognise one; not to measure with.

Values of ``radiometry.chart.typical_camera_signals`` for the reflectances "BabelColor Average"
under even light, a perfect reflector giving 1 in each band, so that detecting a chart does not wait
for the library of reflectances.
"""
from __future__ import annotations

import numpy as np

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


def typical_signals(bands: int) -> np.ndarray:
    """Reference signals (24, bands) of a Classic, dark skin first.

    Parameters
    ----------
    bands : int
        3 gives red, green and blue; any other number the grey level of each patch in every band.
    """
    if bands == TYPICAL_SIGNALS.shape[1]:
        return TYPICAL_SIGNALS
    return np.repeat(TYPICAL_SIGNALS.mean(axis=1, keepdims=True), bands, axis=1)
