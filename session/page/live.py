"""A flat session in memory: chart and calibration while the operator looks, then spectra at once.

A run in the background makes the stages up to the calibration. Beside it the photos are decoded;
from then on the spectrum of any part of them takes a twentieth of a second, by the very functions
of the stages that follow.
"""
from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from spectrabox.capture.photo.binning import thumbnail
from spectrabox.capture.photo.regions import sample_regions
from spectrabox.capture.photo.registration import Registration, find_edges
from spectrabox.measure.colour_comparison import compare_colours
from spectrabox.measure.flat import RegionSignal, signal_of_region
from spectrabox.measure.metamers import LIGHTS
from spectrabox.measure.surface_signals import errors_by_cause
from spectrabox.measure.surface_spectra import DrawOptions
from spectrabox.measure.white import FlatErrors, FlatPhoto
from spectrabox.radiometry.appearance import reflectance_to_lab, reflectance_to_srgb
from spectrabox.radiometry.errors import CheckError, InputError, SpectraboxError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import LinearImage, Quantity, RegionSamples
from spectrabox.radiometry.spectra.formats.csvw import plain_text
from spectrabox.radiometry.spectra.formats.tm27 import spdx_text
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.radiometry.system.words import shortened
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.session.config.session_schema import RegionSection, SessionConfig, ViewInputs
from spectrabox.session.keys import stage_keys
from spectrabox.session.page.photo_views import PhotoFile, PhotoViews
from spectrabox.session.page.run_control import RunControl
from spectrabox.session.stages.inputs import OpenPhotos, band_names, read_photo, read_reflectance
from spectrabox.session.stages.photo_stage import (
    THUMBNAIL_WIDTH,
    UNEVEN,
    outlines_in,
    registration_of,
)
from spectrabox.session.stages.records import ChartRecords, PhotoRecords, SessionRecords
from spectrabox.session.stages.signals_stage import flat_errors, flat_photos, known_spectra
from spectrabox.session.store.input_files import InputFiles
from spectrabox.session.store.store import fingerprint, load_stage

CHART, CALIBRATE = "chart", "calibrate"
POINTED_DRAWS = 300     # behind the error of the colour under the pointer: 4 % of it
# of session.toml, that change regions and their errors and leave the calibration as it is
AFTER_CALIBRATION: dict[str, Any] = {
    **dict.fromkeys(("toml_sha256", "regions", "sampling", "picture", "repeatability",
                     "stray_light"), True), "session": {"name", "operator", "notes"}}
MENTIONED = 0.02        # share of a family or cause that is listed
MAX_KEPT = 500          # estimates of regions


@dataclass(frozen=True, eq=False)
class Calibrated:
    """Photos and calibration of a flat session, without its regions."""

    key: str
    photos: list[FlatPhoto]
    images: dict[str, LinearImage]          # whole, by view
    records: SessionRecords
    bands: tuple[str, ...]
    registrations: dict[str, Registration | None]   # of further photos to the first


