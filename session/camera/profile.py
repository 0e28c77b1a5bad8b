"""What ``spectrabox camera profile`` reads and writes: draws and a raw file, files of profiles."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.capture.photo.raw import decode
from spectrabox.measure.profiles.camera_profile import CameraProfile, camera_matrices
from spectrabox.measure.profiles.colour_profile import colour_profile, response_of_curves
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


def write_profiles(request: CameraProfileRequest) -> CameraProfile:
    """The profile of a camera, written to the files that are asked for.

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
    power = light(request.light, grid)
    profile = CameraProfile(
        request.camera, camera_matrices(curves, grid, request.idt_light, draws),
        colour_profile(response_of_curves(curves, power, grid),
                       None if draws is None else response_of_curves(draws, power, grid),
                       request.family, None if request.raw is None else _own_matrix(request.raw)),
        request.light)
    maker, _, model = request.camera.partition(" ")
    errors = None if draws is None else draws.std(axis=0, ddof=1)
    for path in request.out:
        if path.suffix.lower() == ".json":
            write_rawtoaces(path, maker, model or maker, grid.nm, curves, errors)
        elif path.suffix.lower() == ".txt":
            write_vkdt(path, grid.nm, curves)
        elif path.suffix.lower() in PROFILE_FORMS:
            write_profile(path, f"{request.camera} {request.light}",
                          profile.colours.matrix.coefficients, profile.colours.table.xyz)
        else:
            write_dcp(path, request.camera, f"{request.camera} spectrabox",
                      profile.matrices.fitted)
    return profile


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
