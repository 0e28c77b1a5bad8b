"""A flat session in memory: chart and calibration while the operator looks, then spectra at once.

A run in the background makes the stages up to the calibration. Beside it the photos are decoded;
from then on the spectrum of any part of them takes a twentieth of a second, by the very functions
of the stages that follow.
"""
from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from spectrabox.measure.captured import FlatCapture, Region
from spectrabox.measure.opened_photos import OpenPhotos
from spectrabox.measure.records import CaptureRecords, ChartRecords
from spectrabox.measure.regions.colour_comparison import compare_colours
from spectrabox.measure.regions.pointing import CalibratedPhotos, PointedSample, calibrated_photos
from spectrabox.measure.regions.region_signals import RegionSignal
from spectrabox.measure.steps.inputs import inputs_of_calibration, inputs_of_charts
from spectrabox.measure.steps.photos import UNEVEN
from spectrabox.measure.surfaces.metamers import LIGHTS
from spectrabox.measure.surfaces.surface_signals import errors_by_cause
from spectrabox.radiometry.appearance import reflectance_to_lab, reflectance_to_srgb
from spectrabox.radiometry.errors import CheckError, InputError, SpectraboxError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import LinearImage, Quantity
from spectrabox.radiometry.spectra.formats.csvw import plain_text
from spectrabox.radiometry.spectra.formats.tm27 import spdx_text
from spectrabox.radiometry.system.words import shortened
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.session.config.captured_session import capture_of
from spectrabox.session.config.flat_session import FlatSession
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.page.photo_views import PhotoFile, PhotoViews
from spectrabox.session.page.run_control import RunControl
from spectrabox.session.store.input_files import InputFiles
from spectrabox.session.store.keys import digest_of_parts, step_keys
from spectrabox.session.store.store import fingerprint, load_stage

