"""How spectra behind signals are drawn: options with their defaults.

The functions of the library and the options of the commands have their defaults from here, which
therefore imports nothing that computes.
"""
from __future__ import annotations

from dataclasses import dataclass

PIXEL_NOISE = 0.01      # relative standard error of a pixel of a picture that is uplifted

@dataclass(frozen=True)
class SampleOptions:
    """How to draw spectra.

    Attributes
    ----------
    method : {"prior", "uniform", "paper"}
    samples : int
        T, draws per signal; a 95 % band needs 1000 or more.
    seed : int
    coefficients : int
        N of the B-spline class: bounds, and the methods uniform and paper.
    level : float
        Of the band, 0 to 1.
    keep : int, optional
        Method paper: rank by the further measurements and keep so many (Eqs. 9, 10).
    refine : int, optional
        Coefficients of a finer basis with nested knots; uniform, or paper (Eqs. 11-16).
    """

    method: str = "prior"
    samples: int = 2000
    seed: int = 0
    coefficients: int = 13
    level: float = 0.95
    keep: int | None = None
    refine: int | None = None
