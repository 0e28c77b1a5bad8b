"""Chart photos that each have one fault of a known cause: is it named, left open, or mistaken?

Small photos of a ColorChecker Classic by cameras whose maker is left out of the prior, under lamps
that the prior does not hold: copies of the chart, noise, a light that falls off a little, a little
glare, and one fault on top. The simulator shares no model with what is judged. Each photo is judged
as ``spectrabox chart`` does and fitted as ``spectrabox camera fit`` does.

A row a cause, for the photo by itself and for its fit. "right": it alone is named; "open": two or
three causes are named and it is among them; "wrong": others are named; "nothing": no finding claims
a cause. "by codes" is what the same findings claimed before causes competed: "right" where the only
claim is right, "wrong" where any other is made. "competition alone" leaves the findings' limits
away: what the patches say of every photo. ``chart_causes.MARGIN`` was chosen on photos of even
number, and the table is of those of odd number (``--half even`` shows the others).
"""
from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from spectrabox.calibrate import doubts
from spectrabox.calibrate.chart_calibration import evidence_on_lights
from spectrabox.calibrate.chart_photo import ChartPhoto, used_and_excluded
from spectrabox.calibrate.colour_drift import colour_drift
from spectrabox.calibrate.joint_estimate import estimate_through_glare, veiled
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.curve_posterior import relit
from spectrabox.calibrate.prior.learnt_prior import read_camera_database
from spectrabox.capture.chart import quality
from spectrabox.capture.chart.chart_agreement import TYPICAL_SIGNALS
from spectrabox.fixtures.chart_scene import GRID_MM, PITCH_MM, chart_scene
from spectrabox.radiometry import chart_causes
from spectrabox.radiometry.appearance import encode_srgb, tristimulus
from spectrabox.radiometry.chart import CLASSIC, SINCE_2014
from spectrabox.radiometry.charts.references import editions
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.findings import Finding, Severity, at_least
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.photos import ChartDetection, LinearImage, PhotoKind
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.named_spectra import light
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_unknown_makers import makers_of, prior_without

NONE = "none"
OUTCOMES = ("right", "open", "wrong", "nothing")
HEIGHT, WIDTH = 230, 330
PX_PER_MM = 1.05
REC709_FROM_XYZ = np.array([[3.2405, -1.5371, -0.4985], [-0.9693, 1.8760, 0.0416],
                            [0.0556, -0.2040, 1.0572]])


