"""The spectrum behind every pixel of an image."""
from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api.arguments import (
    CameraLike,
    LightLike,
    as_prior,
    families_of,
    one_blas_thread,
    relative_response,
)
from spectrabox.api.photo import Photo
from spectrabox.api.progress import ProgressLike, progress_steps
from spectrabox.measure.pictures.photo_white import photo_white
from spectrabox.measure.pictures.uplift import require_bands, uplift_image
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture


@one_blas_thread
def uplift(image: ArrayLike | Photo, *, camera: CameraLike,
           light: LightLike, noise: float = 0.01, white: ArrayLike | None = None,
           families: str | list[str] | None = None, prior: str | Path | LogitMixture | None = None,
           progress: ProgressLike = None) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of the reflectance behind every pixel.

    Parameters
    ----------
    image : (H, W, K) array or Photo
        Linear signal.
    camera : name, path, CameraEstimate, or (nm, curves)
    light : name, path, (nm, values) or Spectrum
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
        done. By default a bar is shown in notebooks.

    Returns
    -------
    mean, standard_deviation : (H, W, P) arrays
        At 400, 405 ... 700 nm.

    Raises
    ------
    InputError
        If image and camera have other bands, or the image has no pixel; if a raw photo shows no
        chart and ``white`` is not given; if more than 5 % of the pixels are brighter than white.

    References
    ----------
    The posterior of one signal, for each pixel: docs/explanation/sampling.md. Not in Xia et al.
    2025.

    Examples
    --------
    >>> import numpy as np
    >>> image = np.full((4, 6, 3), 0.3)
    >>> mean, deviation = sb.uplift(image, camera="Nikon 5100 (NPL)", light="D65")
    """
    pixels = image.signal if isinstance(image, Photo) else np.asarray(image, dtype=float)
    if pixels.ndim != 3 or not pixels.size:
        raise InputError(f"an image of shape {pixels.shape} was given; give (height, width, bands) "
                         "with one pixel or more")
    fine_response = relative_response(camera, light)
    response = fine_response @ interpolation_matrix(PRIOR_GRID.nm, FINE_GRID.nm)
    require_bands(pixels.shape[2], response)
    if white is None and isinstance(image, Photo):
        white = photo_white(image.image, fine_response, "Give white=, what a perfect white reads "
                            "in each band")
    with progress_steps(progress, "uplift") as step:
        return uplift_image(pixels, response, as_prior(prior, families_of(families)), noise,
                            white=None if white is None else np.asarray(white, dtype=float),
                            progress=lambda share: step(share, "tables"))
