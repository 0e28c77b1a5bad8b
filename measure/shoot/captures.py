"""The capture that a shoot describes: its files read, but for the photos.

Every file that cannot be used is named at once.
"""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from spectrabox.calibrate.geometry.colmap_model import Picture, read_colmap
from spectrabox.calibrate.geometry.lens import read_lens
from spectrabox.calibrate.prior.camera_prior import load_camera_prior
from spectrabox.measure import captured
from spectrabox.measure.shoot import curves, options
from spectrabox.measure.shoot.inputs import Inputs, chart_files, chart_of
from spectrabox.measure.shoot.shoot import FILE_NAME, CompleteView, Shoot, SurfaceSection
from spectrabox.radiometry import chart, errors, grid
from spectrabox.radiometry.charts.references import reference_file, reference_reflectances
from spectrabox.radiometry.records import calibration, spectra
from spectrabox.radiometry.spectra import filters, light_words, named_spectra, spectrum_files
from spectrabox.radiometry.spectra.filters import read_filter as read_filter_file
from spectrabox.reconstruct.scene import box_scene, edit_scene, scene_file

BOX_SCENE_NAME, CHART_SCENE_NAME = "scene.xml", "chart-scene.xml"   # made of [scene.box]
COLMAP = f"{FILE_NAME}: scene.box.colmap"
SHOWN = 12              # names of pictures in an error
Kind = TypeVar("Kind")


def capture_of(shoot: Shoot, inputs: Inputs) -> captured.FlatCapture | captured.SceneCapture:
    """What is measured, with everything read but its photos.

    Parameters
    ----------
    shoot : Shoot
    inputs : Inputs
        Its files.

    Raises
    ------
    SpectraboxError
        If files cannot be read or used; it names them all, a sentence a line.
    """
    capture, faults = capture_with_faults(shoot, inputs)
    if faults:
        raise type(faults[0])(*(sentence for fault in faults for sentence in fault.faults))
    return capture


def flat_capture_of(shoot: Shoot, inputs: Inputs) -> captured.FlatCapture:
    """As ``capture_of``, of flat samples."""
    capture = capture_of(shoot, inputs)
    assert isinstance(capture, captured.FlatCapture)
    return capture


def capture_with_faults(
        shoot: Shoot, inputs: Inputs
) -> tuple[captured.FlatCapture | captured.SceneCapture, list[errors.SpectraboxError]]:
    """As ``capture_of``, with every fault; what could not be read is None in the capture then."""
    reader = _Reader(shoot, inputs)
    return reader.flat_capture() if shoot.flat else reader.scene_capture(), reader.faults


