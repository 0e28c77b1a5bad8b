"""What speaks for and against a result: one function a rule, from a result to findings.

Causes come before symptoms: the first finding that speaks against a result is the headline. A
finding's words are in ``measure.texts``; what a result rests on is in ``measure.conditions``.
"""
from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from spectrabox.calibrate import camera_curves, chart_findings
from spectrabox.measure import conditions, texts
from spectrabox.measure.regions import white
from spectrabox.radiometry.findings import (
    Finding,
    Severity,
    at_least,
    each_once,
    faults,
    graded,
    worst,
)
from spectrabox.radiometry.records import photos, spectra
from spectrabox.radiometry.records.scenes import Reconstruction, SurfaceAgreement
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.reconstruct import known_light, misfit
from spectrabox.sampling.prior.family_coverage import mostly_in_doubt

if TYPE_CHECKING:
    from spectrabox.measure.camera import CameraFit
    from spectrabox.measure.results import flat_result, scene_result
    from spectrabox.measure.results.capture_result import CaptureResult
    from spectrabox.measure.scene.rehearsal import Rehearsed

# of a photo, share of its pixels: they are left out, so they cost coverage, not correctness
CLIPPED_LIMIT = 0.05
# CIEDE2000 at the probability of the band. Colours that are known worse are off by 1.6 to 2 times
# as much as others on faultless simulated shoots; how wrong spectra are their statements hardly
# tell, and one for both tells nothing: dark surfaces are weak in colour, light ones in spectrum.
WEAK_COLOUR = 5.0
# Relative scatter of a region's pixels. One paint whose relief slopes by 20 degrees (rms) scatters
# by 0.25 in light from 45 degrees; halves of two paints of a ColorChecker by more in 93 % of pairs,
# three paints in 99 %.
ONE_PAINT = 0.25
# |photo / rendering - 1|: pass up to the first, fail beyond the second
MEDIAN_LIMITS = (0.02, 0.05)
WORST_LIMITS = (0.05, 0.15)
SURFACE_OFF = 0.05                    # of a surface that is named without being beyond chance
BANDS_ALIKE = 0.3                     # of its deviation: what its bands differ by where all are off
MAX_NAMED = 3                         # surfaces of which each is said by itself
# Standard errors: by which known surfaces and chart may differ in the level of the light, or a band
# of it in colour. One of a hundred right pairs of photos differs by 2.6 in level.
LIGHT_DOUBTED = 3.0
# Standard deviations, rms over wavelengths, of a stated truth from the mean. Of 119 surfaces of
# published sets in a simulated camera's signals (1 %, D65) right truths reach 3.5, 1 in 100 exceeds
# 2.1; truths of another of these surfaces exceed 4 in more than nine of ten pairs.
ANOTHER_TRUTH = 4.0
# Relative, of the level of the light: up to here it adds no more to a colour than bands do already
LEVEL_KNOWN = 0.1
SMALLEST_SPREAD = 0.002               # of white: what measured spectra repeat to
UNTESTED = "surface.untested"


# ---- the verdict ---------------------------------------------------------------------------------