class Shoot:
    """One case: a camera, a lamp, a copy of the chart and one fault."""

    def __init__(self, cause: str, curves: np.ndarray, lamp: np.ndarray, other: np.ndarray,
                 rng: np.random.Generator) -> None:
        self.rng, self.cause = rng, cause
        edition = next(one for one in editions(CLASSIC) if one.made == SINCE_2014)
        reflectances = edition.drawn(rng)
        if cause == chart_causes.CHART:
            for patch in rng.choice(24, rng.integers(1, 4), replace=False):
                tint = rng.uniform(-0.6, 0.6) * np.linspace(-1, 1, FINE_GRID.nm.size)
                reflectances[patch] *= np.exp(-rng.uniform(0.1, 0.5) * (1 + tint))
        self.white = curves @ lamp / (curves @ lamp).max()
        signals = self._seen(reflectances, curves, lamp)
        # the photo's frame, of which the chart is a part: in chart pixels
        self.y, self.x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
        corners = (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) - 0.5) * GRID_MM * PX_PER_MM \
            + [WIDTH / 2, HEIGHT / 2]
        second = self._seen(reflectances, curves, other) if cause == chart_causes.TWO_LIGHTS \
            else signals
        self.second_white = curves @ other / (curves @ other).max()

        def scene(of: np.ndarray, white: np.ndarray) -> np.ndarray:
            return chart_scene(HEIGHT, WIDTH, of, corners, 0.3 * white, frame=0.03 * white,
                               subsamples=1).astype(float)
        picture = scene(signals, self.white) * self._fall_off(0.12)
        if cause == chart_causes.TWO_LIGHTS:
            angle, depth = rng.uniform(0, 2 * np.pi), rng.uniform(0.25, 1.2)
            along = np.exp(depth * self._along(angle))[..., None]
            share = rng.uniform(0.25, 0.75)
            picture = (1 - share) * picture * along + share / along * scene(
                second, self.second_white) * self._fall_off(0.12)
        picture = self._spoilt(picture, curves, corners)
        exposure = rng.uniform(0.35, 0.75) / picture[
            int(corners[3, 1] - 20), int(corners[3, 0] + 20)].max()
        picture = picture * exposure
        self.kind = PhotoKind.RAW if rng.random() < 0.5 else PhotoKind.LINEAR_FILE
        if cause == chart_causes.TONE:
            power = rng.uniform(0.45, 0.8)
            picture = np.maximum(picture, 0)
            picture = encode_srgb(picture) if rng.random() < 0.3 else picture**power
        noise = rng.choice([0.002, 0.01, 0.02])
        variance = noise**2 * (np.maximum(picture, 0) + 0.02)
        signal = picture + np.sqrt(variance) * rng.standard_normal(picture.shape)
        self.image = LinearImage(
            signal=np.minimum(signal, 1).astype(np.float32), variance=variance.astype(np.float32),
            saturated=signal >= 0.98, sensor_step=1.0, exposure_s=None, iso=None, f_number=None,
            kind=self.kind, camera="", source="simulated", sha256="")
        row, column = np.divmod(np.arange(24), 6)
        centres = (np.column_stack([column, row]) * PITCH_MM + 20) * PX_PER_MM + corners[0]
        quads = centres[:, None] + 0.6 * 20 * PX_PER_MM * np.array(
            [[-1, -1], [1, -1], [1, 1], [-1, 1]])
        self.detection = ChartDetection(quads, 1.0, False,
                                        Finding("chart.corners-given", Severity.INFO))

    def _seen(self, reflectances: np.ndarray, curves: np.ndarray, lamp: np.ndarray) -> np.ndarray:
        return reflectances @ (curves * lamp).T / (curves @ lamp).max()

    def _along(self, angle: float) -> np.ndarray:
        """From -1 to 1 over the chart in a direction."""
        return np.asarray(((self.x / WIDTH - 0.5) * np.cos(angle)
                           + (self.y / HEIGHT - 0.5) * np.sin(angle)) * 2)

    def _fall_off(self, size: float) -> np.ndarray:
        """Light of a lamp that is not far, with what the lens leaves of it at the edges."""
        x0, y0 = self.rng.normal(0, 1, 2)
        far = (self.x / WIDTH - 0.5 - x0) ** 2 + (self.y / WIDTH - 0.35 - y0) ** 2
        return (1 / (1 + self.rng.uniform(0, size) * far))[..., None]

    def _spoilt(self, picture: np.ndarray, curves: np.ndarray, corners: np.ndarray) -> np.ndarray:
        rng, white, cause = self.rng, self.white, self.cause
        picture = picture + rng.uniform(0, 0.005) * white
        if cause == chart_causes.VEIL:
            tint = np.exp(rng.normal(0, 0.08, 3))
            return picture + rng.uniform(0.04, 0.15) * white * tint
        if cause == chart_causes.REFLECTION:
            at = corners[0] + rng.uniform(0, 1, 2) * GRID_MM * PX_PER_MM
            width = rng.uniform(0.5, 1.6) * PITCH_MM * PX_PER_MM
            spot = np.exp(-0.5 * ((self.x - at[0]) ** 2 + (self.y - at[1]) ** 2) / width**2)
            return picture + rng.uniform(0.06, 0.3) * spot[..., None] * white
        if cause == chart_causes.UNEVEN:
            # a lamp close to the chart's side
            at = rng.uniform(0, 2 * np.pi)
            reach = WIDTH * rng.uniform(0.6, 1.2)
            lamp = np.array([WIDTH / 2, HEIGHT / 2]) + reach * np.array([np.cos(at), np.sin(at)])
            height = WIDTH * rng.uniform(0.5, 1.0)
            square = (self.x - lamp[0]) ** 2 + (self.y - lamp[1]) ** 2 + height**2
            return picture * ((reach**2 + height**2) / square)[..., None] ** 1.5
        if cause == chart_causes.COMPUTED:
            xyz = np.array([tristimulus(FINE_GRID.nm, one) for one in editions(CLASSIC)[0].mean])
            seen = editions(CLASSIC)[0].mean @ (curves * light("D65", FINE_GRID)).T
            seen = seen / (curves @ light("D65", FINE_GRID))
            matrix = np.linalg.lstsq(seen, xyz @ REC709_FROM_XYZ.T, rcond=None)[0]
            # the converter balances white first
            return np.asarray((picture / white) @ matrix)
        if cause == chart_causes.BLACK:
            level = rng.choice([-1, 1, 1]) * rng.uniform(0.01, 0.06)
            return picture + level * (1 if rng.random() < 0.7 else rng.uniform(0.3, 1.7, 3))
        if cause == chart_causes.SHADING:
            middle = np.array([WIDTH, HEIGHT]) * rng.uniform(-0.2, 1.2, 2)
            square = ((self.x - middle[0]) ** 2 + (self.y - middle[1]) ** 2) / WIDTH**2
            loss = rng.uniform(0.05, 0.2) + rng.uniform(0.1, 0.3) * rng.permutation([0, 0.5, 1])
            return np.asarray(picture * np.exp(-loss * square[..., None]))
        if cause == chart_causes.SHADOW:
            at = self._along(rng.uniform(0, 2 * np.pi)) - rng.uniform(-0.4, 0.4)
            lit = 1 / (1 + np.exp(-at / rng.uniform(0.01, 0.08)))
            depth = rng.uniform(0.12, 0.6) * np.exp(rng.normal(0, 0.04, 3))
            return np.asarray(picture * (1 - depth * lit[..., None]))
        return picture


