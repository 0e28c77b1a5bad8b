"""Two sessions of flat samples.

The first has a chart photo of its own, a second exposure, a second lamp with
the chart in its photo, dark frames, a flat field and a picture. In the second nobody measured the
lamps: of one the kind is stated, of the other the colour temperature.
"""
from fractions import Fraction

import numpy as np
from flat_example import CHART as CHART_PLACE
from flat_example import PAINTS, SIZE, light_over, picture, rect_of
from session_photos import shoot, write_table

from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.flat_sample import chart_corners
from spectrabox.fixtures.paints import NM, paint
from spectrabox.radiometry.records.spectra import Quantity

SAMPLE, BRIEF, CHART, WARM, FLAT = (Fraction(1, one) for one in (60, 150, 70, 80, 100))
x0, y0, x1, y1 = rect_of("green_wall")
TOML = f"""\
[session]
name = "flat samples with every option"
operator = "B. Tester"
notes = "one of each"
seed = 5

[photos]
object = "photos/sample.dng"
chart = "photos/chart.dng"
flat = "photos/flat.dng"
dark = ["photos/dark0.dng", "photos/dark1.dng", "photos/dark2.dng", "photos/dark3.dng",
        "photos/dark4.dng"]

[chart]
leave_out = [3, 11, 20]

[repeatability]
light = 0.017
shutter = 0.011

[stray_light]
glare = 0.006

[light]
spectrum = "spectra/light.csv"

[sensitivity]
from = {{ file = "spectra/camera.csv", columns = ["R", "G", "B"] }}
relative_error = 0.03
truth = {{ file = "spectra/camera.csv", columns = ["R", "G", "B"] }}

[views.brief]
photo = "photos/brief.dng"

[views.warm]
photo = "photos/warm.dng"
light = {{ file = "spectra/lamps.csv", column = "warm" }}

[regions.white_wall]
rect = {rect_of("white_wall")}
known = {{ file = "spectra/paints.csv", column = "white_wall" }}

[regions.green_wall]
polygon = [[{x0}, {y0}], [{x1}, {y0 + 4}], [{x1 - 3}, {y1}], [{x0 + 9}, {y1 - 5}]]
photo = ["photo", "warm"]
truth = {{ file = "spectra/paints.csv", column = "green_wall" }}
family = "paint"

[regions.red_wall]
rect = {rect_of("red_wall")}
photo = "warm"
truth = {{ file = "spectra/paints.csv", column = "red_wall" }}
family = ["paint", "textile"]

[regions.cube]
rect = {rect_of("cube")}
truth = {{ file = "spectra/paints.csv", column = "cube" }}

[sampling]
coefficients = 9
draws = 1100
level = 0.9

[picture]
rect = [372.5, 29.5, 398.5, 45.5]
light = "A"
step_nm = 25
format = "envi"
family = "paint"
"""
UNKNOWN = """\
[session]
name = "two lamps that nobody measured"
seed = 9

[photos]
object = "photos/sample.dng"

[chart]
corners_px = {corners}
leave_out = [14]

[light]
spectrum = "led"

[views.warm]
photo = "photos/warm.dng"
light = {{ cct = 3100 }}

[regions.white_wall]
rect = {white}
truth = {{ file = "spectra/paints.csv", column = "white_wall" }}

[regions.green_wall]
rect = {green}
photo = "warm"

[regions.cube]
rect = {cube}
known = {{ file = "spectra/paints.csv", column = "cube" }}

[sampling]
method = "uniform"
coefficients = 8
draws = 1000
level = 0.8

[picture]
rect = [299.5, 59.5, 317.5, 69.5]
"""


def warm_power():
    """A black body of 2900 K, relative."""
    return (NM / 560.0) ** -5 * np.expm1(1.4388e7 / 560 / 2900) / np.expm1(1.4388e7 / NM / 2900)


def write_flat_samples(folder):
    """Photos, spectra and session.toml of the first session."""
    rng, curves, cold, warm = (np.random.default_rng(21), camera_sensitivities(),
                               lamp.radiance(NM), warm_power())
    spectra, photos = folder / "spectra", folder / "photos"
    write_table(spectra / "lamps.csv", {"cold": cold, "warm": warm}, Quantity.RELATIVE, "two lamps")
    write_table(spectra / "light.csv", {"value": 3 * cold, "standard_error": 0.05 * cold + 0.001},
                Quantity.RADIANCE, "a reading of one of them")
    write_table(spectra / "paints.csv", {name: paint(name)[1] for name in PAINTS},
                Quantity.REFLECTANCE, "the paints")
    write_table(spectra / "camera.csv", dict(zip("GBR", curves[[1, 2, 0]], strict=True)),
                Quantity.RELATIVE, "the camera")
    white = (curves * cold).sum(axis=1)
    gain = 0.75 / float(SAMPLE) / np.percentile(picture(), 99.9)

    def take(name, light, exposure, strength=gain):
        shoot(photos / f"{name}.dng", strength * float(exposure) * light, exposure, rng,
              hot_dn_per_s=30000.0)

    samples = picture(chart=None)
    take("sample", samples, SAMPLE)
    take("brief", samples, BRIEF)
    take("chart", picture(paints={}), CHART)
    take("warm", picture(power=warm), WARM, 0.5 * gain)
    take("flat", 0.92 * white * light_over()[..., None], FLAT)
    for number, exposure in enumerate((SAMPLE, SAMPLE, BRIEF, CHART, WARM)):
        take(f"dark{number}", np.zeros((*SIZE, 3)), exposure)
    (folder / "session.toml").write_text(TOML, encoding="utf-8")
    return folder


def write_unknown_lamps(folder):
    """The same where both lamps are unknown and each photo has its own chart; marks by hand."""
    rng, photos = np.random.default_rng(23), folder / "photos"
    write_table(folder / "spectra" / "paints.csv", {name: paint(name)[1] for name in PAINTS},
                Quantity.REFLECTANCE, "the paints")
    gain = 0.75 / float(SAMPLE) / np.percentile(picture(), 99.9)
    for name, light, exposure in (("sample", picture(), SAMPLE),
                                  ("warm", 0.4 * picture(power=warm_power()), WARM)):
        light = light + 0.006 * light.mean(axis=(0, 1))
        shoot(photos / f"{name}.dng", gain * float(exposure) * light, exposure, rng)
    corners = chart_corners(*CHART_PLACE) * SIZE[1] - 0.5 + [[0.6, -0.3], [-0.5, 0.4], [0.2, 0.7],
                                                             [-0.4, -0.6]]
    (folder / "session.toml").write_text(UNKNOWN.format(
        corners=corners.round(2).tolist(), white=rect_of("white_wall"), green=rect_of("green_wall"),
        cube=rect_of("cube")), encoding="utf-8")
    return folder