class _Reader:
    """Reads the files of a shoot one after the other, and notes what cannot be used."""

    def __init__(self, shoot: Shoot, inputs: Inputs) -> None:
        self.shoot, self.inputs = shoot, inputs
        self.faults: list[errors.SpectraboxError] = []

    def read(self, read: Callable[..., Kind], *arguments: Any) -> Kind:
        """What a function reads.

        Returns
        -------
        its result
            Not used where there is a fault: the capture is refused then.
        """
        try:
            return read(*arguments)
        except errors.SpectraboxError as fault:
            self.faults.append(fault)
            return None  # type: ignore[return-value]  # nothing is made of it

    def file(self, name: str) -> captured.InputFile:
        """A file by the name that the shoot has for it."""
        return self.inputs.given.get(name) or captured.InputFile(name,
                                                                 self.read(self.inputs.path, name))

    def photo(self, files: dict[str, tuple[str, ...]]) -> captured.PhotoFiles:
        """A photo's files by band."""
        return {band: tuple(self.file(name) for name in names) for band, names in files.items()}

    def flat_capture(self) -> captured.FlatCapture:
        views = tuple(captured.View(**self._view(view)) for view in self.shoot.all_views)
        regions = {name: captured.Surface(**self._surface(section), outline=section.outline(),
                                          photos=section.photos,
                                          known_error=self._known_error(section))
                   for name, section in self.shoot.regions.items()}
        return captured.FlatCapture(views=views, regions=regions, **self._common())

    def scene_capture(self) -> captured.SceneCapture:
        shoot, inputs = self.shoot, self.inputs
        lens = None if shoot.camera.lens is None else self.read(
            lambda name: read_lens(inputs.path(name)), shoot.camera.lens)
        views = tuple(
            captured.SceneView(**self._view(view), lens=lens,
                      scene=self.read(stated_scene, shoot, inputs, view),
                      lights_by_id={name: self.read(read_known_light, inputs, light)
                                    for name, light in view.lights_by_id.items()})
            for view in shoot.all_views)
        materials = {name: captured.Surface(**self._surface(section), bsdf=section.bsdf or name)
                     for name, section in shoot.materials.items()}
        files = dict.fromkeys(view.scene for view in shoot.all_views if view.scene is not None)
        return captured.SceneCapture(views=views, materials=materials,
                            inversion=shoot.reconstruct,
                            scale_from_chart=shoot.scale.source == "chart",
                            refinements={} if self.faults else {
                                file: edit_scene.refinements(inputs.path(file)) for file in files},
                            **self._common())

    def _common(self) -> dict[str, Any]:
        """What is stated of both kinds beside photos and surfaces, by the fields of a capture."""
        shoot, photos = self.shoot, self.shoot.photos
        return {
            "name": shoot.session.name, "seed": shoot.session.seed,
            "chart": self.read(_lit_chart, shoot, self.inputs) if shoot.views_with_chart else None,
            "chart_scene": self.read(read_chart_scene, shoot, self.inputs)
            if shoot.views_with_chart else None,
            "dark_frames": tuple(self.file(name) for name in photos.dark_files),
            "flat_fields": {band: self.file(name) for band, name in photos.flats.items()},
            "not_linear": photos.not_linear, "orientation": photos.orientation,
            "sensitivity": self.read(_sensitivity, shoot, self.inputs),
            "repeatability": shoot.repeatability, "stray_light": shoot.stray_light,
            "sampling": shoot.sampling, "picture": self._picture(), "finish": self.finish}

    @property
    def finish(self) -> options.Surface:
        """What is stated of all surfaces."""
        stated = self.shoot.session.surface
        return None if stated == "unknown" else stated

    def _picture(self) -> options.PictureOptions | None:
        picture = self.shoot.picture
        if picture is None or picture.surface is not None:
            return picture
        return picture.model_copy(update={"surface": self.finish})

    def _view(self, view: CompleteView) -> dict[str, Any]:
        """What is stated of a photo, by the fields of a view."""
        table = view.filter
        through = None if table is None else self.read(read_filter, self.inputs, table)
        return {"name": view.name, "photo": self.photo(view.photo_by_band),
                "chart": self.photo(view.chart_by_band),
                "light": self.read(read_light, self.inputs, view.light),
                "light_words": _words(view.light), "lamp": view.lamp_of, "moved": view.moved_for,
                "filter": through,
                "filter_words": "" if table is None else _words_of_filter(table),
                "filter_known": through is None or through.name != light_words.UNKNOWN}

    def _known_error(self, section: SurfaceSection) -> float:
        """Relative standard error of a known reflectance; of one that is not known, any."""
        known = None if section.known is None else self.read(read_reflectance, self.inputs,
                                                             section.known)
        return captured.READ_ERROR if known is None else captured.error_of_known(known)

    def _surface(self, section: SurfaceSection) -> dict[str, Any]:
        """What is stated of a surface, by the fields of one."""
        known, truth = (None if table is None else self.read(read_reflectance, self.inputs, table)
                        for table in (section.known, section.truth))
        return {
            "families": section.families, "surface": section.surface or self.finish, "known":
            None if known is None else spectrum_files.spectrum_on_grid(known, grid.FINE_GRID),
            "truth": truth
        }


def _words(light: curves.LightTable) -> str:
    """How a light is stated."""
    return light.file or light.word or f"unknown light of {light.cct:g} K"


def _words_of_filter(table: curves.FilterTable) -> str:
    """How a filter is stated."""
    if table.file is None:
        return "an unknown filter"
    column = "" if table.column is None else f", column {table.column}"
    return f"{table.file}{column}"


def _lit_chart(shoot: Shoot, inputs: Inputs) -> captured.LitChart:
    """The session's chart, with its reflectances, published or measured."""
    layout = chart_of(shoot, inputs)
    corners = shoot.chart.corners_px
    return captured.LitChart(layout, read_chart_reference(shoot, inputs, layout),
                    chart.excluded_patches(shoot.chart.leave_out, layout, "chart.leave_out"),
                    None if corners is None else np.array(corners),
                    stated=shoot.chart.reference is not None or layout.reference_file is not None,
                    measured=reference_file(shoot.chart.reference, layout) is not None)


