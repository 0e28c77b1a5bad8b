"""session.toml: what the operator wrote, checked key by key."""
from __future__ import annotations

import dataclasses
import difflib
import tomllib
import types
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from radiometry.errors import InputError

FILE_NAME = "session.toml"


def _as_files(written: str | tuple[str, ...] | None) -> tuple[str, ...]:
    return () if written is None else (written,) if isinstance(written, str) else written


@dataclass(frozen=True)
class SpectrumRef:
    """A spectrum in a text file; written as a string, or as a table where the file holds several columns."""

    file: str
    column: str | int | None = None
    wavelength_column: int = 1


@dataclass(frozen=True)
class CurvesRef:
    """Several curves in a text file, such as camera sensitivities."""

    file: str
    columns: tuple[str | int, ...] | None = None
    wavelength_column: int = 1


@dataclass(frozen=True)
class SessionSection:
    name: str = "untitled session"
    operator: str = ""
    notes: str = ""
    seed: int = 1


@dataclass(frozen=True)
class PhotosSection:
    """Files of each photo; several files of one photo are an exposure bracket."""

    object: str | tuple[str, ...]
    chart: str | tuple[str, ...] | None = None
    flat: str | None = None
    dark: str | tuple[str, ...] | None = None
    not_linear: bool = False

    @property
    def object_files(self) -> tuple[str, ...]:
        return _as_files(self.object)

    @property
    def chart_files(self) -> tuple[str, ...]:
        return _as_files(self.chart)

    @property
    def dark_files(self) -> tuple[str, ...]:
        return _as_files(self.dark)


@dataclass(frozen=True)
class ChartSection:
    reference: str = "BabelColor Average"
    scene: str | None = None
    corners_px: tuple[tuple[float, ...], ...] | None = None


@dataclass(frozen=True)
class LightSection:
    spectrum: SpectrumRef


@dataclass(frozen=True)
class SensitivitySection:
    source: CurvesRef = CurvesRef("chart")
    method: str | None = None
    prior: str | None = None
    coefficients: int = 10
    relative_error: float = 0.02
    truth: CurvesRef | None = None

    @property
    def from_chart(self) -> bool:
        return self.source.file == "chart"


@dataclass(frozen=True)
class ScaleSection:
    source: str = "chart"


@dataclass(frozen=True)
class SceneSection:
    file: str


@dataclass(frozen=True)
class MaterialSection:
    bsdf: str
    known: SpectrumRef | None = None
    truth: SpectrumRef | None = None


@dataclass(frozen=True)
class ReconstructSection:
    engine: str = "transport"
    surface_error: float = 0.01
    smoothness: float = 0.1
    coefficients: int = 11
    width: int = 96
    steps: int = 160
    spp: int = 16


@dataclass(frozen=True)
class SamplingSection:
    method: str = "prior"
    coefficients: int = 11
    draws: int = 4000
    level: float = 0.95


@dataclass(frozen=True)
class SessionConfig:
    """One session as its operator described it; file names are relative to ``folder``."""

    folder: Path
    allow_outside: bool
    photos: PhotosSection
    light: LightSection
    scene: SceneSection
    materials: dict[str, MaterialSection]
    session: SessionSection = field(default_factory=SessionSection)
    chart: ChartSection = field(default_factory=ChartSection)
    sensitivity: SensitivitySection = field(default_factory=SensitivitySection)
    scale: ScaleSection = field(default_factory=ScaleSection)
    reconstruct: ReconstructSection = field(default_factory=ReconstructSection)
    sampling: SamplingSection = field(default_factory=SamplingSection)

    def path(self, name: str) -> Path:
        """Where a file of the session lies.

        Raises
        ------
        InputError
            If it would leave the session folder without having been asked to.
        """
        path = (self.folder / name).resolve()
        if not self.allow_outside and not path.is_relative_to(self.folder.resolve()):
            raise InputError(f"{name!r} lies outside the session folder; copy it in, "
                             "or allow it with --allow-outside")
        return path


