"""Shape of an object with the spectra of its materials, from photos around it."""
from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api import arguments, estimates
from spectrabox.api.photo import Photo, open_photo
from spectrabox.api.progress import ProgressLike, progress_steps
from spectrabox.calibrate.chart_calibration import calibration_from_curves
from spectrabox.calibrate.geometry import colmap_model, lens
from spectrabox.capture.photo import preview
from spectrabox.measure.captured import CURVES_ERROR
from spectrabox.measure.estimate import Estimate
from spectrabox.measure.signals import sample, signal_capture
from spectrabox.measure.signals.options import SampleOptions
from spectrabox.radiometry import error_model, grid, light_scale
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.interreflection import response_matrix, white_signal
from spectrabox.radiometry.records import scenes, spectra
from spectrabox.radiometry.records.calibration import Calibration, LightScale
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.radiometry.system import threads, words
from spectrabox.reconstruct.rendering.renderer import start_mitsuba, threads_given_back
from spectrabox.reconstruct.scene import edit_scene, scene_file
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.shape import mesh as meshes
from spectrabox.reconstruct.shape import paints, shape_fit
from spectrabox.reconstruct.shape import start as starts
from spectrabox.reconstruct.view import MaterialSpec, PhotoView

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OBJECT = "object"           # id of the shape in scenes
LEAST_PHOTOS = 3
SHAPE_COEFFICIENTS = 9      # of the spectrum that moves along with the shape
STEPS = tuple(stage.steps for stage in shape_fit.STAGES)
SQUARE = 1e-3               # relative difference of a camera's focal lengths in x and y
PoseLike = Path | str | Sequence[str | Path] | np.ndarray


class ShapeSpectra(estimates.SpectrumEstimates):
    """An object's closed mesh with the estimates of its materials' spectra, and the photos that it
    explains.

    Attributes
    ----------
    vertices : (V, 3) array
        In the unit of the poses.
    faces : (F, 3) int array
        Anticlockwise seen from outside.
    material_of_face : (F,) int array
        Number of each face's material, in the order of the estimates.
    photos, renderings : tuples of (H, W, K) arrays
        At the size at which they were compared, relative to white.
    disagreement : dict of (V, K) arrays by material
        Logarithm of its signal by each photo alone that tells of it, on the found shape, over that
        by all of them; its scatter over the photos is in the band as the error of the shape.
    descent : dict of (301,) arrays by material
        Reflectance at every nm as the descent left it: a starting point, without an error.
    loss_history : array
        Squared error of every step, relative to the brightest pixel.
    converged : bool
        Whether the error no longer fell when the steps ended.

    References
    ----------
    Xia et al. 2025, Sec. 4.2, Fig. 6. Motion of the mesh: Nicolet et al. 2021; gradient at the
    outline: Zhang et al. 2023. docs/results/shape.md.

    Examples
    --------
    >>> found = sb.fit_shape(["front.dng", "left.dng", "right.dng"],
    ...                      ["front.xml", "left.xml", "right.xml"], camera="Nikon 5100 (NPL)",
    ...                      light="flash.csv", white=[0.31, 0.62, 0.44])
    >>> found.to_ply("found.ply")
    >>> found["object"].plot()
    >>> found.plot_photos()
    """

    def __init__(self, estimates: Sequence[Estimate], shape: shape_fit.ShapeReconstruction,
                 material_of_face: np.ndarray, found: Sequence[scenes.Reconstruction],
                 painted: paints.PaintLabels) -> None:
        super().__init__(estimates)
        by_all = {name: starts.signal_of_photos(found, name) for name in self}
        self.disagreement = {name: apart for name, (_, _, apart) in by_all.items()}
        self.vertices, self.faces = shape.vertices, shape.faces
        self.material_of_face = material_of_face
        self.photos = tuple(one.measured for one in found)
        # rendered with what each photo tells by itself; shown with what all of them do
        self.renderings = tuple(
            one.rendered * (1 + painted.shares[number] @ np.array([
                by_all[name][0] / one.signal[one.materials.index(name)] - 1 for name in self]))
            for number, one in enumerate(found))
        self.descent = dict(zip(self, shape.spectra, strict=True))
        self.loss_history = shape.loss_history
        self.converged = shape.outcome is spectra.Outcome.CONVERGED

    @threads_given_back()
    def to_ply(self, path: str | Path) -> Path:
        """Write the whole mesh as a PLY file with smooth normals, which Mitsuba and others read.

        Parameters
        ----------
        path : path

        Returns
        -------
        Path
            Of the file.

        Raises
        ------
        EnvironmentProblem
            If the file cannot be written; an older one is left as it was.
        """
        start_mitsuba("auto")
        meshes.write_mesh(Path(path), self.vertices, self.faces)
        return Path(path)

    @threads_given_back()
    def to_mitsuba(self, path: str | Path) -> Path:
        """Write a scene to ``<include>``: a shape and a BSDF with the mean reflectance for each
        material, as XML that a stock Mitsuba 3 loads in a spectral variant.

        Parameters
        ----------
        path : path
            Of an XML file; beside it, PLY files of the same name and that of the material.

        Returns
        -------
        Path
            Of the file.

        Raises
        ------
        EnvironmentProblem
            If a file cannot be written; an older one is left as it was.
        """
        start_mitsuba("auto")
        target, nm = Path(path), self[0].nm
        files = paints.write_mesh_of_each_paint(target.with_suffix(""), self.vertices, self.faces,
                                                self.material_of_face, list(self))
        write_text_whole(target, paints.object_xml(
            files, list(self), np.array([one.mean for one in self.values()]), (nm[0], nm[-1]),
            target.parent))
        return target

    def plot_photos(self, count: int = 4) -> Figure:
        """Photos beside renderings of what was found.

        Parameters
        ----------
        count : int
            How many, evenly spread over the photos.

        Returns
        -------
        matplotlib Figure
        """
        import matplotlib.pyplot as plt

        chosen = np.unique(np.linspace(0, len(self.photos) - 1, count).round().astype(int))
        figure, axes = plt.subplots(2, len(chosen), squeeze=False, layout="constrained",
                                    figsize=(2.2 * len(chosen), 4.4))
        for column, number in enumerate(chosen):
            bright = np.percentile(self.photos[number], 99.5)
            for row, picture in enumerate((self.photos, self.renderings)):
                shown = np.clip(picture[number][..., :3] / bright, 0, 1) ** (1 / 2.2)
                axes[row, column].imshow(shown)
                axes[row, column].set(xticks=[], yticks=[])
            axes[0, column].set_title(f"photo {number + 1}", fontsize=9)
        for row, word in enumerate(("photo", "found")):
            axes[row, 0].set_ylabel(word)
        return figure


