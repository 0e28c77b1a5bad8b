"""What ``spectrabox judge`` answers: a hyperspectral picture, its regions and truths in, measures
and a table out.
"""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.photo.image_files import open_channels, read_plane
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import grid_from_nm, visible_grid
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.formats.spectral_exr import MAGIC
from spectrabox.radiometry.spectra.spectrum_files import (
    SpectralTable,
    column_index,
    on_grid,
    read_table,
    spectrum_of,
)
from spectrabox.sampling.judge.cube_files import open_cube
from spectrabox.sampling.judge.cube_regions import (
    Region,
    RegionSpectra,
    point_region,
    read_regions,
    region_spectra,
)
from spectrabox.sampling.judge.cubes import Cube, cube_of_channels, parse_wavelengths
from spectrabox.sampling.judge.judgement import beside, judged, judgement_text, means
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior, of_families
from spectrabox.session.commands.requests import JudgeRequest
from spectrabox.session.signals.signal_options import (
    measurement_of_signal,
    optional_numbers,
    read_signals,
)

IMPORTED = "imported picture"
# a truth or picture may end this far inside 400-700 nm; it is judged where it is known
END_GAP_NM = 20.0
MAX_MEAN = 2.0          # of a reflectance; more is counts or radiance


def judge_answer(request: JudgeRequest) -> tuple[dict[str, Any], str, dict[str, np.ndarray]]:
    """JSON object, text and the regions' spectra by their titles.

    With truths, our methods are judged beside the picture: on the signals of the regions where
    these are given, else on those that the truths give the stated camera under the stated light,
    without noise.

    Raises
    ------
    InputError
    """
    if not request.full_scale > 0:
        raise InputError(f"--full-scale {request.full_scale:g} cannot be; give what reflectance 1 "
                         "reads in the picture")
    cube = open_picture(request.cube, None if request.wavelengths is None
                        else parse_wavelengths(request.wavelengths), request.variable)
    regions = [point_region(text, cube.width, cube.height) for text in request.point]
    if request.regions is not None:
        regions += read_regions(request.regions, cube.width, cube.height,
                                lambda path: read_plane(path)[0])
    if not regions:
        raise InputError("no region was given; give --regions FILE.toml or --point x,y")
    truths = None if request.truth is None else read_table(request.truth)
    regions_read = region_spectra(cube, regions, request.full_scale, request.seed)
    regions_read = relative_to_white(cube, regions_read, truths, request)
    largest = max(float(region.mean.max()) for region in regions_read)
    if largest > MAX_MEAN:
        raise InputError(f"the mean of a region of {cube.file} is {largest:.3g}, no reflectance; "
                         "give what reflectance 1 reads with --full-scale, or a region of known "
                         "reflectance with --white-region")
    rows = [] if truths is None else judge_regions(cube, regions_read, truths, request)
    overall = means(rows, request.delta_light)
    facts = {"cube": cube.file, "wavelengths_nm": cube.nm.tolist(),
             "regions": [_region_facts(region, rows) for region in regions_read],
             "lights": list(request.delta_light),
             "means": {row["method"]: _measures(row) for row in overall}}
    shown = rows + (overall if len(regions_read) > 1 else [])
    return facts, _text(cube, regions_read, shown, request), spectra_columns(regions_read)


def open_picture(path: Path, wavelengths: np.ndarray | None, variable: str | None) -> Cube:
    """A hyperspectral picture of any known format, an EXR being one by what it begins with."""
    if path.is_file():
        with path.open("rb") as file:
            if file.read(len(MAGIC)) == MAGIC:
                return cube_of_channels(path.name, *open_channels(path))
    return open_cube(path, wavelengths, variable)


def judge_regions(cube: Cube, regions: list[RegionSpectra], truths: SpectralTable,
                  request: JudgeRequest) -> list[dict[str, Any]]:
    """Rows of measures: every region's spectrum in the picture, then our methods on the truth's own
    signal.

    Raises
    ------
    InputError
        If signals are given, and not one a region.
    """
    fine = visible_grid(1)
    relative_response = named_spectra.relative_response(request.sensitivity, request.light, fine)
    prior, bands = of_families(load_prior(request.prior), request.family), len(relative_response)
    signals = None if request.signals is None else read_signals(request.signals, bands)
    if signals is not None and len(signals) != len(regions):
        raise InputError(f"{len(signals)} signals were given for {len(regions)} regions; "
                         "give one row a region, in their order")
    white = optional_numbers(request.white, bands, "white")
    noise = optional_numbers(request.noise, bands, "noise")
    rows = []
    for index, region in enumerate(regions):
        truth_nm, truth = truth_of(truths, region.region, request.column)
        nm = common_wavelengths(cube, truth_nm, truths.file)
        grid = grid_from_nm(nm)
        mine = on_grid(cube.nm, np.vstack([region.mean[None], region.spectra]), grid, cube.file)
        expected = on_grid(truth_nm, truth, grid, truths.file)
        if signals is None:
            own = relative_response @ held(truth_nm, truth, fine.nm)
            measurement = measurement_of_signal(relative_response, own)
        else:
            measurement = measurement_of_signal(relative_response, signals[index], white, noise)
        judgements = {IMPORTED: judged(nm, expected, mine[0], request.delta_light, mine[1:])}
        judgements |= beside(measurement, nm, expected, request.delta_light, request.samples,
                             request.seed, request.coefficients, prior, request.baseline)
        rows += [{"region": region.region.name, "method": method, **measures}
                 for method, measures in judgements.items()]
    return rows


