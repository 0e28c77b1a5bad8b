"""The answer of ``spectrabox judge``: a hyperspectral picture, its regions and truths in, measures
and a table out.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.capture.photo.image_files import read_plane
from spectrabox.measure.judgement import JudgeOptions, judge_picture, open_picture
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.sampling.judge.cube_regions import RegionSpectra, point_region, read_regions
from spectrabox.sampling.judge.cubes import Cube, parse_wavelengths
from spectrabox.sampling.judge.judgement import judgement_text
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.session.commands.requests import JudgeRequest
from spectrabox.session.signals.signal_options import optional_noise, optional_numbers, read_signals


def judge_answer(request: JudgeRequest) -> tuple[dict[str, Any], str, dict[str, np.ndarray]]:
    """JSON object, text and the regions' spectra by their titles.

    With truths, our methods are judged beside the picture: on the signals of the regions where
    these are given, else on those that the truths give the stated camera under the stated light,
    without noise.

    Raises
    ------
    InputError
    """
    cube = open_picture(request.cube, None if request.wavelengths is None
                        else parse_wavelengths(request.wavelengths), request.variable)
    regions = [point_region(text, cube.width, cube.height) for text in request.point]
    if request.regions is not None:
        regions += read_regions(request.regions, cube.width, cube.height,
                                lambda path: read_plane(path)[0])
    if not regions:
        raise InputError("no region was given; give --regions FILE.toml or --point x,y")
    response = named_spectra.relative_response(request.sensitivity, request.light, FINE_GRID)
    bands = len(response)
    judgement = judge_picture(
        cube, regions, None if request.truth is None else read_table(request.truth), response,
        of_families(load_prior(request.prior), request.family),
        JudgeOptions(request.delta_light, request.samples, request.seed, request.coefficients,
                     request.baseline, request.column, request.full_scale, request.white_region),
        signals=None if request.signals is None else read_signals(request.signals, bands),
        white=optional_numbers(request.white, bands, "white"),
        noise=optional_noise(request.noise, bands))
    facts = {"cube": cube.file, "wavelengths_nm": cube.nm,
             "regions": [_region_facts(region, judgement.rows) for region in judgement.regions],
             "lights": request.delta_light,
             "means": {row["method"]: _measures(row) for row in judgement.means}}
    rows = judgement.rows + (judgement.means if len(judgement.regions) > 1 else [])
    columns: dict[str, np.ndarray] = {}
    for region in judgement.regions:
        name = region.region.name
        columns |= {name: region.mean, f"{name} standard deviation": region.standard_deviation}
    return facts, _text(cube, judgement.regions, rows, request), columns


def _measures(row: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in row.items() if key not in ("region", "method")}


def _region_facts(region: RegionSpectra, rows: list[dict[str, Any]]) -> dict[str, Any]:
    name = region.region.name
    return {"name": name, "pixels": region.pixels, "left_out": region.left_out,
            "mean": region.mean, "standard_deviation": region.standard_deviation,
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