@dataclass(frozen=True, eq=False)
class Verdict:
    """PASS, WARN or FAIL: the worst of the findings, and what it rests on.

    Attributes
    ----------
    findings : tuple of Finding
        Causes before symptoms.
    right : Finding
        What is said where none of them speaks against the result.
    conditions : tuple of Finding
        That the verdict names after its "if"; none of a result that rests on nothing assumed.
    """

    findings: tuple[Finding, ...]
    right: Finding
    conditions: tuple[Finding, ...] = ()

    @property
    def severity(self) -> Severity:
        """The worst of all findings."""
        return worst(self.findings)

    @property
    def word(self) -> str:
        """"pass", "warn" or "fail"."""
        return {Severity.WARN: "warn", Severity.FAIL: "fail"}.get(self.severity, "pass")

    @property
    def problems(self) -> tuple[Finding, ...]:
        """What speaks against the result, the worst first."""
        return tuple(one for severity in (Severity.FAIL, Severity.WARN) for one in self.findings
                     if one.severity is severity)

    @property
    def passed(self) -> tuple[Finding, ...]:
        """What was looked at and is within its limit."""
        return tuple(one for one in self.findings
                     if one.severity is Severity.INFO and texts.is_tested(one))

    @property
    def reasons(self) -> list[str]:
        """Why it is what it is, in sentences: of a WARN or FAIL those that make it one."""
        decisive = [one for one in self.problems if one.severity is self.severity]
        return [*dict.fromkeys(map(texts.says, decisive or (self.right,)))]

    @property
    def sentence(self) -> str:
        """The same in one paragraph."""
        return " ".join(self.reasons)

    @property
    def condition(self) -> str:
        """What it rests on, as the end of "if ..."; empty where nothing assumed would be seen, and
        of a FAIL, which no condition mends.
        """
        return "" if self.severity is Severity.FAIL else texts.conditions(self.conditions)

    @property
    def title(self) -> str:
        """PASS, WARN or FAIL, with what it rests on: "PASS if matt"."""
        return " if ".join(filter(None, [self.word.upper(), self.condition]))

    @property
    def says(self) -> str:
        """The sentence, with what it rests on."""
        if not self.condition:
            return self.sentence
        said = self.sentence if self.problems else texts.continued(self.sentence)
        return f"If {self.condition}: {said}"

    @property
    def headline(self) -> str:
        """The sentence; of several reasons the first."""
        first, *others = self.reasons
        more = f" And {len(others)} more reason{'s' if len(others) > 1 else ''}, below."
        return first + more if others else first

    @property
    def line(self) -> str:
        """For a terminal: several reasons each on a line of its own."""
        if len(self.reasons) == 1:
            return f"verdict: {self.title}. {self.sentence}"
        return "\n- ".join([f"verdict: {self.title}", *self.reasons])

    @property
    def doubts(self) -> dict[str, tuple[str, ...]]:
        """What speaks against each surface or its band, by its name, as headings; only surfaces
        that have any.
        """
        doubts: dict[str, tuple[str, ...]] = {}
        for one in (*self.problems, *(one for one in self.findings if one.code == UNTESTED)):
            for surface in one.values.get("surfaces", ()):
                doubts[surface] = tuple(dict.fromkeys((*doubts.get(surface, ()), texts.name(one))))
        return doubts


def findings_on(found: CaptureResult) -> tuple[Finding, ...]:
    """All that speaks for or against a result, and what is worth knowing of it."""
    return each_once((
        *found.kept, *processed(found), *chart_photos(found), *of_calibration(found),
        *found.own_findings, *fits(found), *draws(found), *known_to(found), *untested(found),
        *truth_coverage(found), *stated_truths(found)))


# ---- results of any kind -------------------------------------------------------------------------

def processed(found: CaptureResult) -> list[Finding]:
    """Whether a photo is not proportional to light, and was decoded as sRGB all the same."""
    return [Finding("photo.not-linear", Severity.WARN)] if found.processed else []


def chart_photos(found: CaptureResult) -> list[Finding]:
    """Whether each chart photo is good, as ``spectrabox chart`` says it of the same photo."""
    return [one for view, findings in found.chart_findings.items()
            for one in [replace(fault, subject=fault.subject or view) for fault in faults(findings)]
            or [Finding("chart.good", Severity.INFO, view)]]


def fits(found: CaptureResult) -> list[Finding]:
    """How the fits of the camera ended."""
    return [Finding("fit.of-camera", *ended(fit.sensitivity.outcome, view))
            for view, fit in {"": found.calibration, **found.other_calibrations}.items()]


def ended(outcome: spectra.Outcome, photo: str = "") -> tuple[Severity, str, dict[str, Any]]:
    """How a fit ended: severity, subject and values of a finding."""
    return outcome.finding().severity, photo, {"outcome": outcome.value}


def draws(found: CaptureResult) -> list[Finding]:
    """Whether the draws of every estimated surface are as intended."""
    drawn = [(surface, surface.samples) for surface in found.surfaces
             if surface.samples is not None]
    doubtful = [replace(one, subject=surface.name,
                        values={**one.values, "surfaces": [surface.name]})
                for surface, samples in drawn for one in at_least(samples.findings, Severity.NOTE)]
    return doubtful or [Finding("draws.intended", Severity.INFO,
                                values={"outcome": samples.outcome.value})
                        for _, samples in drawn[:1]]


