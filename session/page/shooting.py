"""New photos of a watched folder, each judged as soon as it is whole."""
from __future__ import annotations

import contextlib
import stat
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo.preview import photo_orientation, turned
from spectrabox.measure import photo_quality, texts
from spectrabox.radiometry import chart, errors
from spectrabox.radiometry.findings import faults
from spectrabox.radiometry.system.words import plain, shortened
from spectrabox.session.terminal.command_line import describe_error

PHOTO_SUFFIXES = (".dng", ".nef", ".cr2", ".cr3", ".arw", ".raf", ".orf", ".rw2", ".pef", ".exr",
                  ".tif", ".tiff", ".raw", ".3fr", ".iiq", ".srw", ".nrw", ".crw")
LOOK_EVERY_S = 0.25
STILL_S = 0.5           # a file that has not changed for so long is whole
GIVE_UP_S = 10.0        # on a file that cannot be read, until it changes: a copy may have paused
GOOD, RE_SHOOT, FAULT = "GOOD", "RE-SHOOT", "FAULT"
FileState = tuple[int, int]     # bytes, and time of the last change in ns


@dataclass(frozen=True)
class Shot:
    """One new photo and what it is good for."""

    file: str
    verdict: str                    # GOOD, RE-SHOOT, or FAULT where this program failed
    reasons: list[str]              # what to do about it, or why it cannot be read
    findings: list[dict[str, Any]]  # as ``measure.texts.facts``
    chart: bool                     # whether a chart is in it
    clipped: tuple[float, ...]      # share of pixels, by band
    brightest: tuple[float, ...]    # of saturation, by band
    stops: float                    # by which a longer exposure would be right; negative: shorter
    seconds: float                  # from the file's last change to the verdict


class Shooting:
    """A folder whose new photos are judged while it is watched.

    Parameters
    ----------
    folder : Path
    chart : Chart
        Layout that is looked for.
    """

    def __init__(self, folder: Path, chart: chart.Chart = chart.CLASSIC) -> None:
        if not folder.is_dir():
            raise errors.InputError(
                f"{folder} is no folder; give the one into which the camera's photos " "come")
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
        raise errors.InputError(f"{shortened(file)} is no new photo of {self.folder}")

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
            path = self.folder / name
            image = turned(open_any(path, not_linear=True), photo_orientation(path))
            findings, chart = photo_quality.judge_photo(image, self._chart)
        except (errors.SpectraboxError, OSError, MemoryError) as error:
            verdict, reason = RE_SHOOT, describe_error(error)[0]
        except Exception as error:  # noqa: BLE001 - a fault of ours must not end the watch
            verdict, reason = FAULT, ("a fault of spectrabox, not of the photo: "
                                      + describe_error(error)[0])
        else:
            return Shot(plain(name), RE_SHOOT if faults(findings) else GOOD,
                        texts.reasons(findings), [texts.facts(one) for one in findings], chart,
                        photo_quality.clipped_share(image), photo_quality.brightest_signal(image),
                        photo_quality.exposure_stops(image),
                        time.monotonic() - since)
        if not give_up:
            return None
        return Shot(plain(name), verdict, [plain(reason)], [], False, (), (), 0.0,
                    time.monotonic() - since)
