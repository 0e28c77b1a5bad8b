"""The spectrum behind every pixel of an image."""
from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api import arguments, signals
from spectrabox.api.photo import Photo, open_photo
from spectrabox.api.progress import ProgressLike, progress_steps
from spectrabox.capture.photo.image_files import read_encoded_values
from spectrabox.measure import texts
from spectrabox.measure.pictures.photo_white import photo_white, require_camera_signal
from spectrabox.measure.pictures.uplift import PixelSpectra, require_bands, uplift_image
from spectrabox.measure.signals.options import PIXEL_NOISE
from spectrabox.radiometry import appearance, findings, grid
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.threads import one_blas_thread
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture


@one_blas_thread()
def uplift(image: ArrayLike | Photo | str | Path, *, camera: arguments.CameraLike | None = None,
           light: arguments.LightLike | None = None, encoded: bool = False,
           noise: float = PIXEL_NOISE, white: ArrayLike | None = None,
           families: str | list[str] | None = None, prior: str | Path | LogitMixture | None = None,
           progress: ProgressLike = None) -> PixelSpectra:
    """Mean and standard deviation of the reflectance behind every pixel, and how far it is from the
    pixel's colour.

    Parameters
    ----------
    image : (H, W, K) array, Photo or path
        Linear signal.
    camera : name, path, CameraEstimate, or (nm, curves)
    light : name, path, (nm, values) or Spectrum
    encoded : bool
        In place of camera and light: the image is in sRGB, a PNG or JPEG, or an array of its code
        values, integers or 0 to 1. The spectra are of surfaces that would look so in daylight, not
        of what was photographed.
    noise : float
        Relative standard error of every band.
    white : (K,) array, optional
        What a perfect white reads. Of a Photo, as a ColorChecker in it tells by default; of an
        array, which is taken as relative to white, 1.
    families : str or list of str, optional
        What the surfaces are: paint, textile, leaves, skin, white, earth, animal.
    prior : path or LogitMixture, optional
        On reflectances; the shipped one by default.
    progress : bool or function, optional
        True shows a bar; a function is called with the share that is done, and what is being
        done. By default a bar is shown in notebooks and on terminals.

    Returns
    -------
    PixelSpectra
        ``mean`` and ``standard_deviation`` (H, W, P) at 400, 405 ... 700 nm, which it unpacks to,
        and ``delta_e00`` (H, W).

    Raises
    ------
    InputError
        If image and camera have other bands, or the image has no pixel; if a raw photo shows no
        chart and ``white`` is not given; if more than 5 % of the pixels are brighter than white;
        if camera, light or white are given with ``encoded``, or camera or light not without it.
    CheckError
        If a chart that white is taken from is more than 10 % (rms over its patches) off what camera
        and light predict; above 4 % a warning says so.

    References
    ----------
    The posterior of one signal, for each pixel: docs/explanation/sampling.md. Not in Xia et al.
    2025.

    Examples
    --------
    >>> import numpy as np
    >>> image = np.full((4, 6, 3), 0.3)
    >>> mean, deviation = sb.uplift(image, camera="Nikon 5100 (NPL)", light="D65")
    >>> float(sb.uplift(image, camera="Nikon 5100 (NPL)", light="D65").delta_e00.max()) < 0.5
    True
    """
    if encoded:
        if camera is not None or light is not None or white is not None:
            raise InputError("an image in sRGB is what the CIE observer sees under D65; leave "
                             "camera, light and white out")
        image, camera, light = appearance.signal_of_srgb(
            _code_values(image)), signals.OBSERVER, "D65"
    elif isinstance(image, str | Path):
        image = open_photo(image)
    if camera is None or light is None:
        raise InputError("pixels need the camera that saw them and their light (camera=, light=); "
                         "a PNG or JPEG in sRGB is given with encoded=True")
    pixels = image.signal if isinstance(image, Photo) else arguments.as_numbers(image, "image")
    if pixels.ndim != 3 or not pixels.size:
        raise InputError(f"an image of shape {pixels.shape} was given; give (height, width, bands) "
                         "with one pixel or more")
    if not np.all(np.isfinite(pixels)):
        raise InputError("the image holds numbers that are not finite; put 0 in place of them")
    fine_response = arguments.relative_response(camera, light)
    response = fine_response @ grid.interpolation_matrix(PRIOR_GRID.nm, grid.FINE_GRID.nm)
    require_bands(pixels.shape[2], response)
    if isinstance(image, Photo):
        require_camera_signal(image.image.kind, image.image.source)
        if white is None:
            chart = photo_white(image.image, fine_response, "Give white=, what a perfect white "
                                "reads in each band")
            if chart is not None:
                white, finding = chart
                for doubt in findings.faults([finding]):
                    warnings.warn(texts.says(doubt), stacklevel=3)
    with progress_steps(progress, "uplift") as step:
        return uplift_image(pixels, response,
                            arguments.as_prior(prior, arguments.families_of(families)),
                            arguments.as_number(noise, "noise"),
                            white=None if white is None else arguments.as_numbers(white, "white"),
                            encoded=encoded, progress=lambda share: step(share, "tables"))


def _code_values(image: ArrayLike | Photo | str | Path) -> np.ndarray:
    """Code values (H, W, 3) of sRGB, 0 to 1."""
    if isinstance(image, str | Path):
        return read_encoded_values(image)
    if isinstance(image, Photo):
        raise InputError("a photo that is open holds linear values; give the file of a picture in "
                         "sRGB, or its code values")
    values, _ = arguments.as_code_values(image, "image")
    if values.ndim != 3:
        raise InputError(f"sRGB code values of shape {values.shape} were given; give (height, "
                         "width, 3)")
    return values
