"""The photo of a scene, by stock Mitsuba from the true spectra at 1 nm.

Nothing of the inversion is used: the placeholders of ``scene.xml`` give way to ``truth.csv`` and
``light.csv``, and Mitsuba's own path tracer carries four continuously drawn wavelengths along each
path to a spectral film with the bands of ``camera.csv``. Paths may have three times the segments
that the scene states and more, as light has.

    python -m benchmarks.scenes.render FOLDER/cornell
"""
from __future__ import annotations

import argparse
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from spectrabox.fixtures.demos import box_render

PHOTO = "photo.exr"
SPP, SEGMENTS, SEED = 1024, 24, 53
REFLECTANCES = ("reflectance", "diffuse_reflectance", "specular_reflectance", "base_color")
STRENGTHS = ("radiance", "intensity", "irradiance")
BRIGHTEST = 0.8         # of the white level: the 99th percentile of what is no lamp


def photograph(folder: Path, spp: int = SPP) -> None:
    """Write photo.exr of a scene's folder: linear R, G, B, clipped at 1 as a sensor is."""
    mi = box_render.renderer()
    spectral = mi.load_string(true_xml(folder))
    signal = np.array(mi.render(spectral, spp=spp, seed=SEED), dtype=float)
    lit = signal[signal.max(axis=-1) > 0]
    signal *= BRIGHTEST / np.percentile(lit.max(axis=-1), 99)
    bitmap = mi.Bitmap(np.minimum(signal, 1).astype(np.float32), mi.Bitmap.PixelFormat.RGB)
    unfinished = folder / "unfinished.exr"
    bitmap.write(str(unfinished))
    unfinished.replace(folder / PHOTO)


def true_xml(folder: Path) -> str:
    """The scene with its true spectra, a spectral film and longer paths."""
    root = ET.parse(folder / "scene.xml").getroot()
    nm, truth = columns(folder / "truth.csv")
    _, light = columns(folder / "light.csv")
    _, camera = columns(folder / "camera.csv")
    for bsdf in root.findall("bsdf"):
        for placeholder in bsdf.iter("spectrum"):
            if placeholder.get("name") in REFLECTANCES:
                fill(placeholder, nm, truth[bsdf.attrib["id"]])
    for emitter in root.iter("emitter"):
        for placeholder in emitter.findall("spectrum"):
            if placeholder.get("name") in STRENGTHS:
                fill(placeholder, nm, float(placeholder.attrib["value"]) * light["value"])
    for mesh in root.iter("string"):
        if mesh.get("name") == "filename":
            mesh.set("value", str((folder / mesh.attrib["value"]).resolve()))
    depth = root.find("integrator/integer")
    film = root.find("sensor/film")
    assert depth is not None and film is not None
    depth.set("value", str(SEGMENTS))
    film.set("type", "specfilm")
    ET.SubElement(film, "rfilter", type="box")
    for band, curve in camera.items():
        fill(ET.SubElement(film, "spectrum", name=band), nm, curve)
    return ET.tostring(root, encoding="unicode")


def fill(element: ET.Element, nm: np.ndarray, values: np.ndarray) -> None:
    """Make an element a spectrum of equal steps, piecewise linear between its samples."""
    name = element.attrib["name"]
    element.attrib.clear()
    element.attrib.update(name=name, type="regular")
    ET.SubElement(element, "float", name="wavelength_min", value=f"{nm[0]:g}")
    ET.SubElement(element, "float", name="wavelength_max", value=f"{nm[-1]:g}")
    ET.SubElement(element, "string", name="values",
                  value=", ".join(f"{value:.8g}" for value in values))


def columns(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Wavelengths and columns of a file of spectra, by NumPy alone."""
    with path.open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
    table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    return table[:, 0], dict(zip(names[1:], table[:, 1:].T, strict=True))


def main() -> None:
    """Render scenes that are written already."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+", help="of scenes")
    parser.add_argument("--spp", type=int, default=SPP, help="paths per pixel, a power of 4")
    asked = parser.parse_args()
    for folder in asked.folders:
        photograph(folder, asked.spp)


if __name__ == "__main__":
    main()
