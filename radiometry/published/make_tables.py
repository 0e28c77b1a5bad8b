"""Copies the published tables from colour-science; run with python -m.

The same colour-science gives the same file, byte for byte.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.published.published_tables import (
    CHARTS,
    COLOURS,
    FILE,
    LIGHTS,
    OBSERVERS,
)

ALIASES = ("babel_average", "cc_ohta")  # second names of charts
# charts of which colours alone are published, and one whose colours others are compared with
COLOURED = ("ColorCheckerSG - After November 2014", "ColorChecker24 - Before November 2014",
            "ColorChecker24 - After November 2014")


def tables_of_colour_science() -> dict[str, np.ndarray]:
    """Every table by kind and name: (1 + K, P), wavelengths in nm first; of colours X, Y, Z."""
    import colour

    tables = {}
    for name, curves in {**colour.MSDS_CMFS, **colour.MSDS_CAMERA_SENSITIVITIES}.items():
        tables[f"{OBSERVERS}/{name}"] = np.vstack([curves.wavelengths, curves.values.T])
    for name, curve in {**colour.SDS_LIGHT_SOURCES, **colour.SDS_ILLUMINANTS}.items():
        tables[f"{LIGHTS}/{name}"] = np.vstack([curve.wavelengths, curve.values])
    for name, patches in {**colour.SDS_COLOURCHECKERS}.items():
        if name not in ALIASES:
            curves = list(patches.values())
            tables[f"{CHARTS}/{name}"] = np.vstack([curves[0].wavelengths,
                                                    *(patch.values for patch in curves)])
    for name in COLOURED:
        chart = colour.CCS_COLOURCHECKERS[name]
        tables[f"{COLOURS}/{name}"] = colour.xyY_to_XYZ(np.array(list(chart.data.values()))).T
    return tables


if __name__ == "__main__":
    np.savez_compressed(FILE, **tables_of_colour_science())  # type: ignore[arg-type]