@dataclass(frozen=True, eq=False)
class Conditions:
    """What a session.toml says of the regions of calibrated photos."""

    calibrated: Calibrated
    config: SessionConfig

    @cached_property
    def known(self) -> dict[str, np.ndarray]:
        """Reflectances (P,) of regions of known spectrum."""
        return known_spectra(self.config)

    @cached_property
    def errors(self) -> FlatErrors:
        return flat_errors(self.config, self.calibrated.records)

    @cached_property
    def known_samples(self) -> dict[str, RegionSamples | None]:
        """Of each view: its regions of known spectrum."""
        return {view.name: self._sampled(view, self.config, self.known)
                for view in self.config.all_views}

    def _sampled(self, view: ViewInputs, config: SessionConfig,
                 names: Iterable[str]) -> RegionSamples | None:
        outlines = {name: outline for name, outline in outlines_in(
            config, view, self.calibrated.registrations.get(view.name)).items() if name in names}
        return sample_regions(self.calibrated.images[view.name], outlines,
                              without_clipped=bool(config.views)) if outlines else None

    def signal(self, name: str, region: RegionSection) -> RegionSignal:
        """The signal of a region, which need not be one of the session.

        Parameters
        ----------
        name : str
        region : RegionSection
            What is stated of it: outline, photos, families, surface.
        """
        config = self.config.model_copy(update={"regions": {name: region}})
        samples = [joined(self._sampled(view, config, (name,)), self.known_samples[view.name])
                   for view in config.all_views]
        errors = replace(self.errors, surfaces={name: region.surface} if region.surface else {})
        return signal_of_region(self.calibrated.photos, samples, region.families, self.known,
                                self.calibrated.bands, errors)

    def drawn(self, name: str, region: RegionSection) -> dict[str, Any]:
        """The spectrum of a region of the session for the page, as its report has it."""
        chosen, index = self.config.sampling, list(self.config.regions).index(name)
        signal = self.signal(name, region)
        spectrum = signal.spectrum(region.families, DrawOptions(
            chosen.method, chosen.draws, chosen.coefficients, chosen.level,
            self.config.session.seed + index))
        summary, draws = spectrum.summary, spectrum.samples
        answer = described_spectrum(summary.grid.nm, summary.mean) | described(
            signal, summary.lower, summary.upper,
            reflectance_to_lab(draws.grid.nm, draws.spectra), spectrum.family_shares,
            spectrum.variance_shares) | {"next_nm": summary.next_measurement_nm}
        if any(each.swatch is not None for each in self.config.regions.values()):
            answer["notes"].append("the report also corrects this spectrum by the swatches")
        return answer

    def pointed(self, region: RegionSection) -> dict[str, Any]:
        """The same of any part of a photo, in closed form."""
        signal = self.signal("pointer", region)
        posterior, nm = signal.posterior(region.families), PRIOR_GRID.nm
        return described_spectrum(nm, posterior.mean) | described(
            signal, *posterior.band(self.config.sampling.level),
            reflectance_to_lab(nm, posterior.draws(POINTED_DRAWS, 1)), posterior.family_shares,
            posterior.variance_shares(errors_by_cause(signal.signals, 0)))


    def compared(self, picked: Sequence[tuple[str, RegionSection]]) -> dict[str, Any]:
        """Two parts of photos beside each other, each with its title."""
        (first, region), (second, other) = picked
        both = compare_colours(self.signal("pointer", region), self.signal("pointer", other),
                               (region.families, other.families))
        return {"names": [first, second], "distinct": both.distinct,
                "says": both.sentence,
                "spectra": [{"nm": PRIOR_GRID.nm.tolist(), "mean": _rounded(mean)}
                            for mean in both.spectra],
                "lights": [
                    {"light": light, "hex": [hex_colour(colour) for colour in srgb],
                     "delta_e00": round(float(delta), 2), "error": round(float(error), 2)}
                    for light, srgb, delta, error in zip(
                        LIGHTS, both.srgb, both.delta_e00, both.standard_error, strict=True)]}


