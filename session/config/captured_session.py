"""What session.toml says was photographed, as the record that every measurement starts from.

Spectra, scenes, layouts and priors are read here, photos are not. Every file that cannot be used is
named at once.
"""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, overload

import numpy as np

from spectrabox.calibrate.geometry.lens import Lens, read_lens
from spectrabox.calibrate.prior.camera_prior import CameraPrior, load_camera_prior
from spectrabox.measure.captured import (
    Development,
    FlatCapture,
    InputFile,
    LitChart,
    Material,
    PhotoFiles,
    Region,
    SceneCapture,
    SceneView,
    Sensitivity,
    View,
)
from spectrabox.radiometry.chart import Chart, excluded_patches
from spectrabox.radiometry.charts.references import reference_file, reference_reflectances
from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.calibration import Filter
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.filters import read_filter as read_filter_file
from spectrabox.radiometry.spectra.filters import unknown_filter
from spectrabox.radiometry.spectra.named_spectra import sensitivities, spectrum_of_name, vague_light
from spectrabox.radiometry.spectra.spectrum_files import (
    on_grid,
    read_curves,
    read_spectrum,
    spectrum_on_grid,
)
from spectrabox.reconstruct.scene.edit_scene import refinements
from spectrabox.session.box.scenes import read_chart_scene, stated_scene
from spectrabox.session.config.curve_sources import FilterTable, LightTable, SpectrumTable
from spectrabox.session.config.flat_session import FlatSession
from spectrabox.session.config.session_chart import chart_files, session_chart
from spectrabox.session.config.session_schema import (
    RegionSection,
    SessionConfig,
    SurfaceSection,
    ViewInputs,
)

Kind = TypeVar("Kind")


@overload
def capture_of(config: FlatSession) -> FlatCapture: ...
@overload
def capture_of(config: SessionConfig) -> FlatCapture | SceneCapture: ...


def capture_of(config: SessionConfig) -> FlatCapture | SceneCapture:
    """What a session measures, with everything read but its photos.

    Parameters
    ----------
    config : SessionConfig

    Raises
    ------
    SpectraboxError
        If files cannot be read or used; it names them all, a sentence a line.
    """
    capture, faults = capture_with_faults(config)
    if faults:
        sentences = dict.fromkeys(line for fault in faults for line in str(fault).splitlines())
        raise type(faults[0])("\n".join(sentences))
    return capture


def capture_with_faults(config: SessionConfig
                        ) -> tuple[FlatCapture | SceneCapture, list[SpectraboxError]]:
    """As ``capture_of``, with every fault; what could not be read is None in the capture then."""
    reader = _Reader(config)
    if isinstance(config, FlatSession):
        return _flat_capture(config, reader), reader.faults
    return _scene_capture(config, reader), reader.faults


class _Reader:
    """Reads the files of a session one after the other, and notes what cannot be used."""

    def __init__(self, config: SessionConfig) -> None:
        self.config = config
        self.faults: list[SpectraboxError] = []

    def read(self, read: Callable[..., Kind], *arguments: Any) -> Kind:
        """What a function reads.

        Returns
        -------
        its result
            Not used where there is a fault: the capture is refused then.
        """
        try:
            return read(*arguments)
        except SpectraboxError as fault:
            self.faults.append(fault)
            return None  # type: ignore[return-value]  # nothing is made of it

    def file(self, name: str) -> InputFile:
        """A file by its name in session.toml."""
        return InputFile(name, self.read(self.config.path, name))

    def photo(self, files: dict[str, tuple[str, ...]]) -> PhotoFiles:
        """A photo's files by band."""
        return {band: tuple(self.file(name) for name in names) for band, names in files.items()}


def _flat_capture(config: SessionConfig, reader: _Reader) -> FlatCapture:
    views = tuple(View(**_stated_of_view(config, reader, view)) for view in config.all_views)
    regions = {name: Region(**_stated_of_surface(config, reader, section),
                            outline=_outline(section), photos=section.photos)
               for name, section in config.regions.items()}
    return FlatCapture(views=views, regions=regions, **_stated_of_capture(config, reader))


