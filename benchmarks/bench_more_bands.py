"""Six and nine bands: photos through filters and under further lamps, end to end.

Cases are those of bench_flat.py: an unknown camera whose maker the prior does not hold, an unknown
lamp, a chart off the published average by 1 %, light that falls off over the picture, 1 % of noise
in a pixel, nine published test colours, none twice before all were used. Every further photo is
another raw file of the same scene: through a filter whose file is off by about 1 %, or under
another lamp from another side. The sessions run as ``spectrabox flat`` writes them. Filters: a CSV
of transmittances, a column each, ``--filters``; without it, and beside it, the two gels that
``spectrabox advise`` takes for common. The width of the bands that it forecasts of each, from the
first photo alone, stands beside what comes out. With ``--card`` a white card of known spectrum
takes the place of the fifth colour.

    python -m benchmarks.bench_more_bands --data FOLDER --filters CSV --names "Tiffen Orange 16"
"""
from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.prior.camera_prior import save_camera_prior
from spectrabox.calibrate.prior.learnt_prior import read_camera_database
from spectrabox.fixtures.flat_sample import (
    chart_corners,
    lamplight,
    surface_signals,
    vignetting,
    write_photo,
)
from spectrabox.fixtures.paints import NM, chart_copy
from spectrabox.measure.advice.advise import usual_at_hand
from spectrabox.radiometry.appearance import delta_e00
from spectrabox.radiometry.chart import REFERENCES
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import FINE_GRID, grid_from_nm
from spectrabox.radiometry.records.calibration import Filter
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import read_curves, table_text
from spectrabox.session.commands.requests import MeasuredSignal
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages
from spectrabox.session.signals.advise_answer import advise_answer

from benchmarks.bench_flat import CHART, HEAD, REGIONS, SIZE, places, regions_toml
from benchmarks.bench_unknown_makers import makers_of, prior_without

GELS = ("magenta gel", "orange gel")
FILE_ERROR = 0.01           # of each of three slow waves by which a filter's file is off
CARD, CARD_REFLECTANCE = 4, 0.9     # which colour, in the middle
FIGURES = ("rmse", "inside", "width", "delta_e00")
Kind = tuple[dict[str, np.ndarray], int, bool]      # filters, lamps, whether filters are unknown
PRIOR = '[sensitivity]\nprior = "prior.npz"\n[light]\nspectrum = "unknown"\n'


@dataclass(frozen=True)
class Scene:
    """One case: what is photographed, and by whom."""

    curves: np.ndarray          # (3, P) at NM
    lamps: np.ndarray           # (n, P)
    surfaces: np.ndarray        # (9, P)
    sets: tuple[str, ...]       # where each surface is published
    seed: int


def gels() -> dict[str, np.ndarray]:
    """Transmittances (P,) at NM of the two gels."""
    return {words.split(" ", 1)[1]: np.interp(NM, FINE_GRID.nm, gel.transmittance)
            for words, gel in usual_at_hand().items() if isinstance(gel, Filter)}


def photograph(path: Path, scene: Scene, lamp: int, transmittance: np.ndarray | float) -> None:
    """Write one photo: chart and table stay, every lamp has its own position."""
    rng = np.random.default_rng([scene.seed, lamp])
    lights = [(*rng.uniform(-0.6, 1.6, 2), rng.uniform(1.6, 3.0), 1.0),
              (*rng.uniform(-0.6, 1.6, 2), rng.uniform(1.6, 3.0), rng.uniform(0, 0.6))]
    light = lamplight(SIZE, lights, rng.uniform(0, 0.15)) * vignetting(SIZE, 0.92)
    even = surface_signals(SIZE, scene.curves * scene.lamps[lamp] * transmittance,
                           chart_copy(np.random.default_rng([scene.seed, 99])),
                           chart_corners(*CHART), list(zip(places(), scene.surfaces, strict=True)),
                           np.full(NM.size, 0.2))
    noise = np.random.default_rng([scene.seed, lamp, int(1e6 * np.mean(transmittance))])
    write_photo(path, even * light[..., None], Fraction(1, 60), noise)


def write_session(folder: Path, scene: Scene, kind: Kind, card: bool) -> None:
    """A session of a first photo, one through each filter, and one under each further lamp."""
    filters, lamps, unknown = kind
    (folder / "photos").mkdir()
    photograph(folder / "photos" / "p.dng", scene, 0, 1.0)
    text = HEAD + PRIOR + regions_toml(SIZE[1])
    if card:
        (folder / "card.csv").write_text(table_text(
            NM, {"value": scene.surfaces[CARD]}, quantity=Quantity.REFLECTANCE, source="card"),
            encoding="utf-8")
        text = text.replace(f"[regions.s{CARD}]\n", f'[regions.s{CARD}]\nknown = "card.csv"\n')
    stated = stated_filters(scene, filters)
    for number, (name, transmittance) in enumerate(filters.items()):
        photograph(folder / "photos" / f"f{number}.dng", scene, 0, transmittance)
        write_filters(folder / f"f{number}.csv", {name: stated[name]})
        stated_as = "unknown" if unknown else f"f{number}.csv"
        text += f'[views.f{number}]\nphoto = "photos/f{number}.dng"\nfilter = "{stated_as}"\n'
    for lamp in range(1, lamps):
        photograph(folder / "photos" / f"l{lamp}.dng", scene, lamp, 1.0)
        text += f'[views.l{lamp}]\nphoto = "photos/l{lamp}.dng"\nlight = "unknown"\n'
    (folder / "session.toml").write_text(text, encoding="utf-8")


