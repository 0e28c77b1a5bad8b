"""A flat session in memory: chart and calibration while the operator looks, then spectra at once.

A run in the background makes the stages up to the calibration. Beside it the photos are decoded;
from then on the spectrum of any part of them takes a twentieth of a second, by the very functions
of the stages that follow.
"""
from __future__ import annotations

import contextlib
import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from spectrabox.measure import captured, extras, opened_photos, texts
from spectrabox.measure.pictures import shown_photo
from spectrabox.measure.records import CaptureRecords
from spectrabox.measure.regions.pointing import PointedSample, pointed_sample
from spectrabox.measure.regions.white import PhotoWhite
from spectrabox.measure.results.flat_result import FlatResult
from spectrabox.measure.shoot import captures
from spectrabox.measure.steps.declared_steps import inputs_of_calibration, inputs_of_charts
from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.records import photos, spectra
from spectrabox.radiometry.spectra.formats import delimited, tm27
from spectrabox.radiometry.system.words import shortened
from spectrabox.session.config.session_file import SessionConfig
from spectrabox.session.page import pointed_answers, run_control
from spectrabox.session.page.photo_views import RELATIVE, PhotoFile, PhotoViews
from spectrabox.session.store.keys import InputFiles, digest_of_parts, step_keys
from spectrabox.session.store.record_files import fingerprint, load_stage

CHART, CALIBRATE = "chart", "calibrate"
MAX_KEPT = 500          # answers on regions
MAX_DRAWN = 120         # regions with their draws, 2 MB each
HALVINGS = 3            # of a photo whose brightest part is sought
SETTLED_S = 0.6         # without a change, after which the verdict is worked out


