"""Picture and figures of docs/how-to/picture.md: a patterned wall relit in stock Mitsuba, against
the truth.

    python docs/make_relit_picture.py

A box whose side walls and cube are painted in fields of artists' colours is photographed under the
demo's lamp. The spectra of all pixels are found, written as textures with the scene around them
(`to_mitsuba`), and rendered by Mitsuba's own path tracer under illuminant A; beside it the same
with one spectrum a wall. The truth is the painted box itself under A, from spectra at 1 nm. Writes
`docs/images/relit.png` and prints the errors.
"""
from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import matplotlib as mpl
import numpy as np

import spectrabox as sb
from spectrabox.fixtures.demos import demo_scenes, painted_box
from spectrabox.fixtures.paints import NM, PIGMENTS, paint
from spectrabox.radiometry.colour_science import adapted_srgb
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra.named_spectra import light as named_light
from spectrabox.radiometry.spectra.named_spectra import sensitivities as named_observer
from spectrabox.reconstruct.rendering import renderer

IMAGE = Path(__file__).resolve().parent / "images" / "relit.png"
SIZE, SPP, RELIT_SPP, SEED = (104, 156), 256, 1024, 1
OBSERVER = "CIE 1931 2 Degree Standard Observer"
EDGE = 2                # pixels of the border between fields, where a texel is not a pixel


def relit(scene: Path, light: np.ndarray, observer: np.ndarray, one_spectrum: bool) -> np.ndarray:
    """X, Y, Z (H, W, 3) of a scene that ``to_mitsuba`` wrote, under a light (P,) at ``NM``."""
    import mitsuba as mi

    root = ET.fromstring(scene.read_text(encoding="utf-8"))
    for radiance in list(root.iter("emitter")):
        for child in list(radiance):
            radiance.remove(child)
        radiance.append(ET.fromstring(demo_scenes.regular_spectrum("radiance", NM, light)))
    film = root.find("sensor/film")
    assert film is not None
    film.set("type", "specfilm")
    film[:] = [ET.fromstring(f'<integer name="{name}" value="{value}"/>')
               for name, value in zip(("height", "width"), SIZE, strict=True)]
    film.append(ET.fromstring('<rfilter type="box"/>'))
    film.extend(ET.fromstring(demo_scenes.regular_spectrum(f"band_{number}", NM, curve))
                for number, curve in enumerate(observer))
    if one_spectrum:
        for ref in root.iter("ref"):
            ref.set("id", ref.get("id", "").split(" of ")[0])
    other = scene.with_stem(f"{scene.stem}-{'one' if one_spectrum else 'textures'}")
    other.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    with renderer.all_cores():
        return np.array(mi.render(mi.load_file(str(other)), spp=RELIT_SPP, seed=7), dtype=float)


def main() -> None:
    """Photograph, measure, relight, compare."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    renderer.start_mitsuba("cpu")
    renderer.register_spectral_texture()
    patterns = {name: painted_box.chequered(np.array([PIGMENTS[each] for each in paints]), fields,
                                            SEED)
                for name, (fields, paints) in painted_box.DEMO_PATTERNS.items()}
    grid = grid_from_nm(NM)
    light, observer = named_light("A", grid), named_observer(OBSERVER, grid)
    with tempfile.TemporaryDirectory() as written:
        folder = Path(written) / "box"
        painted_box.write_painted_session(folder, patterns, size=SIZE, spp=SPP)
        found = sb.Session(folder).run(device="cpu", progress=False).spectra
        scene = found.to_mitsuba(Path(written) / "recovered.xml")
        pictures = [relit(scene, light, observer, one) for one in (False, True)]
    truth = painted_box.painted_light(patterns, paint("white_wall")[1], size=SIZE, spp=RELIT_SPP,
                                      seed=11, light=light, sensitivities=observer)
    # pixels of one paint of a wall; the cube, whose faces share coordinates, has no texture
    shown = painted_box.painted_truth({name: patterns[name] for name in ("green", "red")}, SIZE)
    plain = np.isfinite(shown[..., 0])
    for axis in (0, 1):
        for step in range(1, EDGE + 1):
            plain &= np.isfinite(np.roll(shown[..., 0], step, axis)) \
                & np.isfinite(np.roll(shown[..., 0], -step, axis))
    pictures = [picture * (truth[plain, 1].sum() / picture[plain, 1].sum()) for picture in pictures]
    errors = [np.abs(picture[..., 1] / truth[..., 1] - 1) for picture in pictures]
    for name, error in zip(("textures", "one spectrum a wall"), errors, strict=True):
        print(f"{name}: relative error of Y on the patterned walls, median "
              f"{np.median(error[plain]):.3f}, 90 % within {np.quantile(error[plain], 0.9):.3f}")
    white = observer @ (light * grid.weights_nm)
    level = np.percentile(truth[..., 1], 99.5)
    figure, axes = plt.subplots(1, 4, figsize=(12, 2.4), layout="constrained")
    for at, title, picture in zip(axes, ("truth under A", "textures, relit", "one spectrum, relit"),
                                  (truth, *pictures), strict=False):
        at.imshow(adapted_srgb(picture / level, white / white[1]))
        at.set_title(title, fontsize=9)
    bar = axes[3].imshow(np.where(plain, 100 * errors[0], np.nan), vmin=0, vmax=20, cmap="viridis")
    axes[3].set_title("|textures / truth - 1|, %", fontsize=9)
    figure.colorbar(bar, ax=axes[3], shrink=0.9)
    for at in axes:
        at.set(xticks=[], yticks=[])
    figure.savefig(IMAGE, dpi=110)
    print(f"wrote {IMAGE}")


if __name__ == "__main__":
    main()