def stated_filters(scene: Scene, filters: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Transmittances (P,) as the files of a case state them, each off by three slow waves."""
    waves = np.cos(np.outer(np.arange(3), (NM - 400) / 300 * np.pi))
    return {name: np.clip(transmittance * (1 + FILE_ERROR * np.random.default_rng(
        [scene.seed, number]).standard_normal(3) @ waves), 0, 1)
        for number, (name, transmittance) in enumerate(filters.items())}


def write_filters(path: Path, filters: dict[str, np.ndarray]) -> None:
    """A CSV with a column for each filter."""
    path.write_text(table_text(NM, filters, quantity=Quantity.RELATIVE, source="filters"),
                    encoding="utf-8")


def forecasts(folder: Path, scene: Scene, filters: dict[str, np.ndarray]) -> dict[str, float]:
    """Width that a finished session of one photo forecasts of filters, pairs and a second lamp."""
    write_filters(folder / "filters.csv", stated_filters(scene, filters))
    write_filters(folder / "lamp.csv", {"lamp": scene.lamps[1] / scene.lamps[1].max()})
    facts, _ = advise_answer(MeasuredSignal(), None, None, str(folder / "lamp.csv"),
                             str(folder / "filters.csv"), folder, False)
    expected = {_in_order(one["subject"].split(" and ")): one["width_after"]
                for one in facts["overall"]}
    expected["two lamps"] = expected.pop(str(folder / "lamp.csv"), np.nan)
    return expected | {"one photo": facts["overall"][0]["width_before"]}


def scores(folder: Path, scene: Scene) -> list[dict[str, Any]]:
    """RMSE, coverage and width of the 95 % band, and CIEDE2000 under D65, of every surface."""
    finished = run_stages(read_session(folder), device="cpu", only=None, force=False,
                          progress=lambda *_: None)
    rows = []
    for name in finished.records.spectra:
        known, number = finished.records.spectra[name], int(name[1:])
        true = np.interp(known.grid.nm, NM, scene.surfaces[number])
        rows.append({"set": scene.sets[number],
                     "rmse": float(np.sqrt(np.mean((known.mean - true) ** 2))),
                     "inside": float(np.mean((known.lower <= true) & (true <= known.upper))),
                     "width": float(np.mean(known.upper - known.lower)),
                     "delta_e00": delta_e00(known.grid.nm, known.mean, true)})
    return rows


def scene_of(data: Path, case: int, seed: int,
             card: bool) -> tuple[Scene, Any, np.ndarray]:
    """One case, the cameras and which of them its maker made."""
    rng = np.random.default_rng([seed, case])
    database = read_camera_database(data / "cameras")
    camera, makers = int(rng.integers(len(database.names))), np.asarray(makers_of(database))
    with np.load(data / "lights" / "lights_for_checks.npz") as stored:
        chosen = rng.choice(len(stored["spectra"]), 3, replace=False)
        lamps = np.array([np.interp(NM, stored["wavelengths_nm"], stored["spectra"][lamp])
                          for lamp in chosen])
    named = [(name, row) for name, rows in test_reflectances(grid_from_nm(NM[20:-30])).items()
             if name not in REFERENCES for row in rows]
    order = np.random.default_rng(seed).permutation(len(named))     # each comes before any returns
    picked = [named[order[(REGIONS * case + number) % len(named)]] for number in range(REGIONS)]
    surfaces = np.array([np.pad(row, (20, 30), mode="edge") for _, row in picked])
    if card:
        surfaces[CARD] = CARD_REFLECTANCE
    curves = np.array([np.interp(NM, database.nm, row) for row in database.curves[camera]])
    return (Scene(curves, lamps, surfaces, tuple(name for name, _ in picked), 1000 * seed + case),
            database, makers == makers[camera])


def measure(data: Path, kinds: dict[str, Kind], cases: int, seed: int,
            card: bool) -> dict[str, list[tuple[list[dict[str, Any]], float]]]:
    """Rows and forecast of every kind of session, of the cases in which none was refused."""
    collected: dict[str, list[tuple[list[dict[str, Any]], float]]] = {kind: [] for kind in kinds}
    filters = {name: curve for of_kind, _, _ in kinds.values() for name, curve in of_kind.items()}
    for case in range(cases):
        scene, database, own_maker = scene_of(data, case, seed, card)
        rows, expected = {}, {}
        for kind, what in kinds.items():
            with tempfile.TemporaryDirectory() as written:
                save_camera_prior(Path(written) / "prior.npz", prior_without(database, own_maker))
                write_session(Path(written), scene, what, card)
                try:
                    rows[kind] = scores(Path(written), scene)
                    if kind == "one photo":
                        expected = forecasts(Path(written), scene, filters)
                except SpectraboxError as error:
                    print(f"{case} {kind}: refused, {error}", file=sys.stderr)
        if len(rows) == len(kinds):
            for kind, of_kind in rows.items():
                collected[kind].append((of_kind, expected.get(_forecast_as(kind, kinds), np.nan)))
        print(case, {kind: round(float(np.mean([row["rmse"] for row in of_kind])), 4)
                     for kind, of_kind in rows.items()}, file=sys.stderr, flush=True)
    return collected


def _forecast_as(kind: str, kinds: dict[str, Kind]) -> str:
    """What a forecast calls a kind of session."""
    filters, _, unknown = kinds[kind]
    return "" if unknown else _in_order(filters) or kind


def _in_order(names: Iterable[str]) -> str:
    return " and ".join(sorted(names))


def print_tables(collected: dict[str, list[tuple[list[dict[str, Any]], float]]]) -> None:
    """Markdown: a line for each kind of session, then RMSE and coverage by set of test colours."""
    one = np.array([np.mean([row["rmse"] for row in rows]) for rows, _ in collected["one photo"]])
    print(f"{len(one)} scenes\n\n| photos | RMSE | to one photo | 95 % band holds | width | ΔE00 "
          "| forecast to width |\n|---|---|---|---|---|---|---|")
    for kind, cases in collected.items():
        figures = np.array([[np.mean([row[key] for row in rows]) for key in FIGURES]
                            for rows, _ in cases])
        rmse, inside, width, delta_e = figures.mean(axis=0)
        error = figures[:, 1].std(ddof=1) / np.sqrt(len(one))
        ratio, forecast = (_ratio(*pair) for pair in (
            (figures[:, 0], one), (np.array([expected for _, expected in cases]), figures[:, 2])))
        print(f"| {kind} | {rmse:.4f} | {ratio[0]:.2f} ± {ratio[1]:.2f} | {inside:.3f} ± "
              f"{error:.3f} | {width:.3f} | {delta_e:.2f} | {forecast[0]:.2f} ± "
              f"{forecast[1]:.2f} |")
    sets = sorted({row["set"] for cases in collected.values() for rows, _ in cases for row in rows})
    print(f"\n| RMSE, band holds | {' | '.join(sets)} |\n|---{'|---' * len(sets)}|")
    for kind, cases in collected.items():
        cells = []
        for name in sets:
            rmse, inside = np.transpose([(row["rmse"], row["inside"]) for rows, _ in cases
                                         for row in rows if row["set"] == name])
            error = inside.std(ddof=1) / np.sqrt(inside.size)
            cells.append(f"{rmse.mean():.3f}, {inside.mean():.2f} ± {error:.2f}")
        print(f"| {kind} | {' | '.join(cells)} |")


def _ratio(over: np.ndarray, under: np.ndarray) -> tuple[float, float]:
    """Ratio of means over the cases that have both, and its standard error [Cochran 1977,
    Eq. 6.13].
    """
    over, under = over[np.isfinite(over)], under[np.isfinite(over)]
    if over.size == 0:
        return np.nan, np.nan
    ratio = over.mean() / under.mean()
    return float(ratio), float(np.std(over - ratio * under, ddof=1)
                               / np.sqrt(len(over)) / under.mean())


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/ and lights/")
    parser.add_argument("--filters", type=Path, help="CSV of transmittances")
    parser.add_argument("--names", nargs="*", default=(), help="columns of it, one kind each")
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--card", action="store_true", help="a white card is among the colours")
    asked = parser.parse_args()
    at_hand = gels()
    if asked.filters is not None:
        nm, names, curves = read_curves(asked.filters)
        at_hand |= {name: np.interp(NM, nm, curve) for name, curve in zip(names, curves,
                                                                          strict=True)}
    kinds: dict[str, Kind] = {"one photo": ({}, 1, False)} | {
        name: ({name: at_hand[name]}, 1, False) for name in (*asked.names, *GELS)} | {
        "two filters": ({name: at_hand[name] for name in asked.names[:2]}, 1, False),
        "two gels": ({name: at_hand[name] for name in GELS}, 1, False),
        "magenta gel, unknown": ({"magenta gel": at_hand["magenta gel"]}, 1, True),
        "two lamps": ({}, 2, False), "three lamps": ({}, 3, False)}
    if len(asked.names) < 2:
        del kinds["two filters"]
    print_tables(measure(asked.data, kinds, asked.cases, asked.seed, asked.card))


if __name__ == "__main__":
    main()
