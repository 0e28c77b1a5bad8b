"""What session.toml may say: one frozen class per table, and the limits of its numbers."""
from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path

from spectrabox.radiometry.errors import InputError

FILE_NAME = "session.toml"


Files = str | tuple[str, ...]           # one file, or several of an exposure bracket
# or a table of these: a photo for each filter, by the name of its band
Photo = Files | dict[str, Files]
ONE_PHOTO = ""                          # the name under which a photo that is no such table is kept


def by_band(written: Photo | None) -> dict[str, tuple[str, ...]]:
    """Files of a photo by band; of a colour camera's photo under one name."""
    bands = written if isinstance(written,
                                  dict) else {} if written is None else {ONE_PHOTO: written}
    return {band: (files,) if isinstance(files, str) else files for band, files in bands.items()}


def all_files(photo: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Every file of a photo."""
    return tuple(name for files in photo.values() for name in files)


@dataclass(frozen=True)
class SpectrumRef:
    """A spectrum in a text file; written as a string, or as a table where the file holds several
    columns.
    """

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
    """Files of each photo."""

    object: Photo
    chart: Photo | None = None
    flat: str | dict[str, str] | None = None
    dark: Files | None = None
    not_linear: bool = False

    @property
    def flats(self) -> dict[str, str]:
        """The flat-field photo of each band."""
        return self.flat if isinstance(self.flat,
                                       dict) else {} if self.flat is None else {
            ONE_PHOTO: self.flat}

    @property
    def dark_files(self) -> tuple[str, ...]:
        return all_files(by_band(self.dark))


@dataclass(frozen=True)
class ChartSection:
    reference: str = "BabelColor Average"
    scene: str | None = None
    corners_px: tuple[tuple[float, ...], ...] | None = None


@dataclass(frozen=True)
class CameraSection:
    lens: str | None = None


@dataclass(frozen=True)
class DriftSection:
    """Neutral references that chart photo and object photo both show: four corners each, in pixels
    of the photo.
    """

    chart_px: tuple[tuple[tuple[float, ...], ...], ...] = ()
    object_px: tuple[tuple[tuple[float, ...], ...], ...] = ()
    relative_error: float = 0.005


@dataclass(frozen=True)
class LightSection:
    spectrum: SpectrumRef
    by_id: dict[str, SpectrumRef] | None = None     # lights of the scene that have another spectrum


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
class ViewSection:
    """A further photo of the same materials: another light, exposure or viewpoint. None: as in the
    first photo.
    """

    photo: Photo
    light: SpectrumRef | None = None
    scene: str | None = None
    chart: Photo | None = None


@dataclass(frozen=True)
class ReconstructSection:
    engine: str = "auto"
    surface_error: float = 0.01
    brightness_error: float = 0.0
    light_error: float = 0.0
    mixing_error: float = 0.0
    block_error: float = 0.0
    errors_from_scene: bool = True
    spectrum_prior: str = "learnt"
    smoothness: float = 0.1
    coefficients: int = 11
    width: int = 96
    steps: int = 160
    spp: int = 16


@dataclass(frozen=True)
class SamplingSection:
    method: str = "prior"
    through: str = "surface"
    coefficients: int = 11
    draws: int = 4000
    level: float = 0.95


@dataclass(frozen=True)
class ViewInputs:
    """One photo of the materials and what it was taken in; the first, of [photos], has no name.
    """

    name: str
    photo: dict[str, tuple[str, ...]]   # files by band
    chart: dict[str, tuple[str, ...]]   # under the same light; empty where no chart is needed
    light: SpectrumRef
    scene: str
    lights_by_id: dict[str, SpectrumRef]

    @property
    def photo_files(self) -> tuple[str, ...]:
        return all_files(self.photo)

    @property
    def chart_files(self) -> tuple[str, ...]:
        return all_files(self.chart)

    @property
    def all_lights(self) -> tuple[SpectrumRef, ...]:
        return (self.light, *self.lights_by_id.values())

    def record(self, kind: str) -> str:
        """The name under which a stage stores what it makes of this view."""
        return f"{kind} {self.name}".rstrip()


@dataclass(frozen=True)
class SessionConfig:
    """One session as its operator described it; file names are relative to ``folder``."""

    folder: Path
    allow_outside: bool
    photos: PhotosSection
    light: LightSection
    scene: SceneSection
    materials: dict[str, MaterialSection]
    views: dict[str, ViewSection] = field(default_factory=dict)
    session: SessionSection = field(default_factory=SessionSection)
    chart: ChartSection = field(default_factory=ChartSection)
    camera: CameraSection = field(default_factory=CameraSection)
    drift: DriftSection = field(default_factory=DriftSection)
    sensitivity: SensitivitySection = field(default_factory=SensitivitySection)
    scale: ScaleSection = field(default_factory=ScaleSection)
    reconstruct: ReconstructSection = field(default_factory=ReconstructSection)
    sampling: SamplingSection = field(default_factory=SamplingSection)

    @property
    def needs_chart(self) -> bool:
        """Whether the first view's calibration is to come from its chart photo."""
        return self.sensitivity.from_chart or self.scale.source == "chart"

    @property
    def all_views(self) -> tuple[ViewInputs, ...]:
        """The session's photos of the materials, the main one first."""
        main = ViewInputs("", by_band(self.photos.object),
                    by_band(self.photos.chart if self.needs_chart else None), self.light.spectrum,
                    self.scene.file, self.light.by_id or {})
        return (main, *(ViewInputs(name, by_band(view.photo), by_band(view.chart),
                             view.light or main.light,
                             view.scene or main.scene, {} if view.light else main.lights_by_id)
                        for name, view in self.views.items()))

    @property
    def views_with_chart(self) -> tuple[ViewInputs, ...]:
        """Views that have a chart photo under their light."""
        return tuple(view for view in self.all_views if view.chart)

    @property
    def results_folder(self) -> Path:
        """Where the stages keep their results."""
        return self.folder / "results"

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


WRITTEN_AS = {"source": "from"}  # "from" is a word of Python
CHOICES = {
    ("scale", "source"): ("chart", "material"), ("sensitivity", "method"): ("prior", "smooth",
                                                                            "nonnegative", "paper"),
    ("reconstruct", "engine"): ("auto", "transport", "gradient", "per-wavelength", "single-bounce"),
    ("reconstruct", "spectrum_prior"): ("learnt", "smooth", "none"),
    ("sampling", "method"): ("prior", "uniform", "paper"), ("sampling", "through"): ("surface",
                                                                                     "transport")}
NAMED_TABLES = {"materials": MaterialSection, "views": ViewSection}
SECTIONS = {f.name: f for f in dataclasses.fields(SessionConfig) if f.name not in ("folder",
                                                                                   "allow_outside")}
LIMITS: dict[tuple[str, str], tuple[float, float]] = {
    ("session", "seed"): (0, 2**31 - 1), ("sensitivity", "coefficients"): (5, 24),
    ("sensitivity", "relative_error"): (1e-4, 1.0), ("drift", "relative_error"): (1e-5, 1.0),
    ("reconstruct", "coefficients"): (5, 40),
    ("reconstruct", "surface_error"): (0, 1), ("reconstruct", "smoothness"): (0, 1e9),
    ("reconstruct", "brightness_error"): (0, 1), ("reconstruct", "light_error"): (0, 1),
    ("reconstruct", "mixing_error"): (0, 1), ("reconstruct", "block_error"): (0, 1),
    ("reconstruct", "width"): (16, 1024), ("reconstruct", "steps"): (20, 5000),
    ("reconstruct", "spp"): (1, 4096), ("sampling", "coefficients"): (5, 40),
    ("sampling", "draws"): (1000, 1000000), ("sampling", "level"): (0.5, 0.999)}
