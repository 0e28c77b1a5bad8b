"""Two sessions of a scene without a chart: one drawn through its light transport with a picture of
every pixel, one of a processed photo under two lamps of different spectra.
"""
from fractions import Fraction

import numpy as np
from session_photos import rendered_box, shoot, write_table

from spectrabox.capture.photo.image_writers import write_png
from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.demos.demo_scenes import box_scene, regular_spectrum
from spectrabox.fixtures.paints import NM, paint
from spectrabox.radiometry.records.spectra import Quantity

SIZE = (104, 156)
PAINTS = {"white": "white_wall", "green": "green_wall", "red": "red_wall", "cube": "cube"}
EXPOSURE = Fraction(1, 110)
FILL_CM = "-14, 22, 6"
# a camera's colour matrix, mild enough that the session's mixing_error covers it
MIXED = np.array([[1.010, -0.006, -0.004], [-0.005, 1.008, -0.003], [0.002, -0.007, 1.005]])
HEAD = """\
[session]
seed = 17

[stray_light]
glare = 0.003
ambient = 0.001

[sensitivity]
from = "spectra/camera.csv"
relative_error = 0.011

[scale]
from = "material"

[scene]
file = "scene/box.xml"

[materials.white]
known = { file = "spectra/paints.csv", column = "white" }

[materials.green]
truth = { file = "spectra/paints.csv", column = "green" }
family = "paint"

[materials.red]
truth = { file = "spectra/paints.csv", column = "red" }

[materials.block]
bsdf = "cube"
truth = { file = "spectra/paints.csv", column = "cube" }
"""
TRANSPORT = HEAD + """
[photos]
object = "photos/box.dng"

[light]
spectrum = "spectra/light.csv"

[reconstruct]
coefficients = 10
width = 39

[sampling]
through = "transport"
coefficients = 10
draws = 1000
level = 0.85

[picture]
rect = [5.5, 55.5, 53.5, 87.5]
light = "FL2"
step_nm = 30
format = "tiled-exr"
family = ["paint", "textile"]
"""
TWO_LAMPS = HEAD + """
[photos]
object = "photos/box.png"
not_linear = true

[light]
spectrum = "spectra/light.csv"
by_id = { fill = { file = "spectra/fill.csv", column = "halogen" } }

[reconstruct]
engine = "transport"
light_error = 0.03
mixing_error = 0.012
surface_error = 0.009
spectrum_prior = "none"
coefficients = 7
width = 36

[sampling]
method = "uniform"
draws = 1000
coefficients = 7
"""


def halogen():
    """A lamp at 3000 K, a third as bright as the other."""
    return 0.2 * (NM / 560.0) ** -5 * np.expm1(1.4388e7 / 560 / 3000) / np.expm1(
        1.4388e7 / NM / 3000)


def fill(radiance):
    """XML of a second lamp."""
    return (f'<shape type="sphere" id="fill"><float name="radius" value="1.1"/><point name="center"'
            f' value="{FILL_CM}"/><emitter type="area">{radiance}</emitter></shape>')


def write_inputs(folder):
    """Write the spectra of both; give true reflectances, sensitivities and a random generator."""
    rng, curves = np.random.default_rng(41), camera_sensitivities()
    truth = {name: paint(of)[1] for name, of in PAINTS.items()}
    nm, radiance, error = lamp.measured(rng)
    write_table(folder / "spectra" / "light.csv", {"value": radiance, "standard_error": 3 * error},
                Quantity.RADIANCE, "a reading of the lamp", nm)
    write_table(folder / "spectra" / "fill.csv", {"daylight": lamp.radiance(NM)[::-1],
                                                  "halogen": halogen()}, Quantity.RADIANCE, "lamps")
    write_table(folder / "spectra" / "paints.csv", truth, Quantity.REFLECTANCE, "the paints")
    write_table(folder / "spectra" / "camera.csv", dict(zip("RGB", curves, strict=True)),
                Quantity.RELATIVE, "the camera")
    (folder / "scene").mkdir()
    return truth, curves, rng


def write_transport_session(folder):
    """A session whose spectra are drawn through the light transport, with a picture."""
    truth, curves, rng = write_inputs(folder)
    (folder / "scene" / "box.xml").write_text(box_scene(SIZE), encoding="utf-8")
    shown = rendered_box(truth, lamp.radiance(NM), curves, SIZE, seed=8)
    shoot(folder / "photos" / "box.dng", 0.6 * shown / np.percentile(shown, 99.5), EXPOSURE, rng)
    (folder / "session.toml").write_text(TRANSPORT, encoding="utf-8")
    return folder


def write_two_lamps(folder):
    """A session of a processed photo under two lamps of different spectra."""
    truth, curves, _ = write_inputs(folder)
    scene = box_scene(SIZE).replace("</scene>", fill('<spectrum name="radiance" value="1.0"/>')
                                    + "</scene>")
    (folder / "scene" / "box.xml").write_text(scene, encoding="utf-8")
    shown = rendered_box(truth, lamp.radiance(NM), curves, SIZE, seed=9,
                         extra=fill(regular_spectrum("radiance", NM, halogen())))
    linear = 0.7 * shown @ MIXED.T / np.percentile(shown, 99.5)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear,
                       1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)
    (folder / "photos").mkdir()
    write_png(folder / "photos" / "box.png",
              np.rint(255 * np.clip(encoded, 0, 1)).astype(np.uint8))
    (folder / "session.toml").write_text(TWO_LAMPS, encoding="utf-8")
    return folder
