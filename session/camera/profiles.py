"""What ``spectrabox camera profile`` reads and writes: draws and a raw file, files of a camera for
other programs (ICC, OpenColorIO, rawtoaces JSON, vkdt's curves, a DNG camera profile).
"""
from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from spectrabox.calibrate.colour_profile import ILLUMINANTS
from spectrabox.capture.photo.raw import decode
from spectrabox.measure.profiles.camera_profile import CameraProfile
from spectrabox.measure.profiles.colour_profile import colour_profile, response_of_curves
from spectrabox.radiometry import files, profile_files
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.profile_files import FORMS as PROFILE_FORMS
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.spectra.named_spectra import light as light_named
from spectrabox.radiometry.spectra.named_spectra import sensitivities
from spectrabox.radiometry.system.archives import DAMAGE

NM = np.arange(380, 781, 5)         # of rawtoaces and of vkdt
BEYOND = "0 outside the wavelengths that were measured or fitted"
ASCII, SHORT, LONG, SIGNED_RATIO = 2, 3, 4, 10      # types of TIFF fields
DENOMINATOR = 10_000                # of a DNG's matrices, as Adobe writes them
UNRESTRICTED = 3                    # ProfileEmbedPolicy: no restrictions
MAX_DRAWS = 200             # of those in a file
FORMS = PROFILE_FORMS | {".json": "curves as rawtoaces stores them",
                         ".txt": "curves as vkdt reads them", ".dcp": "a DNG camera profile"}


def write_profiles(sensitivity: str, camera: str, out: Sequence[Path], light: str,
                   family: tuple[str, ...], raw: Path | None, draws_file: Path | None,
                   idt_light: str) -> CameraProfile:
    """The profile of a camera, written to the files that are asked for.

    Parameters
    ----------
    sensitivity, light, idt_light : str
        Curves by name or file; light of the photos; that of the ACES matrix.
    camera : str
        Maker and model.
    out : sequence of Path
        Files, by whose endings (`FORMS`) it is written.
    family : tuple of str
        What will be photographed; any where none is named.
    raw, draws_file : Path, optional
        A raw file of the camera; draws of its curves.

    Raises
    ------
    InputError
        If the curves are not those of three bands, or the draws are of others.
    """
    grid = visible_grid(5)
    curves = sensitivities(sensitivity, grid)
    if len(curves) != 3:
        raise InputError(f"{sensitivity} has {len(curves)} bands; profiles are of three: "
                         "R, G and B")
    draws = None if draws_file is None else _read_draws(draws_file, grid, curves)
    power = light_named(light, grid)
    colours = colour_profile(response_of_curves(curves, power, grid),
                             None if draws is None else response_of_curves(draws, power, grid),
                             family, None if raw is None else _own_matrix(raw))
    profile = CameraProfile(camera, curves, grid, idt_light, colours, light, draws)
    maker, _, model = camera.partition(" ")
    errors = None if draws is None else draws.std(axis=0, ddof=1)
    for path in out:
        if path.suffix.lower() == ".json":
            write_rawtoaces(path, maker, model or maker, grid.nm, curves, errors)
        elif path.suffix.lower() == ".txt":
            write_vkdt(path, grid.nm, curves)
        elif path.suffix.lower() in PROFILE_FORMS:
            profile_files.write_profile(path, f"{camera} {light}",
                          profile.colours.matrix.coefficients, profile.colours.table.xyz)
        else:
            write_dcp(path, camera, f"{camera} spectrabox",
                      {illuminant: (colour[0], forward[0])
                       for illuminant, (colour, forward, _) in profile.matrices.items()})
    return profile


def _own_matrix(photo: Path) -> np.ndarray:
    """The matrix (3, 3) from X, Y, Z by which LibRaw knows the camera of a raw file, or a DNG's."""
    matrix = decode(photo)[0].camera_from_xyz
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


