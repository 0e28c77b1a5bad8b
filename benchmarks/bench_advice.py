"""What to do next, carried out: said beside got, over simulated shoots.

Each shoot is drawn as those of bench_flat_faults: a camera whose maker is left out of the prior, a
lamp that nobody measured, a chart among editions and copies, nine published test colours beside it
(``fixtures/near_lamps.py``, which shares no model with the inversion). The chart lies aside, so
that some samples are a third of the picture away from it. Samples are matt, satin or glossy as
often as the product takes surfaces to be. One photo is measured, and what the product advises is
kept; then every action is carried out by itself:

    white-card      two samples are replaced by matt white cards; each stands beside two others
    chart-nearer    the chart lies between the rows of samples
    flat-field      a photo of a white card that fills the picture
    lamp-moved      a photo more under the same lamp in another place
    gel             a photo more through the gel advised, whose file is off by 1 %
    second-lamp     a photo more under the lamp advised, in another place, unknown to the product
    reading         the true reflectance at the wavelength advised, off by 0.5 % of white
    matt            stated of shoots whose samples are

"said" and "got" are the share of the width that is left, mean over four samples, which are those of
the forecast. A list is right where no action brought more than 1.3 times as much as the first.
"""
from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import spectrabox
from spectrabox.api.flat import FlatSpectra
from spectrabox.calibrate.prior.learnt_prior import read_camera_database
from spectrabox.fixtures.near_lamps import (
    REGIONS,
    WHITE,
    Place,
    Shoot,
    drawn_lamp,
    moved,
    photograph,
    photograph_white,
    rectangles,
)
from spectrabox.fixtures.paints import NM, chart_copy
from spectrabox.measure.advice.advice import TIMES
from spectrabox.measure.advice.advise import usual_at_hand
from spectrabox.measure.advice.forecast import outlook_of
from spectrabox.radiometry.appearance import ciede2000
from spectrabox.radiometry.chart import COPIES_BEFORE_2014, COPIES_SINCE_2014, REFERENCES
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.gloss import USUAL
from spectrabox.radiometry.grid import FINE_GRID, grid_from_nm
from spectrabox.radiometry.records.calibration import Filter
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.sampling.further.more_measurements import Reading, condition
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior

from benchmarks.bench_flat_faults import LATER_EDITION, _prior_without
from benchmarks.bench_unknown_makers import makers_of

ASIDE = 0.22                # widths of the picture by which the chart lies aside
CARDS = {2: (1, 3), 7: (6, 8)}      # where white cards lie, and the samples beside each
JUDGED = tuple(sample for beside in CARDS.values() for sample in beside)
READING_ERROR, FILE_ERROR = 0.005, 0.01
MUCH_MORE, CLOSE = 1.3, 0.15
Known = Mapping[str, tuple[float, float]]       # of each sample: width of the band, colour error


def known(result: FlatSpectra) -> dict[str, tuple[float, float]]:
    """How well the judged samples are known."""
    found = {}
    for number in JUDGED:
        estimate = result.get(f"s{number}")
        if estimate is not None:
            draws = estimate._drawn_lab("D65")
            off = ciede2000(estimate.lab("D65").value, draws)
            found[f"s{number}"] = estimate.band_width, float(np.sqrt(np.mean(off**2)))
    return found


def with_reading(result: FlatSpectra, truth: np.ndarray,
                 rng: np.random.Generator) -> dict[str, tuple[float, float]]:
    """How well they are known after the reading that is advised of each."""
    found = {}
    for number in JUDGED:
        estimate = result[f"s{number}"]
        assert estimate.measurement is not None
        advised = [one for one in estimate.advice if one.action == "reading"]
        if not advised:
            continue
        nm = float(advised[0].subject.split()[0])
        value = np.interp(nm, NM, truth[number]) + READING_ERROR * rng.standard_normal()
        width, colour = outlook_of(solve_posterior(load_prior(), condition(
            estimate.measurement, [Reading.at_wavelength(nm, float(value))])), 0.95).tolist()
        found[f"s{number}"] = width, colour
    return found