ENGINES = ("transport", "gradient", "per-wavelength", "single-bounce")
CURVE_METHODS = ("prior", "smooth", "nonnegative", "paper")
SAMPLERS = ("prior", "uniform", "paper")
WRITTEN_AS = {"source": "from"}  # "from" is a word of Python
SECTIONS = {f.name: f for f in dataclasses.fields(SessionConfig) if f.name not in ("folder", "allow_outside")}
LIMITS: dict[tuple[str, str], tuple[float, float]] = {
    ("session", "seed"): (0, 2**31 - 1), ("sensitivity", "coefficients"): (5, 24),
    ("sensitivity", "relative_error"): (1e-4, 1.0), ("reconstruct", "coefficients"): (5, 40),
    ("reconstruct", "surface_error"): (0, 1), ("reconstruct", "smoothness"): (0, 1e9),
    ("reconstruct", "width"): (16, 1024), ("reconstruct", "steps"): (20, 5000), ("reconstruct", "spp"): (1, 4096),
    ("sampling", "coefficients"): (5, 40), ("sampling", "draws"): (1000, 1000000), ("sampling", "level"): (0.5, 0.999)}


def read_session(folder: Path, allow_outside: bool = False) -> SessionConfig:
    """The session described in ``folder``/session.toml.

    Raises
    ------
    InputError
        Naming every fault of the file at once: unknown keys with the nearest known one, wrong types, missing keys.
    """
    config, problems = try_read_session(folder, allow_outside)
    if config is None:
        raise InputError("\n".join(problems))
    return config


def try_read_session(folder: Path, allow_outside: bool = False) -> tuple[SessionConfig | None, list[str]]:
    """The session, or None with every fault of its file in a sentence each."""
    path = folder / FILE_NAME
    if not path.is_file():
        return None, [f"{path} is missing: write one with 'spectrabox new {folder}'"]
    try:
        written = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        return None, [f"{FILE_NAME} is not valid TOML: {error}"]
    problems: list[str] = []
    values: dict[str, Any] = {"folder": folder, "allow_outside": allow_outside}
    values |= _sections(written, problems)
    problems += _consistency(values) if not problems else []
    return (None, problems) if problems else (SessionConfig(**values), [])


def _sections(written: dict[str, Any], problems: list[str]) -> dict[str, Any]:
    hints = typing.get_type_hints(SessionConfig)
    values: dict[str, Any] = {}
    _report_unknown(written, SECTIONS, "", problems)
    for name, section in SECTIONS.items():
        if name in written:
            node = written[name]
            if not isinstance(node, dict):
                problems.append(f"{FILE_NAME}: {name} must be a table [{name}]")
            elif name == "materials":
                values[name] = {material: _build(MaterialSection, table, f"materials.{material}", problems)
                                for material, table in node.items()}
            else:
                values[name] = _build(hints[name], node, name, problems)
        elif section.default_factory is dataclasses.MISSING:
            problems.append(f"{FILE_NAME}: the table [{name}] is missing" + (".NAME" if name == "materials" else ""))
    return values


def _build(section: Any, node: Any, place: str, problems: list[str]) -> Any:
    if not isinstance(node, dict):
        problems.append(f"{FILE_NAME}: [{place}] must be a table")
        return None
    hints = typing.get_type_hints(section)
    fields = {WRITTEN_AS.get(f.name, f.name): f for f in dataclasses.fields(section)}
    _report_unknown(node, fields, place, problems)
    values = {}
    for key, description in fields.items():
        if key in node:
            values[description.name] = _convert(hints[description.name], node[key], f"{place}.{key}", problems)
            _check_limit(place, key, values[description.name], problems)
        elif description.default is dataclasses.MISSING:
            problems.append(f"{FILE_NAME}: {place}.{key} is missing")
    if any(f.default is dataclasses.MISSING and f.name not in values for f in fields.values()):
        return None
    return section(**values)