@threads_given_back()
@threads.one_blas_thread()
def fit_shape(photos: Sequence[str | Path | Photo | np.ndarray], poses: PoseLike, *,
              camera: arguments.CameraLike, light: arguments.LightLike,
              white: ArrayLike | None = None, masks: Sequence[ArrayLike] | None = None,
              start: str | Path | tuple[ArrayLike, ArrayLike | float] | None = None,
              intrinsics: ArrayLike | None = None, flash: Sequence[float] = (0.0, 0.0, 0.0),
              name: str = OBJECT, materials: Sequence[str] | None = None,
              steps: Sequence[int] = STEPS, width: int = 48,
              light_error: float = 0.0, sensitivity_error: float = 0.0,
              draws: int = SampleOptions.samples, seed: int = 1, device: str = "auto",
              checkpoint: str | Path | None = None, progress: ProgressLike = None) -> ShapeSpectra:
    """Shape and spectra of one matt object of one or several materials, from photos around it.

    A mesh is moved towards the photos by descent through Mitsuba, coarse to fine; then the spectra
    behind all photos together are estimated on the found shape.

    Parameters
    ----------
    photos : sequence of V paths, Photo or (H, W, K) arrays
        Three or more that show the whole object on a black ground, or with ``masks``; linear,
        developed alike.
    poses : sequence of V paths, folder, or (V, 4, 4) array
        A Mitsuba scene for each photo, with camera, lights and a shape with the id "object"; or the
        folder of a COLMAP model in text form that knows the photos by their file names; or matrices
        from world to camera (x right, y down, z ahead), with ``intrinsics``.
    camera : name, path, CameraEstimate, Calibration or (nm, curves)
    light : path, name, (nm, values) or Spectrum
        Of the flash, or of the strongest light of the scenes.
    white : (K,) or (V, K) array, optional
        What a perfect white card reads in the middle of the object's bounding box, turned to the
        light, in the first photo; 1 by default. In the others the lamp is as strong, in the place
        that their poses give it, and exposures that the files state are allowed for. Or a row for
        each photo.
    masks : sequence of V (H, W) arrays, optional
        Where each photo shows the object: bool, or the share of each pixel, 0 to 1; with
        ``materials`` label images.
    start : path, (vertices, faces) or (centre, radius), optional
        A closed mesh to start from, in place, as PLY or arrays; or a sphere. By default a sphere of
        the place and size of the silhouettes.
    intrinsics : (3, 3) array, optional
        Of poses that are matrices: the camera matrix in pixels of the photos, without distortion.
    flash : (3,) sequence
        Of poses that are no scenes: where the one small lamp is, in the camera's axes and the unit
        of the poses.
    name : str
        Of the object of one material, in the result.
    materials : sequence of str, optional
        Names of the materials of an object that has several. The masks then are label images: 0
        the ground, 1 where a photo shows the first of these, 2 the second. A face of the mesh has
        the material that most pixels of all photos find on it.
    steps : sequence of int
        Of the three stages: as the start mesh is; each triangle cut into four; less stiff. Fewer
        numbers leave out the later stages.
    width : int
        Of the pictures that are compared, in pixels.
    light_error, sensitivity_error : float
        Relative standard errors of the light's strength (of ``white``) and of each curve.
    draws, seed : int
        T spectra behind the band, and the seed of paths and draws.
    device : {"auto", "cpu", "cuda"}
    checkpoint : path, optional
        File (.npz) that takes the mesh of every finished stage. A fit that was stopped goes on from
        there when it is asked for again with the same photos, poses, start and seed, and ends with
        the same numbers; more stages may be asked for. The file stays.
    progress : bool or function, optional
        As of `reconstruct_scene`.

    Returns
    -------
    ShapeSpectra

    Raises
    ------
    InputError
        If photos and poses do not fit, the ground is bright, the start mesh is not closed, or
        fewer than two photos tell of a material.
    EnvironmentProblem
        If there is no LLVM, or no GPU that was asked for.
    ConvergenceError
        If there are too few draws for the band.

    References
    ----------
    Xia et al. 2025, Sec. 4.2, Fig. 6, which starts from a black sphere and has no outline gradient
    of its own: docs/results/shape.md.

    Examples
    --------
    >>> found = sb.fit_shape(["front.dng", "left.dng", "right.dng"], "colmap", flash=(0.2, 0, 0),
    ...                      camera="Nikon 5100 (NPL)", light="flash.csv",
    ...                      white=[0.31, 0.62, 0.44])
    >>> found.vertices, found["object"].mean, found["object"].band()
    """
    if len(photos) < LEAST_PHOTOS:
        raise InputError(f"{len(photos)} photos were given; a shape needs at least {LEAST_PHOTOS} "
                         "from around it, better ten or more")
    if masks is not None and len(masks) != len(photos):
        raise InputError(f"{len(masks)} masks were given for {len(photos)} photos; give one each")
    names, labels = _materials(materials, masks, name)
    if not 1 <= len(steps) <= len(STEPS) or min(steps) < 1:
        raise InputError(f"steps is one to {len(STEPS)} positive numbers, one a stage; {steps!r} "
                         "was given")
    opened = [one if isinstance(one, Photo) else open_photo(one, orientation=preview.AS_READ)
              for one in photos]
    start_mitsuba(device)
    shown = _scenes(photos, opened, poses, intrinsics, np.asarray(flash, dtype=float))
    stages = tuple(replace(stage, steps=count)
                   for stage, count in zip(shape_fit.STAGES, steps, strict=False))
    spectrum = arguments.as_spectrum(light)
    calibration = _relative_to_white(calibration_from_curves(
        grid.FINE_GRID, arguments.as_curves(camera), spectrum, CURVES_ERROR))
    views = _views(opened, shown, calibration, white, [own > 0 for own in labels] or masks, width)
    painted = _painted(names, labels, views)
    vertices, faces, middle = _start_mesh(start, views)
    same_lamp = np.ndim(white) < 2      # type: ignore[arg-type]
    views = _lit(views, middle, same_lamp)
    with progress_steps(progress, "shape") as show:
        found = shape_fit.reconstruct_shape(
            views, OBJECT, vertices, faces, painted, stages,
            InversionSettings(SHAPE_COEFFICIENTS, seed=seed),
            lambda share, message: show(0.9 * share, message),
            None if checkpoint is None else Path(checkpoint))
        middle = (found.vertices.min(axis=0) + found.vertices.max(axis=0)) / 2
        material_of_face, on_mesh = shape_fit.on_mesh(
            _lit(views, middle, same_lamp), OBJECT, found.vertices, found.faces, painted,
            found.spectra, InversionSettings(seed=seed, engine="transport", errors_from_scene=False,
                              spectrum_prior="smooth"),
            lambda share, message: show(0.9 + 0.1 * share, message))
    response = arguments.relative_response(camera, spectrum)
    estimates = [_estimate(one, on_mesh, response, light_error, sensitivity_error,
                           SampleOptions(samples=draws, seed=seed)) for one in painted.names]
    return ShapeSpectra(estimates, found, material_of_face, on_mesh, painted)


