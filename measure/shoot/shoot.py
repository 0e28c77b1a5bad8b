"""What is stated of a measurement: ``Shoot``, a model with a table for each part of it.

Each key stands here once, with its unit, limits, default and meaning; editors and the help of
commands show the meanings. There are three ways in, with tables of the same names: ``from_toml``
from a session's file, ``from_arguments`` from a function of the library, ``from_command`` from a
command that measures without a session. Curves are in ``curves.py``, errors and options in
``options.py``; ``rules.py`` says which keys do not go together, and ``captures.py`` reads the files
that are named.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Self, get_args, get_origin

from pydantic import Field, model_validator

from spectrabox.measure import captured
from spectrabox.measure.shoot import curves, options
from spectrabox.measure.steps import declared_steps
from spectrabox.radiometry.charts.layouts import is_layout_file
from spectrabox.radiometry.checked_tables import ListOf, Table, checked
from spectrabox.reconstruct.scene import box_tables

FILE_NAME = "session.toml"

# One file, or several of an exposure bracket; or a photo for each filter, by the name of its band.
Files = str | Annotated[ListOf[str], Field(min_length=1)]
Photo = Files | Annotated[dict[str, Files], Field(min_length=1)]


def by_band(written: str | tuple[str, ...] | Mapping[str, Files] | None
            ) -> dict[str, tuple[str, ...]]:
    """Files of a photo by band; of a colour camera's photo under one name."""
    bands = {} if written is None else written if isinstance(written, Mapping) else {
        captured.ONE_PHOTO: written}
    return {band: (files,) if isinstance(files, str) else files for band, files in bands.items()}


