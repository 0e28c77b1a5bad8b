"""A spectral EXR as a texture of Mitsuba, whose own ``bitmap`` knows three channels alone.

    from spectrabox.reconstruct.rendering.spectral_texture import register_spectral_texture
    register_spectral_texture()     # after mi.set_variant("llvm_ad_spectral"), or cuda
    mi.load_dict({"type": "diffuse", "reflectance": {"type": "spectral_picture",
                                                     "filename": "uplifted/mean.exr"}})

Pixels are the nearest, wavelengths interpolated; outside those of the file its ends are held.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.spectral_layers import REFLECTANCE, spectral_layers

NAME = "spectral_picture"


def register_spectral_texture() -> None:
    """Make the texture known to Mitsuba under ``spectral_picture``; its variant is set before."""
    import drjit as dr
    import mitsuba as mi

    texture: Any = mi.Texture

    class SpectralPicture(texture):
        """Reflectance of a spectral EXR at a surface's texture coordinates."""

        def __init__(self, properties: Any) -> None:
            texture.__init__(self, properties)
            pixels, nm = _read(properties["filename"])
            self.height, self.width, self.count = pixels.shape
            self.first, self.step = float(nm[0]), float(nm[1] - nm[0])
            self.values = mi.Float(np.ascontiguousarray(pixels.ravel(), dtype=np.float32))

        def eval(self, si: Any, active: bool = True) -> Any:
            """Reflectance at the wavelengths of a ray."""
            column = dr.clip(mi.Int32(dr.floor(si.uv.x * self.width)), 0, self.width - 1)
            # v runs upwards, rows downwards
            row = dr.clip(mi.Int32(dr.floor((1 - si.uv.y) * self.height)), 0, self.height - 1)
            start = (row * self.width + column) * self.count
            reflectance = []
            for wavelength in si.wavelengths:
                position = dr.clip((wavelength - self.first) / self.step, 0, self.count - 1)
                below = dr.minimum(mi.Int32(dr.floor(position)), self.count - 2)
                low = dr.gather(mi.Float, self.values, start + below, active)
                high = dr.gather(mi.Float, self.values, start + below + 1, active)
                reflectance.append(dr.lerp(low, high, position - below))
            return mi.UnpolarizedSpectrum(reflectance)

        def mean(self) -> Any:
            """Mean over picture and wavelengths."""
            return dr.mean(self.values)

        def is_spatially_varying(self) -> bool:
            """Whether it differs over a surface."""
            return True

        def to_string(self) -> str:
            """As Mitsuba prints it."""
            return f"SpectralPicture[{self.width} x {self.height}, {self.count} wavelengths]"

    mi.register_texture(NAME, lambda properties: SpectralPicture(properties))


def _read(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (H, W, P) and wavelengths (P,) of the layers T of a file."""
    import mitsuba as mi

    from spectrabox.reconstruct.rendering.renderer import all_cores
    with all_cores():       # its reader waits for ever where there is one thread
        picture: Any = mi.Bitmap(path)
    names = [field.name for field in picture.struct_()]
    kind, layers = spectral_layers(names, first=REFLECTANCE)
    nm = np.array([wavelength for wavelength, _ in layers])
    if kind != REFLECTANCE or nm.size < 2 or np.ptp(np.diff(nm)) > 1e-6:
        raise InputError(f"{path} holds no layers T of evenly spaced wavelengths, such as "
                         "T.400,000000nm; give a spectral EXR of reflectances")
    pixels = np.array(picture).astype(np.float32)[..., [index for _, index in layers]]
    if not np.all(np.isfinite(pixels)):
        raise InputError(f"{path} has pixels that are not numbers (clipped ones); fill them first")
    return pixels, nm
