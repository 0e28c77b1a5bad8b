"""Matrices of a camera for other programs (DNG, ACES) and its colour profile under one light, each
with its spread over draws of the curves.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.calibrate.colour_profile import ILLUMINANTS, IlluminantMatrices, matrices, target
from spectrabox.measure.profiles.colour_profile import ColourProfile, Spread
from spectrabox.radiometry.colour_science import aces_idt
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.spectra.named_spectra import test_reflectances

FITTED_SET, FRESH_SET = "BabelColor Average", "CES99"   # the second is never seen by the fit
MAX_IDT_DRAWS = 25          # an ACES matrix takes a search for each


@dataclass(frozen=True)
class CameraMatrices:
    """Matrices of a camera for other programs, each with those of T draws of its curves."""

    fitted: dict[str, IlluminantMatrices]                       # by illuminant
    drawn: dict[str, tuple[IlluminantMatrices, ...]]
    aces: tuple[np.ndarray, np.ndarray]                         # matrix (3, 3), white balance (3,)
    aces_drawn: tuple[tuple[np.ndarray, np.ndarray], ...]
    idt_light: str
    draws: int

    def of_illuminant(self, name: str) -> IlluminantSpreads:
        """What a DNG profile states of an illuminant."""
        fitted, drawn = self.fitted[name], self.drawn[name]
        return IlluminantSpreads(
            spread_over(fitted.colour, [each.colour for each in drawn]),
            spread_over(fitted.forward, [each.forward for each in drawn]),
            {of: spread_over(fitted.delta_e00[index], [each.delta_e00[index] for each in drawn])
             for index, of in enumerate((FITTED_SET, FRESH_SET))})

    def aces_spreads(self) -> tuple[Spread, Spread]:
        """The ACES matrix and its white balance."""
        matrix, balance = (spread_over(self.aces[index], [each[index] for each in self.aces_drawn])
                           for index in (0, 1))
        return matrix, balance


@dataclass(frozen=True)
class IlluminantSpreads:
    """Matrices under an illuminant, and the mean CIEDE2000 of the forward matrix by set."""

    color_matrix: Spread
    forward_matrix: Spread
    delta_e00: dict[str, Spread]


def spread_over(value: np.ndarray | float, drawn: Sequence[np.ndarray | float]) -> Spread:
    """A value with its standard deviation over draws, where there are any."""
    deviation = np.std(np.array(drawn), axis=0, ddof=1) if len(drawn) > 1 else None
    return Spread(value, deviation)


def camera_matrices(curves: np.ndarray, grid: WavelengthGrid, idt_light: str,
                    draws: np.ndarray | None = None) -> CameraMatrices:
    """Colour matrices (DNG, ACES) of a camera.

    Parameters
    ----------
    curves : (3, P) array
        Sensitivities R, G, B on ``grid``, of any scale.
    grid : WavelengthGrid
    idt_light : str
        CIE name or file, of the ACES matrix.
    draws : (T, 3, P) array or None
        Of the curves, for the spread of every number.
    """
    each = () if draws is None else tuple(draws)
    sets = test_reflectances(grid)
    targets = {name: target(name, grid, sets[FITTED_SET], (sets[FITTED_SET], sets[FRESH_SET]))
               for name in ILLUMINANTS}
    return CameraMatrices(
        {name: matrices(curves, aim) for name, aim in targets.items()},
        {name: tuple(matrices(draw, aim) for draw in each) for name, aim in targets.items()},
        aces_idt(grid.nm, curves, idt_light),
        tuple(aces_idt(grid.nm, draw, idt_light) for draw in each[:MAX_IDT_DRAWS]), idt_light,
        len(each))


@dataclass(frozen=True)
class CameraProfile:
    """Matrices of a camera, and its colour profile under the light of its photos."""

    camera: str             # as its raw files name it
    matrices: CameraMatrices
    colours: ColourProfile
    light: str              # of the colour profile

    def facts(self) -> dict[str, object]:
        """As ``spectrabox camera profile --json`` names them."""
        matrix, balance = self.matrices.aces_spreads()
        return {"camera": self.camera, "draws": self.matrices.draws,
                "illuminants": {name: self.matrices.of_illuminant(name) for name in ILLUMINANTS},
                "aces_idt": {"light": self.matrices.idt_light,
                             "draws": len(self.matrices.aces_drawn), "matrix": matrix,
                             "white_balance": balance},
                "colour": {"light": self.light, "delta_e00": self.colours.facts()}}

    def text(self) -> str:
        """Matrices and colour errors, for a person."""
        known = (f", spread over {self.matrices.draws} draws of the curves" if self.matrices.draws
                 else "; without --draws-file their spread is not known")
        lines = [f"{self.camera}: matrices for {' and '.join(ILLUMINANTS)}{known}"]
        for name in ILLUMINANTS:
            one = self.matrices.of_illuminant(name)
            lines += [f"ColorMatrix, {name}", *matrix_rows(one.color_matrix),
                      f"ForwardMatrix, {name}", *matrix_rows(one.forward_matrix)]
            lines += [f"CIEDE2000 of the forward matrix under {name}, mean of {of}: {error.words}"
                      for of, error in one.delta_e00.items()]
        lines += [f"CIEDE2000 under {self.light} to D50", *self.colours.error_lines()]
        return "\n".join([*lines, f"ACES IDT, {self.matrices.idt_light}",
                          *matrix_rows(self.matrices.aces_spreads()[0])])


def matrix_rows(matrix: Spread) -> list[str]:
    """A matrix for a person, a line for each row, with its spread where that is known."""
    shown = [" ".join(f"{cell:8.4f}" for cell in row) for row in np.asarray(matrix.value)]
    if matrix.standard_deviation is not None:
        shown = [f"{row}   ± " + " ".join(f"{cell:.4f}" for cell in spread) for row, spread
                 in zip(shown, np.asarray(matrix.standard_deviation), strict=True)]
    return [f"  {row}" for row in shown]