def case(cause: str, number: int, seed: int, data: tuple[Any, ...]) -> dict[str, Any]:
    """One photo, judged and fitted."""
    database, makers, lamps, priors = data
    rng = np.random.default_rng([seed, number, sum(cause.encode())])
    camera, (one, two) = rng.integers(len(makers)), rng.choice(len(lamps), 2, replace=False)
    curves = on_grid(database.nm, database.curves[camera], FINE_GRID, database.names[camera])
    shoot = Shoot(cause, curves, lamps[one], lamps[two], rng)
    verdict = quality.judge_chart(shoot.image, shoot.detection, TYPICAL_SIGNALS)
    wrong = cause == chart_causes.LIGHT
    stated = lamps[two if wrong else one]
    known: Spectrum | UnknownLight = Spectrum(FINE_GRID, stated, Quantity.RELATIVE, "lamp") \
        if wrong or rng.random() < 0.5 else UnknownLight()
    shipped = editions(CLASSIC)
    photo = ChartPhoto(verdict.samples, shipped[0].mean, known, chart=CLASSIC,
                       editions=shipped[:1])
    maker = makers[camera]
    if maker not in priors:
        priors[maker] = prior_without(database, makers == maker)
    return {"cause": cause, "number": number, "chart": verdict.findings,
            "samples": verdict.samples, **fitted(photo, priors[maker])}


def fitted(photo: ChartPhoto, prior: CameraPrior) -> dict[str, Any]:
    """The joint estimate of a photo, without the fits that leave suspects out, which name no cause:
    what it found, and what causes are told from.
    """
    used, excluded = used_and_excluded([photo], FINE_GRID)
    try:
        fit, _ = estimate_through_glare(used, photo.light, prior, FINE_GRID, excluded)
    except SpectraboxError as error:
        return {"refused": str(error), "fit": (), "patches": None, "against": None}
    evidence = evidence_on_lights([photo], used, prior, FINE_GRID)
    drift = colour_drift(fit.posterior, relit(fit.posterior, used), 0)
    state = fit.photos[0]
    return {"refused": "disagrees" if fit.disagrees else "",
            "fit": (*veiled(fit), *evidence, doubts.unlike_cameras(fit),
                    *([] if drift is None else [doubts.drifting_light(*drift, None)])),
            "photo": used[0], "state": state,
            "evidence": evidence}


# ---- what is said --------------------------------------------------------------------------------

def ranking_of_photo(found: dict[str, Any]) -> dict[str, float]:
    """By the photo alone."""
    samples = found["samples"]
    return chart_causes.ranked(
        np.where(samples.clipped, np.nan, samples.mean), TYPICAL_SIGNALS, samples.standard_error,
        CLASSIC.centres_uv, quality.MIXING_SD)


def ranking_of_fit(found: dict[str, Any]) -> dict[str, float] | None:
    """By the photo and its fit; None where nothing could be fitted."""
    if "state" not in found:
        return None
    return doubts.ranked(found["photo"], found["state"], found["evidence"])


def claimed(findings: Sequence[Finding]) -> list[str]:
    """The causes that findings name."""
    named = []
    for one in at_least(findings, Severity.NOTE):
        named += chart_causes.CLAIMS.get(one.code, ())
        named += one.values.get("causes", [])
    return list(dict.fromkeys(named))


