"""Whether every extra works, whatever was photographed: advice, comparison, edition, report, texts.

Cases are small synthetic captures, each drawn from a seed of its own: charts of several layouts, 3
to 8 bands of Gaussian cameras, one to three photos (the same lamp, moved, another, through stated,
unknown and nearly opaque filters), a light stated by file with and without errors, by name, kind
and temperature, or not at all, some of them dark at some wavelengths; damaged and excluded patches;
regions that are tiny, clipped, black, brighter than white, known, of stated families and surfaces;
other methods of sampling. Each calibration is used for several sets of regions. Signals by
themselves have 1 to 31 bands and any noise, impossible ones among them. ``--scene DIR`` takes the
reconstruction of a finished session of a scene, and states other things of its materials.

A capture that is refused has no answer, and is counted by its error; an extra that fails on an
answer that is there is printed with its traceback. Exit code 1 where any extra failed.
"""
from __future__ import annotations

import argparse
import collections
import itertools
import json
import tempfile
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.api.arguments import as_light
from spectrabox.api.flat import FlatSpectra
from spectrabox.api.scene import SceneSpectra
from spectrabox.api.signals import sample
from spectrabox.capture.photo.image_writers import write_png
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.fixtures.chart_scene import card_scene
from spectrabox.fixtures.paints import NM, random_paints
from spectrabox.measure.captured import (
    ONE_PHOTO,
    FlatCapture,
    InputFile,
    LitChart,
    PhotoFiles,
    SceneCapture,
    Surface,
    View,
)
from spectrabox.measure.chart_patches import edition_in_photo
from spectrabox.measure.estimate import Estimate
from spectrabox.measure.records import KeptRecord, Record
from spectrabox.measure.shoot.options import Sampling
from spectrabox.measure.steps.measurement import MemoryKeeper, measure
from spectrabox.radiometry.chart import Chart, chart_reflectances
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.filters import stated_filter, unknown_filter
from spectrabox.radiometry.spectra.named_spectra import light as named_light
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import FinishedRun, load_finished
from spectrabox.session.outputs.session_results import SessionResults
from spectrabox.session.report.page import render_report
from spectrabox.session.terminal.command_line import to_json

SIZE = (180, 270)           # rows, columns
NOISE = 0.003               # of full scale, in a pixel
LAYOUTS = ("ColorChecker Classic", "ColorChecker Passport", "Artist Paint Target")
LAMPS = ("D65", "A", "FL11", "LED-B3", "LED-RGB1")
WORDS = ("unknown", "led", "halogen", "daylight", "fluorescent", "3200K", "6100K")
FAMILIES = ("paint", "textile", "leaves", "skin", "white", "earth", "animal")
CHART_PX = np.array([[12.0, 16.0], [150.0, 16.0], [150.0, 108.0], [12.0, 108.0]])
# x, y of the top left corners of the places of regions
PLACES = tuple(itertools.product((170, 205, 238), (15, 55, 95)))
SIDE = 26


@dataclass(frozen=True, eq=False)
class Case:
    """A capture, and what was drawn of it in words."""

    capture: FlatCapture
    words: str
    surfaces: np.ndarray        # (9, 301) on the places


def drawn_case(seed: int) -> Case:
    """A capture that nobody planned.

    Parameters
    ----------
    seed : int
    """
    rng = np.random.default_rng(seed)
    chart = chart_layout(str(rng.choice(LAYOUTS, p=(0.7, 0.15, 0.15))))
    bands = int(rng.choice((3, 3, 3, 3, 4, 6, 8)))
    curves = _curves(rng, bands)
    reflectances = chart_reflectances(chart.references[0], FINE_GRID, chart)
    own = reflectances * np.exp(rng.choice((0.003, 0.01, 0.03)) * rng.standard_normal(
        (len(reflectances), 1)))
    surfaces = _surfaces(rng)
    lamp = named_light(str(rng.choice(LAMPS)), FINE_GRID)
    photos = [_photo(rng, chart, own, surfaces, curves * lamp, "first")]
    light, words = _stated(rng, lamp)
    if isinstance(light, Spectrum) and rng.random() < 0.3:      # as a meter reads a dim lamp
        values = np.where(light.values < 0.03 * light.values.max(), 0, light.values)
        light, words = replace(light, values=values), f"{words}, dark in part"
    views = [View("", photos[0], photos[0], light, words)]
    for number in range(int(rng.choice((0, 0, 0, 1, 1, 2)))):
        views.append(_further(rng, f"view{number}", views[0], chart, own, surfaces, curves, lamp))
    regions = _regions(rng, surfaces)
    excluded = np.zeros(len(reflectances), bool)
    if rng.random() < 0.25:
        excluded[rng.choice(len(reflectances), int(rng.integers(1, 8)), replace=False)] = True
    method = str(rng.choice(("prior", "prior", "prior", "prior", "uniform")))
    draws = 1000
    capture = FlatCapture(
        name=f"case {seed}", views=tuple(views), regions=regions,
        chart=LitChart(chart, reflectances, excluded, CHART_PX, stated=bool(rng.random() < 0.5)),
        sampling=Sampling(method=method, draws=draws), seed=seed)
    said = [f"seed {seed}", chart.name, f"{bands} bands", f"light {words}",
            *(f"{view.name}: {view.filter_words or view.light_words}"
              f"{' moved' if view.moved else ''}" for view in views[1:]),
            _words(regions), method, f"{int(excluded.sum())} excluded"]
    return Case(capture, "; ".join(said), surfaces)


