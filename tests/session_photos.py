"""Photos and spectral files of the recorded sessions, which any machine makes alike."""
from fractions import Fraction

import numpy as np

from spectrabox.fixtures.demos.box_render import renderer
from spectrabox.fixtures.demos.demo_scenes import box_scene, regular_spectrum
from spectrabox.fixtures.dng import write_dng
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.spectra.spectrum_files import table_text

BLACK, WHITE = (598, 602, 604, 599), 15871      # DN of the RGGB tile, and of a full pixel
ELECTRONS, READ_NOISE_DN = 60000.0, 2.5
HOT = (slice(5, None, 97), slice(8, None, 89))  # pixels that gather a dark signal of their own


def shoot(path, signal, exposure_s, rng, *, hot_dn_per_s=0.0, f_number=8.0, iso=100):
    """Write the DNG of a signal (H, W, 3), with hot pixels.

    Noise is drawn apart from the signal, so that a rounding of the signal moves no other pixel.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = signal.shape[:2]
    counts, noise = np.empty((height, width)), rng.standard_normal((2, height, width))
    for position, band in enumerate((0, 1, 1, 2)):
        tile = (slice(position // 2, None, 2), slice(position % 2, None, 2))
        level = np.maximum(signal[(*tile, band)], 0).astype(float)
        shot = np.sqrt(level / ELECTRONS) * noise[0][tile]
        counts[tile] = BLACK[position] + (WHITE - BLACK[position]) * (level + shot)
    counts[HOT] += hot_dn_per_s * float(exposure_s)
    counts = np.clip(np.rint(counts + READ_NOISE_DN * noise[1]), 0, WHITE).astype(np.uint16)
    write_dng(path, counts, pattern="RGGB", black=BLACK, white=WHITE,
              exposure_s=Fraction(exposure_s), f_number=f_number, iso=iso, make="Spectrabox",
              model="Synthetic 5100", serial="WHOLE-1")


def write_table(path, columns, quantity, source, nm=NM):
    """Write a spectral file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(table_text(nm, columns, quantity=quantity, source=source), encoding="utf-8")


def rendered_box(reflectances, light, sensitivities, size, *, changed=(), extra="", seed=1):
    """Integrals (H, W, K) of radiance x sensitivity in the demo's box, by Mitsuba's specfilm.

    Parameters
    ----------
    changed : sequence of (old, new)
        Replacements in the text of the scene.
    extra : str
        XML that is added to it.
    """
    spectra = {name: regular_spectrum("reflectance", NM, values)
               for name, values in reflectances.items()}
    spectra["light"] = regular_spectrum("radiance", NM, light)
    bands = "".join(regular_spectrum(f"band_{band}", NM, curve)
                    for band, curve in enumerate(sensitivities))
    film = (f'<film type="specfilm"><integer name="width" value="{size[1]}"/><integer name="height"'
            f' value="{size[0]}"/><rfilter type="box"/>{bands}</film>'
            '<sampler type="multijitter"><integer name="sample_count" value="16"/></sampler>')
    text = box_scene(size, spectra, film, 10).replace("</scene>", extra + "</scene>")
    for old, new in changed:
        assert old in text, old
        text = text.replace(old, new)
    mi = renderer()
    return np.array(mi.render(mi.load_string(text), spp=16, seed=seed), dtype=float)