def read_chart_reference(shoot: Shoot, inputs: Inputs, layout: chart.Chart) -> np.ndarray:
    """Reflectances (I, P) of the chart, published or measured.

    Raises
    ------
    InputError, CheckError
        If a file cannot be read, or lists the patches in another order.
    """
    for name in chart_files(shoot, inputs):
        inputs.path(name)      # refuses what lies outside the session
    return reference_reflectances(shoot.chart.reference, layout, grid.FINE_GRID, inputs.folder)


def _sensitivity(shoot: Shoot, inputs: Inputs) -> captured.Sensitivity:
    """Where the camera's sensitivities come from."""
    chosen = shoot.sensitivity
    prior = None if chosen.prior is None else inputs.given.get(chosen.prior) \
        or load_camera_prior(inputs.path(chosen.prior))
    names, curves = ((), None) if chosen.from_chart else read_sensitivities(shoot, inputs)
    return captured.Sensitivity(curves, names, chosen.source.words, chosen.method, prior,
                       chosen.relative_error)


def read_sensitivities(shoot: Shoot, inputs: Inputs) -> tuple[tuple[str, ...], np.ndarray]:
    """Measured curves (K, P) on the working grid, scaled to a largest value of 1, and their names,
    where their file names them.

    Raises
    ------
    InputError
        If there are fewer than three curves, or they are negative.
    """
    source = shoot.sensitivity.source
    names: tuple[str, ...] = ()
    if source.file is None:
        on = named_spectra.sensitivities(source.words, grid.FINE_GRID)
    else:
        nm, names, curves = spectrum_files.read_curves(inputs.path(source.file), source.columns)
        on = spectrum_files.on_grid(nm, curves, grid.FINE_GRID, source.file)
    if len(on) < 3:
        raise errors.InputError(f"{source.words} holds {len(on)} curves; three or more bands are "
                         "needed")
    if on.max() <= 0 or on.min() < -0.05 * on.max():
        raise errors.InputError(f"{source.words}: sensitivities must be positive; "
                         f"they run from {on.min():.3g} to {on.max():.3g}")
    return names, np.maximum(on, 0.0) / on.max()


def read_light(inputs: Inputs, table: curves.LightTable) -> spectra.Spectrum | spectra.UnknownLight:
    """Light spectrum as its file gives it, or what is known of it.

    Raises
    ------
    InputError
        If its file cannot be read, does not cover 400-700 nm or is negative there, or no light has
        its name.
    """
    if table.cct is not None:
        return spectra.UnknownLight(cct=table.cct)
    if table.word is not None:
        return named_spectra.vague_light(table.word) or named_spectra.spectrum_of_name(
            table.word, grid.FINE_GRID)
    assert table.file is not None
    if table.file in inputs.given:
        return inputs.given[table.file]
    light = spectrum_files.read_spectrum(inputs.path(table.file), role=spectra.Quantity.RELATIVE,
                                         column=table.column)
    values = spectrum_files.spectrum_on_grid(light, grid.FINE_GRID)
    if values.max() <= 0 or values.min() < -0.01 * values.max():
        raise errors.InputError(f"{table.file}: a light spectrum must be positive; "
                         f"it runs from {values.min():.3g} to {values.max():.3g} over 400-700 nm")
    return light


def read_known_light(inputs: Inputs, table: curves.LightTable) -> spectra.Spectrum:
    """The same where a spectrum is needed.

    Raises
    ------
    InputError
        As ``read_light``, and if the light is not known.
    """
    light = read_light(inputs, table)
    if isinstance(light, spectra.UnknownLight):
        raise errors.InputError(
            f"this needs the spectrum of a light and has an {light.words}; measure "
            "it, or name a CIE illuminant")
    return light


def read_filter(inputs: Inputs, table: curves.FilterTable) -> calibration.Filter:
    """A filter of the session, with its error.

    Raises
    ------
    InputError
        If its file cannot be read, does not cover 400-700 nm, or is no transmittance.
    """
    if table.file is None:
        return filters.unknown_filter()
    if table.file in inputs.given:
        return inputs.given[table.file]
    return read_filter_file(inputs.path(table.file), table.column)