def _materials(materials: Sequence[str] | None, masks: Sequence[ArrayLike] | None,
               name: str) -> tuple[tuple[str, ...], tuple[np.ndarray, ...]]:
    """Names of the object's materials, and label images of the photos if there may be several."""
    if materials is None:
        return (name,), ()
    names = tuple(materials)
    if isinstance(materials, str) or not names or len(set(names)) < len(names) \
            or words.sharing_a_file(names):
        raise InputError(f"materials={materials!r} was given; give a list of different names, such "
                         "as materials=[\"red paint\", \"blue paint\"]")
    if masks is None:
        raise InputError(f"materials= names {', '.join(names)}, and nothing tells where they are: "
                         "give masks=, a label image (height, width) for each photo, with 0 for "
                         f"the ground and 1 to {len(names)} for the materials in this order")
    return names, tuple(paints.label_image(np.asarray(mask), names, f"photo {number}")
                        for number, mask in enumerate(masks, start=1))


def _painted(names: tuple[str, ...], labels: tuple[np.ndarray, ...],
             views: Sequence[PhotoView]) -> paints.PaintLabels:
    """Where the views show the materials; each is shown by two photos or more."""
    if not labels:
        return paints.PaintLabels(names, tuple(np.ones((*view.size[::-1], 1)) for view in views))
    shares = []
    for view, own in zip(views, labels, strict=True):
        across, down = (preview.area_weights(source, target) for source, target
                        in zip(own.shape[::-1], view.size, strict=True))
        shares.append(np.stack([down @ (own == number + 1) @ across.T
                                for number in range(len(names))], axis=2))
    paints.telling_photos(np.array([(share > paints.PURE).sum(axis=(0, 1)) for share in shares]),
                          names)
    return paints.PaintLabels(names, tuple(shares), labels)


