"""New photos of a watched folder, each judged as soon as it is whole."""
from __future__ import annotations

import contextlib
import math
import stat
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.chart.detection import locate_chart
from spectrabox.capture.chart.quality import judge_chart
from spectrabox.capture.develop.developed import open_any
from spectrabox.measure.camera import chart_signals
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import LinearImage
from spectrabox.radiometry.system.words import plain, shortened
from spectrabox.session.command_line import describe_error

PHOTO_SUFFIXES = (".dng", ".nef", ".cr2", ".cr3", ".arw", ".raf", ".orf", ".rw2", ".pef", ".exr",
                  ".tif", ".tiff", ".raw", ".3fr", ".iiq", ".srw", ".nrw", ".crw")
LOOK_EVERY_S = 0.25
STILL_S = 0.5           # a file that has not changed for so long is whole
GIVE_UP_S = 10.0        # on a file that cannot be read, until it changes: a copy may have paused
BRIGHT = 0.75           # of saturation, where the brightest parts should lie
DARKEST = 0.2           # of it, below which a photo is shot again
MAX_CLIPPED = 0.002     # share of pixels that may be clipped: a lamp in view, a highlight
BRIGHT_PERCENTILE = 99.5
GOOD, RE_SHOOT = "GOOD", "RE-SHOOT"
FileState = tuple[int, int]     # bytes, and time of the last change in ns


@dataclass(frozen=True)
class Shot:
    """One new photo and what it is good for."""

    file: str
    verdict: str                    # GOOD or RE-SHOOT
    reasons: tuple[str, ...]
    chart: bool                     # whether a chart is in it
    clipped: tuple[float, ...]      # share of pixels, by band
    brightest: tuple[float, ...]    # of saturation, by band
    stops: float                    # by which a longer exposure would be right; negative: shorter
    seconds: float                  # from the file's last change to the verdict


def judge_photo(image: LinearImage, chart: Chart = CLASSIC) -> tuple[tuple[str, ...], bool]:
    """Why a photo should be shot again, and whether a chart is in it.

    Parameters
    ----------
    image : LinearImage
    chart : Chart
        Layout that is looked for.

    Returns
    -------
    reasons : tuple of str
        Empty for a good photo.
    chart : bool
    """
    reasons, clipped, brightest = [], clipped_share(image), brightest_signal(image)
    if max(clipped) > MAX_CLIPPED:
        reasons.append(f"{max(clipped):.1%} of the pixels are clipped; expose "
                       f"{_stops_words(-1.0)}")
    elif max(brightest) < DARKEST:
        reasons.append(f"the brightest parts reach {max(brightest):.0%} of saturation; expose "
                       f"{_stops_words(exposure_stops(image))}")
    if not chart.has_known_colours:
        return tuple(reasons), False
    try:
        signals = chart_signals(chart, None, image.signal.shape[2], visible_grid())
        detection = locate_chart(image, signals, None, chart)
    except SpectraboxError:
        return tuple(reasons), False
    verdict = judge_chart(image, detection, signals, chart)
    if detection.mirrored:
        reasons.append("the chart is mirrored")
    return (*reasons, *verdict.reasons), True


def clipped_share(image: LinearImage) -> tuple[float, ...]:
    """Share of clipped pixels, by band."""
    return tuple(float(share) for share in image.saturated.mean(axis=(0, 1)))


def brightest_signal(image: LinearImage) -> tuple[float, ...]:
    """Signal of the brightest parts, by band: of saturation."""
    stride = max(1, int(math.sqrt(image.signal[..., 0].size / 250_000)))
    return tuple(float(value) for value in np.percentile(
        image.signal[::stride, ::stride].reshape(-1, image.signal.shape[2]), BRIGHT_PERCENTILE,
        axis=0))


def exposure_stops(image: LinearImage) -> float:
    """By how many stops a longer exposure brings the brightest parts to ``BRIGHT``."""
    return float(np.log2(BRIGHT / max(max(brightest_signal(image)), 1e-6)))


def _stops_words(stops: float) -> str:
    return f"{abs(stops):.1f} stops {'longer' if stops > 0 else 'shorter'}"


class Shooting:
    """A folder whose new photos are judged while it is watched.

    Parameters
    ----------
    folder : Path
    chart : Chart
        Layout that is looked for.
    """

    def __init__(self, folder: Path, chart: Chart = CLASSIC) -> None:
        if not folder.is_dir():
            raise InputError(f"{folder} is no folder; give the one into which the camera's photos "
                             "come")
        self.folder, self._chart = folder, chart
        self._judged_states = self._states()    # what lay there before is left alone
        self._arriving: dict[str, tuple[FileState, float]] = {}     # and since when it is so
        self._shots: dict[str, Shot] = {}       # the last one last
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def end(self) -> None:
        """Watch no longer."""
        self._stop.set()

    def state(self) -> dict[str, Any]:
        """What the page shows: the folder, shots with the last first, and what is coming in."""
        return {"folder": plain(str(self.folder)),
                "shots": [asdict(shot) for shot in list(self._shots.values())[::-1]],
                "arriving": sorted(plain(name) for name in list(self._arriving))}

    def path(self, file: str) -> Path:
        """The photo of a shot, by its name as the page shows it.

        Raises
        ------
        InputError
            If there is none.
        """
        for name, shot in list(self._shots.items()):
            if shot.file == file:
                return self.folder / name
        raise InputError(f"{shortened(file)} is no new photo of {self.folder}")

    def _states(self) -> dict[str, FileState]:
        states = {}
        for path in self.folder.iterdir():
            if path.suffix.lower() in PHOTO_SUFFIXES and not path.name.startswith("."):
                with contextlib.suppress(OSError):      # it went away meanwhile
                    status = path.stat()
                    if stat.S_ISREG(status.st_mode):
                        states[path.name] = (status.st_size, status.st_mtime_ns)
        return states

    def _watch(self) -> None:
        while not self._stop.wait(LOOK_EVERY_S):
            try:
                states = self._states()
            except OSError:             # the folder is away for a moment: a card, a network
                continue
            for gone in self._arriving.keys() - states.keys():
                del self._arriving[gone]
            for name in sorted(states):
                self._look_at(name, states[name])

    def _look_at(self, name: str, state: FileState) -> None:
        """Judge a file once it has been still for a while, and again whenever it has changed."""
        if self._judged_states.get(name) == state:
            self._arriving.pop(name, None)
            return
        now = time.monotonic()
        if name not in self._arriving or self._arriving[name][0] != state:
            self._arriving[name] = (state, now)
            return
        since = self._arriving[name][1]
        if now - since < STILL_S or not state[0]:
            return
        shot = self._judged(name, since, give_up=now - since > GIVE_UP_S)
        if shot is not None:
            self._shots.pop(name, None)
            self._shots[name] = shot
            self._judged_states[name] = state
            del self._arriving[name]

    def _judged(self, name: str, since: float, give_up: bool) -> Shot | None:
        """The verdict; None where the file cannot be read yet."""
        try:
            image = open_any(self.folder / name, not_linear=True)
            reasons, chart = judge_photo(image, self._chart)
        except Exception as error:  # noqa: BLE001 - one bad file must not end the watch
            if not give_up:
                return None
            return Shot(plain(name), RE_SHOOT, (plain(describe_error(error)[0]),), False, (), (),
                        0.0, time.monotonic() - since)
        return Shot(plain(name), RE_SHOOT if reasons else GOOD, reasons, chart,
                    clipped_share(image), brightest_signal(image), exposure_stops(image),
                    time.monotonic() - since)