def known_to(found: CaptureResult) -> Iterator[Finding]:
    """How well each surface is known, by its own draws; what is known weakly is no fault."""
    for surface in found.surfaces:
        if surface.within is None or surface.summary is None:
            continue
        (colour, spectrum), shares = surface.within, surface.causes
        cause = max(shares, key=lambda one: shares[one], default="")
        yield Finding("surface.known-to", Severity.INFO, surface.name, {
            "colour": colour, "spectrum": spectrum, "level": float(surface.summary.level),
            "weak": colour > WEAK_COLOUR,
            "cause": cause, "share": float(shares.get(cause, 0.0)),
            "by_light": conditions.share_by(surface, conditions.LIGHT_CAUSES)})


def untested(found: CaptureResult) -> list[Finding]:
    """Surfaces of which most of what they may be was not certified on measured surfaces."""
    return [Finding(UNTESTED, Severity.INFO, surface.name, {
        "surfaces": [surface.name],
        "families": [family.name for family in surface.families if family.in_doubt]})
        for surface in found.surfaces if mostly_in_doubt(surface.families)]


def truth_coverage(found: CaptureResult) -> list[Finding]:
    """How much of the measured spectra their bands hold."""
    tested = [(surface.scores.coverage, surface.summary.level) for surface in found.surfaces
              if surface.scores is not None and surface.summary is not None]
    if not tested:
        return [Finding("truth.not-given", Severity.INFO)]
    share, level = np.mean(tested, axis=0)
    return [Finding("truth.held", Severity.INFO, values={
        "value": float(share), "intended": float(level), "tested": len(tested)})]


def stated_truths(found: CaptureResult) -> list[Finding]:
    """Whether each stated truth can be that of its surface."""
    far = {}
    for surface in found.surfaces:
        if surface.truth is not None and surface.summary is not None:
            off = spectrum_on_grid(surface.truth, surface.summary.grid) - surface.summary.mean
            spread = np.maximum(surface.summary.standard_deviation, SMALLEST_SPREAD)
            far[surface.name] = float(np.sqrt(np.mean((off / spread) ** 2)))
    if not far:
        return []
    name = max(far, key=lambda one: far[one])
    code, severity = ("truth.of-another", Severity.WARN) if far[name] > ANOTHER_TRUTH \
        else ("truth.possible", Severity.INFO)
    return [Finding(code, severity, name, {
        "value": far[name], "passes": ANOTHER_TRUTH,
        "surfaces": [each for each, off in far.items() if off > ANOTHER_TRUTH]})]


# ---- calibration ---------------------------------------------------------------------------------

def of_calibration(found: CaptureResult) -> list[Finding]:
    """What the calibrations found, copies of charts, left-out patches, residuals of charts."""
    return [*of_fits(found), *held_out_patches(found), *chart_agreement(found)]


def of_fits(found: CaptureResult) -> list[Finding]:
    """What the fits found of cameras, lights and charts."""
    fits = {"": found.calibration, **found.other_calibrations}
    return [*(of_photo(one, view) for view, fit in fits.items() for one in fit.findings),
            *found.calibration_findings]


def of_photo(finding: Finding, view: str) -> Finding:
    """The finding, of a further photo; as it is of the first."""
    return replace(finding, subject=view) if view else finding


def held_out_patches(found: CaptureResult) -> list[Finding]:
    """How well each chart patch is predicted by a calibration without it; nothing without a chart.
    """
    chart = found.chart
    if chart is None or chart.left_out is None:
        return []
    left_out = {"": chart.left_out, **found.other_charts}
    return [of_photo(one, view) for view, patches in left_out.items()
            for one in (*chart_findings.held_out(patches, found.layout.names),
                        chart_findings.colours(patches))]