def _relative_to_white(calibration: Calibration) -> Calibration:
    """The camera with each band's curve divided by what it reads of a white under the light."""
    fit = calibration.sensitivity
    light = spectrum_on_grid(calibration.light, fit.grid)
    white = white_signal(response_matrix(fit.grid, fit.curves, light))
    return replace(calibration, sensitivity=replace(fit, curves=fit.curves / white[:, None]))


# ---- cameras and lamps ---------------------------------------------------------------------------

def _scenes(photos: Sequence[object], opened: Sequence[Photo], poses: PoseLike,
            intrinsics: ArrayLike | None, flash: np.ndarray) -> list[scene_file.SceneFile]:
    """A scene for each photo: camera, light, and a shape with the id ``OBJECT``."""
    if isinstance(poses, np.ndarray):
        return [_scene_of_pose(each, pose, flash, f"pose {number}") for number, (each, pose)
                in enumerate(_posed(opened, poses, intrinsics), start=1)]
    if intrinsics is not None:
        raise InputError("intrinsics= belongs to poses that are matrices; scenes and COLMAP's "
                         "models state their own")
    if isinstance(poses, str | Path):
        images = colmap_model.read_colmap(Path(poses))
        scenes = []
        for given, photo in zip(photos, opened, strict=True):
            if isinstance(given, np.ndarray):
                raise InputError("an array has no file name, by which COLMAP knows its pictures; "
                                 "give paths or photos of open_photo")
            # a developed photo may have another name than the one that it was developed from
            source = Path(photo.image.source)
            name = Path(given).name if isinstance(given, str | Path) else source.name
            picture = next((one for word in (Path(name), source) for key, one in images.items()
                            if word.stem == Path(key).stem), None)
            if picture is None:
                raise InputError(f"the COLMAP model in {poses} knows no picture {name}; it knows "
                                 f"{', '.join(list(images)[:5])} ...")
            height, width = photo.signal.shape[:2]
            own_lens, pose = picture
            own = colmap_model.for_photo(own_lens, width, height, name)
            scenes.append(_scene_of_pose(own, pose, flash, name))
        return scenes
    if len(poses) != len(photos):
        raise InputError(f"{len(poses)} poses were given for {len(photos)} photos; give one each")
    scenes = [scene_file.read_scene(Path(pose)) for pose in poses]
    for scene in scenes:
        if list(scene.surfaces) != [OBJECT]:
            raise InputError(f"{scene.path.name} holds {', '.join(scene.surfaces) or 'no shape'}; "
                             f"besides lights one shape with the id {OBJECT!r} is needed, such as "
                             "a sphere: other surfaces are not taken into account yet")
    return scenes


