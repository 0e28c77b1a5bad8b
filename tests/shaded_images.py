"""Images of a few surfaces under light that falls off, shared by the tests of their spectra."""
import numpy as np
import OpenImageIO as oiio
from sampling_cameras import surface

from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.session.signals.signal_options import response_of_names

CAMERA, LIGHT = "Nikon 5100 (NPL)", "D65"


def shaded_image(height, width, seed=0):
    """Signals (H, W, 3) relative to white, exact in half floats."""
    matrix = response_of_names(CAMERA, LIGHT)
    surfaces = np.array([matrix @ surface(PRIOR_GRID.nm, seed + each) for each in range(6)])
    shade = np.linspace(0.5, 1, height)[:, None, None]
    return (surfaces[np.arange(width) % 6] * shade).astype(np.float16).astype(np.float32)


def write_image(path, image, tile=None, kind="half"):
    """A TIFF or EXR of scan lines, or of tiles (height, width)."""
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, kind)
    if tile:
        spec.tile_height, spec.tile_width = tile
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec)
    assert file.write_image(image.astype(np.float32)) and file.close()
    return path
