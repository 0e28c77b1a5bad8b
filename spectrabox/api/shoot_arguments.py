"""The arguments of a function as a shoot: tables of what they state, and the records among them."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from spectrabox.api import arguments
from spectrabox.api.photo import Photo, as_input_file
from spectrabox.calibrate.prior.camera_prior import load_camera_prior
from spectrabox.measure.captured import FlatCapture, SceneCapture
from spectrabox.measure.shoot import captures, inputs, options, shoot
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.records import calibration, spectra
from spectrabox.radiometry.spectra import given_spectra, light_words

# their defaults
SESSION, SAMPLING, INVERSION, SENSITIVITY = (
    shoot.SessionSection(), options.Sampling(), options.Inversion(), shoot.SensitivitySection())
Table = dict[str, Any]


class Arguments:
    """Tables of a shoot, made from what a function accepts: each method gives a table, or a name
    that stands in one, and keeps the record that it stands for.
    """

    def __init__(self) -> None:
        self._given: dict[str, Any] = {}

    def capture(self, tables: Table) -> FlatCapture | SceneCapture:
        """What the tables describe.

        Raises
        ------
        InputError
            If a value is out of its range, or a file cannot be read.
        """
        return captures.capture_of(shoot.Shoot.from_arguments(tables),
                                   inputs.Inputs(Path(), True, self._given))

    def _named(self, name: str, record: Any) -> str:
        """The name under which a record is kept: numbered where another has it."""
        free, number = name, 2
        while free in self._given:
            free, number = f"{name} {number}", number + 1
        self._given[free] = record
        return free

    def photo(self, photo: str | Path | Photo | None) -> str | None:
        """A photo's file, or one that is open."""
        if photo is None:
            return None
        file = as_input_file(photo)
        return file.name if self._given.get(file.name) == file else self._named(file.name, file)

    def light(self, light: arguments.LightLike) -> Table:
        """A light. Two that are named alike by a word or file are one."""
        record = arguments.as_light(light)
        if isinstance(light, str | Path):
            words = str(light)
            if isinstance(record, spectra.UnknownLight):
                return {"word": words}
            self._given.setdefault(words, record)
            return {"file": words}
        if isinstance(record, spectra.UnknownLight):
            return {"cct": record.cct
                    } if record.cct else {"word": record.kind or light_words.UNKNOWN}
        return {"file": self._named(record.source, record)}

    def filter(self, through: arguments.FilterLike, photo: str | Path) -> Table:
        """A filter before the lens or the lamp of a photo."""
        words = through.name if isinstance(through, calibration.Filter) else \
            str(through) if isinstance(through, str | Path) else "given"
        return {"file": self._named(f"{words}, {photo}", arguments.as_filter(through))}

    def chart(self, layout: str | Path | Chart | None, reference: str | None,
              corners: ArrayLike | None = None) -> Table:
        """The chart and where it lies."""
        record, points = arguments.as_chart(layout), arguments.as_corners(corners)
        return {"layout": self._named(record.name, record), "reference": reference,
                "corners_px": None if points is None else points.tolist()}

    def camera_prior(self, prior: str | Path | None) -> Table:
        """Where the camera's sensitivities come from."""
        return {} if prior is None else {
            "prior": self._named(str(prior), load_camera_prior(Path(prior)))}

    def surface(self, name: str, families: Mapping[str, str | Sequence[str]] | None,
                surfaces: Mapping[str, str],
                known: Mapping[str, given_spectra.KnownSpectrum | None],
                truth: Mapping[str, given_spectra.KnownSpectrum]) -> Table:
        """What is stated of a surface, each argument by its name."""
        return {"family": list(arguments.families_of((families or {}).get(name))) or None,
                "surface": surfaces.get(name),
                "known": self._reflectance(known.get(name), name),
                "truth": self._reflectance(truth.get(name), name)}

    def _reflectance(self, given: given_spectra.KnownSpectrum | None, name: str) -> Table | None:
        if given is None:
            return None
        return {"file": self._named(f"reflectance of {name}", given_spectra.as_known(given, name))}

    def outline(self, region: Sequence[float] | Sequence[Sequence[float]], name: str) -> Table:
        """A rectangle, or the corners of a region going round.

        Raises
        ------
        InputError
            If it is neither.
        """
        points = arguments.region_points(region, f"region {name!r}")
        return {"rect" if points.ndim == 1 else "polygon": points.tolist()}