def _scene_capture(config: SessionConfig, reader: _Reader) -> SceneCapture:
    chart_scene = reader.read(read_chart_scene, config) if config.views_with_chart else None
    lens = reader.read(_lens, config)
    views = tuple(
        SceneView(**_stated_of_view(config, reader, view), lens=lens, scene_name=view.scene,
                  scene=reader.read(stated_scene, config, view),
                  lights_by_id={name: reader.read(read_known_light, config, light)
                                for name, light in view.lights_by_id.items()})
        for view in config.all_views)
    materials = {name: Material(**_stated_of_surface(config, reader, section),
                                bsdf=section.bsdf or name)
                 for name, section in config.materials.items()}
    files = dict.fromkeys(view.scene for view in config.all_views if view.scene is not None)
    return SceneCapture(views=views, materials=materials, chart_scene=chart_scene,
                        inversion=config.reconstruct,
                        scale_from_chart=config.scale.source == "chart",
                        refinements={} if reader.faults else {
                            file: refinements(config.path(file)) for file in files},
                        **_stated_of_capture(config, reader))


def _lens(config: SessionConfig) -> Lens | None:
    """The lens by which object photos are undistorted, where its file is named."""
    return None if config.camera.lens is None else read_lens(config.path(config.camera.lens))


def _stated_of_capture(config: SessionConfig, reader: _Reader) -> dict[str, Any]:
    """What sessions of both kinds state beside photos and surfaces, by the fields of a capture."""
    photos = config.photos
    return {
        "name": config.session.name, "seed": config.session.seed,
        "chart": reader.read(_chart, config) if config.views_with_chart else None,
        "development": Development(
            tuple(reader.file(name) for name in photos.dark_files),
            {band: reader.file(name) for band, name in photos.flats.items()},
            photos.not_linear, photos.orientation),
        "sensitivity": reader.read(_sensitivity, config),
        "repeatability": config.repeatability, "stray_light": config.stray_light,
        "sampling": config.sampling, "picture": config.picture}


def _stated_of_view(config: SessionConfig, reader: _Reader, view: ViewInputs) -> dict[str, Any]:
    """What is stated of a photo, by the fields of a view."""
    table = view.filter
    return {"name": view.name, "photo": reader.photo(view.photo), "chart": reader.photo(view.chart),
            "light": reader.read(read_light, config, view.light), "light_words": _words(view.light),
            "lamp": view.lamp, "moved": view.moved,
            "filter": None if table is None else reader.read(read_filter, config, table),
            "filter_words": "" if table is None else _words_of_filter(table),
            "filter_known": table is None or table.file is not None}


def _words(light: LightTable) -> str:
    """How a light is stated."""
    return light.file or light.word or f"unknown light of {light.cct:g} K"


def _words_of_filter(table: FilterTable) -> str:
    """How a filter is stated."""
    if table.file is None:
        return "an unknown filter"
    column = "" if table.column is None else f", column {table.column}"
    return f"{table.file}{column}"


def _stated_of_surface(config: SessionConfig, reader: _Reader,
                       section: SurfaceSection) -> dict[str, Any]:
    """What is stated of a surface, by the fields of one."""
    return {"families": section.families, "surface": section.surface,
            "known": _reflectance(config, reader, section.known),
            "truth": None if section.truth is None
            else reader.read(read_reflectance, config, section.truth)}


def _reflectance(config: SessionConfig, reader: _Reader,
                 table: SpectrumTable | None) -> np.ndarray | None:
    """A measured reflectance (P,)."""
    spectrum = None if table is None else reader.read(read_reflectance, config, table)
    return None if spectrum is None else spectrum_on_grid(spectrum, FINE_GRID)


def _outline(section: RegionSection) -> tuple[tuple[float, float], ...]:
    """Corners of a region, going round."""
    return tuple((x, y) for x, y in section.outline())


def _chart(config: SessionConfig) -> LitChart:
    """The session's chart, with its reflectances, published or measured."""
    layout = session_chart(config)
    corners = config.chart.corners_px
    return LitChart(layout, read_chart_reference(config, layout),
                    excluded_patches(config.chart.leave_out, layout, "chart.leave_out"),
                    None if corners is None else np.array(corners),
                    stated=config.chart.reference is not None or layout.reference_file is not None,
                    measured=reference_file(config.chart.reference, layout) is not None)