class LiveSample:
    """What a flat session's page knows while it is open.

    Parameters
    ----------
    run : RunControl
        Of the session, which also makes the calibration.
    views : PhotoViews
        Which are given the photos.
    """

    def __init__(self, run: run_control.RunControl, views: PhotoViews) -> None:
        self._run, self._views = run, views
        self._config: SessionConfig | None = None       # of flat samples
        self._scene: SessionConfig | None = None
        self._sample: PointedSample | None = None
        self._sample_key = ""                           # of its calibration and photos
        self._calibrated_as = ""                        # digest of what these rest on
        self._kept: dict[str, dict[str, Any]] = {}      # answers by what they depend on
        self._drawn: dict[str, tuple[list[PhotoWhite], spectra.SpectrumSummary]] = {}  # likewise
        self._tried: set[str] = set()                   # keys that a run was started for
        self._images: tuple[str, dict[str, photos.LinearImage]] = ("", {})
        self._chart: tuple[str, dict[str, Any]] = ("", {})
        self._error = ""
        # of which sample, as the page shows it, and itself
        self._result: tuple[PointedSample | None, dict[str, Any] | None, FlatResult | None] = \
            None, None, None
        self._looks_of: Any = None      # calibration and known regions that photos are shown by
        self._seen: Any = None
        self._lock, self._drawing = threading.Lock(), threading.Lock()
        self._advising, self._wanted = threading.Lock(), threading.Event()
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
            None of a session with faults; of one of a scene photos alone are shown as they are
            calibrated.
        """
        scene = None if config is None or config.flat else config
        written = None if config is None else config.model_dump_json()
        now = written, self._run.running, self._run.state()["lines"][-1:]
        with self._lock:
            edited = self._seen is None or now[0] != self._seen[0]
            self._config, self._scene = None if scene is not None else config, scene
            if edited:
                with contextlib.suppress(
                        errors.SpectraboxError):  # said where the session is checked
                    self._state_anew()
            changed, self._seen = now != self._seen, now
        if changed:
            self._wanted.set()

    def state(self) -> dict[str, Any] | None:
        """What the page shows of it; None of a session that is not flat."""
        if self._config is None and self._sample is None:
            return None
        of, result, _ = self._result
        return {"ready": self._sample is not None, "error": self._error, "charts": self._chart[1],
                "result": result, "result_now": self._sample is not None and of is self._sample}

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
        return pointed_answers.answered_or_refused(
            lambda: pointed_answers.described_part(sample, part_of(sample.capture, role, rect)))

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
            raise errors.InputError("pick two colours to compare")
        for one in picked:
            if "name" in one and one["name"] not in regions:
                raise errors.InputError(f"there is no region {shortened(str(one['name']))}")

        def titled(number: int, one: Mapping[str, Any]) -> tuple[str, captured.Surface]:
            if "name" in one:
                return one["name"], regions[one["name"]]
            return f"point {number}", part_of(sample.capture, one["role"], one["rect"])

        return pointed_answers.answered_or_refused(lambda: pointed_answers.described_comparison(
            sample, [titled(number, one) for number, one in enumerate(picked, start=1)]))

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
            raise errors.InputError(f"there is no region {shortened(name)}")
        region = capture.regions[name]
        if region.known is not None:
            return pointed_answers.described_spectrum(grid.FINE_GRID.nm, region.known) | {
                "given": True, "doubt": sample.doubted_known.get(name, "")}
        depends = depends_on(sample, name)
        if depends not in self._kept:
            answer = pointed_answers.answered_or_refused(
                lambda: pointed_answers.described_region(sample, *self._drawn_region(sample, name)))
            with self._lock:
                for old in list(self._kept)[:-MAX_KEPT]:
                    del self._kept[old]
                self._kept[depends] = answer
        return self._kept[depends]

    def _drawn_region(self, sample: PointedSample,
                      name: str) -> tuple[list[PhotoWhite], spectra.SpectrumSummary]:
        """White at a region and its spectrum, drawn once for the page and the verdict."""
        depends = depends_on(sample, name)
        with self._drawing:
            if depends not in self._drawn:
                for old in list(self._drawn)[:-MAX_DRAWN]:
                    del self._drawn[old]
                self._drawn[depends] = sample.drawn(name)
            return self._drawn[depends]

    def advice(self) -> dict[str, Any]:
        """What to do next, of all that is marked now and of each; it takes a quarter of a second
        for each.

        Raises
        ------
        CheckError
            Before the verdict on it is there.
        """
        of, _, found = self._result
        if found is None or of is not self._require_ready():
            raise errors.CheckError("the verdict on what is marked is still being worked out")
        with self._advising:
            failed = found.failed_advice
            return found.advice.facts | {
                "failed": [] if failed is None else [texts.sentence(failed)]}

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
        nm = grid.FINE_GRID.nm
        answers = {name: self.region(name) for name in capture.regions}
        answers = {name: answer for name, answer in answers.items() if "mean" in answer}
        means = {name: np.interp(nm, answer["nm"], answer["mean"])
                 for name, answer in answers.items()}
        if suffix == ".spdx":
            return tm27.spdx_text(nm, means, quantity=spectra.Quantity.REFLECTANCE,
                                  source=f"{', '.join(means)}; {capture.name}")
        columns: dict[str, np.ndarray] = {}
        for name, answer in answers.items():
            columns[f"{name} mean"] = means[name]
            for end in ("lower", "upper"):
                if end in answer:
                    columns[f"{name} {end} {capture.sampling.level:g}"] = np.interp(
                        nm, answer["nm"], answer[end])
        return delimited.plain_text(nm, columns)

    def _require_ready(self) -> PointedSample:
        if self._sample is None:
            raise errors.CheckError("chart and camera are still being calibrated")
        return self._sample

    def _work(self) -> None:
        while self._wanted.wait() and not self._ended:
            self._wanted.clear()
            config, scene = self._config, self._scene
            if scene is not None:
                extras.attempt("calibrated picture", partial(self._show_scene, scene), None)
                continue
            _, failed = extras.attempt("spectra on the page", partial(self._update, config), None)
            if failed is not None:
                self._error, self._sample = failed.values["error"], None
            extras.attempt("calibrated picture", self._show_calibrated, None)
            if failed is None and not self._wanted.wait(SETTLED_S):
                self._find_result()

    def _find_result(self) -> None:
        """Work out verdict and conditions of what is marked now."""
        sample = self._sample
        if sample is None or self._result[0] is sample:
            return
        found, described = None, None
        if any(region.known is None for region in sample.capture.regions.values()):
            now, failed = extras.attempt("verdict", lambda: self._described_now(sample), None)
            if failed is not None:                  # a region that is clipped, say
                described = {"status": "fail", "says": failed.values["error"], "conditions": []}
            elif now is not None:
                found, described = now
        self._result = sample, described, found

    def _described_now(self, sample: PointedSample) -> tuple[FlatResult, dict[str, Any]]:
        """The result of what is marked now, and what the page shows of it."""
        found = pointed_answers.result_now(sample, lambda name: self._drawn_region(sample, name)[1])
        return found, pointed_answers.described_result(found)

    def _show_calibrated(self) -> None:
        """Show the photos in the colours of the calibration, and of what is known of the light."""
        sample = self._sample
        depends = None if sample is None else (sample.records, digest_of_parts({
            name: sample.capture.regions[name] for name in sample.capture.known}))
        if depends == self._looks_of:
            return
        self._looks_of, looks = depends, {}
        if sample is not None:
            for view in sample.capture.views:
                files = [file for band in view.photo.values() for file in band]
                if len(files) == 1 and view.name in sample.looks:
                    looks[files[0].path] = sample.looks[view.name]
        self._views.calibrate(looks)

    def _show_scene(self, config: SessionConfig) -> None:
        """Show the photos of a scene and of its charts in the colours of the calibration that a run
        has made of them.
        """
        capture = captures.capture_of(config, config.inputs)
        assert isinstance(capture, captured.SceneCapture)
        keys = step_keys(capture, InputFiles(config))
        stage = load_stage(config.results_folder, CALIBRATE)
        made = stage is not None and not stage.fault and stage.key == keys[CALIBRATE]
        depends = fingerprint(keys[CALIBRATE]) if made else None
        if depends == self._looks_of:
            return
        self._looks_of, looks = depends, {}
        if stage is not None and made:
            records = CaptureRecords({CALIBRATE: stage})
            for view, calibration in zip(capture.views, records.calibrations(capture.views),
                                         strict=True):
                for files in map(captured.files_of, (view.photo, view.chart)):
                    if len(files) == 1 and files[0].path is not None:
                        photo = self._views.photo(PhotoFile(files[0].path, capture.orientation))
                        look = shown_photo.scene_look(calibration, photo.reduced(HALVINGS))
                        if look is not None:
                            looks[files[0].path] = look
        self._views.calibrate(looks, RELATIVE)

    def _update(self, config: SessionConfig | None) -> None:
        """Bring what is known up to a session, or have a run begin that will."""
        if config is None:
            return              # a fault that is being mended: what was known stays
        capture = captures.flat_capture_of(config, config.inputs)
        keys = step_keys(capture, InputFiles(config))
        done = {}
        for name in (CHART, CALIBRATE):
            stage = load_stage(config.results_folder, name)
            if stage is not None and not stage.fault and stage.key == keys[name]:
                done[name] = stage
        charts, wanted = fingerprint(keys[CHART]), fingerprint(keys[CALIBRATE])
        if CHART not in done:
            self._chart = ("", {})
        elif self._chart[0] != charts:
            self._chart = charts, pointed_answers.described_charts(capture,
                                                                   CaptureRecords(done).charts)
        if len(done) < 2:
            self._sample = None
            self._begin(wanted)
        photo = keys["photo"]
        shown = fingerprint({"files": photo["files"]} | {
            name: photo["settings"][name] for name in ("photos", "development")})
        if self._images[0] != shown:
            self._images = (shown, self._opened(capture))
        key = wanted + shown
        if len(done) == 2 and (self._sample is None or self._sample_key != key):
            sample = pointed_sample(capture, CaptureRecords(done), self._images[1])
            with self._lock:
                self._error, self._sample_key = "", key
                self._calibrated_as = calibration_digest(capture)
                self._sample = sample
                self._state_anew()      # regions may have been marked meanwhile

    def _opened(self, capture: captured.FlatCapture) -> dict[str, photos.LinearImage]:
        """Every photo, developed; those of one file alone are shown too."""
        images = {}
        photos = opened_photos.OpenPhotos(capture)
        plain = not (capture.flat_fields or capture.dark_frames)
        for view in capture.views:
            images[view.name] = photos.developed(view.photo)[0]
            files = [file for band in view.photo.values() for file in band]
            if len(files) == 1 and plain:
                self._views.keep(PhotoFile(files[0].path, capture.orientation),
                                 images[view.name])
        return images

    def _state_anew(self) -> None:
        """Take what is stated of regions by now, where photos and calibration are the same."""
        if self._config is None or self._sample is None:
            return
        capture = captures.flat_capture_of(self._config, self._config.inputs)
        if calibration_digest(capture) == self._calibrated_as:
            self._sample = replace(self._sample, capture=capture)

    def _begin(self, key: str) -> None:
        """Have the calibration made, once for each key; a run that failed says why."""
        if self._run.running:
            if self._run.until == CALIBRATE:
                self._tried.add(key)        # it may have begun before the page did
            return
        if key not in self._tried:
            self._tried.add(key)
            self._error = ""
            with contextlib.suppress(errors.CheckError):       # one has just begun
                self._run.start(CALIBRATE)
        else:
            run = self._run.state()
            self._error = str(run["error"] or "")
            if run["stopped"] and not self._error:
                self._error = "stopped before the calibration was made"


def calibration_digest(capture: captured.FlatCapture) -> str:
    """Digest of what charts, photos and calibration rest on, the content of files apart."""
    return digest_of_parts(inputs_of_charts(capture) | inputs_of_calibration(capture)
                           | {"surfaces": {view.name: view.photo for view in capture.views}})


def depends_on(sample: PointedSample, name: str) -> str:
    """What the spectrum of a region depends on, as a text."""
    capture = sample.capture
    return f"{id(sample.records)} {name} " + digest_of_parts({
        "region": capture.regions[name], "number": list(capture.regions).index(name),
        "known": {other: capture.regions[other] for other in capture.known},
        "sampling": capture.sampling, "repeatability": capture.repeatability,
        "stray light": capture.stray_light})


def part_of(capture: captured.FlatCapture, role: str, rect: Sequence[float]) -> captured.Surface:
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
        raise errors.InputError("a photo of the samples is needed")
    return captured.Surface(outline=captured.rectangle(rect), surface=capture.finish,
                            photos=(role, ) if len(titles) > 1 else ())