def _words(regions: Mapping[str, Surface]) -> str:
    """What is stated of regions."""
    return ", ".join(f"{name}{' ' + region.surface if region.surface else ''}"
                     f"{' known' if region.known is not None else ''}"
                     f"{' ' + '/'.join(region.families) if region.families else ''}"
                     for name, region in regions.items())


def _curves(rng: np.random.Generator, bands: int) -> np.ndarray:
    """Sensitivities (K, 301) of a camera."""
    centres = np.linspace(610, 450, bands) + rng.normal(0, 6, bands)
    widths = rng.uniform(0.7, 1.2, bands) * 110 / bands
    curves = np.exp(-0.5 * ((FINE_GRID.nm - centres[:, None]) / widths[:, None])**2)
    return np.asarray((curves + 0.002) * rng.uniform(0.5, 1, (bands, 1)))


def _stated(rng: np.random.Generator, lamp: np.ndarray) -> tuple[Spectrum | UnknownLight, str]:
    """A lamp as somebody states it, and in which words."""
    how = int(rng.integers(4))
    if how == 0:
        return Spectrum(FINE_GRID, lamp, Quantity.RELATIVE, "lamp.csv"), "lamp.csv"
    if how == 1:
        error = rng.choice((0.002, 0.02, 0.2)) * lamp + 1e-4 * lamp.max()
        read = np.maximum(lamp + rng.standard_normal(lamp.size) * error, 0)
        return Spectrum(FINE_GRID, read, Quantity.RELATIVE, "read.csv", error), "read.csv"
    word = str(rng.choice(WORDS if how == 2 else LAMPS))
    return as_light(word), word


def _photo(rng: np.random.Generator, chart: Chart, reflectances: np.ndarray, surfaces: np.ndarray,
           response: np.ndarray, name: str) -> PhotoFiles:
    """A photo of chart and surfaces, light falling off, developed."""
    patches = reflectances @ (response * FINE_GRID.weights_nm).T
    white = (response * FINE_GRID.weights_nm).sum(axis=1)
    exposure = rng.choice((0.4, 0.75, 0.95, 1.3), p=(0.2, 0.5, 0.2, 0.1)) / white.max()
    centres, sizes = chart.centres_uv, chart.sizes_uv
    left, top = np.unique((centres - sizes / 2)[:, 0].round(6)), np.unique(
        (centres - sizes / 2)[:, 1].round(6))
    side = (float(sizes[0, 0]), float(sizes[0, 1]))
    origin = np.array([left[0], top[0]])
    scene = card_scene(*SIZE, patches, CHART_PX, left - origin[0], top - origin[1], side,
                       border=0.01, background=float(0.2 * white.mean()))
    for (x, y), surface in zip(PLACES, surfaces, strict=True):
        scene[y:y + SIDE, x:x + SIDE] = (response * FINE_GRID.weights_nm) @ surface
    if rng.random() < 0.3:                  # a finger, a scratch, glare on some patches
        for _ in range(int(rng.integers(1, 4))):
            x, y = rng.integers(14, 140), rng.integers(18, 100)
            scene[y:y + 14, x:x + 14] *= rng.choice((0.3, 1.5, 4.0))
    fall = 1 - rng.uniform(0, 0.3) * np.linspace(0, 1, SIZE[1])
    glare = rng.uniform(0, 0.01) * scene.mean(axis=(0, 1))
    signal = exposure * (scene * fall[:, None] + glare)
    signal += NOISE * np.sqrt(np.maximum(signal, 0.01)) * rng.standard_normal(signal.shape)
    saturated = signal >= 1
    image = LinearImage(np.minimum(signal, 1).astype(np.float32),
                        (NOISE**2 * np.maximum(signal, 0.01)).astype(np.float32), saturated, 1.0,
                        1 / 60, 100.0, 8.0, PhotoKind.RAW, "camera", f"{name}.exr", "0" * 64)
    return {ONE_PHOTO: (InputFile(f"{name}.exr", Path(f"{name}.exr"), image),)}