def read_chart_reference(config: SessionConfig, layout: Chart) -> np.ndarray:
    """Reflectances (I, P) of the chart, published or measured.

    Raises
    ------
    InputError, CheckError
        If a file cannot be read, or lists the patches in another order.
    """
    for name in chart_files(config):
        config.path(name)      # refuses what lies outside the session
    return reference_reflectances(config.chart.reference, layout, FINE_GRID, config.folder)


def _sensitivity(config: SessionConfig) -> Sensitivity:
    """Where the camera's sensitivities come from."""
    chosen = config.sensitivity
    prior: CameraPrior | None = None
    if chosen.prior is not None:
        prior = load_camera_prior(config.path(chosen.prior))
    names, curves = ((), None) if chosen.from_chart else read_sensitivities(config)
    return Sensitivity(curves, names, chosen.source.words, chosen.method, prior,
                       chosen.relative_error)


def read_sensitivities(config: SessionConfig) -> tuple[tuple[str, ...], np.ndarray]:
    """Measured curves (K, P) on the working grid, scaled to a largest value of 1, and their names,
    where their file names them.

    Raises
    ------
    InputError
        If there are fewer than three curves, or they are negative.
    """
    source = config.sensitivity.source
    names: tuple[str, ...] = ()
    if source.file is None:
        on = sensitivities(source.words, FINE_GRID)
    else:
        nm, names, curves = read_curves(config.path(source.file), source.columns)
        on = on_grid(nm, curves, FINE_GRID, source.file)
    if len(on) < 3:
        raise InputError(f"{source.words} holds {len(on)} curves; three or more bands are "
                         "needed")
    if on.max() <= 0 or on.min() < -0.05 * on.max():
        raise InputError(f"{source.words}: sensitivities must be positive; "
                         f"they run from {on.min():.3g} to {on.max():.3g}")
    return names, np.maximum(on, 0.0) / on.max()


def read_light(config: SessionConfig, table: LightTable) -> Spectrum | UnknownLight:
    """Light spectrum as its file gives it, or what is known of it.

    Raises
    ------
    InputError
        If its file cannot be read, does not cover 400-700 nm or is negative there, or no light has
        its name.
    """
    if table.cct is not None:
        return UnknownLight(cct=table.cct)
    if table.word is not None:
        return vague_light(table.word) or spectrum_of_name(table.word, FINE_GRID)
    assert table.file is not None
    light = read_spectrum(config.path(table.file), role=Quantity.RELATIVE,
                          column=table.column)
    values = spectrum_on_grid(light, FINE_GRID)
    if values.max() <= 0 or values.min() < -0.01 * values.max():
        raise InputError(f"{table.file}: a light spectrum must be positive; "
                         f"it runs from {values.min():.3g} to {values.max():.3g} over 400-700 nm")
    return light


def read_known_light(config: SessionConfig, table: LightTable) -> Spectrum:
    """The same where a spectrum is needed.

    Raises
    ------
    InputError
        As ``read_light``, and if the light is not known.
    """
    light = read_light(config, table)
    if isinstance(light, UnknownLight):
        raise InputError(f"this needs the spectrum of a light and has an {light.words}; measure "
                         "it, or name a CIE illuminant")
    return light


def read_filter(config: SessionConfig, table: FilterTable) -> Filter:
    """A filter of the session, with its error.

    Raises
    ------
    InputError
        If its file cannot be read, does not cover 400-700 nm, or is no transmittance.
    """
    if table.file is None:
        return unknown_filter()
    return read_filter_file(config.path(table.file), table.column)


def read_reflectance(config: SessionConfig, table: SpectrumTable) -> Spectrum:
    """Reflectance that covers 400-700 nm.

    Raises
    ------
    InputError
        If the file cannot be read, or does not cover 400-700 nm.
    """
    spectrum = read_spectrum(config.path(table.file), role=Quantity.REFLECTANCE,
                             column=table.column)
    spectrum_on_grid(spectrum, FINE_GRID)
    return spectrum