def write_rawtoaces(path: Path, maker: str, model: str, nm: np.ndarray, curves: np.ndarray,
                    errors: np.ndarray | None) -> None:
    """Curves (3, P) as rawtoaces-data stores a camera, their error in the comments: rawtoaces takes
    the first wavelength of a second data set for a wrong step, and refuses the file.
    """
    comments = BEYOND if errors is None else (
        f"{BEYOND}; standard error {np.sqrt(np.mean(errors**2)) / curves.max():.1%} of the highest "
        "peak (root mean square over 400-700 nm)")
    document = {
        "header": {"schema_version": "0.1.0", "manufacturer": maker, "model": model,
                   "description": "camera spectral sensitivity data",
                   "document_creator": "spectrabox", "document_creation_date": None,
                   "measurement_equipment": None, "comments": comments, "license": None},
        "spectral_data": {"units": "relative", "index": {"main": ["R", "G", "B"]},
                          "data": {"main": {
                              str(point): [float(f"{value:.9g}") for value in row]
                              for point, row in zip(NM, _on_table(nm, curves).T, strict=True)}}}}
    files.write_text_whole(path, json.dumps(document, indent=4) + "\n")


def write_vkdt(path: Path, nm: np.ndarray, curves: np.ndarray) -> None:
    """Curves (3, P) as ``vkdt-mkclut`` reads them: wavelength, red, green, blue; no header."""
    files.write_text_whole(path, "".join(
        f"{point} " + " ".join(f"{value:.13f}" for value in row) + "\n"
        for point, row in zip(NM, (_on_table(nm, curves) / curves.max()).T, strict=True)))


def write_dcp(path: Path, camera: str, name: str,
              matrices: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """A DNG camera profile with the matrices of two illuminants (DNG specification 1.6).

    Parameters
    ----------
    camera : str
        UniqueCameraModel, as a DNG of the camera states it.
    name : str
        Of the profile, as a raw developer lists it.
    matrices : dict of colour and forward matrix
        By the names of ``ILLUMINANTS``.
    """
    (colour, forward), (other_colour, other_forward) = (
        matrices[illuminant] for illuminant in ILLUMINANTS)
    numbers = list(ILLUMINANTS.values())
    fields = {50708: _text(camera), 50721: _matrix(colour), 50722: _matrix(other_colour),
              50778: (SHORT, 1, struct.pack("<H", numbers[0])),
              50779: (SHORT, 1, struct.pack("<H", numbers[1])), 50936: _text(name),
              50941: (LONG, 1, struct.pack("<L", UNRESTRICTED)), 50942: _text("made by spectrabox"),
              50964: _matrix(forward), 50965: _matrix(other_forward)}
    with files.whole_file(path) as unfinished:
        unfinished.write_bytes(struct.pack("<4sL", b"IIRC", 8) + _directory(fields, 8))


def _on_table(nm: np.ndarray, curves: np.ndarray) -> np.ndarray:
    return np.array([np.interp(NM, nm, curve, left=0, right=0) for curve in curves])


def _text(words: str) -> tuple[int, int, bytes]:
    content = words.encode("utf-8") + b"\0"
    return ASCII, len(content), content


def _matrix(values: np.ndarray) -> tuple[int, int, bytes]:
    ratios = [Fraction(round(value * DENOMINATOR), DENOMINATOR) for value in values.ravel()]
    return SIGNED_RATIO, len(ratios), b"".join(
        struct.pack("<ll", ratio.numerator, ratio.denominator) for ratio in ratios)


def _directory(fields: dict[int, tuple[int, int, bytes]], offset: int) -> bytes:
    """One directory of a TIFF placed at ``offset``, its longer values after it."""
    behind = offset + 2 + 12 * len(fields) + 4
    entries, values = b"", b""
    for tag, (kind, count, content) in sorted(fields.items()):
        if len(content) > 4:
            pointer = struct.pack("<L", behind + len(values))
            values += content + bytes(len(content) % 2)
            content = pointer
        entries += struct.pack("<HHL", tag, kind, count) + content.ljust(4, b"\0")
    return struct.pack("<H", len(fields)) + entries + bytes(4) + values