def _further(rng: np.random.Generator, name: str, first: View, chart: Chart,
             reflectances: np.ndarray, surfaces: np.ndarray, curves: np.ndarray,
             lamp: np.ndarray) -> View:
    """One photo more."""
    kind = str(rng.choice(("same", "moved", "lamp", "filter", "unknown filter")))
    if kind in ("same", "moved"):
        photo = _photo(rng, chart, reflectances, surfaces, curves * lamp, name)
        return replace(first, name=name, photo=photo, chart=photo,
                       moved=name if kind == "moved" else "")
    if kind == "lamp":
        other = named_light(str(rng.choice(LAMPS)), FINE_GRID)
        photo = _photo(rng, chart, reflectances, surfaces, curves * other, name)
        light, words = _stated(rng, other)
        return View(name, photo, photo, light, words, lamp=name)
    edge = 1 / (1 + np.exp(-rng.choice((-1, 1)) * (FINE_GRID.nm - rng.uniform(460, 640)) / 12))
    passed = np.clip(0.9 * edge, rng.choice((1e-4, 0.02, 0.2)), 1)
    photo = _photo(rng, chart, reflectances, surfaces, curves * lamp * passed, name)
    through = stated_filter("gel", passed) if kind == "filter" else unknown_filter()
    return replace(first, name=name, photo=photo, chart=photo, filter=through,
                   filter_words=kind, filter_known=kind == "filter")


def _surfaces(rng: np.random.Generator) -> np.ndarray:
    """Reflectances (9, 301) of the places, some of them no easy ones."""
    paints = random_paints(len(PLACES), rng)
    paints = np.array([np.interp(FINE_GRID.nm, NM, row) for row in paints])
    for index in range(len(PLACES)):
        kind = rng.random()
        if kind < 0.1:
            paints[index] = rng.choice((0.0, 0.004, 0.03))
        elif kind < 0.15:
            paints[index] = 1.6
        elif kind < 0.25:
            paints[index] = np.exp(-0.5 * ((FINE_GRID.nm - rng.uniform(430, 660)) / 6)**2)
        elif kind < 0.35:
            paints[index] = rng.uniform(0.05, 0.95)
    return paints


def _regions(rng: np.random.Generator, surfaces: np.ndarray) -> dict[str, Surface]:
    """Regions on some places, of which something may be stated."""
    count = int(rng.integers(1, 5)) if rng.random() < 0.9 else len(PLACES)
    regions = {}
    for number in rng.choice(len(PLACES), count, replace=False).tolist():
        x, y = PLACES[number]
        size = int(rng.choice((4, 8, SIDE - 6), p=(0.05, 0.2, 0.75)))
        box = (x + 3.0, y + 3.0, x + 3.0 + size, y + 3.0 + size)
        outline = ((box[0], box[1]), (box[2], box[1]), (box[2], box[3]), (box[0], box[3]))
        families = (str(rng.choice(FAMILIES)),) if rng.random() < 0.3 else ()
        surface = str(rng.choice(("matt", "satin", "glossy"))) if rng.random() < 0.3 else None
        given = bool(regions) and rng.random() < 0.15
        truth = Spectrum(FINE_GRID, np.clip(surfaces[number], 0, 1), Quantity.REFLECTANCE, "truth")
        regions[f"place{number}"] = Surface(
            families, surface, np.clip(surfaces[number], 0, 1) if given else None,
            truth if rng.random() < 0.3 else None, outline=outline)
    return regions


