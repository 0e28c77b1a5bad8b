"""Flat samples photographed with real-life faults: what the bands hold, and what the verdict says.

Cameras and lamps of a folder, the camera's maker left out of the prior, a chart drawn among
editions and copies, nine published test colours in two rows beside it, photographed by near lamps
(``fixtures/near_lamps.py``, which shares no model with the inversion): each shoot once as it should
be, and once with each fault, by one photo and by three ways to take more of them:

    gels        two photos more, each through a filter of known transmittance before the lens
    lamp        a photo more under another unknown lamp in another place
    moved       a photo more under the same lamp in another place

Gloss: satin samples under a lamp so high that they mirror this share of white on the mean; the
second lamp stands as high, the moved one as one would put it. A shadow lies where the first lamp
stands, not where the other does; its edge crosses four samples, which alone count. Samples in
another plane are 0.04 widths of the picture higher and turned by 3 degrees, the chart by 10. A
brightener makes papers of the samples that emit in the blue. Two kinds of lamps shine in every
photo from two sides. "False PASS" counts sessions with the verdict PASS whose bands hold less than
90 %, and in brackets those in which the condition that the fault breaks is not named as assumed;
"gloss found" is how far that of the first photo is off, in per cent of white and in its errors.

With ``--verdicts`` the faults are more, each by one photo: those of the camera or its file, and
those of what is stated. A veil adds a twentieth of full scale, evenly or more to the right; a lens
shades the corners by colour; a black level is off by 1 %; a tone curve has a shoulder; the chart's
white or another patch is soiled by 15 %; another lamp's spectrum is stated; a card of .9 is said to
be .78; regions lie half on the table; another table of reflectances is stated; the chart was
photographed by itself before the lamp was moved. For each fault: how often the verdict passes with
one, three and nine regions of the same photo, how often a finding names something that none does
of the same shoot without the fault, how often the condition that it breaks stands after the "if",
and how wrong colours are that are said to be weak, and the others.
"""
from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import spectrabox
from spectrabox.calibrate.prior.camera_prior import save_camera_prior
from spectrabox.calibrate.prior.learnt_prior import CameraDatabase, read_camera_database
from spectrabox.fixtures.near_lamps import (
    ABOVE,
    REGIONS,
    WHITE,
    Lamp,
    Place,
    Shoot,
    drawn_lamp,
    moved,
    photograph,
    rectangles,
    with_gloss,
)
from spectrabox.fixtures.paints import NM, chart_copy
from spectrabox.measure.results.flat_result import FlatResult
from spectrabox.radiometry.appearance import delta_e00
from spectrabox.radiometry.chart import COPIES_BEFORE_2014, COPIES_SINCE_2014, REFERENCES
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import read_table

from benchmarks.bench_unknown_makers import makers_of, prior_without

FAULTS = ("none", "gloss 1.5 %", "gloss 3 %", "shadow 10 %", "shadow edge", "other plane",
          "chart tilted", "brightener", "two lamps")
# what becomes of the signal (H, W, K), as a fraction of full scale, by the camera or its file
SPOILT: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "veil": lambda signal: signal + 0.05 * _colour(signal),
    "uneven veil": lambda signal: signal + 0.05 * _across(signal) ** 2 * _colour(signal),
    "colour shading": lambda signal: signal * (1 + _from_middle(signal) * [-0.12, 0.0, 0.08]),
    "clipped": lambda signal: 1.5 * signal,
    "pedestal": lambda signal: signal + 0.013,
    "black too high": lambda signal: np.maximum(signal - 0.0065, 0),
    "tone curve": lambda signal: 1.5 * signal / (1 + 0.667 * signal)}
STATED = ("soiled white", "soiled patch", "wrong light", "wrong card", "two paints",
          "wrong reference", "lamp moved between")
# shoots without a fault, and all of which the verdict is asked
FAULTLESS = ("none", "right light", "right card")
VERDICTS = (*FAULTLESS, *FAULTS[1:], *SPOILT, *STATED)
WHITE_PATCH, SOILED, CARD_NUMBER, WRONG_CARD = 18, 0.85, 6, 0.78
NUMBERS = (1, 3, REGIONS)   # of regions with which a verdict is asked for
OTHER_REFERENCE = "ColorChecker N Ohta"
# conditions of a result that a fault breaks
BROKEN = {"gloss 1.5 %": "gloss", "gloss 3 %": "gloss", "shadow 10 %": "shadow",
          "shadow edge": "shadow", "other plane": "plane", "chart tilted": "plane",
          "brightener": "fluorescence", "two lamps": "light on the sample",
          "lamp moved between": "light on the sample"}