def chart_agreement(found: CaptureResult) -> list[Finding]:
    """How well each calibration reproduces the first chart that it was fitted to."""
    residuals, chart, measured = chart_residuals(found), found.chart, found.measured_chart
    if residuals is not None and chart is not None and measured is not None:
        counted = np.ones(len(residuals), bool) if chart.left_out is None \
            else chart.left_out.counted
        residuals = residuals[~measured.samples.clipped & counted[:, None]]
    if chart_findings.root_mean_square(residuals) is None:
        passes, fails = chart_findings.CHART_LIMITS
        return [Finding("calibration.no-chart", Severity.INFO,
                        values={"value": None, "passes": passes, "fails": fails})]
    each = {"": residuals}
    for view, made in found.other_calibrations.items():
        assert made.sensitivity.residuals is not None
        each[view] = made.sensitivity.residuals[found.other_charts[view].counted]
    return [of_photo(one, view) for view, values in each.items() if values is not None
            for one in chart_findings.chart_residual(values, found.stated.chart_stated)]


def chart_residuals(found: CaptureResult) -> np.ndarray | None:
    """(photo - predicted) / photo of the patches (I, K), or None where no chart was used."""
    residuals = found.calibration.sensitivity.residuals
    if residuals is None and found.chart is not None and found.measured_chart is not None:
        measured = found.measured_chart.samples.mean
        return (measured - found.chart.predicted) / measured
    return residuals


# ---- a camera by itself --------------------------------------------------------------------------

def of_camera(fit: CameraFit) -> list[Finding]:
    """All that was found of a camera that was fitted by itself, in the order of a result."""
    calibration, first, copy = fit.chart.calibration, fit.chart_photos[0], fit.chart.copy
    names = first.chart.names
    off = 1 - fit.chart.predicted / first.samples.mean
    return [*calibration.findings,
            *([] if copy is None else [chart_findings.edition(copy)]),
            *fit.chart.of_chart(fit.held_out, names),
            *chart_findings.held_out(fit.held_out, names), chart_findings.colours(fit.held_out),
            *chart_findings.chart_residual(
                off[~first.samples.clipped & fit.held_out.counted[:, None]], not first.editions),
            Finding("fit.of-camera", *ended(fit.sensitivity.outcome))]


def camera_fitted(fit: CameraFit) -> Finding:
    """What was fitted of a camera, how surely, and what it is for."""
    light, band = fit.chart_photos[0].light, fit.curve_band
    if isinstance(light, spectra.UnknownLight):
        stated = f"a light stated as {light.stated}" if light.stated else "an unknown light"
    else:
        stated = "the given light" if fit.light == "given" else fit.light
    return Finding("camera.fitted", Severity.INFO, values={
        "bands": list(fit.bands), "photos": len(fit.chart_photos), "light": stated,
        "products": fit.chart.calibration.products, "level": camera_curves.LEVEL,
        "half_width": None if band is None else float((band[1] - band[0]).mean()) / 2,
        "noise_alone": fit.chart.prior_fit is None,
        "delta_e00": float((fit.chart.delta_e if band is None
                            else fit.chart.held_out_delta_e).mean())})


# ---- flat samples --------------------------------------------------------------------------------

def flat_findings(found: flat_result.FlatResult) -> list[Finding]:
    """Change of the light, levels of known regions, scatter of their pixels, edges across them."""
    return [*light_change(found), *known_levels(found),
            *uneven_regions(found), *edges(found), clipped("flat.clipped", found)]


def light_change(found: flat_result.FlatResult) -> list[Finding]:
    """How much the light changes from the chart to the regions."""
    levels = np.array([level for photo in found.photos for level, _ in photo.light.values()]
                      + [1.0])
    return [Finding("flat.light-change", Severity.INFO,
                    values={"value": float(levels.max() / levels.min() - 1)})]


def known_levels(found: flat_result.FlatResult) -> list[Finding]:
    """How far the stated levels of known regions are from what the chart's light gives."""
    misfits = largest_of_photos(photo.level_misfits for photo in found.photos)
    if not misfits:
        return []
    name = max(misfits, key=lambda one: misfits[one])
    return [Finding("flat.known-level", graded(misfits[name], white.LEVEL_DOUBTED), name, {
        "value": misfits[name], "passes": white.LEVEL_DOUBTED,
        "surfaces": [each for each, misfit in misfits.items() if misfit > white.LEVEL_DOUBTED]})]