def relative_to_white(cube: Cube, regions: list[RegionSpectra], truths: SpectralTable | None,
                      request: JudgeRequest) -> list[RegionSpectra]:
    """The spectra divided by those of the white region times its truth (1 where there is none).

    Raises
    ------
    InputError
        If the white region is none of the regions, or not above 0 everywhere.
    """
    if request.white_region is None:
        return regions
    white = next((one for one in regions if one.region.name == request.white_region), None)
    if white is None:
        raise InputError(f"--white-region {request.white_region!r} is no region; there are "
                         f"{', '.join(region.region.name for region in regions)}")
    if white.mean.min() <= 0:
        raise InputError(f"region {request.white_region!r} reads {white.mean.min():.3g} at one "
                         "wavelength; white must be above 0 everywhere")
    known = np.ones(cube.nm.size)
    if truths is not None:
        known = held(*truth_of(truths, white.region, None), cube.nm)
    factor = known / white.mean
    return [replace(region, mean=region.mean * factor, spectra=region.spectra * factor,
                    standard_deviation=region.standard_deviation * factor) for region in regions]


def truth_of(truths: SpectralTable, region: Region,
             column: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths and values of a region's truth: the column it names, the one of its name, else
    the only one.
    """
    wanted = column or region.truth or (region.name if region.name in truths.names else None)
    chosen = truths.names[column_index(truths, wanted)]
    spectrum = spectrum_of(truths, role=Quantity.REFLECTANCE, column=chosen)
    return spectrum.grid.nm, spectrum.values


def common_wavelengths(cube: Cube, truth_nm: np.ndarray, name: str) -> np.ndarray:
    """Those of 400, 405 ... 700 nm that picture and truth both cover.

    Raises
    ------
    InputError
        If these do not reach from 420 to 680 nm.
    """
    low, high = max(cube.nm[0], truth_nm[0]), min(cube.nm[-1], truth_nm[-1])
    nm = PRIOR_GRID.nm[(PRIOR_GRID.nm >= low - 1e-6) & (PRIOR_GRID.nm <= high + 1e-6)]
    if nm.size < 2 or nm[0] > PRIOR_GRID.nm[0] + END_GAP_NM \
            or nm[-1] < PRIOR_GRID.nm[-1] - END_GAP_NM:
        raise InputError(f"{cube.file} covers {cube.nm[0]:g}-{cube.nm[-1]:g} nm and {name} "
                         f"{truth_nm[0]:g}-{truth_nm[-1]:g} nm; to be judged both must reach from "
                         "420 to 680 nm")
    return nm


def held(nm: np.ndarray, values: np.ndarray, wanted_nm: np.ndarray) -> np.ndarray:
    """Values at wanted wavelengths, the first and the last held beyond the ends."""
    if wanted_nm[0] >= nm[0] and wanted_nm[-1] <= nm[-1]:
        return on_grid(nm, values, grid_from_nm(wanted_nm), "")
    return np.interp(wanted_nm, nm, values)


def spectra_columns(regions: list[RegionSpectra]) -> dict[str, np.ndarray]:
    """Mean and standard deviation (P,) of every region, by the titles they get."""
    columns: dict[str, np.ndarray] = {}
    for region in regions:
        name = region.region.name
        columns |= {name: region.mean, f"{name} standard deviation": region.standard_deviation}
    return columns


def _measures(row: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in row.items() if key not in ("region", "method")}


def _region_facts(region: RegionSpectra, rows: list[dict[str, Any]]) -> dict[str, Any]:
    name = region.region.name
    return {"name": name, "pixels": region.pixels, "left_out": region.left_out,
            "mean": region.mean.tolist(), "standard_deviation": region.standard_deviation.tolist(),
            "judged": {row["method"]: _measures(row) for row in rows if row["region"] == name}}


def _text(cube: Cube, regions: list[RegionSpectra], rows: list[dict[str, Any]],
          request: JudgeRequest) -> str:
    lines = [f"{cube.file}: {cube.width} x {cube.height} pixels, {cube.nm.size} wavelengths "
             f"{cube.nm[0]:g}-{cube.nm[-1]:g} nm"]
    lines += [f"{region.region.name}: {region.pixels} pixels, mean {region.mean.mean():.3f}, "
              f"spread over pixels {region.standard_deviation.mean():.3f}"
              + (f", {region.left_out} left out" if region.left_out else "")
              for region in regions]
    if rows:
        seen = ("the signals that were given" if request.signals is not None else
                f"the signal that the truth gives {request.sensitivity} under {request.light}, "
                "without noise")
        lines += ["", judgement_text(rows, request.delta_light), "",
                  f"prior, uniform and paper saw {seen}. The band of the picture is the scatter of "
                  "its pixels (1000 at least). scaled: RMSE after the one best factor."]
    return "\n".join(lines)