class LiveSample:
    """What a flat session's page knows while it is open.

    Parameters
    ----------
    run : RunControl
        Of the session, which also makes the calibration.
    views : PhotoViews
        Which are given the photos.
    """

    def __init__(self, run: RunControl, views: PhotoViews) -> None:
        self._run, self._views = run, views
        self._config: SessionConfig | None = None
        self._conditions: Conditions | None = None
        self._kept: dict[str, dict[str, Any]] = {}      # answers by what they depend on
        self._tried: set[str] = set()                   # keys that a run was started for
        self._images: tuple[str, dict[str, LinearImage]] = ("", {})
        self._chart: tuple[str, dict[str, Any]] = ("", {})
        self._error = ""
        self._seen: Any = None
        self._lock, self._wanted = threading.Lock(), threading.Event()
        run.when_ended = self._wanted.set
        self._ended = False
        self._thread = threading.Thread(target=self._work, daemon=True)

    def start(self) -> None:
        """Begin to work in the background."""
        self._thread.start()

    def end(self) -> None:
        """Work no longer."""
        self._ended = True
        self._wanted.set()

    def follow(self, config: SessionConfig | None) -> None:
        """Look at a session as it is now; returns at once.

        Parameters
        ----------
        config : SessionConfig or None
            None of a session with faults.
        """
        flat = config if config is not None and config.flat else None
        now = (None if flat is None else flat.model_dump_json(), self._run.running,
               self._run.state()["lines"][-1:])
        with self._lock:
            self._config = flat
            if flat is not None and self._conditions is not None \
                    and calibrated_alike(flat, self._conditions.config):
                self._conditions = Conditions(self._conditions.calibrated, flat)
            changed, self._seen = now != self._seen, now
        if changed:
            self._wanted.set()

    def state(self) -> dict[str, Any] | None:
        """What the page shows of it; None of a session that is not flat."""
        config, conditions = self._config, self._conditions
        if config is None and conditions is None:
            return None
        return {"ready": conditions is not None, "error": self._error, "charts": self._chart[1]}

    def point(self, role: str, rect: Sequence[float]) -> dict[str, Any]:
        """The spectrum of a rectangle of a photo that is no region yet.

        Parameters
        ----------
        role : str
            Title of the photo.
        rect : (x0, y0, x1, y1)
            In its pixels.

        Raises
        ------
        CheckError
            Before the calibration is there.
        """
        conditions = self._require_ready()
        return answered_or_refused(lambda: conditions.pointed(part_of(conditions.config, role,
                                                                      rect)))

    def compare(self, picked: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Two picked colours beside each other.

        Parameters
        ----------
        picked : two mappings
            Each the ``name`` of a region, or ``role`` and ``rect`` as of ``point``.

        Raises
        ------
        CheckError
            Before the calibration is there.
        InputError
            If there is no such region, or they are not two.
        """
        conditions = self._require_ready()
        regions = conditions.config.regions
        if len(picked) != 2:
            raise InputError("pick two colours to compare")
        for one in picked:
            if "name" in one and one["name"] not in regions:
                raise InputError(f"there is no region {shortened(str(one['name']))}")
        return answered_or_refused(lambda: conditions.compared(
            [(one["name"], regions[one["name"]]) if "name" in one else
             (f"point {number}", part_of(conditions.config, one["role"], one["rect"]))
             for number, one in enumerate(picked, start=1)]))

    def region(self, name: str) -> dict[str, Any]:
        """The spectrum of a region of the session, which is the one of its report.

        Parameters
        ----------
        name : str

        Raises
        ------
        CheckError
            Before the calibration is there.
        InputError
            If there is no such region.
        """
        conditions = self._require_ready()
        config = conditions.config
        if name not in config.regions:
            raise InputError(f"there is no region {shortened(name)}")
        region, index = config.regions[name], list(config.regions).index(name)
        if region.measured is not None:
            given = spectrum_on_grid(read_reflectance(config, region.measured), FINE_GRID)
            return described_spectrum(FINE_GRID.nm, given) | {"given": True}
        depends = repr((conditions.calibrated.key, name, index, region, [
            (other, config.regions[other]) for other in conditions.known], config.sampling,
            config.repeatability, config.stray_light,
            any(other.swatch is not None for other in config.regions.values())))
        if depends not in self._kept:
            answer = answered_or_refused(lambda: conditions.drawn(name, region))
            with self._lock:
                for old in list(self._kept)[:-MAX_KEPT]:
                    del self._kept[old]
                self._kept[depends] = answer
        return self._kept[depends]

    def export(self, suffix: str) -> str:
        """A file of the spectra that are marked now: a table (.csv), or IES TM-27 (.spdx).

        Parameters
        ----------
        suffix : str

        Raises
        ------
        CheckError
            Before the calibration is there.
        """
        config = self._require_ready().config
        answers = {name: answer for name in config.regions
                   if "mean" in (answer := self.region(name))}
        nm = FINE_GRID.nm
        means = {name: np.interp(nm, answer["nm"], answer["mean"])
                 for name, answer in answers.items()}
        if suffix == ".spdx":
            return spdx_text(nm, means, quantity=Quantity.REFLECTANCE,
                             source=f"{', '.join(means)}; {config.session.name}")
        columns: dict[str, np.ndarray] = {}
        for name, answer in answers.items():
            columns[f"{name} mean"] = means[name]
            for end in ("lower", "upper"):
                if end in answer:
                    columns[f"{name} {end} {config.sampling.level:g}"] = np.interp(
                        nm, answer["nm"], answer[end])
        return plain_text(nm, columns)

    def _require_ready(self) -> Conditions:
        if self._conditions is None:
            raise CheckError("chart and camera are still being calibrated")
        return self._conditions

    def _work(self) -> None:
        while self._wanted.wait() and not self._ended:
            self._wanted.clear()
            config = self._config
            try:
                self._update(config)
            except (SpectraboxError, OSError, MemoryError) as error:
                self._error, self._conditions = str(error), None

    def _update(self, config: SessionConfig | None) -> None:
        """Bring what is known up to a session, or have a run begin that will."""
        if config is None:
            return              # a fault that is being mended: what was known stays
        keys = stage_keys(config, InputFiles(config))
        stored = {name: load_stage(config.results_folder, name) for name in (CHART, CALIBRATE)}
        done = {name: stage for name, stage in stored.items()
                if stage is not None and not stage.fault and stage.key == keys[name]}
        if CHART in done and self._chart[0] != fingerprint(keys[CHART]):
            self._chart = (fingerprint(keys[CHART]),
                           described_charts(config, done[CHART].read(ChartRecords)))
        if CHART not in done:
            self._chart = ("", {})
        wanted = fingerprint(keys[CALIBRATE])
        if CALIBRATE not in done or CHART not in done:
            self._conditions = None
            self._begin(wanted)
        shown = fingerprint({"files": keys["photo"]["files"]} | {
            name: keys["photo"]["settings"][name]
            for name in ("photos", "not_linear", "flats", "orientation")})
        if self._images[0] != shown:
            images = {}
            for view in config.all_views:
                images[view.name] = read_photo(config, view.photo)[0]
                if len(view.photo_files) == 1 and not (config.photos.flats
                                                       or config.photos.dark_files):
                    self._views.keep(PhotoFile(config.path(view.photo_files[0]),
                                               config.photos.orientation), images[view.name])
            self._images = (shown, images)
        if len(done) == 2:
            key = wanted + shown
            current = self._conditions
            calibrated = current.calibrated if current is not None \
                and current.calibrated.key == key else calibrated_of(
                    key, config, SessionRecords(done), self._images[1])
            with self._lock:        # regions may have been marked meanwhile
                newer = self._config
                self._error, self._conditions = "", Conditions(
                    calibrated, newer if newer is not None and calibrated_alike(newer, config)
                    else config)

    def _begin(self, key: str) -> None:
        """Have the calibration made, once for each key; a run that failed says why."""
        if self._run.running:
            if self._run.until == CALIBRATE:
                self._tried.add(key)        # it may have begun before the page did
            return
        if key not in self._tried:
            self._tried.add(key)
            self._error = ""
            with contextlib.suppress(CheckError):       # one has just begun
                self._run.start(CALIBRATE)
        else:
            run = self._run.state()
            self._error = str(run["error"] or "") or (
                "stopped before the calibration was made" if run["stopped"] else "")


def calibrated_alike(config: SessionConfig, other: SessionConfig) -> bool:
    """Whether two versions of a session.toml have one calibration."""
    return config.model_dump_json(exclude=AFTER_CALIBRATION) == other.model_dump_json(
        exclude=AFTER_CALIBRATION)


def part_of(config: SessionConfig, role: str, rect: Sequence[float]) -> RegionSection:
    """A rectangle of a photo that is no region yet.

    Parameters
    ----------
    config : SessionConfig
    role : str
        Title of the photo.
    rect : (x0, y0, x1, y1)
        In its pixels.

    Raises
    ------
    InputError
        If the photo shows no samples.
    """
    titles = [view.title for view in config.all_views]
    if role not in titles:
        raise InputError("a photo of the samples is needed")
    x0, y0, x1, y1 = rect
    return RegionSection(rect=(min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)),
                         photo=role if len(titles) > 1 else None)


def answered_or_refused(estimate: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """An estimate for the page, or why there is none: pixels that are clipped, say."""
    try:
        return estimate()
    except SpectraboxError as error:
        return {"refused": str(error)}


def joined(own: RegionSamples | None, known: RegionSamples | None) -> RegionSamples | None:
    """A region's samples, and after them those of regions of known spectrum."""
    if own is None or known is None:
        return own
    clipped = None if own.clipped is None and known.clipped is None else np.concatenate(
        [np.zeros(each.mean.shape, bool) if each.clipped is None else each.clipped
         for each in (own, known)])
    mean, covariance, pixels, scatter, points = (
        np.concatenate([getattr(own, name), getattr(known, name)])
        for name in ("mean", "covariance_of_mean", "pixels", "scatter", "points_px"))
    return RegionSamples((*own.names, *known.names), mean, covariance, pixels, scatter, points,
                         clipped)


def calibrated_of(key: str, config: SessionConfig, records: SessionRecords,
                  images: Mapping[str, LinearImage]) -> Calibrated:
    """What stored stages and photos give.

    Parameters
    ----------
    key : str
    config : SessionConfig
    records : SessionRecords
        Of chart and calibration.
    images : mapping
        Photos by view.
    """
    if config.drift.object_px:
        raise InputError("with references of [drift] the page shows no spectra while you point; "
                         "the report has them")
    records.photo = PhotoRecords({name: thumbnail(image, THUMBNAIL_WIDTH)
                                  for name, image in images.items()}, {}, None, {},
                                 OpenPhotos().bands(config, images[""]), ())
    first, *others = config.all_views
    edges = {view.name: find_edges(images[view.name]) for view in config.all_views
             if others}
    registrations = {view.name: registration_of(records.chart.charts, first, view, edges[""],
                                                edges[view.name]) for view in others
                     if view.photo_files != first.photo_files}
    photos = flat_photos(config, records)
    return Calibrated(key, photos, dict(images), records,
                      band_names(config, records.photo.bands), registrations)


def described_charts(config: SessionConfig, records: ChartRecords) -> dict[str, Any]:
    """Of each photo with a chart, by the title of its role: patches, and whether to use it."""
    charts = {}
    for view in config.views_with_chart:
        chart = records.charts[view.name]
        in_photo = view.chart_files == view.photo_files
        role = view.title if in_photo else f"{view.name} chart".strip()
        charts[role] = {"patches": np.round(chart.detection.corners_px, 1).tolist(),
                        "verdict": "RE-SHOOT" if chart.reasons else "GOOD",
                        "reasons": list(chart.reasons)}
    return charts


def described(signal: RegionSignal, lower: np.ndarray, upper: np.ndarray, labs: np.ndarray,
              families: Mapping[str, float], causes: Mapping[str, float]) -> dict[str, Any]:
    """What an estimate adds to its spectrum: band, error of the colour from draws (T, 3), causes.
    """
    notes = [] if signal.scatter <= UNEVEN else [
        f"uneven: its pixels differ by {signal.scatter:.0%}; outline one colour"]
    return {"lower": _rounded(lower), "upper": _rounded(upper),
            "lab_error": _rounded(labs.std(axis=0)), "families": _largest(families),
            "causes": _largest(causes), "light": list(signal.light), "notes": notes}


def described_spectrum(nm: np.ndarray, reflectance: np.ndarray) -> dict[str, Any]:
    """A reflectance (P,) and its colour under D65."""
    return {"nm": nm.tolist(), "mean": _rounded(reflectance),
            "lab": _rounded(reflectance_to_lab(nm, reflectance)),
            "hex": hex_colour(reflectance_to_srgb(nm, reflectance))}


def hex_colour(srgb: np.ndarray) -> str:
    """Encoded sRGB (3,), 0 to 1, as CSS writes it."""
    return "#" + "".join(f"{round(255 * float(value)):02x}" for value in srgb)


def _largest(shares: Mapping[str, float]) -> list[tuple[str, float]]:
    """Shares that are large enough to be listed, the largest first."""
    return sorted(((name, round(share, 3)) for name, share in shares.items()
                   if share >= MENTIONED), key=lambda each: -each[1])


def _rounded(values: np.ndarray, decimals: int = 5) -> list[float]:
    return [round(float(value), decimals) for value in values]
