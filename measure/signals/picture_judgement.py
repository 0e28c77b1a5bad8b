"""Spectra recovered by any method, judged by the same measures: one signal, or regions of a picture
beside our methods.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from spectrabox.measure.signals.options import JudgeOptions, SampleOptions
from spectrabox.measure.signals.sample import measurement_of_signal
from spectrabox.measure.signals.signal_estimate import SignalEstimate
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID, grid_from_nm
from spectrabox.radiometry.records.spectra import Quantity, SpectralMeasurement
from spectrabox.radiometry.spectra.spectrum_files import (
    SpectralTable,
    column_index,
    on_grid,
    spectrum_of,
)
from spectrabox.sampling.evaluation.cube_regions import CubeRegion, RegionSpectra, region_spectra
from spectrabox.sampling.evaluation.cubes import Cube
from spectrabox.sampling.evaluation.scores_by_method import (
    ScoredSpectrum,
    SpectrumScores,
    baselines,
    beside,
    judged,
    judgement_text,
    means,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture

IMPORTED = "imported picture"
# a truth or picture may end this far inside 400-700 nm; it is judged where it is known
END_GAP_NM = 20.0
MAX_MEAN = 2.0          # of a reflectance; more is counts or radiance


@dataclass(frozen=True, repr=False)
class PictureJudgement:
    """Spectra of R regions of a picture, and how near they and ours are to the truth.

    Attributes
    ----------
    cube : Cube
    regions : list of RegionSpectra
        Relative to white.
    scored, averages : lists of ScoredSpectrum
        By region and method, and averaged over the regions by method; none without truths.
    options : JudgeOptions
    given : bool
        Whether the signals that our methods saw were given.
    """

    cube: Cube
    regions: list[RegionSpectra]
    scored: list[ScoredSpectrum]
    averages: list[ScoredSpectrum]
    options: JudgeOptions
    given: bool

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Keys ``region``, ``method`` and the fields of SpectrumScores, for a table."""
        return [_row(one) for one in self.scored]

    @property
    def means(self) -> list[dict[str, Any]]:
        """One row a method, averaged over the regions."""
        return [_row(one) for one in self.averages]

    def facts(self) -> dict[str, object]:
        """As ``spectrabox judge --json`` names them."""
        return {"cube": self.cube.file, "wavelengths_nm": self.cube.nm,
                "regions": [{"name": one.region.name, "pixels": one.pixels,
                             "left_out": one.left_out, "mean": one.mean,
                             "standard_deviation": one.standard_deviation,
                             "judged": {row.method: row.scores for row in self.scored
                                        if row.region == one.region.name}}
                            for one in self.regions],
                "lights": self.options.lights,
                "means": {row.method: row.scores for row in self.averages}}

    def text(self) -> str:
        """Size, regions and scores, for a person."""
        cube = self.cube
        lines = [f"{cube.file}: {cube.width} x {cube.height} pixels, {cube.nm.size} wavelengths "
                 f"{cube.nm[0]:g}-{cube.nm[-1]:g} nm"]
        for one in self.regions:
            left_out = f", {one.left_out} left out" if one.left_out else ""
            lines.append(f"{one.region.name}: {one.pixels} pixels, mean {one.mean.mean():.3f}, "
                         f"spread over pixels {one.standard_deviation.mean():.3f}{left_out}")
        if self.scored:
            rows = self.scored + (self.averages if len(self.regions) > 1 else [])
            seen = "the signals that were given" if self.given else \
                f"the signal that the truth gives {self.options.camera}, without noise"
            lines += ["", judgement_text(rows), "",
                      f"prior, uniform and paper saw {seen}. The band of the picture is the "
                      "scatter of its pixels (1000 at least). scaled: RMSE after the one best "
                      "factor."]
        return "\n".join(lines)

    def columns(self) -> dict[str, np.ndarray]:
        """Mean and standard deviation over the pixels of each region, as columns of a table."""
        columns: dict[str, np.ndarray] = {}
        for one in self.regions:
            name = one.region.name
            columns |= {name: one.mean, f"{name} standard deviation": one.standard_deviation}
        return columns

    def __repr__(self) -> str:
        lines = [f"  {one.method}: RMSE {one.scores.rmse:.4f}" for one in self.averages]
        return "\n".join([f"<PictureJudgement of {len(self.regions)} regions>", *lines])


def _row(one: ScoredSpectrum) -> dict[str, Any]:
    return {"region": one.region, "method": one.method} | asdict(one.scores)


def compared(estimate: SignalEstimate, options: SampleOptions, truth: np.ndarray | None,
             lights: tuple[str, ...], with_baselines: bool) -> SignalEstimate:
    """The estimate beside other authors' spectra, and all of them judged where the truth is known.

    Parameters
    ----------
    estimate : SignalEstimate
        With draws.
    options : SampleOptions
        Of the estimate.
    truth : (61,) array, optional
        Reflectance at 400, 405 ... 700 nm.
    lights : names
        Of the colour differences.
    with_baselines : bool
        The greedy sampler has no draws for some signals that can be reached.
    """
    others = baselines(estimate.measurement, options.samples, options.seed, options.coefficients) \
        if with_baselines else {}
    scores = None
    if truth is not None:
        assert estimate.draws is not None
        spectra = estimate.draws.spectra
        ours = {options.method: (spectra.mean(axis=0), spectra)}
        scores = {name: judged(PRIOR_GRID.nm, truth, other[0], lights, other[1])
                  for name, other in (ours | others).items() if other is not None}
    singles = {name: None if other is None else other[0] for name, other in others.items()}
    return replace(estimate, baselines=singles if with_baselines else None, judged=scores)


