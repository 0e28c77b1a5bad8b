"""A small session of a flat sample: four paints beside a chart, whose light falls off."""
from fractions import Fraction

import numpy as np

from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.flat_sample import (
    box,
    chart_corners,
    lamplight,
    surface_signals,
    vignetting,
    write_photo,
)
from spectrabox.fixtures.paints import NM, paint
from spectrabox.radiometry.chart import AFTER_2014, chart_reflectances
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text

SIZE = (320, 480)
CHART = (0.06, 0.08, 0.45)      # left, top and width of the patch grid
PAINTS = {"white_wall": (0.58, 0.06), "green_wall": (0.78, 0.06), "red_wall": (0.58, 0.36),
          "cube": (0.78, 0.36)}
SIDE = 0.16
LAMPS = [(0.1, 0.2, 1.4, 1.0)]
MEASURED_CHART = f'[chart]\nreference = "{AFTER_2014}"\n'
HEAD = f"""{MEASURED_CHART}[photos]
object = "photos/sample.dng"
[light]
spectrum = "spectra/light.csv"
[sampling]
draws = 1000
"""


def rect_of(name, size=SIZE):
    """[x0, y0, x1, y1] well inside a paint, in pixels of the photo."""
    left, top = PAINTS[name]
    inner = np.array([left + 0.03, top + 0.03, left + SIDE - 0.03, top + SIDE - 0.03])
    return [round(float(value)) for value in inner * size[1]]


def light_over(size=SIZE, corner=0.9):
    """Light (H, W) that reaches the sensor from a white plane, largest value 1."""
    light = lamplight(size, LAMPS) * vignetting(size, corner)
    return light / light.max()


def stated_chart(seed=1):
    """Reflectances (24, P) of the chart that the session states, each patch off by .5 %.

    The paints lie up to a chart's width away, where the patches of an odd copy tilt the light by a
    fifth: copies that nobody stated are drawn in test_chart_generation.py and by benchmarks.
    """
    stated = chart_reflectances(AFTER_2014, grid_from_nm(NM))
    return stated * np.exp(0.005 * np.random.default_rng(seed).standard_normal((24, 1)))


def picture(size=SIZE, *, chart=CHART, paints=PAINTS, light=None, seed=1, power=None):
    """Light (H, W, 3) that reaches the sensor from chart and paints, under a lamp of a power (P,).
    """
    responses = camera_sensitivities() * (lamp.radiance(NM) if power is None else power)
    areas = [(box(left, top, left + SIDE, top + SIDE), paint(name)[1])
             for name, (left, top) in paints.items()]
    corners = None if chart is None else chart_corners(*chart)
    flat = surface_signals(size, responses, stated_chart(seed), corners, areas,
                           np.full(NM.size, 0.2))
    return flat * (light_over(size) if light is None else light)[..., None]


def write_spectra(folder):
    """The lamp's spectrum and those of the paints, under their names."""
    folder.mkdir(parents=True)
    spectra = {name: (paint(name)[1], Quantity.REFLECTANCE) for name in PAINTS}
    spectra["light"] = (lamp.radiance(NM), Quantity.RELATIVE)
    for name, (values, quantity) in spectra.items():
        text = table_text(NM, {"value": values}, quantity=quantity, source=name)
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")


def regions_toml(names=tuple(PAINTS), known=()):
    """[regions.NAME] of some paints, with their truths or as known."""
    return "".join(f'[regions.{name}]\nrect = {rect_of(name)}\n'
                   f'{"known" if name in known else "truth"} = "spectra/{name}.csv"\n'
                   for name in names)


def write_flat(folder, more=""):
    """A session of all four paints, its chart in the same photo; ``more`` is added to its file."""
    write_spectra(folder / "spectra")
    (folder / "photos").mkdir()
    write_photo(folder / "photos" / "sample.dng", picture(), Fraction(1, 60),
                np.random.default_rng(3))
    (folder / "session.toml").write_text(HEAD + more + regions_toml(), encoding="utf-8")
    return folder
