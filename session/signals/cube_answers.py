"""What ``spectrabox judge`` answers: a hyperspectral picture, its regions and truths in, measures
and a table out.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import grid_from_nm, visible_grid
from spectrabox.radiometry.records import Quantity, SpectralMeasurement
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.spectrum_files import (
    SpectralTable,
    column_index,
    on_grid,
    spectrum_of,
    table_text,
)
from spectrabox.sampling.judge.cube_regions import Region, RegionSpectra, region_spectra
from spectrabox.sampling.judge.cubes import Cube
from spectrabox.sampling.judge.judgement import beside, judged, judgement_text, means
from spectrabox.sampling.prior.mixture import GRID, load_prior
from spectrabox.session.signals.signal_options import measurement_of_signal

IMPORTED = "imported picture"
# a truth or picture may end this far inside 400-700 nm; it is judged where it is known
END_GAP_NM = 20.0
LARGEST_MEAN = 2.0          # of a reflectance; more is counts or radiance


@dataclass(frozen=True)
class JudgeRequest:
    """The options of ``spectrabox judge``."""

    column: str | None
    full_scale: float
    white_region: str | None
    sensitivity: str
    light: str
    lights: tuple[str, ...]
    draws: int
    seed: int
    coefficients: int
    baseline: bool
    prior: Path | None
    # (K,) each, in the order of the regions; None: those of the truths
    signals: Sequence[np.ndarray] | None = None
    white: str | None = None
    noise: str | None = None


def judge_answer(cube: Cube, regions: list[Region], truths: SpectralTable | None,
                 request: JudgeRequest) -> tuple[dict[str, Any], str, str]:
    """JSON object, text and a CSV of the regions' spectra.

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
    found = region_spectra(cube, regions, request.full_scale, request.seed)
    found = relative_to_white(cube, found, truths, request)
    largest = max(float(one.mean.max()) for one in found)
    if largest > LARGEST_MEAN:
        raise InputError(f"the mean of a region of {cube.file} is {largest:.3g}, no reflectance; "
                         "give what reflectance 1 reads with --full-scale, or a region of known "
                         "reflectance with --white-region")
    rows = [] if truths is None else judge_regions(cube, found, truths, request)
    facts = [{"name": one.region.name, "pixels": one.pixels, "left_out": one.left_out,
              "mean": one.mean.tolist(), "standard_deviation": one.standard_deviation.tolist(),
              "judged": {row["method"]: {key: value for key, value in row.items()
                                         if key not in ("region", "method")} for row in rows
                         if row["region"] == one.region.name}} for one in found]
    overall = means(rows, request.lights)
    return {"cube": cube.file, "wavelengths_nm": cube.nm.tolist(), "regions": facts, "lights": list(request.lights),
            "means": {row["method"]: {key: row[key] for key in row if key not in ("region", "method")}
                      for row in overall}}, \
        _text(cube, found, rows + (overall if len(found) > 1 else []), request), spectra_csv(cube, found)


def judge_regions(cube: Cube, found: list[RegionSpectra], truths: SpectralTable,
                  request: JudgeRequest) -> list[dict[str, Any]]:
    """Rows of measures: every region's spectrum in the picture, then our methods on the truth's own
    signal.
    """
    fine = visible_grid(1)
    relative_response = named_spectra.relative_response(request.sensitivity, request.light, fine)
    prior, bands = load_prior(request.prior), len(relative_response)
    if request.signals is not None and len(request.signals) != len(found):
        raise InputError(f"{len(request.signals)} signals were given for {len(found)} regions; "
                         "give one row a region, in their order")
    rows = []
    for index, one in enumerate(found):
        truth_nm, truth = truth_of(truths, one.region, request.column)
        nm = common_wavelengths(cube, truth_nm, truths.file)
        grid = grid_from_nm(nm)
        mine = on_grid(cube.nm, np.vstack([one.mean[None], one.spectra]), grid, cube.file)
        expected = on_grid(truth_nm, truth, grid, truths.file)
        if request.signals is None:
            own = relative_response @ held(truth_nm, truth, fine.nm)
            measurement = SpectralMeasurement(fine, relative_response, own, np.zeros((bands, bands)))
        else:
            measurement = measurement_of_signal(relative_response, request.signals[index], request.white,
                                                request.noise)
        judgements = {IMPORTED: judged(nm, expected, mine[0], request.lights, mine[1:])}
        judgements |= beside(measurement, nm, expected, request.lights, request.draws, request.seed,
                             request.coefficients, prior, request.baseline)
        rows += [{"region": one.region.name, "method": method, **measures} for method,
                 measures in judgements.items()]
    return rows