def _posed(opened: Sequence[Photo], poses: np.ndarray,
           intrinsics: ArrayLike | None) -> list[tuple[lens.Lens, np.ndarray]]:
    if intrinsics is None:
        raise InputError("poses that are matrices need intrinsics=, the camera matrix (3, 3)")
    matrix = arguments.as_numbers(intrinsics, "intrinsics")
    if matrix.shape != (3, 3) or poses.shape != (len(opened), 4, 4):
        raise InputError(f"poses of shape {poses.shape} and intrinsics of shape {matrix.shape} "
                         f"were given; ({len(opened)}, 4, 4) and (3, 3) are needed")
    rotation = poses[:, :3, :3]
    if not np.allclose(rotation @ rotation.swapaxes(1, 2), np.eye(3), atol=1e-3) or np.any(
            np.linalg.det(rotation) < 0):
        raise InputError("poses are matrices from world to camera, [[R, t], [0, 1]]; a rotation R "
                         "among these is none")
    return [(lens.Lens(photo.signal.shape[1], photo.signal.shape[0], matrix, np.zeros(5),
                       np.zeros(4), np.zeros(5), 0.0, "given"), pose)
            for photo, pose in zip(opened, poses, strict=True)]


def _scene_of_pose(own: lens.Lens, world_to_camera: np.ndarray, flash: np.ndarray,
                   name: str) -> scene_file.SceneFile:
    """A scene with this camera, a small lamp beside it, and a ball that is replaced."""
    if np.any(own.distortion != 0):
        raise InputError(f"the lens of {name} is distorted; undistort the photos first (colmap "
                         "image_undistorter), and give the model of those")
    if abs(own.matrix[0, 0] / own.matrix[1, 1] - 1) > SQUARE:
        raise InputError(f"the focal lengths of {name} in x and y differ: {own.matrix[0, 0]:g} and "
                         f"{own.matrix[1, 1]:g} pixels; square pixels are needed")
    pose = lens.Pose(world_to_camera, np.zeros((6, 6)), np.zeros((0, 2)), 0.0)
    place = (np.linalg.inv(world_to_camera) @ [*flash, 1.0])[:3]
    root = ET.Element("scene", version="3.0.0")
    integrator = ET.SubElement(root, "integrator", type="path")
    ET.SubElement(integrator, "integer", name="max_depth", value="4")
    sensor = ET.SubElement(root, "sensor", type="perspective")
    sensor.extend(edit_scene.camera_nodes(lens.mitsuba_sensor(own, pose)))
    film = ET.SubElement(sensor, "film", type="hdrfilm")
    for side, pixels in (("width", own.width), ("height", own.height)):
        ET.SubElement(film, "integer", name=side, value=str(pixels))
    emitter = ET.SubElement(root, "emitter", type="point", id="flash")
    ET.SubElement(emitter, "point", name="position", value=", ".join(f"{each:.9g}"
                                                                     for each in place))
    ET.SubElement(emitter, "spectrum", name="intensity", value="1.0")
    bsdf = ET.SubElement(root, "bsdf", type="diffuse", id="paint")
    ET.SubElement(bsdf, "spectrum", name="reflectance", value="0.5")
    shape = ET.SubElement(root, "shape", type="sphere", id=OBJECT)
    ET.SubElement(shape, "ref", id="paint")
    return scene_file.scene_of_text(ET.tostring(root, encoding="unicode"), Path(f"{name}.xml"))


# ---- photos --------------------------------------------------------------------------------------