PROTOCOLS = ("one", "gels", "lamp", "moved")
GELS = ("Tiffen Red1(25)", "Tiffen 80A")
SHADOW, EDGE_SHADOW = 0.10, 0.15
LATER_EDITION = 0.9         # share of charts in use
HIGHER, TURNED, CHART_TURNED = 0.04, np.radians(3.0), np.radians(10.0)


def papers(rng: np.random.Generator) -> np.ndarray:
    """Total radiance factors (REGIONS, P) of papers with a brightener, which absorbs below 410 nm
    and emits about 440 nm.
    """
    base = rng.uniform(0.75, 0.88, (REGIONS, 1)) + rng.uniform(-0.03, 0.03, (REGIONS, 1)) * (
        NM - 550) / 150
    absorbed = 1 - rng.uniform(0.3, 0.8, (REGIONS, 1)) / (1 + np.exp((NM - 405) / 6))
    emitted = np.where(NM < 440, np.exp(-0.5 * ((NM - 440) / 12) ** 2),
                       np.exp(-0.5 * ((NM - 440) / 28) ** 2))
    return base * absorbed + rng.uniform(0.08, 0.3, (REGIONS, 1)) * emitted


def photos_of(folder: Path, fault: str, protocols: Sequence[str], shoot: Shoot,
              lamps: Sequence[np.ndarray], filters: Sequence[np.ndarray],
              rng: np.random.Generator) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Write the photos of one shoot with one fault: first.dng, those of the protocols, and
    chart.dng of a chart by itself.

    Returns
    -------
    (REGIONS, P) array
        The true spectra.
    dict
        By photo what the samples mirror, (REGIONS,).
    """
    draws = np.random.default_rng(rng.integers(2**31))      # of what a fault alone needs
    first, other = drawn_lamp(rng), drawn_lamp(rng)
    elsewhere, second = moved(first, rng), rng.choice([-1, 1])
    if fault == "brightener":
        shoot = replace(shoot, surfaces=papers(draws))
    elif fault.startswith("gloss"):
        shoot = replace(shoot, kind="satin")
        wanted = float(fault.split()[1]) / 100
        first, other = (with_gloss(shoot, lamp, wanted) for lamp in (first, other))
    elif fault == "other plane":
        shoot = replace(shoot, samples=Place(HIGHER, _turned(TURNED, draws)))
    elif fault == "chart tilted":
        shoot = replace(shoot, card=Place(0.0, _turned(CHART_TURNED, draws)))
    elif fault.startswith("soiled"):
        patches = np.arange(len(shoot.chart))
        patch = WHITE_PATCH if fault == "soiled white" else draws.integers(WHITE_PATCH)
        shoot = replace(shoot, chart=np.where(patches[:, None] == patch, SOILED, 1.0) * shoot.chart)
    elif fault.endswith(" card"):
        shoot = replace(shoot, cards=(CARD_NUMBER,))
    kept_off = {"shadow 10 %": SHADOW, "shadow edge": EDGE_SHADOW}.get(fault, 0.0)
    edge = fault == "shadow edge"

    def light(lamp: Lamp, spectrum: np.ndarray) -> list[tuple[Lamp, np.ndarray]]:
        if fault != "two lamps":
            return [(lamp, spectrum)]
        beside = replace(lamp, azimuth=lamp.azimuth + second * np.radians(120))
        return [(lamp, spectrum), (beside, lamps[2])]

    name = {"gels": ["red", "blue"], "lamp": ["lamp"], "moved": ["moved"]}
    wanted_photos = ["first", *(photo for one in protocols for photo in name.get(one, []))]
    wanted_photos += ["chart"] * (fault == "lamp moved between")
    mirrored = {}
    for number, (photo, lit, through, shade) in enumerate((
            ("first", light(first, lamps[0]), None, kept_off),
            ("red", light(first, lamps[0]), filters[0], kept_off),
            ("blue", light(first, lamps[0]), filters[1], kept_off),
            ("lamp", light(other, lamps[1]), None, 0.0),
            ("moved", light(elsewhere, lamps[0]), None, 0.0),
            ("chart", light(elsewhere, lamps[0]), None, 0.0))):
        noise = np.random.default_rng([number, rng.integers(2**31)])
        if photo in wanted_photos:
            mirrored[photo] = photograph(folder / f"{photo}.dng", shoot, lit, noise, shade=shade,
                                         edge=edge, through=through, spoilt=SPOILT.get(fault))
    return shoot.surfaces, mirrored


def stated_of(folder: Path, fault: str, lamps: Sequence[np.ndarray]) -> dict[str, Any]:
    """What ``spectrabox.flat`` is told of a shoot with a fault, beside its photo."""
    if fault.endswith(" light"):
        power = lamps[0] if fault == "right light" else lamps[1]
        return {"light": (NM, power)}
    if fault.endswith(" card"):
        card = WHITE if fault == "right card" else WRONG_CARD
        return {"known": {f"s{CARD_NUMBER}": (card, 0.005)}}
    if fault == "wrong reference":
        return {"reference": OTHER_REFERENCE}
    if fault == "lamp moved between":
        return {"chart_photo": folder / "chart.dng"}
    return {}


def outlined(fault: str) -> dict[str, tuple[float, ...]]:
    """Rectangles of the regions; of two paints, the first half on the table."""
    regions = {f"s{number}": corners for number, corners in enumerate(rectangles())}
    if fault == "two paints":
        x0, y0, x1, y1 = regions["s0"]
        regions["s0"] = (x0 - 0.7 * (x1 - x0), y0, x0 + 0.5 * (x1 - x0), y1)
    return regions


def further(folder: Path, protocol: str, filters: Sequence[np.ndarray]) -> dict[str, Any]:
    """What ``spectrabox.flat`` is told of the photos beside the first."""
    if protocol == "gels":
        return {"filtered": {folder / f"{name}.dng": (NM, values) for name, values
                             in zip(("red", "blue"), filters, strict=True)}}
    return {"one": {}, "lamp": {"also": {folder / "lamp.dng": "unknown"}},
            "moved": {"also": {folder / "moved.dng": "moved"}}}[protocol]


def figures(folder: Path, truth: np.ndarray, judged: slice, prior: Path,
            regions: Mapping[str, tuple[float, ...]], **stated: Any) -> dict[str, Any]:
    """Figures of one session, by the function that users call."""
    result = spectrabox.flat(folder / "first.dng", regions, camera_prior=prior, draws=1000,
                             progress=False, **stated)
    found = result.found
    surfaces = []
    for surface, spectrum in list(zip(found.surfaces, truth, strict=True))[judged]:
        if surface.known:
            continue
        assert surface.summary is not None
        (said,) = [one for one in found.findings
                   if one.code == "surface.known-to" and one.subject == surface.name]
        at_nm = np.interp(surface.nm, NM, spectrum)
        lower, upper = surface.summary.lower, surface.summary.upper
        surfaces.append({
            "rmse": float(np.sqrt(np.mean((surface.mean - at_nm) ** 2))),
            "inside": float(np.mean((lower <= at_nm) & (at_nm <= upper))),
            "width": float(np.mean(upper - lower)),
            "dE00": delta_e00(surface.nm, surface.mean, at_nm), **dict(said.values)})
    return {**{name: float(np.mean([one[name] for one in surfaces]))
               for name in ("rmse", "inside", "width")},
            "verdict": result.verdict, "surfaces": surfaces,
            "codes": sorted({one.code for one in found.verdict.problems}),
            "passes": {number: passes(found, number) for number in NUMBERS},
            "named": [condition["name"] for condition in result.facts()["conditions"]
                      if condition["named"]],
            "found": [[(place["gloss"], place["gloss_error"]) for place
                       in region["lamp_places"]] for region in result.facts()["regions"]
                      if "lamp_places" in region]}


def passes(found: FlatResult, number: int) -> float:
    """How often the verdict passes with so many of the regions, beside those of known spectrum."""
    names = [surface.name for surface in found.surfaces if not surface.known]
    groups = [names[start:start + number] for start in range(0, len(names), number)]
    words = [with_regions(found, group).verdict.word for group in groups]
    return float(np.mean([word == "pass" for word in words]))


def with_regions(found: FlatResult, names: Sequence[str]) -> FlatResult:
    """The result, had only some of its regions been outlined."""
    left = {surface.name for surface in found.surfaces if surface.known or surface.name in names}

    def kept(of_regions: Mapping[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in of_regions.items() if name in left}

    return replace(
        found, surfaces=tuple(surface for surface in found.surfaces if surface.name in left),
        photos=tuple(replace(photo, light=kept(photo.light), scatter=kept(photo.scatter),
                             edges=kept(photo.edges)) for photo in found.photos))


def measure(data: Path, cases: int, seed: int, faults: Sequence[str], protocols: Sequence[str],
            **stated: Any) -> list[dict[str, Any]]:
    """Figures of every session; one that is refused has its sentence alone.

    Parameters
    ----------
    data : Path
        With cameras/, lights/ and filters/.
    cases, seed : int
    faults, protocols : sequence of str
        Of FAULTS and PROTOCOLS.
    stated
        What ``spectrabox.flat`` is told of the surfaces.
    """
    database, rng = read_camera_database(data / "cameras"), np.random.default_rng(seed)
    makers = np.asarray(makers_of(database))
    with np.load(data / "lights" / "lights_for_checks.npz") as stored:
        spectra = np.array([np.interp(NM, stored["wavelengths_nm"], row)
                            for row in stored["spectra"]])
    sets = test_reflectances(grid_from_nm(NM[20:-30]))
    colours = np.vstack([rows for name, rows in sets.items() if name not in REFERENCES])
    padded = np.pad(colours, ((0, 0), (20, 30)), mode="edge")
    table = read_table(data / "filters" / "photographic_filters_27.csv")
    filters = [np.interp(NM, table.nm, table.values[table.names.index(name)]) for name in GELS]
    rows = []
    with tempfile.TemporaryDirectory() as written:
        folder = Path(written)
        for case in range(cases):
            start = time.perf_counter()
            camera, lamps = int(rng.integers(len(makers))), rng.choice(len(spectra), 3, False)
            edition = COPIES_SINCE_2014 if rng.random() < LATER_EDITION else COPIES_BEFORE_2014
            shoot = Shoot(
                np.array([np.interp(NM, database.nm, row) for row in database.curves[camera]]),
                chart_copy(rng, edition),
                padded[rng.choice(len(padded), REGIONS, replace=False)],
                "matt", Place(), Place(), rng.uniform(0, 0.12), rng.uniform(0, 0.012),
                rng.uniform(0.85, 1.0))
            prior = _prior_without(database, makers, makers[camera], folder)
            for fault in faults:
                truth, mirrored = photos_of(folder, fault, protocols, shoot, spectra[lamps],
                                            filters, np.random.default_rng([seed, case]))
                judged = {"shadow edge": slice(len(ABOVE)), "two paints": slice(1)}.get(
                    fault, slice(None))
                for protocol in protocols:
                    row = {"case": case, "fault": fault, "protocol": protocol,
                           "gloss": {name: values.tolist() for name, values in mirrored.items()}}
                    try:
                        row |= figures(
                            folder, truth, judged, prior, outlined(fault),
                            **further(folder, protocol, filters),
                            **stated_of(folder, fault, spectra[lamps]), **stated)
                    except SpectraboxError as error:
                        row["refused"] = str(error)
                    rows.append(row)
            print(f"{case + 1}/{cases} {database.names[camera]}, "
                  f"{time.perf_counter() - start:.0f} s", file=sys.stderr, flush=True)
    return rows


def _colour(signal: np.ndarray) -> np.ndarray:
    """Of a picture's mean (K,), of mean 1."""
    return np.asarray(signal.mean(axis=(0, 1)) / signal.mean())