def answers_of(case: Case, sets: int) -> Iterator[tuple[str, FlatSpectra | Exception]]:
    """Answers of one calibration, or why there is none: for the regions of a case, and for as many
    other sets of regions.

    Parameters
    ----------
    case : Case
    sets : int
    """
    kept: dict[str, Record | KeptRecord] = {}
    for number in range(sets + 1):
        regions, words = case.capture.regions, case.words
        if number:
            regions = _regions(np.random.default_rng([case.capture.seed, number]), case.surfaces)
            words = f"{case.words}; now {_words(regions)}"
        capture = replace(case.capture, regions=regions)
        keeper = MemoryKeeper(kept=dict(kept))
        try:
            yield words, FlatSpectra(capture, measure(capture, keeper))
        except Exception as error:      # noqa: BLE001 - one that is no refusal is counted as failed
            yield words, error
        kept = {name: keeper.kept[name] for name in ("chart", "calibrate") if name in keeper.kept}
        if len(kept) < 2:
            return


def scene_answer(finished: FinishedRun, seed: int) -> tuple[str, SceneSpectra]:
    """The answer of a scene whose photos are inverted, something else being stated of it."""
    rng = np.random.default_rng(seed)
    capture = finished.capture
    assert isinstance(capture, SceneCapture)
    materials = {name: replace(
        material, families=(str(rng.choice(FAMILIES)),) if rng.random() < 0.4 else (),
        surface=str(rng.choice(("matt", "satin", "glossy"))) if rng.random() < 0.4 else None)
        for name, material in capture.materials.items()}
    sampling = Sampling(method=str(rng.choice(("prior", "prior", "uniform", "paper"))), draws=1000,
                        level=float(rng.choice((0.5, 0.9, 0.95))))
    capture = replace(capture, materials=materials, sampling=sampling, seed=seed)
    keeper = MemoryKeeper(kept={name: stage for name, stage in finished.stored.items()
                                if name != "sample"})
    words = f"scene {seed}; {sampling.method}; " + ", ".join(
        f"{name} {one.surface or ''} {'/'.join(one.families)}" for name, one in materials.items())
    return words, SceneSpectra(capture, measure(capture, keeper))


def signal_answer(seed: int) -> tuple[str, Estimate]:
    """The estimate of a signal that is given as numbers."""
    rng = np.random.default_rng(seed)
    bands = int(rng.choice((1, 2, 3, 3, 4, 6, 8, 12, 31)))
    curves, lamp = _curves(rng, bands), named_light(str(rng.choice(LAMPS)), FINE_GRID)
    response = curves * lamp * FINE_GRID.weights_nm
    signal = response @ _surfaces(rng)[0] / response.sum(axis=1)
    kind = str(rng.choice(("true", "true", "off", "any", "dark")))
    signal = {"true": signal, "off": signal * np.exp(0.2 * rng.standard_normal(bands)),
              "any": rng.uniform(0, 1.2, bands), "dark": np.full(bands, 1e-6)}[kind]
    noise = float(rng.choice((1e-4, 0.003, 0.03, 0.3)))
    estimate = sample(signal, camera=(FINE_GRID.nm, curves), light=(FINE_GRID.nm, lamp),
                      noise=noise, draws=1000, seed=seed,
                      families=(str(rng.choice(FAMILIES)),) if rng.random() < 0.3 else ())
    assert isinstance(estimate, Estimate)
    return f"signal {seed}; {bands} bands, {kind}, noise {noise}", estimate


