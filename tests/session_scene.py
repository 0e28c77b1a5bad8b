"""A session of a scene that states everything a session can state.

Three photos: an exposure bracket under one lamp; a
shorter exposure under the same lamp; a photo under a second lamp with a chart photo of its own.
Dark frames at every exposure, a flat field, a lens, patches left out, glare, measured spectra of
lamp, chart and one material.
"""
from fractions import Fraction

import numpy as np
from session_photos import rendered_box, shoot, write_table

from spectrabox.calibrate.geometry.lens import Lens, write_lens
from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import (
    CARD_LIGHT,
    camera_sensitivities,
    chart_light,
    vignetting,
)
from spectrabox.fixtures.demos.demo_scenes import box_scene, chart_scene_xml
from spectrabox.fixtures.paints import NM, chart_copy, paint
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.records.spectra import Quantity

SIZE = (208, 312)
PAINTS = {"white": "white_wall", "green": "green_wall", "red": "red_wall", "cube": "cube"}
GAIN = 2.0e4                    # signal per light x second
CHART, LONG, SHORT, WARM, WARM_CHART = (Fraction(1, one) for one in (75, 110, 300, 240, 150))
TOML = """\
[session]
name = "a scene with every option"
operator = "A. Tester"
notes = "one of each"
seed = 7

[photos]
object = ["photos/long.dng", "photos/short.dng"]
chart = "photos/chart.dng"
flat = "photos/flat.dng"
dark = ["photos/dark0.dng", "photos/dark1.dng", "photos/dark2.dng", "photos/dark3.dng",
        "photos/dark4.dng", "photos/dark5.dng"]

[chart]
reference = "spectra/chart.csv"
scene = "scene/chart.xml"
leave_out = [5, 17]

[camera]
lens = "lens.json"

[repeatability]
light = 0.021
shutter = 0.013
lamp_position = 0.008

[stray_light]
glare = 0.011
ambient = 0.004

[light]
spectrum = "spectra/light.csv"

[sensitivity]
from = "chart"
truth = { file = "spectra/camera.csv", columns = ["R", "G", "B"] }

[scene]
file = "scene/box.xml"

[views.brief]
photo = "photos/short.dng"

[views.warm]
photo = "photos/warm.dng"
light = { file = "spectra/lamps.csv", column = "warm" }
chart = "photos/warm_chart.dng"

[materials.walls]
bsdf = "white"
known = { file = "spectra/paints.csv", column = "white" }

[materials.green]
truth = { file = "spectra/paints.csv", column = "green" }
family = "paint"

[materials.red]
truth = { file = "spectra/paints.csv", column = "red" }
family = ["paint", "textile"]

[materials.block]
bsdf = "cube"
truth = { file = "spectra/paints.csv", column = "cube" }

[reconstruct]
engine = "transport"
surface_error = 0.013
brightness_error = 0.007
errors_from_scene = false
coefficients = 9
width = 40

[sampling]
draws = 1000
level = 0.9
coefficients = 9
"""


def warm_light():
    """A black body of 2856 K, about as bright as the lamp."""
    return 0.6 * (NM / 560.0) ** -5 * np.expm1(1.4388e7 / 560 / 2856) / np.expm1(
        1.4388e7 / NM / 2856)


def write_scene(folder):
    """Photos, spectra, scenes and session.toml."""
    rng, curves, cold, warm = (np.random.default_rng(11), camera_sensitivities(),
                               lamp.radiance(NM), warm_light())
    truth = {name: paint(of)[1] for name, of in PAINTS.items()}
    chart, lens = chart_copy(np.random.default_rng(2)), vignetting(SIZE)[..., None]
    nm, radiance, error = lamp.measured(rng)
    read = 0.995 * chart * (1 + 0.008 * rng.standard_normal((24, 1)))
    write_table(folder / "spectra" / "light.csv", {"value": radiance, "standard_error": 2 * error},
                Quantity.RADIANCE, "a reading of the lamp", nm)
    write_table(folder / "spectra" / "lamps.csv", {"cold": cold, "warm": warm}, Quantity.RADIANCE,
                "two lamps")
    write_table(folder / "spectra" / "paints.csv", truth, Quantity.REFLECTANCE, "the paints")
    write_table(folder / "spectra" / "chart.csv", dict(zip(CLASSIC.names, read, strict=True)),
                Quantity.REFLECTANCE, "this chart")
    write_table(folder / "spectra" / "camera.csv", dict(zip("RGB", curves, strict=True)),
                Quantity.RELATIVE, "the camera")
    (folder / "scene").mkdir()
    (folder / "scene" / "box.xml").write_text(box_scene(SIZE), encoding="utf-8")
    (folder / "scene" / "chart.xml").write_text(chart_scene_xml(SIZE), encoding="utf-8")
    focal = SIZE[1] / 2 / np.tan(np.radians(37.3) / 2)
    write_lens(folder / "lens.json", Lens(
        SIZE[1], SIZE[0], np.array([[focal, 0, SIZE[1] / 2 - 0.5], [0, focal, SIZE[0] / 2 - 0.5],
                                    [0, 0, 1]]), np.array([-0.004, 0.002, 0.0003, -0.0002, 0.001]),
        np.array([1.0, 1.1, 0.4, 0.3]), np.full(5, 1e-3), 0.2, "measured"))
    boxes = [rendered_box(truth, light, curves, SIZE, seed=seed)
             for seed, light in ((3, cold), (4, warm))]
    photos = folder / "photos"

    def take(name, light, exposure, glare=0.0):
        light = light + glare * light.mean(axis=(0, 1))
        shoot(photos / f"{name}.dng", GAIN * float(exposure) * light * lens, exposure, rng,
              hot_dn_per_s=60000.0)

    take("chart", chart_light(chart, cold, curves, SIZE), CHART, glare=0.01)
    take("warm_chart", chart_light(chart, warm, curves, SIZE), WARM_CHART)
    take("long", boxes[0], LONG, glare=0.004)
    take("short", boxes[0], SHORT, glare=0.004)
    take("warm", boxes[1], WARM)
    card = np.broadcast_to(0.9 * CARD_LIGHT * np.trapezoid(cold * curves, NM, axis=1), (*SIZE, 3))
    take("flat", card, Fraction(1, 100))
    for number, exposure in enumerate((CHART, LONG, LONG, SHORT, WARM, WARM_CHART)):
        take(f"dark{number}", np.zeros((*SIZE, 3)), exposure)
    (folder / "session.toml").write_text(TOML, encoding="utf-8")
    return folder
