"""CIELAB and CIEDE2000 of many colours at once [CIE 15:2018; Sharma, Wu & Dalal 2005]."""
from __future__ import annotations

import numpy as np

DARK = (6 / 29) ** 3


def lab_from_xyz(xyz: np.ndarray, white: np.ndarray) -> np.ndarray:
    """L*, a*, b* (..., 3) of tristimulus values.

    Parameters
    ----------
    xyz : (..., 3) array
    white : (3,) array
        Tristimulus values of the perfect reflector under the same light.
    """
    share = xyz / white
    cubic = np.where(share > DARK, np.cbrt(share), share * (29 / 6) ** 2 / 3 + 4 / 29)
    x, y, z = np.moveaxis(cubic, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def ciede2000(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """CIEDE2000 (...), all weights 1; symbols as in Sharma et al., Eqs. 2-22.

    Parameters
    ----------
    first, second : (..., 3) arrays
        L*, a*, b*; the difference is the same in both orders.
    """
    (L1, a1, b1), (L2, a2, b2) = (np.moveaxis(np.asarray(lab, dtype=float), -1, 0)
                                  for lab in (first, second))
    C_mean = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    G = 0.5 * (1 - np.sqrt(C_mean**7 / (C_mean**7 + 25.0**7)))
    a1, a2 = (1 + G) * a1, (1 + G) * a2
    C1, C2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = np.degrees(np.arctan2(b1, a1)) % 360, np.degrees(np.arctan2(b2, a2)) % 360
    grey = C1 * C2 == 0
    turn = np.where(grey, 0.0, (h2 - h1 + 180) % 360 - 180)
    dL, dC, dH = L2 - L1, C2 - C1, 2 * np.sqrt(C1 * C2) * np.sin(np.radians(turn / 2))
    L, C = (L1 + L2) / 2, (C1 + C2) / 2
    far = np.abs(h1 - h2) > 180
    h = np.where(grey, h1 + h2, (h1 + h2 + np.where(far, np.where(h1 + h2 < 360, 360, -360), 0))
                 / 2)
    T = (1 - 0.17 * np.cos(np.radians(h - 30)) + 0.24 * np.cos(np.radians(2 * h))
         + 0.32 * np.cos(np.radians(3 * h + 6)) - 0.20 * np.cos(np.radians(4 * h - 63)))
    S_L = 1 + 0.015 * (L - 50) ** 2 / np.sqrt(20 + (L - 50) ** 2)
    S_C, S_H = 1 + 0.045 * C, 1 + 0.015 * C * T
    R_C = 2 * np.sqrt(C**7 / (C**7 + 25.0**7))
    R_T = -np.sin(np.radians(60 * np.exp(-(((h - 275) / 25) ** 2)))) * R_C
    l_term, c_term, h_term = dL / S_L, dC / S_C, dH / S_H
    return np.sqrt(l_term**2 + c_term**2 + h_term**2 + R_T * c_term * h_term)