def extras_of(spectra: FlatSpectra | SceneSpectra,
              folder: Path) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Every extra of an answer by its name.

    Parameters
    ----------
    spectra : FlatSpectra or SceneSpectra
    folder : Path
        For pictures.
    """
    capture, records = spectra.found.advise.args
    yield "facts and advice", lambda: _whole(spectra)
    yield "text", spectra.text
    yield "repr", lambda: repr(spectra) + spectra._repr_html_()
    yield "methods", lambda: spectra.methods
    if "" in records.charts:
        chart = records.charts[""]
        yield "edition", lambda: _raised(edition_in_photo(chart.thumbnail, capture.layout,
                                                          chart.samples).failed)
    names = [name for name, one in spectra.items() if one.given is None]
    for pair in itertools.islice(itertools.combinations(names, 2), 2):
        yield "comparison", lambda pair=pair: _compared(spectra, pair)
    yield "report", lambda: [_raised(one) for one in render_report(_session(spectra, folder))[2]]


def _whole(spectra: FlatSpectra | SceneSpectra) -> None:
    """Everything as JSON, in which nothing failed."""
    facts = spectra.facts()
    json.dumps(facts, default=to_json, allow_nan=False)
    for one in spectra.failed_extras:
        _raised(one)


def _raised(failed: Finding | None) -> None:
    if failed is not None:
        raise AssertionError(f"{failed.subject}\n{failed.values['traceback']}")


def _compared(spectra: FlatSpectra | SceneSpectra, pair: tuple[str, str]) -> Any:
    """A comparison with its colours, or None where it is refused."""
    try:
        both = spectra.compare(*pair)
    except SpectraboxError:
        return None
    numbers = np.r_[both.difference, both.limit, both.lab().value, both.lab("A").standard_error,
                    both.delta_e(), both.spectrum.standard_error]
    assert np.isfinite(numbers).all(), "a comparison holds numbers that are none"
    return repr(both)


def _session(spectra: FlatSpectra | SceneSpectra, folder: Path) -> SessionResults:
    """The answer as a report takes it."""
    capture, records = spectra.found.advise.args
    previews = {}
    for view in capture.views:
        previews[view.name] = folder / f"{view.label('preview')}.png"
        write_png(previews[view.name], signal_rgb8(records.photo.photos[view.name].signal))
    return SessionResults(
        found=spectra.found, folder=folder, name=capture.name, operator="", notes="", inputs=(),
        stages=(), sensitivity_truth=None, previews=previews,
        chart_overlay=previews[""], provenance={})


class Tally:
    """What was tried, refused and failed."""

    def __init__(self) -> None:
        self.answers = 0
        self.refused: collections.Counter[str] = collections.Counter()
        self.failed: collections.Counter[str] = collections.Counter()

    def attempt(self, name: str, words: str, make: Callable[[], Any]) -> Any:
        """What is made, or None with the failure printed."""
        try:
            return make()
        except Exception:       # noqa: BLE001 - printed and counted
            self.failed[name] += 1
            print(f"{name.upper()} {words}\n{traceback.format_exc()}", flush=True)
            return None

    def answer(self, words: str, answer: FlatSpectra | SceneSpectra | Exception) -> None:
        """Every extra of an answer."""
        if isinstance(answer, SpectraboxError):
            self.refused[f"{type(answer).__name__}: {str(answer)[:70]}"] += 1
            return
        if isinstance(answer, Exception):
            self.failed["answer"] += 1
            print(f"ANSWER {words}", *traceback.format_exception(answer), sep="\n", flush=True)
            return
        self.answers += 1
        with tempfile.TemporaryDirectory() as folder:
            for name, extra in extras_of(answer, Path(folder)):
                self.attempt(name, words, extra)

    def signal(self, seed: int) -> None:
        """The advice on a signal."""
        try:
            words, estimate = signal_answer(seed)
        except SpectraboxError as error:
            self.refused[f"{type(error).__name__}: {str(error)[:70]}"] += 1
            return
        self.answers += 1
        self.attempt("advice on a signal", words, estimate.advise)


def main() -> int:
    """Print what fails."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=60, help="calibrations of flat samples")
    parser.add_argument("--sets", type=int, default=4, help="of regions more, of each")
    parser.add_argument("--signals", type=int, default=300)
    parser.add_argument("--scene", type=Path, help="a finished session of a scene")
    parser.add_argument("--scenes", type=int, default=30, help="statements about it")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    tally = Tally()
    try:
        _try_all(tally, asked)
    except KeyboardInterrupt:
        print("stopped")
    print(f"{tally.answers} answers, {sum(tally.refused.values())} refused, "
          f"failed {dict(tally.failed)}")
    for sentence, count in tally.refused.most_common(15):
        print(f"  {count:4d} {sentence}")
    return 1 if tally.failed else 0


def _try_all(tally: Tally, asked: argparse.Namespace) -> None:
    for seed in range(asked.seed, asked.seed + asked.signals):
        tally.signal(seed)
    for seed in range(asked.seed, asked.seed + asked.cases):
        for words, answer in answers_of(drawn_case(seed), asked.sets):
            tally.answer(words, answer)
    if asked.scene is not None:
        finished = load_finished(read_session(asked.scene))
        for seed in range(asked.seed, asked.seed + asked.scenes):
            try:
                tally.answer(*scene_answer(finished, seed))
            except SpectraboxError as error:
                tally.answer(f"scene {seed}", error)


if __name__ == "__main__":
    raise SystemExit(main())