class Photos:
    """The photos of one shoot, and what the product finds from them."""

    def __init__(self, folder: Path, shoot: Shoot, lamp: np.ndarray, prior: Path,
                 seed: Sequence[int]) -> None:
        self.folder, self.shoot, self.spectrum, self.prior = folder, shoot, lamp, prior
        self.rng = np.random.default_rng(seed)
        self.lamp = drawn_lamp(self.rng)
        self.take("first")

    def take(self, name: str, lamp: Any = None, spectrum: np.ndarray | None = None,
             through: np.ndarray | None = None, **other: Any) -> Path:
        """A photo of the samples."""
        path = self.folder / f"{name}.dng"
        photograph(path, replace(self.shoot, **other), [
            (lamp or self.lamp, self.spectrum if spectrum is None else spectrum)], self.rng,
            through=through)
        return path

    def measured(self, name: str = "first", left_out: Sequence[int] = (),
                 **stated: Any) -> FlatSpectra:
        """What the product finds, by the function that users call."""
        regions = {f"s{number}": corners for number, corners in enumerate(rectangles())
                   if number in (*JUDGED, *CARDS) and number not in left_out}
        return spectrabox.flat(self.folder / f"{name}.dng", regions, camera_prior=self.prior,
                               draws=2000, progress=False, **stated)

    def carried_out(self, action: str, subject: str,
                    first: FlatSpectra) -> dict[str, tuple[float, float]]:
        """How well the samples are known after an action."""
        if action == "white-card":
            self.take("card", cards=tuple(CARDS))
            found: dict[str, tuple[float, float]] = {}
            for card, beside in CARDS.items():
                other = next(number for number in CARDS if number != card)
                each = known(self.measured("card", (other,), known={f"s{card}": WHITE}))
                found |= {f"s{number}": each[f"s{number}"] for number in beside}
            return found
        if action == "chart-nearer":
            self.take("nearer", aside=0.0)
            return known(self.measured("nearer"))
        if action == "flat-field":
            photograph_white(self.folder / "white.dng", self.shoot, [(self.lamp, self.spectrum)],
                             self.rng)
            return known(self.measured(flat_field=self.folder / "white.dng"))
        if action == "lamp-moved":
            return known(self.measured(also={
                self.take("moved", moved(self.lamp, self.rng)): "moved"}))
        if action == "gel":
            gel = usual_at_hand()[subject]
            assert isinstance(gel, Filter)
            passed = gel.transmittance
            waves = np.cos(np.outer(np.arange(3), (FINE_GRID.nm - 400) / 300 * np.pi))
            off = 1 + FILE_ERROR * self.rng.standard_normal(3) @ waves
            return known(self.measured(filtered={
                self.take("gel", through=np.interp(NM, FINE_GRID.nm, passed)):
                    (FINE_GRID.nm, np.clip(passed * off, 0, 1))}))
        if action == "second-lamp":
            spectrum = usual_at_hand()[subject]
            assert not isinstance(spectrum, Filter)
            power = np.interp(NM, FINE_GRID.nm, spectrum)
            return known(self.measured(also={
                self.take("lamp", moved(self.lamp, self.rng), power / power.max()): "unknown"}))
        if action == "reading":
            return with_reading(first, self.shoot.surfaces, self.rng)
        return known(self.measured(surface="matt"))


def of_shoot(photos: Photos) -> list[dict[str, Any]]:
    """Said and got of every action in a shoot's lists, in shares of width and colour error."""
    first = photos.measured()
    before, rows = known(first), []
    listed = {action: [(name, one) for name in before for one in first[name].advice
                       if one.action == action] for action in TIMES}
    for action, each in listed.items():
        if not each or (action == "matt" and photos.shoot.kind != "matt"):
            continue
        try:
            after = photos.carried_out(action, each[0][1].subject, first)
        except SpectraboxError as error:
            rows.append({"action": action, "refused": str(error)})
            continue
        # where a sample's own list leaves an action out, it says that it brings nothing
        said = {name: (one.width_after, one.colour_after) for name, one in each}
        of = {name: (said.get(name, before[name]), after[name]) for name in before
              if name in after}
        (said_width, said_colour), (got_width, got_colour) = np.mean(
            list(of.values()), axis=0).tolist()
        width, colour = np.mean([before[name] for name in of], axis=0).tolist()
        rows.append({"action": action, "before": width, "said": said_width / width,
                     "got": got_width / width, "said_colour": said_colour / colour,
                     "got_colour": got_colour / colour})
    return rows