def _across(signal: np.ndarray) -> np.ndarray:
    """From 0 at the left to 2 at the right."""
    return np.asarray(np.linspace(0, 2, signal.shape[1])[None, :, None])


def _from_middle(signal: np.ndarray) -> np.ndarray:
    """Square of the distance from the middle, 1 in the corners."""
    y, x = (np.linspace(-1, 1, size) for size in signal.shape[:2])
    return np.asarray((y[:, None, None] ** 2 + x[None, :, None] ** 2) / 2)


def _turned(angle: float, rng: np.random.Generator) -> tuple[float, float, float]:
    """A normal turned by an angle to any side."""
    side = rng.uniform(0, 2 * np.pi)
    return (np.sin(angle) * np.cos(side), np.sin(angle) * np.sin(side), np.cos(angle))


def _prior_without(database: CameraDatabase, makers: np.ndarray, maker: str, folder: Path) -> Path:
    path = folder / f"{maker}.npz".replace(" ", "_")
    if not path.exists():
        save_camera_prior(path, prior_without(database, makers == maker))
    return path


def table_of(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown: a line for every fault and way to photograph it."""
    lines = ["| fault | photos | bands hold | RMSE | width | PASS, WARN, FAIL, refused "
             "| false PASS | gloss found |", "|---|---|---|---|---|---|---|---|"]
    for fault in FAULTS:
        for protocol in PROTOCOLS:
            each = [row for row in rows if (row["fault"], row["protocol"]) == (fault, protocol)]
            done = [row for row in each if "refused" not in row]
            if not each:
                continue
            verdicts = [row["verdict"] for row in done]
            counts = [*(verdicts.count(word) for word in ("pass", "warn", "fail")),
                      len(each) - len(done)]
            inside, rmse, width = (np.array([row[name] for row in done])
                                   for name in ("inside", "rmse", "width"))
            error = inside.std(ddof=1) / np.sqrt(len(done)) if len(done) > 1 else np.nan
            wrong = [row for row in done if row["verdict"] == "pass" and row["inside"] < 0.9]
            unnamed = sum(BROKEN.get(fault) not in row["named"] for row in wrong)
            held = "" if not done else (f"{inside.mean():.3f} ± {error:.3f} | {rmse.mean():.4f} | "
                                        f"{width.mean():.3f}")
            lines.append(f"| {fault} | {protocol} | {held or ' | | '} | "
                         f"{', '.join(map(str, counts))} | {len(wrong)} ({unnamed}) "
                         f"| {_gloss_found(done)} |")
    return "\n".join(lines)


def table_of_verdicts(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown: a line for every fault, by one photo."""
    lines = ["| fault | PASS with 1, 3, 9 regions | refused | named | after the if | bands hold "
             "| dE00; of weak colours |", "|---" * 7 + "|"]
    usual = {row["case"]: set(row["codes"]) for row in rows
             if row["fault"] == "none" and "codes" in row}
    for fault in VERDICTS:
        each = [row for row in rows if row["fault"] == fault]
        done = [row for row in each if "refused" not in row]
        if not each:
            continue
        passed = ", ".join(f"{np.mean([row['passes'][number] for row in done]):.2f}"
                           for number in NUMBERS) if done else ""
        named = len(each) - len(done) + sum(
            bool(set(row["codes"]) - usual.get(row["case"], set())) for row in done)
        broken = sum(BROKEN.get(fault) in row["named"] for row in done)
        of_all = "" if fault in FAULTLESS else f"{named} of {len(each)}"
        surfaces = [one for row in done for one in row["surfaces"]]
        inside = f"{np.mean([one['inside'] for one in surfaces]):.3f}" if surfaces else ""
        lines.append(
            f"| {fault} | {passed} | {len(each) - len(done)} of {len(each)} | {of_all} | "
            f"{f'{broken} of {len(done)}' if fault in BROKEN else ''} | {inside} | "
            f"{_colours(surfaces) if surfaces else ''} |")
    return "\n".join(lines)


def _colours(surfaces: Sequence[dict[str, Any]]) -> str:
    """Mean CIEDE2000 of surfaces of which nothing is said; of weak ones, and their share."""
    each = [[one["dE00"] for one in surfaces if one["weak"] is is_weak]
            for is_weak in (False, True)]
    others, weak = (f"{np.mean(off):.1f}" if off else "none" for off in each)
    return f"{others}; {weak} ({len(each[1]) / max(len(surfaces), 1):.2f})"


def _gloss_found(rows: Sequence[dict[str, Any]]) -> str:
    """How far the gloss found in the first photo is off what was mirrored there, root mean square
    in per cent of white and in stated errors; empty without a moved lamp.
    """
    off = np.array([(100 * (found[0][0] - true), (found[0][0] - true) / found[0][1])
                    for row in rows for found, true
                    in zip(row["found"], row["gloss"]["first"], strict=bool(row["found"]))])
    if not off.size:
        return ""
    share, errors = np.sqrt(np.mean(off**2, axis=0))
    return f"± {share:.1f} % ({errors:.1f})"


def main() -> None:
    """Print a table of the faults."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, required=True,
                        help="folder with cameras/, lights/ and filters/")
    parser.add_argument("--cases", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--faults", nargs="*", choices=VERDICTS)
    parser.add_argument("--photos", nargs="*", default=list(PROTOCOLS), choices=PROTOCOLS)
    parser.add_argument("--verdicts", action="store_true",
                        help="all faults by one photo, and what the verdict says of them")
    parser.add_argument("--surface", help="what is stated of the samples: matt, satin or glossy")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    faults = asked.faults or (VERDICTS if asked.verdicts else FAULTS)
    rows = measure(asked.data, asked.cases, asked.seed, faults,
                   PROTOCOLS[:1] if asked.verdicts else asked.photos, surface=asked.surface)
    table = table_of_verdicts if asked.verdicts else table_of
    print(json.dumps(rows) if asked.json else table(rows))


if __name__ == "__main__":
    main()