def all_files(photo: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Every file of a photo."""
    return tuple(name for files in photo.values() for name in files)


def encloses(rect: Sequence[float]) -> bool:
    """Whether [x0, y0, x1, y1] are two opposite corners of more than a line."""
    return len(rect) == 4 and rect[0] != rect[2] and rect[1] != rect[3]


class SessionSection(Table):
    """What the report says of the session."""

    name: str = Field("untitled session", description="shown in the report")
    operator: str = Field("", description="shown in the report")
    notes: str = Field("", description="shown in the report")
    seed: int = Field(1, ge=0, le=2**31 - 1, description="same seed, same results")
    surface: Literal["matt", "satin", "glossy", "unknown"] | None = Field(
        None, description="finish of all that is measured where its own table says none: matt, "
        "satin or glossy; unknown where nobody can say")


class PhotosSection(Table):
    """Files of each photo."""

    object: Photo = Field(description="the scene: camera raw, or linear EXR or TIFF; a list is an "
                          "exposure bracket, a table has one photo for each filter or lamp")
    chart: Photo | None = Field(None, description="the colour chart under the same light, same "
                                "camera")
    flat: str | dict[str, str] | None = Field(None, description="evenly lit white card: corrects "
                                              "vignetting")
    dark: Files | None = Field(None, description="dark frames, one or several at each exposure")
    not_linear: bool = Field(False, description="take JPEG or PNG photos, decoded as sRGB")
    orientation: int = Field(1, ge=1, le=8, description="how all photos of a flat sample are "
                             "turned before pixels are counted, as EXIF numbers it: 6 a quarter "
                             "to the right, 8 to the left, 3 upside down; 1 as the sensor read "
                             "them")

    @property
    def flats(self) -> dict[str, str]:
        """The flat-field photo of each band."""
        return {band: files[0] for band, files in by_band(self.flat).items()}

    @property
    def dark_files(self) -> tuple[str, ...]:
        return all_files(by_band(self.dark))


class ChartSection(Table):
    """The chart and where it lies."""

    layout: str = Field("ColorChecker Classic", description="name of a chart that is sold, or a "
                        "file NAME.toml of one's own")
    reference: str | None = Field(None, description="published reflectances by name, or a file of "
                                  "measured ones; by default what copies of the chart are "
                                  "like, and how they differ")
    scene: str | None = Field(None, description="Mitsuba XML with the light and a rectangle of id "
                              "\"chart\"")
    corners_px: ListOf[ListOf[float]] | None = Field(
        None, description="the chart's four corners in pixels of the photo: of the Classic the "
        "outer corners at dark skin, bluish green, black and white")
    leave_out: ListOf[int] = Field((), description="numbers of patches, from 1, that no fit uses: "
                                   "soiled ones, or some to judge the calibration by")

    @property
    def layout_file(self) -> str | None:
        """Name of the file of the layout; None where a chart that is sold is named."""
        return self.layout if is_layout_file(self.layout) else None


class CameraSection(Table):
    """The camera's optics."""

    lens: str | None = Field(None, description="from 'spectrabox geometry lens': object photos "
                             "are undistorted")


class LightSection(Table):
    """Spectra of the lights."""

    spectrum: curves.LightRef = Field(
        description="a file of its spectrum, any unit; or \"unknown\", a "
        "CIE name, a kind of lamp (daylight, halogen, led, fluorescent), or "
        "{cct = 3200}")
    by_id: dict[str, curves.LightRef] | None = Field(
        None, description="lights of the scene that are not as strong or as coloured beside the "
        "others as it states: their spectra, in the unit of light.spectrum")


class SensitivitySection(Table):
    """Where the camera's sensitivities come from."""

    source: curves.SourceRef = Field(
        curves.SourceTable(file=curves.FROM_CHART), validation_alias="from",
        description="\"chart\", a file of measured curves, or a camera's "
        "name")
    method: Literal["prior", "smooth", "nonnegative", "paper"] = Field(
        "prior", description="prior: learnt from measured cameras; the others: splines")
    prior: str | None = Field(None, description="a prior made by 'spectrabox camera prior'")
    relative_error: float = Field(captured.CURVES_ERROR, ge=1e-4, le=1, description="of signals "
                                  "predicted from measured curves")
    truth: curves.CurvesRef | None = Field(None, description="curves to compare with in the report")

    @property
    def from_chart(self) -> bool:
        return self.source.file == curves.FROM_CHART


class ScaleSection(Table):
    """What sets the brightness of the light."""

    source: Literal["chart", "material"] = Field(
        "chart", validation_alias="from", description="the chart photo, or materials with a known "
        "spectrum")


class SceneSection(Table):
    """The scene of the object photo: a file, or a box measured with a tape."""

    file: str | None = Field(None, description="Mitsuba XML: geometry, camera pose, light in their "
                             "places")
    box: box_tables.BoxTable | None = Field(
        None, description="a box with objects, lamp, camera and chart, in "
        "place of file")

    @model_validator(mode="after")
    def _is_file_or_box(self) -> SceneSection:
        if (self.file is None) == (self.box is None):
            raise ValueError("a scene is either file = \"scene/scene.xml\" or the measures of a "
                             "box in [scene.box]; give one of the two")
        return self


class SurfaceSection(Table):
    """What is known of a surface beforehand."""

    known: curves.SpectrumRef | None = Field(None,
                                             description="measured reflectance, taken as given")
    truth: curves.SpectrumRef | None = Field(None,
                                             description="measured reflectance, only compared with")
    family: str | ListOf[str] | None = Field(
        None, description="what the surface is: paint, textile, leaves, skin, white, earth or "
        "animal; bands are then conditional on it")
    surface: options.Surface = options.SURFACE_FIELD

    @property
    def families(self) -> tuple[str, ...]:
        """The families that the surface is said to be one of; none where nobody said."""
        if self.family is None:
            return ()
        return (self.family,) if isinstance(self.family, str) else tuple(self.family)

    @property
    def measured(self) -> curves.SpectrumTable | None:
        """Its measured reflectance, which is not looked for."""
        return self.known


class MaterialSection(SurfaceSection):
    """A material of the scene."""

    bsdf: str | None = Field(None, description="id of the BSDF in the scene; the material's name "
                             "where left out")


class RegionSection(SurfaceSection):
    """A region of a flat sample, in pixels of the photo."""

    rect: ListOf[float] | None = Field(None, description="[x0, y0, x1, y1]: two opposite corners")
    polygon: ListOf[ListOf[float]] | None = Field(None, description="[[x, y], ...]: three corners "
                                                  "or more, going round")
    photo: str | ListOf[str] | None = Field(None, description="the photo that shows it, or "
                                            "several, by the names of [views]; \"photo\" is that "
                                            "of [photos]. All of them where left out")

    @property
    def photos(self) -> tuple[str, ...]:
        """Names of the photos that show it; none stands for all."""
        return (self.photo,) if isinstance(self.photo, str) else tuple(self.photo or ())

    def outline(self) -> captured.Outline:
        """Its corners (x, y), going round."""
        if self.rect is not None:
            return captured.rectangle(self.rect)
        return tuple((x, y) for x, y in self.polygon or ())


class ViewSection(Table):
    """A further photo of the same materials: another light, exposure or viewpoint."""

    photo: Photo = Field(description="files as of photos.object")
    light: curves.LightRef | None = Field(
        None, description="its light; that of light.spectrum, from the "
        "same lamp, where left out")
    same_light_as: str | None = Field(None, description="in place of light: the view whose lamp "
                                      "shines here too, unchanged; \"photo\" is that of [photos]")
    lamp: Literal["moved"] | None = Field(None, description="of flat samples: \"moved\", the lamp "
                                          "is the same and stands elsewhere")
    filter: curves.FilterRef | None = Field(
        None, description="a filter before lens or lamp: the file of "
        "its transmittance, or \"unknown\"")
    scene: str | None = Field(None, description="its scene; that of [scene] where left out")
    turn_deg: float | None = Field(None, ge=-360, le=360, description="by which the turntable of "
                                   "[scene.box] had turned, counter-clockwise as seen from above")
    lamp_at_mm: box_tables.Point | None = Field(
        None, description="where the lamp of [scene.box] stood for "
        "this photo, if it was moved")
    camera: box_tables.CameraTable | None = Field(None, description="where its camera stood, as of "
                                       "[scene.box.camera]; there too where left out")
    chart: Photo | None = Field(None, description="the chart under its light; without it, "
                                "materials in common with other photos tell its strength")


class CompleteView(ViewSection):
    """One photo of the surfaces with what its table leaves out: its light, chart and scene. The
    first, of [photos], has no name.
    """

    name: str
    light: curves.LightTable
    lights_by_id: dict[str, curves.LightTable]
    lamp_of: str = captured.FIRST_PHOTO  # title of the first photo that its lamp is stated to light
    moved_for: str = ""                 # title of the photo for which its lamp was put elsewhere

    @property
    def title(self) -> str:
        """What it is called in sentences and in a region's ``photo``."""
        return self.name or captured.FIRST_PHOTO

    @property
    def photo_by_band(self) -> dict[str, tuple[str, ...]]:
        return by_band(self.photo)

    @property
    def photo_files(self) -> tuple[str, ...]:
        return all_files(self.photo_by_band)

    @property
    def chart_files(self) -> tuple[str, ...]:
        return all_files(self.chart_by_band)

    @property
    def chart_by_band(self) -> dict[str, tuple[str, ...]]:
        """Empty where no chart is needed."""
        return by_band(self.chart)

    @property
    def light_files(self) -> tuple[str, ...]:
        """Of the spectra of its lights and its filter."""
        of_filter = () if self.filter is None or self.filter.file is None else (self.filter.file,)
        lights = (self.light, *self.lights_by_id.values())
        return (*(name for light in lights for name in light.files), *of_filter)

    @property
    def spectrum_stated(self) -> bool:
        """Whether the spectrum of what lights it, filter included, is stated."""
        return self.light.stated and (self.filter is None or self.filter.file is not None)

    def same_light(self, other: CompleteView) -> bool:
        """Whether both are stated to be under one lamp, through one filter if any. Of two filters
        that nobody measured nothing says that they are one.
        """
        if self.name == other.name:
            return True
        unknown = self.filter is not None and self.filter.file is None
        return self.lamp_of == other.lamp_of and self.filter == other.filter and not unknown


class Shoot(Table):
    """What is stated of photos, lights, chart, surfaces and scene, with the options of the
    measurement. Files are named as seen from one folder.
    """

    session: SessionSection = SessionSection()
    photos: PhotosSection
    chart: ChartSection = ChartSection()
    camera: CameraSection = CameraSection()
    repeatability: options.Repeatability = options.Repeatability()
    stray_light: options.StrayLight = options.StrayLight()
    light: LightSection
    sensitivity: SensitivitySection = SensitivitySection()
    scale: ScaleSection = ScaleSection()
    scene: SceneSection | None = None
    views: dict[str, ViewSection] = Field(default_factory=dict)
    materials: dict[str, MaterialSection] = Field(default_factory=dict)
    regions: dict[str, RegionSection] = Field(default_factory=dict)
    reconstruct: options.Inversion = options.Inversion()
    sampling: options.Sampling = options.Sampling()
    picture: options.PictureOptions | None = None

    @classmethod
    def from_toml(cls, tables: Mapping[str, Any]) -> Self:
        """What the tables of a session.toml state; raises as ``checked``, as do those below."""
        return checked(cls, tables, FILE_NAME)

    @classmethod
    def from_arguments(cls, tables: Mapping[str, Any]) -> Self:
        """What the arguments of a function of the library state, in the same tables."""
        return checked(cls, {"session": {"name": ""}, **tables}, "arguments")

    @classmethod
    def from_command(cls, tables: Mapping[str, Any]) -> Self:
        """What the options of a command without a session state, in the same tables."""
        return checked(cls, {"session": {"name": ""}, **tables}, "options")

    @property
    def flat(self) -> bool:
        """Whether regions of flat samples are measured and no scene; an empty [regions] says so
        before one is outlined.
        """
        scene_stated = self.scene is not None or self.materials
        return "regions" in self.model_fields_set and (bool(self.regions) or not scene_stated)

    @property
    def steps(self) -> tuple[declared_steps.Step, ...]:
        """Of its measurement."""
        return declared_steps.FLAT_STEPS if self.flat else declared_steps.SCENE_STEPS

    @property
    def surfaces(self) -> Mapping[str, SurfaceSection]:
        """What is measured, by name."""
        return self.regions if self.flat else self.materials

    @property
    def bsdfs(self) -> dict[str, str]:
        """Id of the BSDF of every material."""
        return {name: material.bsdf or name for name, material in self.materials.items()}

    @property
    def box(self) -> box_tables.BoxTable | None:
        """The box that the scene is made from, where it is no file."""
        return None if self.scene is None else self.scene.box

    @property
    def camera_from_chart(self) -> bool:
        """Whether the camera is fitted to a chart photo."""
        return self.flat or self.sensitivity.from_chart

    @property
    def needs_chart(self) -> bool:
        """Whether the first view's calibration is to come from its chart photo."""
        return self.camera_from_chart or self.scale.source == "chart"

    @property
    def chart_pose_known(self) -> bool:
        """Whether it is stated where light and chart stood for the chart photo."""
        return self.chart.scene is not None or (self.box is not None
                                                and self.box.chart is not None)

    @property
    def all_views(self) -> tuple[CompleteView, ...]:
        """The photos of the surfaces, that of [photos] first."""
        scene, by_id = self.scene.file if self.scene else None, self.light.by_id or {}
        photo, chart = self.photos.object, self.photos.chart
        if chart is None and self.flat:     # the photo of the samples shows the chart itself
            chart = photo
        views = [CompleteView(
            name="", photo=photo, light=self.light.spectrum, scene=scene, lights_by_id=by_id,
            chart=chart if self.needs_chart else None)]
        for name, view in self.views.items():
            lamp = self._lamp_of(name)
            own = None if lamp not in self.views else self.views[lamp].light
            views.append(CompleteView(**{
                **dict(view), "name": name, "light": own or self.light.spectrum,
                "scene": view.scene or scene, "lights_by_id": {} if own else by_id,
                "chart": self._chart_of(view, lamp), "lamp_of": lamp,
                "moved_for": self._moved_for(name)}))
        return tuple(views)

    def _chart_of(self, view: ViewSection, lamp: str) -> Photo | None:
        """The photo that shows the chart under a further view's light; None where none is needed.

        Without one of its own, the photo of flat samples shows the chart where its light is
        another, elsewhere or through a filter, or where the first photo shows it.
        """
        shows_chart = self.flat and (lamp != captured.FIRST_PHOTO or view.filter is not None
                                     or view.lamp is not None or self.photos.chart is None)
        return view.photo if view.chart is None and shows_chart else view.chart

    def _moved_for(self, name: str) -> str:
        """Title of the photo for which the lamp of a view was put where it stands; empty where it
        stands as in the first photo under it.
        """
        passed: list[str] = []
        while name in self.views and name not in passed:
            if self.views[name].lamp is not None:
                return name
            passed.append(name)
            name = self.views[name].same_light_as or captured.FIRST_PHOTO
        return ""

    def _lamp_of(self, name: str) -> str:
        """Title of the first photo that is stated to be under the lamp of a view.

        One lamp is what ``same_light_as`` says, what names no light of its own, and what names the
        same measured file or the same CIE name. A word such as "unknown" or "halogen" says what two
        lamps are like, not that they are one.
        """
        passed: list[str] = []
        while (other := self.views[name].same_light_as) in self.views and other not in passed:
            assert other is not None
            passed.append(name)
            name = other
        light = self.views[name].light
        if light is None:
            return captured.FIRST_PHOTO
        alike = [title for title, named in ((captured.FIRST_PHOTO, self.light.spectrum),
                                            *((other, view.light) for other, view
                                              in self.views.items())) if named == light]
        return alike[0] if light.stated else name

    @property
    def views_with_chart(self) -> tuple[CompleteView, ...]:
        """Views that have a chart photo under their light."""
        return tuple(view for view in self.all_views if view.chart)

    def regions_in(self, view: CompleteView) -> dict[str, RegionSection]:
        """The regions that the photo of a view shows."""
        return {name: region for name, region in self.regions.items()
                if not region.photos or view.title in region.photos}


def meaning(key: str) -> str:
    """What a key means, as a sentence, and which of its words is the default.

    Parameters
    ----------
    key : str
        Its table and name, such as "regions.family".
    """
    table, _, name = key.partition(".")
    kind = Shoot.model_fields[table].annotation
    model = next(each for each in (kind, *get_args(kind))
                 if isinstance(each, type) and issubclass(each, Table))
    field = next(field for named, field in model.model_fields.items()
                 if name in (named, field.validation_alias))
    said = field.description or ""
    default = f" By default {field.default}." if get_origin(field.annotation) is Literal else ""
    return f"{said[0].upper()}{said[1:].rstrip('.')}.{default}"