def relative_to_white(cube: Cube, found: list[RegionSpectra], truths: SpectralTable | None,
                      request: JudgeRequest) -> list[RegionSpectra]:
    """The spectra divided by those of the white region times its truth (1 where there is none)."""
    if request.white_region is None:
        return found
    white = next((one for one in found if one.region.name == request.white_region), None)
    if white is None:
        raise InputError(f"--white-region {request.white_region!r} is no region; there are "
                         f"{', '.join(one.region.name for one in found)}")
    if white.mean.min() <= 0:
        raise InputError(f"region {request.white_region!r} reads {white.mean.min():.3g} at one "
                         "wavelength; white must be above 0 everywhere")
    known = np.ones(cube.nm.size)
    if truths is not None:
        known = held(*truth_of(truths, white.region, None), cube.nm)
    factor = known / white.mean
    return [RegionSpectra(one.region, one.pixels, one.left_out, one.mean * factor,
                          one.standard_deviation * factor, one.spectra * factor) for one in found]


def truth_of(truths: SpectralTable, region: Region, column: str | None) -> tuple[np.ndarray,
                                                                                 np.ndarray]:
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
    nm = GRID.nm[(GRID.nm >= low - 1e-6) & (GRID.nm <= high + 1e-6)]
    if nm.size < 2 or nm[0] > GRID.nm[0] + END_GAP_NM or nm[-1] < GRID.nm[-1] - END_GAP_NM:
        raise InputError(f"{cube.file} covers {cube.nm[0]:g}-{cube.nm[-1]:g} nm and {name} "
                         f"{truth_nm[0]:g}-{truth_nm[-1]:g} nm; to be judged both must reach from "
                         "420 to 680 nm")
    return nm


def held(nm: np.ndarray, values: np.ndarray, wanted_nm: np.ndarray) -> np.ndarray:
    """Values at wanted wavelengths, the first and the last held beyond the ends."""
    if wanted_nm[0] >= nm[0] and wanted_nm[-1] <= nm[-1]:
        return on_grid(nm, values, grid_from_nm(wanted_nm), "")
    return np.interp(wanted_nm, nm, values)


def spectra_csv(cube: Cube, found: list[RegionSpectra]) -> str:
    """Mean and standard deviation of every region as a table of spectra."""
    columns: dict[str, np.ndarray] = {}
    for one in found:
        columns |= {one.region.name: one.mean,
                    f"{one.region.name} standard deviation": one.standard_deviation}
    return table_text(cube.nm, columns, quantity=Quantity.REFLECTANCE,
                      source=f"regions of {cube.file}")


def _text(cube: Cube, found: list[RegionSpectra], rows: list[dict[str, Any]],
          request: JudgeRequest) -> str:
    lines = [f"{cube.file}: {cube.width} x {cube.height} pixels, {cube.nm.size} wavelengths "
             f"{cube.nm[0]:g}-{cube.nm[-1]:g} nm"]
    lines += [f"{one.region.name}: {one.pixels} pixels, mean {one.mean.mean():.3f}, spread over "
              f"pixels {one.standard_deviation.mean():.3f}"
              + (f", {one.left_out} left out" if one.left_out else "")
              for one in found]
    if rows:
        lines += ["", judgement_text(rows, request.lights), "",
                  f"prior, uniform and paper saw {_seen(request)}. The band of the picture is the "
                  "scatter of its pixels (1000 at least). scaled: RMSE after the one best factor."]
    return "\n".join(lines)


def _seen(request: JudgeRequest) -> str:
    if request.signals is not None:
        return "the signals that were given"
    return f"the signal that the truth gives {request.sensitivity} under {request.light}, without noise"
