"""Sessions without raw photos or chart: linear image files, scenes from elsewhere, a known paint
for the scale.
"""
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.capture.photo.linear import open_photo
from spectrabox.session.cli import app

SESSION = """
[session]
name = "box without a chart"
[photos]
object = "photos/box.exr"
[light]
spectrum = {{ file = "spectra/lights.csv", column = 3 }}
[sensitivity]
from = {{ file = "spectra/truth_sensitivity.csv", columns = ["R", "G", "B"] }}
[scale]
from = "material"
[scene]
file = "scene/box.xml"
[materials.white]
bsdf = "white"
known = "spectra/truth_white.csv"
[materials.green]
bsdf = "green"
truth = "spectra/truth_green.csv"
[materials.red]
bsdf = "red"
truth = "spectra/truth_red.csv"
[materials.cube]
bsdf = "cube"
truth = "spectra/truth_cube.csv"
[reconstruct]
width = 40
steps = {steps}
[sampling]
draws = 1000
"""


@pytest.fixture
def converted(captured):
    """The captured box as another lab would hand it over: an EXR, a scene with its own plugins, a
    loose CSV.
    """
    photo = open_photo(captured / "photos" / "box.dng")
    write_exr(captured / "photos" / "box.exr", 37.5 * photo.signal, ("R", "G", "B"))  # any scale
    scene = captured / "scene" / "box.xml"
    scene.write_text(scene.read_text(encoding="utf-8").replace('type="diffuse"',
                                                               'type="spectralDiffuse"'),
                     encoding="utf-8")
    rows = [line.split(",") for line in (captured / "spectra"
                                         / "light.csv").read_text(encoding="utf-8").splitlines()
            if line[0].isdigit()]
    loose = ["Wvl.,other lamp,Rad. [W],"] + [f"{row[0]},1,{row[1]}," for row in rows]
    (captured / "spectra" / "lights.csv").write_text("\n".join(loose), encoding="utf-8")
    (captured / "session.toml").write_text(SESSION.format(steps=80), encoding="utf-8")
    return captured


def run(folder, *options):
    return CliRunner().invoke(app, ["run", str(folder), "--json", "--device", "cpu", *options])


def test_an_exr_with_a_known_paint_gives_the_other_paints(converted):
    outcome = run(converted)
    assert outcome.exit_code == 0, outcome.output
    facts = json.loads(outcome.stdout)
    assert {stage["name"] for stage in facts["stages"]} == {"photo", "calibrate", "reconstruct",
                                                            "sample"}
    ratios = np.array([surface["ratio"] for surface in facts["surfaces"]])
    # The photo has no flat field: 15 % of vignetting is left in the corners, and it must show.
    assert 0.02 < np.abs(ratios - 1).max() < 0.15
    known = next(material for material in facts["materials"] if material["name"] == "white")
    assert known["known"] and "rmse_mean" not in known
    for material in facts["materials"][1:]:
        assert material["rmse_inverse_rendering"] < 0.15, material


def test_a_photo_shifted_against_its_scene_is_said_by_how_much(converted):
    scene = converted / "scene" / "box.xml"
    scene.write_text(scene.read_text(encoding="utf-8").replace(
        '<float name="fov"', f'<float name="principal_point_offset_x" value="{8 / 156}"/>'
        '<float name="fov"'), encoding="utf-8")
    outcome = run(converted)
    assert outcome.exit_code in (0, 4)
    found = {one["code"]: one["values"] for one in json.loads(outcome.stdout)["findings"]}
    shift = found["scene.shifted"]
    right, down, across = (shift[name] for name in ("right_px", "down_px", "width_px"))
    # Eight of 156 pixels; the parabola through the correlation's peak is good to a third of a
    # pixel.
    assert right == pytest.approx(8 * across / 156, abs=0.4) and abs(down) < 0.5
    named = [part["what"] for part in found["scene.estimated"]["parts"] if part["named"]]
    assert named == ["camera"]


def test_an_image_with_the_bands_missing_is_refused(converted):
    write_exr(converted / "photos" / "box.exr", np.ones((104, 156, 1), np.float32), ("Y",))
    outcome = run(converted)
    assert outcome.exit_code == 3 and "box.exr" in json.loads(outcome.stdout)["error"]


def test_a_scene_may_not_reach_files_outside(converted):
    scene = converted / "scene" / "box.xml"
    mesh = ('<shape type="ply" id="mesh"><string name="filename" value="../../secret.ply"/><ref '
            'id="white"/></shape></scene>')
    scene.write_text(scene.read_text(encoding="utf-8").replace("</scene>", mesh), encoding="utf-8")
    outcome = run(converted)
    assert outcome.exit_code == 3 and "outside the session folder" in json.loads(
        outcome.stdout)["error"]
