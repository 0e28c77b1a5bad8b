"""A photo as a person sees its samples in daylight: signals relative to white, as sRGB.

Swatches are of estimated spectra under D65. A photo that stands beside them is taken to the same
colours: each pixel is divided by what white reads there (``regions.white``), then goes through a
transform that is fitted to surfaces of the prior as this camera sees them under this light. Before
there is a calibration the camera's own matrix gives colours near them.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from spectrabox.calibrate import colour_profile as transforms
from spectrabox.capture.photo import preview
from spectrabox.measure.pictures.crop import crop_of, node_grid
from spectrabox.measure.profiles import colour_profile
from spectrabox.measure.regions import white as whites
from spectrabox.radiometry import appearance, interreflection, profile_files
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records import calibration, photos
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.sampling.prior import mixture

LIGHT = "D65"
SURFACES = 3000             # of the prior, that the transform is fitted to
COLUMNS = 24                # of the nodes at which the light is computed
BRIGHTEST = 99              # percentile of a photo of a scene that is shown as white
DARKEST = 1e-6              # of white: below, roots of a signal are those of this
BANDS = 3                   # of a camera whose photos have colours of their own


@dataclass(frozen=True, eq=False)
class PhotoLook:
    """How signals of one photo become a picture in sRGB."""

    exponents: np.ndarray       # (E, 3) of R, G and B in each term
    to_rgb: np.ndarray          # (3, E) from terms to linear sRGB
    white: np.ndarray           # (3,) signal of white where the light is that of the chart
    glare: np.ndarray           # (3,) signal
    nodes_px: tuple[np.ndarray, np.ndarray]     # x (X,) and y (Y,) in pixels of the photo
    log_light: np.ndarray       # (Y, X) logarithm of the light there

    def linear(self, signal: np.ndarray, x_px: np.ndarray, y_px: np.ndarray) -> np.ndarray:
        """Linear sRGB (h, w, 3), 1 for white, of a part of the photo.

        Parameters
        ----------
        signal : (h, w, 3) array
        x_px, y_px : (w,) and (h,) arrays
            Where its pixels lie, in pixels of the photo.
        """
        across, down = (interpolation_matrix(nodes, np.clip(at, nodes[0], nodes[-1]))
                        for nodes, at in zip(self.nodes_px, (x_px, y_px), strict=True))
        light = np.exp(down @ self.log_light @ across.T).astype(np.float32)
        relative = (signal - self.glare.astype(np.float32)) / (
            self.white.astype(np.float32) * light[..., None])
        terms = [relative]
        if len(self.exponents) > BANDS:     # by logarithms: a quarter of the time of powers
            logs = np.log(np.maximum(relative, DARKEST))
            terms.append(np.exp(logs @ self.exponents[BANDS:].T.astype(np.float32)))
        return np.concatenate(terms, axis=-1) @ self.to_rgb.T.astype(np.float32)

    def rgb8(self, signal: np.ndarray, x_px: np.ndarray, y_px: np.ndarray) -> np.ndarray:
        """The same as a picture (h, w, 3) uint8, encoded for the screen."""
        return preview.linear_rgb8(self.linear(signal, x_px, y_px))


def calibrated_look(photo: whites.FlatPhoto, known: Mapping[str, np.ndarray],
                    errors: whites.FlatErrors) -> PhotoLook | None:
    """A photo of flat samples in the colours that its calibration gives; None of a camera of other
    than three bands, or where one of them can hardly be read.

    Parameters
    ----------
    photo : FlatPhoto
        With or without regions.
    known : mapping
        From the names of regions to their known reflectances (P,).
    errors : FlatErrors

    Raises
    ------
    InputError
        As ``regions.white.white_by_chart``.
    """
    if len(photo.white.level) != BANDS or photo.lost_bands.any():
        return None
    samples = photo.samples or _no_regions(len(photo.white.level))
    photo = dataclasses.replace(photo, samples=samples)
    crop = crop_of(photo.image, None)
    nodes_px, _ = node_grid(crop, COLUMNS)
    white = whites.white_at_regions(photo, known, errors, nodes_px)
    assert white is not None, "samples may be none, and are given"
    x_px, y_px = np.unique(nodes_px[:, 0]), np.unique(nodes_px[:, 1])
    log_light = white.log_field[len(samples.names):].reshape(len(y_px), len(x_px))
    of_chart = white.exposure * white.level * np.exp(
        white.mean[white.level_part] + white.mean[white.exposure_part].sum())
    transform = daylight_transform(photo.calibration)
    return PhotoLook(transform.exponents, _to_rgb(transform), of_chart,
                     white.glare + white.mean[white.glare_part], (x_px, y_px), log_light)


def camera_look(camera_from_xyz: np.ndarray | None, white: tuple[float, ...]) -> PhotoLook | None:
    """A photo that is not calibrated, by the camera's own matrix; None where none is known.

    Parameters
    ----------
    camera_from_xyz : (3, 3) array or None
        From X, Y, Z to R, G, B in daylight, of any scale.
    white : tuple of float
        What is shown as white, of each band.
    """
    if camera_from_xyz is None or len(white) != BANDS:
        return None
    return _under_even_light(transforms.stated_transform(camera_from_xyz), np.array(white))


def scene_look(calibration: calibration.Calibration, signal: np.ndarray) -> PhotoLook | None:
    """A photo of a scene, whose light is another everywhere, in the colours that its calibration
    gives, as bright as its brightest part allows; None of a camera of other than three bands.

    Parameters
    ----------
    calibration : Calibration
    signal : (H, W, K) array
        Of the photo, at any size.
    """
    if signal.shape[2] != BANDS:
        return None
    of_light = interreflection.white_signal(interreflection.response_matrix(
        calibration.sensitivity.grid, calibration.sensitivity.curves,
        spectrum_on_grid(calibration.light, calibration.sensitivity.grid)))
    look = _under_even_light(daylight_transform(calibration), of_light)
    height, width = signal.shape[:2]
    linear = look.linear(np.nan_to_num(signal), np.arange(width), np.arange(height))
    # terms of a transform are of degree 1: of a light so much brighter all colours are as much less
    brightest = max(float(np.percentile(linear, BRIGHTEST)), DARKEST)
    return dataclasses.replace(look, white=of_light * brightest)


def _under_even_light(transform: transforms.ColourTransform, white: np.ndarray) -> PhotoLook:
    everywhere = np.array([0.0, 1.0])
    return PhotoLook(transform.exponents, _to_rgb(transform), white, np.zeros(BANDS),
                     (everywhere, everywhere), np.zeros((2, 2)))


def daylight_transform(calibration: calibration.Calibration) -> transforms.ColourTransform:
    """From signals relative to white to the colours that surfaces of the prior have under D65.

    These are X, Y, Z adapted to D50 by Bradford, as colour spaces of pictures are defined.

    Parameters
    ----------
    calibration : Calibration
        Of a camera of three bands.

    Raises
    ------
    CalibrationError
        If its bands are too alike.
    """
    grid = calibration.sensitivity.grid
    response = interreflection.relative_response(calibration, grid) @ interpolation_matrix(
        mixture.PRIOR_GRID.nm, grid.nm)
    surfaces = mixture.drawn_reflectances(mixture.load_prior(), SURFACES)
    weights = appearance.tristimulus_weights(mixture.PRIOR_GRID.nm, LIGHT)
    xyz = surfaces @ weights.T @ appearance.adaptation(
        weights.sum(axis=1), transforms.D50).T
    relative = response / response.sum(axis=1, keepdims=True)
    return transforms.transform_of_signals(surfaces @ relative.T, xyz, colour_profile.TABLE_DEGREE)


def look_of_image(look: PhotoLook, image: photos.LinearImage, factor: int = 1) -> np.ndarray:
    """A whole photo as a picture (h, w, 3) uint8, each pixel the mean of ``factor`` squared.

    Parameters
    ----------
    look : PhotoLook
    image : LinearImage
    factor : int
    """
    height, width = (size // factor for size in image.signal.shape[:2])
    signal = image.signal[:height * factor, :width * factor].reshape(
        height, factor, width, factor, -1).mean(axis=(1, 3))
    x_px, y_px = (((np.arange(count) + 0.5) * factor) * image.sensor_step - 0.5
                  for count in (width, height))
    return look.rgb8(signal, x_px, y_px)


def _to_rgb(transform: transforms.ColourTransform) -> np.ndarray:
    to_xyz = profile_files.TO_XYZ[profile_files.SRGB]
    return np.asarray(np.linalg.solve(to_xyz, transform.coefficients))


def _no_regions(bands: int) -> photos.RegionSamples:
    return photos.RegionSamples((), np.empty((0, bands)), np.empty((0, bands, bands)),
                                np.empty(0, int), np.empty((0, bands)), np.empty((0, 1, 2)))