def _report_unknown(node: dict[str, Any], known: typing.Iterable[str], place: str, problems: list[str]) -> None:
    for key in node:
        if key not in known:
            near = difflib.get_close_matches(key, list(known), n=1, cutoff=0.0)
            where = f" in [{place}]" if place else ""
            problems.append(f"{FILE_NAME}: unknown key {key!r}{where}; did you mean {near[0]!r}?")


def _convert(hint: Any, value: Any, place: str, problems: list[str]) -> Any:
    """The value as the field's type, or a problem."""
    options = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    for option in options:
        if option in (SpectrumRef, CurvesRef):
            return _build(option, {"file": value} if isinstance(value, str) else value, place, problems)
        if typing.get_origin(option) is tuple and isinstance(value, list):
            return tuple(_convert(typing.get_args(option)[0], item, place, problems) for item in value)
        if option is float and isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        if isinstance(option, type) and option is not types.NoneType and type(value) is option:
            return value
    wanted = " or ".join("list" if typing.get_origin(option) is tuple else option.__name__
                         for option in options if option is not types.NoneType)
    problems.append(f"{FILE_NAME}: {place} is {value!r}; {wanted} is needed")
    return None


def _check_limit(place: str, key: str, value: Any, problems: list[str]) -> None:
    limits = LIMITS.get((place, key))
    if limits and isinstance(value, int | float) and not limits[0] <= value <= limits[1]:
        problems.append(f"{FILE_NAME}: {place}.{key} is {value:g}; {limits[0]:g} to {limits[1]:g} is possible")


def _consistency(values: dict[str, Any]) -> list[str]:
    """Faults between keys that are each well written."""
    config = SessionConfig(**values)
    problems = []
    if config.scale.source not in ("chart", "material"):
        problems.append(f"{FILE_NAME}: scale.from is {config.scale.source!r}; \"chart\" or \"material\" is possible")
    if config.sensitivity.method not in (None, *CURVE_METHODS):
        problems.append(f"{FILE_NAME}: sensitivity.method is {config.sensitivity.method!r}; "
                        f"{', '.join(CURVE_METHODS)} are possible")
    if config.reconstruct.engine not in ENGINES:
        problems.append(f"{FILE_NAME}: reconstruct.engine is {config.reconstruct.engine!r}; "
                        f"{', '.join(ENGINES)} are possible")
    if config.sampling.method not in SAMPLERS:
        problems.append(f"{FILE_NAME}: sampling.method is {config.sampling.method!r}; "
                        f"{', '.join(SAMPLERS)} are possible")
    needs_chart = config.sensitivity.from_chart or config.scale.source == "chart"
    if needs_chart and config.photos.chart is None:
        problems.append(f"{FILE_NAME}: photos.chart is missing, but sensitivities or scale are to come from it; "
                        "add the photo, or give [sensitivity] from = \"curves.csv\" and [scale] from = \"material\"")
    if config.scale.source == "chart" and config.chart.scene is None:
        problems.append(f"{FILE_NAME}: chart.scene is missing: a scale from the chart photo needs light and chart in "
                        "their places; add it, or use [scale] from = \"material\"")
    if config.scale.source == "material" and not any(m.known for m in config.materials.values()):
        problems.append(f"{FILE_NAME}: scale.from is \"material\", but no material has a known spectrum; "
                        "add known = \"spectra/NAME.csv\" to one")
    if all(material.known for material in config.materials.values()):
        problems.append(f"{FILE_NAME}: every material is known, so there is nothing to find; leave out one 'known'")
    owners: dict[str, str] = {}
    for name, material in config.materials.items():
        if material.bsdf in owners:
            problems.append(f"{FILE_NAME}: materials {owners[material.bsdf]!r} and {name!r} name the same BSDF "
                            f"{material.bsdf!r}")
        owners[material.bsdf] = name
    if config.chart.corners_px is not None and [len(c) for c in config.chart.corners_px] != [2] * 4:
        problems.append(f"{FILE_NAME}: chart.corners_px needs four [x, y] pairs: the outer corners at dark skin, "
                        "bluish green, black and white")
    return problems
