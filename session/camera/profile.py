"""What ``spectrabox camera profile`` answers: matrices of a camera with their spread over draws,
and its colour profile under one light.
"""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.camera_profile import ILLUMINANTS, IlluminantMatrices
from spectrabox.capture.photo.raw import decode
from spectrabox.measure.camera import FITTED_SET, FRESH_SET, camera_profile
from spectrabox.measure.profiles.colour_profile import (
    ColourProfile,
    colour_profile,
    response_of_curves,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.profiles.profile_files import FORMS as PROFILE_FORMS
from spectrabox.radiometry.profiles.profile_files import write_profile
from spectrabox.radiometry.records import WavelengthGrid
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities
from spectrabox.radiometry.system.archives import DAMAGE
from spectrabox.session.camera.profile_files import write_dcp, write_rawtoaces, write_vkdt
from spectrabox.session.commands.requests import CameraProfileRequest

MAX_DRAWS = 200             # of those in a file
FORMS = PROFILE_FORMS | {".json": "curves as rawtoaces stores them",
                         ".txt": "curves as vkdt reads them", ".dcp": "a DNG camera profile"}


def profile_answer(request: CameraProfileRequest) -> tuple[dict[str, Any], str]:
    """JSON object and text; writes the files that are asked for.

    Raises
    ------
    InputError
        If the curves are not those of three bands, or the draws are of others.
    """
    grid = visible_grid(5)
    curves = sensitivities(request.sensitivity, grid)
    if len(curves) != 3:
        raise InputError(f"{request.sensitivity} has {len(curves)} bands; profiles are of three: "
                         "R, G and B")
    draws = None if request.draws_file is None else _read_draws(request.draws_file, grid, curves)
    profile = camera_profile(curves, grid, request.idt_light, draws)
    maker, _, model = request.camera.partition(" ")
    errors = None if draws is None else draws.std(axis=0, ddof=1)
    power = light(request.light, grid)
    colours = colour_profile(
        response_of_curves(curves, power, grid),
        None if draws is None else response_of_curves(draws, power, grid),
        request.family, None if request.raw is None else _own_matrix(request.raw))
    for path in request.out:
        if path.suffix.lower() == ".json":
            write_rawtoaces(path, maker, model or maker, grid.nm, curves, errors)
        elif path.suffix.lower() == ".txt":
            write_vkdt(path, grid.nm, curves)
        elif path.suffix.lower() in PROFILE_FORMS:
            write_profile(path, f"{request.camera} {request.light}", colours.matrix.coefficients,
                          colours.table.xyz)
        else:
            write_dcp(path, request.camera, f"{request.camera} spectrabox", profile.matrices)
    facts: dict[str, Any] = {
        "camera": request.camera, "files": [str(path) for path in request.out],
        "draws": 0 if draws is None else len(draws),
        "illuminants": {name: _facts(profile.matrices[name], profile.drawn[name])
                        for name in ILLUMINANTS},
        "aces_idt": {"light": request.idt_light, "draws": len(profile.aces_drawn),
                     **{name: _spread(profile.aces[index],
                                      [each[index] for each in profile.aces_drawn])
                        for index, name in enumerate(("matrix", "white_balance"))}},
        "colour": {"light": request.light, "delta_e00": colour_facts(colours)}}
    return facts, _text(facts)


def colour_facts(profile: ColourProfile) -> dict[str, Any]:
    """Errors of a profile by transform and set of surfaces, each with its spread."""
    return {name: {of: {"mean": {"value": one.mean, "standard_deviation": one.mean_spread},
                        "percentile_95": {"value": one.percentile_95,
                                          "standard_deviation": one.percentile_95_spread}}
                   for of, one in sets.items()} for name, sets in profile.errors.items()}


def error_lines(facts: dict[str, Any]) -> list[str]:
    """A line for each transform and set of ``colour_facts``."""
    return [f"  {name}, {of}: mean {_with_spread(one['mean'])}, 95 % below "
            f"{_with_spread(one['percentile_95'])}"
            for name, sets in facts.items() for of, one in sets.items()]


def _with_spread(number: dict[str, Any]) -> str:
    spread = number["standard_deviation"]
    return f"{number['value']:.2f}" + ("" if spread is None else f" ± {spread:.2f}")


def _own_matrix(photo: Path) -> np.ndarray:
    """The matrix (3, 3) from X, Y, Z by which LibRaw knows the camera of a raw file, or a DNG's."""
    matrix = decode(photo).camera_from_xyz
    if matrix is None:
        raise InputError(f"{photo.name} states no colour matrix for daylight, and LibRaw has none "
                         "for its camera; leave --raw out")
    return matrix


def _read_draws(path: Path, grid: WavelengthGrid, curves: np.ndarray) -> np.ndarray:
    """Draws (T, 3, P) on the grid, the first few."""
    try:
        with np.load(path, allow_pickle=False) as file:
            nm, values = file["wavelengths_nm"], file["curves"][:MAX_DRAWS]
    except FileNotFoundError:
        raise InputError(f"{path} is missing; 'spectrabox camera fit --draws-file' writes one"
                         ) from None
    except DAMAGE as error:
        raise InputError(f"{path.name} holds no draws of curves ({type(error).__name__}); "
                         "'spectrabox camera fit --draws-file' writes them") from None
    if values.ndim != 3 or values.shape[1:] != (len(curves), nm.size) or len(values) < 2 \
            or nm[0] > grid.nm[0] or nm[-1] < grid.nm[-1] or not np.all(np.isfinite(values)):
        raise InputError(f"{path.name} holds draws {values.shape}; two or more of three curves "
                         "over 400-700 nm are needed, as 'camera fit --draws-file' writes them")
    return np.array([[np.interp(grid.nm, nm, curve) for curve in draw] for draw in values])


def _facts(fitted: IlluminantMatrices, drawn: Sequence[IlluminantMatrices]) -> dict[str, Any]:
    return {"color_matrix": _spread(fitted.colour, [each.colour for each in drawn]),
            "forward_matrix": _spread(fitted.forward, [each.forward for each in drawn]),
            "delta_e00": {name: _spread(fitted.delta_e00[index],
                                        [each.delta_e00[index] for each in drawn])
                          for index, name in enumerate((FITTED_SET, FRESH_SET))}}


def _spread(value: Any, drawn: Sequence[Any]) -> dict[str, Any]:
    """A value with its standard deviation over draws, where there are any."""
    deviation = np.std(drawn, axis=0, ddof=1).tolist() if len(drawn) > 1 else None
    return {"value": np.asarray(value).tolist(), "standard_deviation": deviation}


def _text(facts: dict[str, Any]) -> str:
    lines = [f"{facts['camera']}: matrices for {' and '.join(facts['illuminants'])}"
             + (f", spread over {facts['draws']} draws of the curves" if facts["draws"]
                else "; without --draws-file their spread is not known")]
    for name, each in facts["illuminants"].items():
        lines += [f"ColorMatrix, {name}", *_rows(each["color_matrix"]), f"ForwardMatrix, {name}",
                  *_rows(each["forward_matrix"])]
        lines += [f"CIEDE2000 of the forward matrix under {name}, mean of {of}: "
                  f"{error['value']:.2f}" + ("" if error["standard_deviation"] is None
                                             else f" ± {error['standard_deviation']:.2f}")
                  for of, error in each["delta_e00"].items()]
    lines += [f"CIEDE2000 under {facts['colour']['light']} to D50",
              *error_lines(facts["colour"]["delta_e00"])]
    idt = facts["aces_idt"]
    lines += [f"ACES IDT, {idt['light']}", *_rows(idt["matrix"]),
              *(f"wrote {path}" for path in facts["files"])]
    return "\n".join(lines)


def _rows(matrix: dict[str, Any]) -> list[str]:
    value, deviation = np.array(matrix["value"]), matrix["standard_deviation"]
    shown = [" ".join(f"{cell:8.4f}" for cell in row) for row in value]
    if deviation is not None:
        shown = [f"{row}   ± " + " ".join(f"{cell:.4f}" for cell in spread)
                 for row, spread in zip(shown, deviation, strict=True)]
    return [f"  {row}" for row in shown]