def outcome(cause: str, named: Sequence[str]) -> str:
    """How causes that are named compare with the true one."""
    truth = chart_causes.CHANCE if cause == NONE else cause
    if not named:
        return "right" if cause == NONE else "nothing"
    if truth not in named:
        return "wrong"
    return "right" if len(named) == 1 else "open"


class Said(NamedTuple):
    """Of one photo: how each way of naming a cause ended, and how many causes it named."""

    cause: str
    photo: str
    fit: str
    alone: str
    alone_with_fit: str
    by_codes_photo: str
    by_codes_fit: str
    sizes: tuple[int, ...]


def said(found: dict[str, Any]) -> Said:
    """What is said of a photo."""
    cause, photo, fit = found["cause"], ranking_of_photo(found), ranking_of_fit(found)
    # as the findings were before causes compete
    of_photo, of_fit = without_rule(found["chart"]), without_rule(found["fit"])
    named = claimed(chart_causes.settled(of_photo, photo, "chart.cause"))
    named_fit = claimed(of_fit if fit is None else chart_causes.settled(
        of_fit, fit, doubts.UNDECIDED_CAUSE))
    old, old_fit = claimed(of_photo), claimed(of_fit)

    def by_codes(claims: list[str]) -> str:
        ended = outcome(cause, claims)
        return "wrong" if ended == "open" else ended    # several are named, each as the one
    alone = chart_causes.likely_causes(photo)
    both = alone if fit is None else chart_causes.likely_causes(fit)
    return Said(cause, outcome(cause, named), outcome(cause, named_fit), outcome(cause, alone),
                outcome(cause, both), by_codes(old), by_codes(old_fit),
                tuple(len(names) for names in (named, named_fit) if names))


def without_rule(findings: Sequence[Finding]) -> list[Finding]:
    """Findings as they are before causes compete."""
    plain = []
    for one in findings:
        replaced = one.values.get("doubts")
        plain += [one] if replaced is None else [
            Finding(code, one.severity, one.subject, values) for code, values in replaced.items()]
    return plain


def table(rows: Sequence[Said]) -> None:
    """Print confusions: rows truth, columns how it was named."""
    ways = ("photo", "fit", "alone", "alone_with_fit", "by_codes_photo", "by_codes_fit")
    print("right, open, wrong, nothing of each way\n")
    print("| cause | photos | photo | fit | competition alone, photo | the same, fit "
          "| by codes, photo | by codes, fit |")
    print("|---|---|---|---|---|---|---|---|")
    truths = (NONE, *chart_causes.CAUSES)
    for truth in truths:
        of = [row for row in rows if row.cause == truth]
        counts = [", ".join(str(sum(getattr(row, way) == name for row in of))
                            for name in OUTCOMES) for way in ways]
        print(f"| {truth} | {len(of)} | {' | '.join(counts)} |")
    faulty = [row for row in rows if row.cause != NONE]
    for way in ways:
        ends = [getattr(row, way) for row in faulty]
        spoken = [end for end in ends if end != "nothing"]
        good = sum(end in ("right", "open") for end in spoken)
        share = good / len(spoken)
        print(f"{way}: of {len(faulty)} photos with a fault {len(spoken)} have a cause named, "
              f"right or open {share:.2f} ± {np.sqrt(share * (1 - share) / len(spoken)):.2f}, "
              f"right {spoken.count('right') / len(spoken):.2f}")
    print(f"causes named at a time: {np.mean([size for row in rows for size in row.sizes]):.2f}")


def main() -> None:
    """Photograph, fit, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/ and lights/")
    parser.add_argument("--cases", type=int, default=20, help="of each cause")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--half", choices=("odd", "even", "all"), default="odd")
    asked = parser.parse_args()
    with threadpool_limits(1):
        database = read_camera_database(asked.data / "cameras")
        with np.load(asked.data / "lights" / "lights_for_checks.npz") as stored:
            lamps = np.array([np.interp(FINE_GRID.nm, stored["wavelengths_nm"], spectrum)
                              for spectrum in stored["spectra"]])
        data = database, np.asarray(makers_of(database)), lamps, {}
        wanted = {"odd": (1,), "even": (0,), "all": (0, 1)}[asked.half]
        table([said(case(cause, number, asked.seed, data)) for number in range(asked.cases)
               if number % 2 in wanted for cause in (NONE, *chart_causes.CAUSES)])


if __name__ == "__main__":
    main()