def judge_picture(cube: Cube, regions: Sequence[CubeRegion], truths: SpectralTable | None,
                  relative_response: np.ndarray, prior: LogitMixture, options: JudgeOptions, *,
                  signals: Sequence[np.ndarray] | None = None, white: np.ndarray | None = None,
                  noise: np.ndarray | None = None) -> PictureJudgement:
    """Judge the spectra of a hyperspectral picture, and our methods beside it.

    Parameters
    ----------
    cube : Cube
    regions : sequence of CubeRegion
    truths : SpectralTable, optional
        Measured reflectances; without them nothing is judged.
    relative_response : (K, 301) array
        Of the camera that our methods see with.
    prior : LogitMixture
    options : JudgeOptions
    signals : sequence of (K,) arrays, optional
        What our methods see, one a region; by default what the truths give the camera, without
        noise.
    white, noise : (K,) arrays, optional
        Of the signals, as in `measurement_of_signal`.

    Raises
    ------
    InputError
    """
    if not options.full_scale > 0:
        raise InputError(f"a full scale of {options.full_scale:g} cannot be; give what reflectance "
                         "1 reads in the picture")
    spectra = region_spectra(cube, list(regions), options.full_scale, options.seed)
    spectra = _divide_by_white(cube, spectra, truths, options.white_region)
    largest = max(float(region.mean.max()) for region in spectra)
    if largest > MAX_MEAN:
        raise InputError(f"the mean of a region of {cube.file} is {largest:.3g}, no reflectance; "
                         "give what reflectance 1 reads (full scale), or a region of known "
                         "reflectance (white region)")
    if truths is None:
        return PictureJudgement(cube, spectra, [], [], options, signals is not None)
    if signals is not None and len(signals) != len(spectra):
        raise InputError(f"{len(signals)} signals were given for {len(spectra)} regions; give one "
                         "row a region, in their order")
    rows = []
    for index, region in enumerate(spectra):
        truth_nm, truth = truth_of(truths, region.region, options.column)
        nm = common_wavelengths(cube, truth_nm, truths.file)
        if signals is None:
            measurement = measurement_of_signal(
                relative_response,
                relative_response @ hold_ends(truth_nm, truth, FINE_GRID.nm))
        else:
            measurement = measurement_of_signal(relative_response, signals[index], white, noise)
        scores = _judge_region(cube, region, measurement, nm,
                               on_grid(truth_nm, truth, grid_from_nm(nm), truths.file), prior,
                               options)
        rows += [ScoredSpectrum(region.region.name, method, one) for method, one in scores.items()]
    return PictureJudgement(cube, spectra, rows, means(rows), options, signals is not None)


def _judge_region(cube: Cube, region: RegionSpectra, measurement: SpectralMeasurement,
                  nm: np.ndarray, truth: np.ndarray, prior: LogitMixture,
                  options: JudgeOptions) -> dict[str, SpectrumScores]:
    imported = on_grid(cube.nm, np.vstack([region.mean[None], region.spectra]), grid_from_nm(nm),
                       cube.file)
    return {IMPORTED: judged(nm, truth, imported[0], options.lights, imported[1:]),
            **beside(measurement, nm, truth, options.lights, options.samples, options.seed,
                     options.coefficients, prior, options.baseline)}


def _divide_by_white(cube: Cube, regions: list[RegionSpectra], truths: SpectralTable | None,
                     white_region: str | None) -> list[RegionSpectra]:
    """The spectra divided by those of the white region times its truth (1 where there is none)."""
    if white_region is None:
        return regions
    white = next((one for one in regions if one.region.name == white_region), None)
    if white is None:
        raise InputError(f"the white region {white_region!r} is no region; there are "
                         f"{', '.join(region.region.name for region in regions)}")
    if white.mean.min() <= 0:
        raise InputError(f"region {white_region!r} reads {white.mean.min():.3g} at one wavelength; "
                         "white must be above 0 everywhere")
    known = np.ones(cube.nm.size)
    if truths is not None:
        known = hold_ends(*truth_of(truths, white.region, None), cube.nm)
    factor = known / white.mean
    return [replace(region, mean=region.mean * factor, spectra=region.spectra * factor,
                    standard_deviation=region.standard_deviation * factor) for region in regions]


def truth_of(truths: SpectralTable, region: CubeRegion,
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


def hold_ends(nm: np.ndarray, values: np.ndarray, wanted_nm: np.ndarray) -> np.ndarray:
    """Values at wanted wavelengths, the first and the last held beyond the ends."""
    if wanted_nm[0] >= nm[0] and wanted_nm[-1] <= nm[-1]:
        return on_grid(nm, values, grid_from_nm(wanted_nm), "")
    return np.interp(wanted_nm, nm, values)