def measure(data: Path, cases: int, seed: int) -> list[dict[str, Any]]:
    """Rows of all shoots.

    Parameters
    ----------
    data : Path
        With cameras/ and lights/.
    cases, seed : int
    """
    database = read_camera_database(data / "cameras")
    makers = np.asarray(makers_of(database))
    with np.load(data / "lights" / "lights_for_checks.npz") as stored:
        lamps = np.array([np.interp(NM, stored["wavelengths_nm"], row)
                          for row in stored["spectra"]])
    sets = test_reflectances(grid_from_nm(NM[20:-30]))
    colours = np.pad(np.vstack([rows for name, rows in sets.items() if name not in REFERENCES]),
                     ((0, 0), (20, 30)), mode="edge")
    rows = []
    for case in range(cases):
        start, rng = time.perf_counter(), np.random.default_rng([seed, case])
        camera = int(rng.integers(len(makers)))
        edition = COPIES_SINCE_2014 if rng.random() < LATER_EDITION else COPIES_BEFORE_2014
        kind = str(rng.choice(list(USUAL), p=list(USUAL.values())))
        shoot = Shoot(
            np.array([np.interp(NM, database.nm, row) for row in database.curves[camera]]),
            chart_copy(rng, edition), colours[rng.choice(len(colours), REGIONS, replace=False)],
            kind, Place(), Place(), rng.uniform(0, 0.12), rng.uniform(0, 0.012),
            rng.uniform(0.85, 1.0), aside=ASIDE)
        with tempfile.TemporaryDirectory() as written:
            prior = _prior_without(database, makers, makers[camera], Path(written))
            try:
                each = of_shoot(Photos(Path(written), shoot, lamps[rng.integers(len(lamps))], prior,
                                       [seed, case, 1]))
            except SpectraboxError as error:
                each = []
                print(f"{case}: {error}", file=sys.stderr)
        rows += [{"case": case, "kind": kind, **row} for row in each]
        print(f"{case + 1}/{cases} {database.names[camera]}, {kind}, "
              f"{time.perf_counter() - start:.0f} s " + " ".join(
                  f"{row['action']} {row['said']:.2f}/{row['got']:.2f}" if "got" in row
                  else f"{row['action']} refused" for row in each), file=sys.stderr, flush=True)
    return rows


def table_of(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown: a line for every action, and what the first of the lists brought."""
    lines = ["| action | shoots | width left, said | got | within 15 % | colour error left, said "
             "| got | refused |", "|---|---|---|---|---|---|---|---|"]
    for action in TIMES:
        each = [row for row in rows if row["action"] == action]
        done = [row for row in each if "got" in row]
        if not done:
            continue
        said, got, said_colour, got_colour = (np.array([row[name] for row in done]) for name in (
            "said", "got", "said_colour", "got_colour"))
        close = np.abs(said / got - 1) <= CLOSE
        error = (got - said).std(ddof=1) / np.sqrt(len(done)) if len(done) > 1 else np.nan
        lines.append(f"| {action} | {len(done)} | {said.mean():.2f} | {got.mean():.2f} ± "
                     f"{error:.2f} | {close.sum()} | {said_colour.mean():.2f} | "
                     f"{got_colour.mean():.2f} | {len(each) - len(done)} |")
    firsts, better = [], []
    for case in sorted({row["case"] for row in rows}):
        done = [row for row in rows if row["case"] == case and "got" in row]
        if done:
            first = min(done, key=lambda row: row["said"])
            firsts.append(abs(first["said"] / first["got"] - 1) <= CLOSE)
            best = min(done, key=lambda row: row["got"])
            better.append(1 - best["got"] > MUCH_MORE * (1 - first["got"]))
    return "\n".join([*lines, "", f"first of the list: what is left within 15 % of what was said "
                      f"in {sum(firsts)} of {len(firsts)} shoots; another brought more than "
                      f"{MUCH_MORE} times as much in {sum(better)}"])


def main() -> None:
    """Print a table of the actions."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/ and lights/")
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    rows = measure(asked.data, asked.cases, asked.seed)
    print(json.dumps(rows) if asked.json else table_of(rows))


if __name__ == "__main__":
    main()