def largest_of_photos(of_photos: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """The largest size of what each region has in any photo, by the region's name."""
    largest: dict[str, float] = {}
    for one in of_photos:
        for name, value in one.items():
            largest[name] = max(abs(value), largest.get(name, 0.0))
    return largest


def uneven_regions(found: flat_result.FlatResult) -> list[Finding]:
    """Whether each region can be one paint, by what its pixels scatter."""
    scatter = largest_of_photos(photo.scatter for photo in found.photos)
    if not scatter:
        return []
    name = max(scatter, key=lambda one: scatter[one])
    return [Finding("flat.scatter", graded(scatter[name], ONE_PAINT), name, {
        "value": scatter[name], "passes": ONE_PAINT,
        "surfaces": [each for each, value in scatter.items() if value > ONE_PAINT]})]


def edges(found: flat_result.FlatResult) -> list[Finding]:
    """Whether a shadow's edge, a fold or two paints lie in a region."""
    edges = {name: (edge, photo) for photo in reversed(found.photos)
             for name, edge in photo.edges.items()}
    if not any(photo.scatter for photo in found.photos):
        return []
    several = len(found.photos) > 1
    return [edge_in(name, edge, photo.name if several else "")
            for name, (edge, photo) in edges.items()] or [
                Finding("flat.no-edge", Severity.INFO, values={"value": 0.0})]


def edge_in(region: str, edge: photos.RegionEdge, photo: str = "") -> Finding:
    """An edge that runs across a region."""
    steps = np.abs(edge.step[np.isfinite(edge.step)])
    part = edge.larger_part_px
    return Finding("flat.edge", Severity.WARN, region, {
        "value": float(steps.max()), "smallest_step": float(steps.min()), "kind": edge.kind.name,
        "line_px": edge.line_px.tolist(), "photo": photo, "surfaces": [region],
        "larger_part_px": None if part is None else part.astype(int).tolist()})


def clipped(code: str, found: CaptureResult) -> Finding:
    """How much of the photo is clipped of which that is the most: of flat samples no region is, or
    it would have been refused; of scenes that part is not in the fit.
    """
    shares = {name: photo.clipped_share for name, photo in found.photo_of_view.items()}
    name = max(shares, key=lambda one: shares[one])
    return Finding(code, graded(shares[name], CLIPPED_LIMIT), values={
        "value": shares[name], "passes": CLIPPED_LIMIT, "photo": name})


# ---- scenes --------------------------------------------------------------------------------------

def scene_findings(found: scene_result.SceneResult) -> list[Finding]:
    """Photo against rendering, misfits, the fit, known surfaces, rehearsal, what is not corrected.
    """
    bands = found.bands
    photos = [("", found.reconstruction),
              *((name, made) for name, (_, made) in found.views.items())]
    agreement = [median_surface(made.agreement, photo) for photo, made in photos]
    agreement += [worst_surface(made.agreement, bands, photo) for photo, made in photos]
    misfits = [one for photo, made in photos for one in misfits_of(made, bands, photo)]
    if found.picture is not None:
        # one spectrum cannot fit a surface with patterns, of which the picture has every pixel's
        agreement = [replace(one, severity=Severity.INFO) for one in agreement]
        misfits = [*patterned([made for _, made in photos])]
    unusable = [of_photo(one, photo) for photo, made in photos for one in made.findings
                if one.severity is Severity.FAIL]
    return [*unusable, *agreement, *misfits,
            Finding("fit.of-scene", *ended(found.reconstruction.outcome)),
            *(one for photo, made in photos for one in light_of_known(made, photo)),
            *(one for photo, made in photos for one in of_fit(made, bands, photo)),
            *rehearsed(found.rehearsal), clipped("scene.clipped", found),
            *surfaces_off(found), *not_corrected(found)]


def median_surface(agreement: SurfaceAgreement, photo: str) -> Finding:
    """How well half of the surfaces agree with the photo."""
    value, (passes, fails) = median_surface_error(agreement), MEDIAN_LIMITS
    values = {"value": value, "passes": passes, "fails": fails, "photo": photo}
    if value is None:
        return Finding("scene.median-unknown", Severity.WARN, values=values)
    return Finding("scene.median", graded(value, passes, fails), values=values)


def worst_surface(agreement: SurfaceAgreement, bands: tuple[str, ...], photo: str) -> Finding:
    """How far the surface is off that fits least."""
    entry, (passes, fails) = worst_entry(agreement), WORST_LIMITS
    values = {"value": None, "passes": passes, "fails": fails, "photo": photo}
    if entry is None:
        return Finding("scene.worst-unknown", Severity.WARN, values=values)
    surface, band = entry
    ratio = float(agreement.ratio[entry])
    return Finding("scene.worst", graded(abs(ratio - 1), passes, fails), agreement.names[surface],
                   values | {
        "value": abs(ratio - 1), "ratio": ratio, "band": bands[band],
        "surfaces": [agreement.materials[surface]]})


def misfits_of(made: Reconstruction, bands: tuple[str, ...], photo: str) -> Iterator[Finding]:
    """Surfaces whose deviation neither chance nor the stated errors explain, or what many of them
    have in common.
    """
    common = {"photo": photo, "chance": misfit.FALSE_ALARM, "fails": WORST_LIMITS[1]}
    materials = dict(zip(made.agreement.names, made.agreement.materials, strict=True))
    if not made.misfits:
        yield Finding("scene.fits", Severity.INFO, values={"value": 0.0, **common})
        return

    def of(surfaces: list[str]) -> list[str]:
        return [*dict.fromkeys(materials[one] for one in surfaces if one in materials)]

    cause = misfit.common_cause(made.agreement, made.misfits, bands)
    if cause is not None:
        largest = max(one.values["value"] for one in made.misfits)
        yield replace(cause, severity=_beyond_chance(largest), values={
            **cause.values, "value": largest, **common,
            "surfaces": of([one.subject for one in made.misfits])})
        return
    for one in made.misfits[:MAX_NAMED]:
        yield replace(one, severity=_beyond_chance(one.values["value"]), values={
            **one.values, **common, "surfaces": of([one.subject])})
    others = made.misfits[MAX_NAMED:]
    if others:
        largest = max(one.values["value"] for one in others)
        yield Finding("scene.more-misfits", _beyond_chance(largest), values={
            "value": largest, "names": [one.subject for one in others], **common,
            "surfaces": of([one.subject for one in others])})


def _beyond_chance(deviation: float) -> Severity:
    return Severity.WARN if deviation <= WORST_LIMITS[1] else Severity.FAIL


def patterned(photos: list[Reconstruction]) -> Iterator[Finding]:
    """The same of a scene with a picture."""
    names = [*dict.fromkeys(one.subject for made in photos for one in made.misfits)]
    if not names:
        yield Finding("scene.fits", Severity.INFO, values={
            "value": 0.0, "photo": "", "chance": misfit.FALSE_ALARM, "fails": WORST_LIMITS[1]})
        return
    materials = {name: material for made in photos for name, material
                 in zip(made.agreement.names, made.agreement.materials, strict=True)}
    yield Finding("scene.patterns", Severity.WARN, values={
        "value": max(one.values["value"] for made in photos for one in made.misfits),
        "chance": misfit.FALSE_ALARM, "names": names,
        "surfaces": [*dict.fromkeys(materials[name] for name in names if name in materials)]})


def light_of_known(made: Reconstruction, photo: str) -> list[Finding]:
    """How the light on known surfaces differs from the chart's, and whether it may."""
    light = made.known_light
    if light is None:
        return []
    common = {"passes": LIGHT_DOUBTED, "photo": photo, "names": list(light.materials),
              "surfaces": list(light.materials)}
    colour = float(np.abs(light.colour - 1).max())
    errors = colour / known_light.LAMP_COLOUR_ERROR
    rows = [Finding("scene.known-colour", graded(errors, LIGHT_DOUBTED), values={
        "value": errors, "size": colour, **common})]
    if light.level is not None:
        errors = light.contradiction
        rows.insert(0, Finding("scene.known-level", graded(errors, LIGHT_DOUBTED), values={
            "value": errors, "size": abs(light.level - 1), "ratio": light.level, **common}))
    return rows


def of_fit(made: Reconstruction, bands: tuple[str, ...], photo: str) -> list[Finding]:
    """What the fit found of a photo: where it disagrees, what was corrected, what is prior."""
    return [agreement_in(made.agreement, bands, photo),
            *(one if one.subject else of_photo(one, photo) for one in made.findings)]


def agreement_in(agreement: SurfaceAgreement, bands: tuple[str, ...], photo: str = "") -> Finding:
    """On which surfaces photo and rendering disagree, the worst first, and by how much.

    Parameters
    ----------
    agreement : SurfaceAgreement
    bands : tuple of K str
        Names of the columns of ``agreement.ratio``.
    photo : str
    """
    ratio = agreement.ratio
    compared = np.isfinite(ratio).all(axis=1)
    deviation = np.where(compared[:, None], np.abs(ratio - 1), 0.0)
    largest = deviation.max(axis=1, initial=0.0)
    off = [index for index in np.argsort(-largest, kind="stable").tolist()
           if largest[index] > SURFACE_OFF]
    alike = bool(off) and bool(np.ptp(ratio[off[0]]) < BANDS_ALIKE * largest[off[0]])
    worst_bands = deviation.argmax(axis=1)
    return Finding("scene.agreement", Severity.INFO, photo, {
        "compared": int(compared.sum()), "largest": float(largest.max(initial=0.0)),
        "limit": SURFACE_OFF, "all_bands_alike": alike,
        "off": [{"surface": agreement.names[index], "band": bands[worst_bands[index]],
                 "ratio": float(ratio[index, worst_bands[index]])} for index in off],
        "not_compared": [agreement.names[index] for index in np.flatnonzero(~compared).tolist()]})


def rehearsed(last: Rehearsed | None) -> list[Finding]:
    """Whether bands held known truths in the last rehearsal."""
    return [] if last is None else [last.finding]


def surfaces_off(found: scene_result.SceneResult) -> Iterator[Finding]:
    """Surfaces of the first photo that are off, though not beyond chance and stated errors."""
    views = (found.reconstruction, *(made for _, made in found.views.values()))
    named = {one.subject for made in views for one in made.misfits}
    agreement = found.reconstruction.agreement
    for name, ratio in zip(agreement.names, agreement.ratio, strict=True):
        band = int(np.argmax(np.abs(ratio - 1)))
        if abs(ratio[band] - 1) > SURFACE_OFF and name not in named:
            yield Finding("scene.surface-off", Severity.NOTE, name, {
                "value": float(ratio[band] - 1), "band": found.bands[band]})


def not_corrected(found: scene_result.SceneResult) -> Iterator[Finding]:
    """What was not measured, and counts as the scene says."""
    fit = found.calibration.sensitivity
    if not found.stated.flat_fields:
        yield Finding("scene.no-flat-field", Severity.NOTE)
    if found.level_error is not None:
        yield Finding("scene.level-by-prior", graded(found.level_error, LEVEL_KNOWN), values={
            "value": found.level_error, "passes": LEVEL_KNOWN})
    elif any(surface.known for surface in found.surfaces) and (
            not found.stated.scale_from_chart or found.calibration.light_scale is None):
        yield Finding("scene.scale-of-known", Severity.NOTE)
    if fit.basis is None and fit.residuals is None:
        yield Finding("camera.of-file", Severity.NOTE)


def worst_entry(agreement: SurfaceAgreement) -> tuple[int, int] | None:
    """Surface and band of the largest |ratio - 1|, None where no surface was compared.

    Returns
    -------
    tuple of int or None
        Its row and column in ``agreement.ratio``.
    """
    deviation = np.abs(agreement.ratio - 1)
    if not np.isfinite(deviation).any():
        return None
    surface, band = np.unravel_index(np.nanargmax(deviation), deviation.shape)
    return int(surface), int(band)


def median_surface_error(agreement: SurfaceAgreement) -> float | None:
    """Median over surfaces of |ratio - 1| in the worst band, None where no surface was compared."""
    largest = np.abs(agreement.ratio - 1).max(axis=1, initial=0)
    finite = largest[np.isfinite(largest)]
    return float(np.median(finite)) if finite.size else None
