"""A session of a box measured with a tape.

Three photos from two positions, one estimated from marked corners and one measured; an object
turned between them, a lamp moved since, a chart under a lamp in another position, measured
sensitivities.
"""
from fractions import Fraction

import numpy as np
from session_photos import rendered_box, shoot, write_table

from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities, chart_light, vignetting
from spectrabox.fixtures.paints import NM, chart_copy, paint
from spectrabox.radiometry.records.spectra import Quantity

SIZE = (208, 312)
PAINTS = {"white": "white_wall", "green": "green_wall", "red": "red_wall", "cube": "cube"}
GAIN = 2.0e4                    # signal per light x second
CHART, BOX, SIDE, TURNED = (Fraction(1, one) for one in (75, 110, 140, 125))
BLOCK, AXIS, TURN_DEG = np.array([-50.0, -200.0]), np.array([-30.0, -220.0]), 28.0
SIDE_TURN_DEG, TURNED_DEG = 35.0, -40.0
CAMERA_MM, FOV_DEG = np.array([0.0, 165.0, 690.0]), 37.3
CORNERS = ("back bottom left", "back bottom right", "back top left", "back top right",
           "block front top left", "block front top right", "block front bottom left",
           "block back top right")
TOML = """\
[session]
name = "a box with every option"
seed = 13

[photos]
object = "photos/box.dng"
chart = "photos/chart.dng"
flat = "photos/flat.dng"

[chart]
leave_out = [9]

[repeatability]
light = 0.015
shutter = 0.006
lamp_position = 0.007

[stray_light]
glare = 0.004
ambient = 0.003

[light]
spectrum = {{ file = "spectra/lamps.csv", column = 2 }}

[sensitivity]
from = {{ file = "spectra/camera.csv", columns = ["red", "green", "blue"] }}
relative_error = 0.013

[scene.box]
width_mm = 480
height_mm = 330
depth_mm = 400
walls = {{ back = "white", ceiling = "white", floor = "white", left = "green", right = "red" }}
turntable_mm = [-30, -220]

[[scene.box.objects]]
name = "block"
shape = "box"
material = "cube"
size_mm = [120, 120, 120]
at_mm = [-50, 0, -200]
turn_deg = 28
on_turntable = true

[scene.box.lamp]
at_mm = [47, 272, 384]
radius_mm = 8
moved_mm = [3, -2, -4]
moved_error_mm = [1.1, 1.4, 2.3]

[scene.box.camera]
corners_px = {corners}

[scene.box.chart]
at_mm = [10, 60, 20]
look_at_mm = [10, 60, 500]
up = [0, 1, 0]
size_mm = [290, 203]
lamp_at_mm = [-30, 160, 760]

[views.side]
photo = "photos/side.dng"
turn_deg = 35

[views.side.camera]
at_mm = [120, 240, 660]
look_at_mm = [-30, 120, -120]
up = [0.05, 1, 0]
fov_deg = 40

[views.turned]
photo = "photos/turned.dng"
turn_deg = -40

[materials.white]
truth = {{ file = "spectra/paints.csv", column = "white" }}

[materials.green]
family = "paint"

[materials.red]

[materials.cube]
truth = {{ file = "spectra/paints.csv", column = "cube" }}

[reconstruct]
surface_error = 0.008
brightness_error = 0.012
spectrum_prior = "smooth"
coefficients = 8
width = 40

[sampling]
method = "uniform"
draws = 1200
level = 0.8
coefficients = 8
"""


def turned(at, axis, degrees):
    """Points (..., 2) of x and z turned counter-clockwise as seen from above."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return axis + (at - axis) @ np.array([[cosine, -sine], [sine, cosine]])


def marks(rng):
    """Corners in pixels of the first photo, as a hand of 0.2 pixels marks them."""
    half = {"left": -1, "right": 1, "bottom": 0, "top": 1, "front": 1, "back": -1}
    focal, seen = SIZE[1] / 2 / np.tan(np.radians(FOV_DEG) / 2), {}
    for name in CORNERS:
        depth, height, side = name.removeprefix("block ").split()
        x, y, z = half[side] * 240.0, half[height] * 330.0, -400.0
        if name.startswith("block"):
            x, z = turned(BLOCK + 60 * np.array([half[side], half[depth]]), BLOCK, TURN_DEG)
            y = half[height] * 120.0
        ahead = CAMERA_MM[2] - z
        at = np.array([SIZE[1] / 2 + focal * x / ahead,
                       SIZE[0] / 2 - focal * (y - CAMERA_MM[1]) / ahead]) - 0.5
        seen[name] = (at + 0.2 * rng.standard_normal(2)).round(2).tolist()
    return seen


def block_at(degrees):
    """What of the scene's text changes where the turntable has turned; in cm."""
    x, z = turned(BLOCK, AXIS, degrees) / 10
    return ('<rotate y="1" angle="28"/>\n            <translate x="-5" y="6" z="-20"/>',
            f'<rotate y="1" angle="{TURN_DEG + degrees}"/>\n'
            f'            <translate x="{x}" y="6" z="{z}"/>')


def write_box(folder):
    """Photos, spectra and session.toml."""
    rng, curves, light = np.random.default_rng(31), camera_sensitivities(), lamp.radiance(NM)
    truth = {name: paint(of)[1] for name, of in PAINTS.items()}
    write_table(folder / "spectra" / "lamps.csv", {"lamp": light, "other": light[::-1]},
                Quantity.RADIANCE, "two lamps")
    write_table(folder / "spectra" / "paints.csv", truth, Quantity.REFLECTANCE, "the paints")
    write_table(folder / "spectra" / "camera.csv",
                {"blue": curves[2], "red": curves[0], "green": curves[1]}, Quantity.RELATIVE,
                "the camera")

    def take(name, shown, exposure):
        shoot(folder / "photos" / f"{name}.dng",
              GAIN * float(exposure) * shown * vignetting(SIZE)[..., None], exposure, rng)

    take("chart", chart_light(chart_copy(np.random.default_rng(3)), light, curves, SIZE), CHART)
    take("box", rendered_box(truth, light, curves, SIZE, seed=5), BOX)
    take("side", rendered_box(truth, light, curves, SIZE, seed=6, changed=(
        block_at(SIDE_TURN_DEG), ('value="37.3"', 'value="40"'),
        ('origin="0, 16.5, 69" target="0, 16.5, 0" up="0, 1, 0"',
         'origin="12, 24, 66" target="-3, 12, -12" up="0.05, 1, 0"'))), SIDE)
    take("turned", rendered_box(truth, light, curves, SIZE, seed=7,
                                changed=(block_at(TURNED_DEG),)), TURNED)
    take("flat", np.full((*SIZE, 3), 0.6 / GAIN / float(BOX)), BOX)
    corners = ", ".join(f'"{name}" = {at}' for name, at in marks(rng).items())
    (folder / "session.toml").write_text(TOML.format(corners=f"{{ {corners} }}"), encoding="utf-8")
    return folder