def read_reflectance(inputs: Inputs, table: curves.SpectrumTable) -> spectra.Spectrum:
    """Reflectance that covers 400-700 nm.

    Raises
    ------
    InputError
        If the file cannot be read, or does not cover 400-700 nm.
    """
    if table.file in inputs.given:
        return inputs.given[table.file]
    spectrum = spectrum_files.read_spectrum(inputs.path(table.file),
                                            role=spectra.Quantity.REFLECTANCE, column=table.column)
    spectrum_files.spectrum_on_grid(spectrum, grid.FINE_GRID)
    return spectrum


def stated_scene(shoot: Shoot, inputs: Inputs,
                 view: CompleteView | None = None) -> scene_file.SceneFile | captured.BoxPhoto:
    """The scene of a photo: a file, which lies within the session folder, or a measured box.

    Parameters
    ----------
    shoot : Shoot
    inputs : Inputs
    view : CompleteView, optional
        The first by default.

    Raises
    ------
    InputError
        If the session has no scene, or it cannot be read.
    """
    if shoot.scene is None:
        raise errors.InputError(
            f"{FILE_NAME} describes regions of a flat sample and no scene; this needs "
            "a session with [scene]")
    view = view or shoot.all_views[0]
    if view.scene is None:
        return box_photo(shoot, inputs, view)
    return scene_file.read_scene(inputs.path(view.scene), inputs.bounds)


def box_photo(shoot: Shoot, inputs: Inputs, view: CompleteView | None = None) -> captured.BoxPhoto:
    """What a session with [scene.box] states of one of its photos.

    Parameters
    ----------
    shoot : Shoot
    inputs : Inputs
    view : CompleteView, optional
        The first by default.

    Raises
    ------
    InputError
        If a file cannot be read, or lies outside the session.
    """
    box, first = shoot.box, shoot.all_views[0]
    view = view or first
    assert box is not None
    box = box.model_copy(update={"chart": None})        # which stands in a scene of its own
    turned = box.turned(view.turn_deg or 0.0).lit_from(view.lamp_at_mm)
    # a view without a camera of its own was taken by the first photo's, which marked its corners
    if view.camera is None:
        camera, marked, taken = box.camera, box, first.photo_files[0]
        camera_view, table = first.name, "scene.box.camera"
    else:
        camera, marked, taken = view.camera, turned, view.photo_files[0]
        camera_view, table = view.name, f"views.{view.name}.camera"
    lens, beam = shoot.camera.lens, box.lamp.beam
    return captured.BoxPhoto(
        box=turned, camera=camera, marked=marked, taken=captured.InputFile(
            taken, inputs.path(taken)), lens=None if lens is None else read_lens(inputs.path(lens)),
        path=inputs.folder / BOX_SCENE_NAME,
        beam=None if beam is None else captured.InputFile(beam, inputs.path(beam)),
        model={} if camera.image is None else _pictures(shoot, inputs, camera.image),
        camera_view=camera_view, camera_place=f"{FILE_NAME}: {table}", model_place=COLMAP)


def _pictures(shoot: Shoot, inputs: Inputs, image: str) -> dict[str, Picture]:
    """The picture of the session's COLMAP model that is a photo, and those that tie it to the box.
    """
    assert shoot.box is not None and shoot.box.colmap is not None
    images = read_colmap(inputs.path(shoot.box.colmap.folder))
    needed = (image, *shoot.box.colmap.corners_px)
    for name in needed:
        if name not in images:
            some = ", ".join([*images][:SHOWN]) + (", ..." if len(images) > SHOWN else "")
            raise errors.InputError(f"{COLMAP}: the model has no picture {name!r}; it has {some}")
    return {name: images[name] for name in needed}


def read_chart_scene(shoot: Shoot, inputs: Inputs) -> scene_file.SceneFile | None:
    """The scene of the chart photo, where there is one."""
    if shoot.chart.scene is not None:
        return scene_file.read_scene(inputs.path(shoot.chart.scene), inputs.bounds)
    if shoot.box is None or shoot.box.chart is None:
        return None
    return scene_file.scene_of_text(box_scene.chart_xml(shoot.box, shoot.box.chart),
                         inputs.folder / CHART_SCENE_NAME, inputs.bounds)