def _views(opened: Sequence[Photo], scenes: Sequence[scene_file.SceneFile],
           calibration: Calibration, white: ArrayLike | None, masks: Sequence[ArrayLike] | None,
           width: int) -> list[PhotoView]:
    """The photos relative to white, on black, at the size that is compared."""
    bands = len(calibration.sensitivity.curves)
    whites = np.ones(bands) if white is None else arguments.as_numbers(white, "white")
    if whites.shape not in ((bands,), (len(opened), bands)) or np.any(whites <= 0):
        raise InputError(f"white of shape {whites.shape} was given; positive numbers are needed, "
                         f"one a band ({bands},) or a row for each photo ({len(opened)}, {bands})")
    views = []
    for number, (photo, scene) in enumerate(zip(opened, scenes, strict=True)):
        image, name = photo.image, f"photo {number + 1}"
        if photo.bands != bands:
            raise InputError(f"{name} has {photo.bands} bands and the camera {bands}")
        own = whites[number] if whites.ndim == 2 else whites
        if whites.ndim == 1 and image.exposure_s is not None:
            own = own * light_scale.exposure_ratio(opened[0].image, image)
        if masks is not None:
            image = starts.cut_out(image, np.asarray(masks[number]), name)
        image = preview.bin_image(image, *preview.render_size(
            image.signal.shape[1], image.signal.shape[0], width))
        image = replace(image, signal=(image.signal / own).astype(np.float32),
                        variance=(image.variance / own**2).astype(np.float32))
        scene_file.require_same_shape(photo.image, scene, name)
        view = PhotoView(name, scene, image, calibration, tuple(f"band {band + 1}" for band
                                                                in range(bands)),
                         (MaterialSpec(OBJECT, scene.surfaces[OBJECT]),))
        views.append(view)
    return views


def _start_mesh(start: str | Path | tuple[ArrayLike, ArrayLike | float] | None,
                views: Sequence[PhotoView]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, faces and middle (3,) of the mesh to start from."""
    silhouettes = [starts.object_pixels(view.photo, view.name) for view in views]
    if start is None:
        middle, radius = starts.sphere_of_silhouettes(
            [(view.scene(), shown) for view, shown in zip(views, silhouettes, strict=True)])
        return (*shape_fit.sphere(middle, radius), middle)
    if isinstance(start, str | Path):
        vertices, faces = starts.read_closed_mesh(Path(start))
    elif np.ndim(start[1]) == 0:
        middle = arguments.as_numbers(start[0], "start")
        radius = float(np.asarray(start[1]))
        if middle.shape != (3,) or not radius > 0:
            raise InputError("a sphere to start from is its centre (x, y, z) and its radius; "
                             f"{start!r} was given")
        return (*shape_fit.sphere(middle, radius), middle)
    else:
        vertices, faces = starts.closed_mesh(np.asarray(start[0], dtype=float),
                                             np.asarray(start[1]), "start")
    return vertices, faces, (vertices.min(axis=0) + vertices.max(axis=0)) / 2


def _lit(views: Sequence[PhotoView], middle: np.ndarray, same_lamp: bool) -> list[PhotoView]:
    """The views with their light scale, by a white card in the object's middle: in the first photo,
    or in each.
    """
    light = [starts.light_on_card(view.scene_file, middle) for view in views]
    if same_lamp:
        light = light[:1] * len(light)
    return [replace(view, light_scale=LightScale(float(np.pi / own), None, None, "white"))
            for view, own in zip(views, light, strict=True)]


# ---- the spectrum --------------------------------------------------------------------------------

def _estimate(name: str, found: Sequence[scenes.Reconstruction], response: np.ndarray,
              light_error: float, sensitivity_error: float, options: SampleOptions) -> Estimate:
    """The estimate of a material's spectrum; the error of the shape is among those of the signal.
    """
    signal, noise, apart = starts.signal_of_photos(found, name)
    causes = error_model.stated_causes(signal, noise, light_error, sensitivity_error)
    causes[error_model.DISAGREEMENT] = error_model.proportional_covariance(
        signal, np.cov(apart, rowvar=False))
    capture = signal_capture.SignalCapture(response, signal[None], (name,), np.ones(signal.size),
                                           np.sqrt(np.diagonal(noise)), light_error,
                                           sensitivity_error)
    base = spectra.SpectralMeasurement(grid.FINE_GRID, response, signal, noise)
    return sample.estimate_from_draws(name, base, causes, options, capture)