CHART, CALIBRATE = "chart", "calibrate"
POINTED_DRAWS = 300     # behind the error of the colour under the pointer: 4 % of it
MENTIONED = 0.02        # share of a family or cause that is listed
MAX_KEPT = 500          # estimates of regions


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
        self._sample: PointedSample | None = None
        self._sample_key = ""                           # of its calibration and photos
        self._calibrated_as = ""                        # digest of what these rest on
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
        flat = config if isinstance(config, FlatSession) else None
        now = (None if flat is None else flat.model_dump_json(), self._run.running,
               self._run.state()["lines"][-1:])
        with self._lock:
            edited = self._seen is None or now[0] != self._seen[0]
            self._config = flat
            if edited and flat is not None and self._sample is not None:
                with contextlib.suppress(SpectraboxError):      # said where the session is checked
                    capture = capture_of(flat)
                    if isinstance(capture, FlatCapture) \
                            and calibration_digest(capture) == self._calibrated_as:
                        self._sample = PointedSample(capture, self._sample.calibrated)
            changed, self._seen = now != self._seen, now
        if changed:
            self._wanted.set()

    def state(self) -> dict[str, Any] | None:
        """What the page shows of it; None of a session that is not flat."""
        if self._config is None and self._sample is None:
            return None
        return {"ready": self._sample is not None, "error": self._error, "charts": self._chart[1]}

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
        sample = self._require_ready()
        return answered_or_refused(lambda: described_part(sample, part_of(sample.capture, role,
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
        sample = self._require_ready()
        regions = sample.capture.regions
        if len(picked) != 2:
            raise InputError("pick two colours to compare")
        for one in picked:
            if "name" in one and one["name"] not in regions:
                raise InputError(f"there is no region {shortened(str(one['name']))}")
        return answered_or_refused(lambda: described_comparison(sample, [
            (one["name"], regions[one["name"]]) if "name" in one else
            (f"point {number}", part_of(sample.capture, one["role"], one["rect"]))
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
        sample = self._require_ready()
        capture = sample.capture
        if name not in capture.regions:
            raise InputError(f"there is no region {shortened(name)}")
        region = capture.regions[name]
        if region.given is not None:
            return described_spectrum(FINE_GRID.nm, region.given) | {"given": True}
        depends = f"{id(sample.calibrated)} {name} " + digest_of_parts({
            "region": region, "number": list(capture.regions).index(name),
            "known": {other: capture.regions[other] for other in capture.known},
            "sampling": capture.sampling, "repeatability": capture.repeatability,
            "stray light": capture.stray_light, "swatches": bool(capture.swatches)})
        if depends not in self._kept:
            answer = answered_or_refused(lambda: described_region(sample, name))
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
        capture = self._require_ready().capture
        answers = {name: answer for name in capture.regions
                   if "mean" in (answer := self.region(name))}
        nm = FINE_GRID.nm
        means = {name: np.interp(nm, answer["nm"], answer["mean"])
                 for name, answer in answers.items()}
        if suffix == ".spdx":
            return spdx_text(nm, means, quantity=Quantity.REFLECTANCE,
                             source=f"{', '.join(means)}; {capture.name}")
        columns: dict[str, np.ndarray] = {}
        for name, answer in answers.items():
            columns[f"{name} mean"] = means[name]
            for end in ("lower", "upper"):
                if end in answer:
                    columns[f"{name} {end} {capture.sampling.level:g}"] = np.interp(
                        nm, answer["nm"], answer[end])
        return plain_text(nm, columns)

    def _require_ready(self) -> PointedSample:
        if self._sample is None:
            raise CheckError("chart and camera are still being calibrated")
        return self._sample

    def _work(self) -> None:
        while self._wanted.wait() and not self._ended:
            self._wanted.clear()
            config = self._config
            try:
                self._update(config)
            except (SpectraboxError, OSError, MemoryError) as error:
                self._error, self._sample = str(error), None

    def _update(self, config: SessionConfig | None) -> None:
        """Bring what is known up to a session, or have a run begin that will."""
        if config is None:
            return              # a fault that is being mended: what was known stays
        capture = capture_of(config)
        assert isinstance(capture, FlatCapture)
        keys = step_keys(capture, InputFiles(config))
        stored = {name: load_stage(config.results_folder, name) for name in (CHART, CALIBRATE)}
        done = {name: stage for name, stage in stored.items()
                if stage is not None and not stage.fault and stage.key == keys[name]}
        if CHART in done and self._chart[0] != fingerprint(keys[CHART]):
            self._chart = (fingerprint(keys[CHART]),
                           described_charts(capture, done[CHART].read(ChartRecords)))
        if CHART not in done:
            self._chart = ("", {})
        wanted = fingerprint(keys[CALIBRATE])
        if CALIBRATE not in done or CHART not in done:
            self._sample = None
            self._begin(wanted)
        photo = keys["photo"]
        shown = fingerprint({"files": photo["files"]} | {
            name: photo["settings"][name] for name in ("photos", "development")})
        if self._images[0] != shown:
            self._images = (shown, self._opened(capture))
        if len(done) == 2:
            key = wanted + shown
            if self._sample is None or self._sample_key != key:
                self._use(calibrated_photos(capture, CaptureRecords(done), self._images[1]),
                          capture, key)

    def _opened(self, capture: FlatCapture) -> dict[str, LinearImage]:
        """Every photo, developed; those of one file alone are shown too."""
        images = {}
        photos = OpenPhotos(capture)
        plain = not (capture.development.flat_fields or capture.development.dark_frames)
        for view in capture.views:
            images[view.name] = photos.developed(view.photo)[0]
            files = [file for band in view.photo.values() for file in band]
            if len(files) == 1 and plain:
                self._views.keep(PhotoFile(files[0].path, capture.development.orientation),
                                 images[view.name])
        return images

    def _use(self, calibrated: CalibratedPhotos, capture: FlatCapture, key: str) -> None:
        """Show what has just been calibrated, of the session as it is by now."""
        with self._lock:
            newer = None if self._config is None else capture_of(self._config)
            if isinstance(newer, FlatCapture) \
                    and calibration_digest(newer) == calibration_digest(capture):
                capture = newer         # regions may have been marked meanwhile
            self._error, self._sample_key = "", key
            self._calibrated_as = calibration_digest(capture)
            self._sample = PointedSample(capture, calibrated)

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


def calibration_digest(capture: FlatCapture) -> str:
    """Digest of what charts, photos and calibration rest on, the content of files apart."""
    return digest_of_parts(inputs_of_charts(capture) | inputs_of_calibration(capture)
                           | {"surfaces": {view.name: view.photo for view in capture.views}})


def part_of(capture: FlatCapture, role: str, rect: Sequence[float]) -> Region:
    """A rectangle of a photo that is no region yet.

    Parameters
    ----------
    capture : FlatCapture
    role : str
        Title of the photo.
    rect : (x0, y0, x1, y1)
        In its pixels.

    Raises
    ------
    InputError
        If the photo shows no samples.
    """
    titles = [view.title for view in capture.views]
    if role not in titles:
        raise InputError("a photo of the samples is needed")
    x0, y0, x1, y1 = rect
    left, right, top, bottom = min(x0, x1), max(x0, x1), min(y0, y1), max(y0, y1)
    return Region(outline=((left, top), (right, top), (right, bottom), (left, bottom)),
                  photos=(role,) if len(titles) > 1 else ())


def answered_or_refused(estimate: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """An estimate for the page, or why there is none: pixels that are clipped, say."""
    try:
        return estimate()
    except SpectraboxError as error:
        return {"refused": str(error)}


def described_charts(capture: FlatCapture, records: ChartRecords) -> dict[str, Any]:
    """Of each photo with a chart, by the title of its role: patches, and whether to use it."""
    charts = {}
    for view in capture.views_with_chart:
        chart = records.charts[view.name]
        role = view.title if view.shows_chart else f"{view.name} chart".strip()
        charts[role] = {"patches": np.round(chart.detection.corners_px, 1).tolist(),
                        "verdict": "RE-SHOOT" if chart.reasons else "GOOD",
                        "reasons": list(chart.reasons)}
    return charts


def described_region(sample: PointedSample, name: str) -> dict[str, Any]:
    """The spectrum of a region of the session for the page, as its report has it."""
    signal, spectrum = sample.drawn(name)
    summary, draws = spectrum.summary, spectrum.samples
    answer = described_spectrum(summary.grid.nm, summary.mean) | described(
        signal, summary.lower, summary.upper, reflectance_to_lab(draws.grid.nm, draws.spectra),
        spectrum.family_shares, spectrum.variance_shares) | {
            "next_nm": summary.next_measurement_nm}
    if sample.capture.swatches:
        answer["notes"].append("the report also corrects this spectrum by the swatches")
    return answer


def described_part(sample: PointedSample, region: Region) -> dict[str, Any]:
    """The same of any part of a photo, in closed form."""
    signal, posterior = sample.pointed(region)
    nm = PRIOR_GRID.nm
    return described_spectrum(nm, posterior.mean) | described(
        signal, *posterior.band(sample.capture.sampling.level),
        reflectance_to_lab(nm, posterior.draws(POINTED_DRAWS, 1)), posterior.family_shares,
        posterior.variance_shares(errors_by_cause(signal.signals, 0)))


def described_comparison(sample: PointedSample,
                         picked: Sequence[tuple[str, Region]]) -> dict[str, Any]:
    """Two parts of photos beside each other, each with its title."""
    (first, region), (second, other) = picked
    both = compare_colours(sample.signal("pointer", region), sample.signal("pointer", other),
                           (region.families, other.families))
    return {"names": [first, second], "distinct": both.distinct, "says": both.sentence,
            "spectra": [{"nm": PRIOR_GRID.nm.tolist(), "mean": _rounded(mean)}
                        for mean in both.spectra],
            "lights": [
                {"light": light, "hex": [hex_colour(colour) for colour in srgb],
                 "delta_e00": round(float(delta), 2), "error": round(float(error), 2)}
                for light, srgb, delta, error in zip(
                    LIGHTS, both.srgb, both.delta_e00, both.standard_error, strict=True)]}


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
