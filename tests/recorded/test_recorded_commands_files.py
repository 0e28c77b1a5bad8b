"""Commands on spectral files, photos, charts, cameras and geometry: answers, files and refusals."""
import json
import re
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from calibrate_cameras import GRID, cameras, led, on_grid
from flat_example import picture, write_flat
from geometry_views import TILTS, TRUE
from said_by_commands import content_of, said
from test_beam import written as write_wall
from test_geometry_commands import BOARD, SCENE, bent_photo

from spectrabox.calibrate.geometry.lens_files import write_lens
from spectrabox.capture.photo.image_files import write_exr, write_png
from spectrabox.fixtures.demo_scenes import box_scene
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.fixtures.spectral_files import write_examples
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.records import LightScale, Outcome
from spectrabox.reconstruct.scene.light_position import LightPosition
from spectrabox.session.commands import beam as beam_command
from spectrabox.session.commands import light_position
from spectrabox.session.commands.spectrum import _grid as grid_of

NUMBER = re.compile(r"(?<![\w.])-?\d+\.\d+(?:e[-+]?\d+)?")
FIT = 1e-3          # of a fit: where its steps end


# ---- spectral files

def write_tables(folder):
    """Two columns of one quantity with a gap, one with errors, and one that says nothing."""
    nm = np.arange(400, 701, 20)
    rows = [f"{each},{0.2 + at / 40:.4f},{'' if at == 3 else f'{0.5 - at / 60:.4f}'}"
            for at, each in enumerate(nm)]
    (folder / "two.csv").write_text("# quantity: reflectance\n# source: a meter\nnm,red,blue\n"
                                    + "\n".join(rows) + "\n", encoding="utf-8")
    rows = [f"{each},{1.5 + at**2 / 90:.5f},{0.01 + at / 900:.5f}" for at, each in enumerate(nm)]
    (folder / "errors.csv").write_text("# quantity: irradiance\nnm,value,standard_error\n"
                                       + "\n".join(rows) + "\n", encoding="utf-8")
    (folder / "loose.csv").write_text("nm,v\n400,0.5\n500,0.6\n600,0.8\n700,0.7\n",
                                      encoding="utf-8")
    many = ",".join(f"s{at}" for at in range(14))
    (folder / "many.csv").write_text(f"# quantity: reflectance\nnm,{many}\n" + "\n".join(
        f"{each}," + ",".join(f"{(at + 1) / 20 + each / 1e4:.4f}" for at in range(14))
        for each in (400, 500, 600, 700)) + "\n", encoding="utf-8")


SHOW = [("DIR/two.csv",), ("DIR/two.csv", "--column", "blue"), ("DIR/two.csv", "--column", "0"),
        ("DIR/errors.csv",), ("DIR/loose.csv", "--plot"), ("DIR/many.csv",),
        ("DIR/errors.csv", "DIR/loose.csv"), ("DIR/two.csv", "--column", "green"),
        ("DIR/none.csv",)]


@pytest.mark.parametrize("form", [("--json",), ()], ids=["json", "text"])
def test_what_a_spectral_file_holds(form, tmp_path, recorded):
    write_tables(tmp_path)
    recorded([said(tmp_path, "spectrum", "show", *words, *form) for words in SHOW], case="tables")
    recorded({name: said(tmp_path, "spectrum", "show", path, *form)
              for name, path in write_examples(tmp_path).items()}, case="other formats")


CONVERT = [("two.csv", "a.csv", "--column", "red"), ("errors.csv", "b.csv"),
           ("errors.csv", "c.csv", "--grid", "420:680:10"), ("errors.csv", "d.spdx"),
           ("loose.csv", "e.csv", "--quantity", "radiance"), ("loose.csv", "f.csv"),
           ("many.csv", "g.sp"), ("many.csv", "h.csv", "--column", "3"), ("many.csv", "i.exr"),
           ("two.csv", "j.csv"), ("errors.csv", "k.csv", "--quantity", "radiance"),
           ("errors.csv", "l.txt"), ("two.csv", "m.csv", "--quantity", "mood"),
           ("errors.csv", "n.exr", "--grid", "400:700:50")]


def test_spectra_in_other_formats(tmp_path, recorded):
    write_tables(tmp_path)
    answers, files = [], {}
    for source, out, *more in CONVERT:
        answers.append(said(tmp_path, "spectrum", "convert", f"DIR/{source}", "-o", f"DIR/{out}",
                            *more, "--json"))
        if (tmp_path / out).exists():
            files[out] = content_of(tmp_path / out, [tmp_path])
    answers.append(said(tmp_path, "spectrum", "convert", "DIR/loose.csv", "DIR/errors.csv", "-o",
                        "DIR/out", "--quantity", "irradiance", "--to", ".sp"))
    recorded(answers, case="answers")
    recorded(files, case="files")
    said(tmp_path, "spectrum", "convert", "DIR/many.csv", "-o", "DIR/o.sli")
    recorded([content_of(tmp_path / "o.hdr", [tmp_path]), np.frombuffer(
        (tmp_path / "o.sli").read_bytes(), np.uint8)], case="ENVI")


def test_which_grids_are_understood(recorded):
    found = {}
    for text in ("400:700:5", "400:700:300", "400:700:301", "400:700:0", "400:400:1", "400:701:5",
                 "400:700:2.5", "400.5:700.5:10", "x", "0:100001:1", "0:100000:1", "400:700"):
        try:
            nm = grid_of(text)
            found[text] = [nm.size, float(nm[0]), float(nm[-1])]
        except typer.BadParameter as error:
            found[text] = str(error)
    recorded(found)


# ---- photos and charts

@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """A photo with a chart, one of a white card, a dark frame, a dim photo and a JPEG-like one."""
    folder = tmp_path_factory.mktemp("photos")
    rng = np.random.default_rng(7)
    scene = picture((400, 600), chart=(0.06, 0.08, 0.8), paints={})
    gain = write_photo(folder / "chart.dng", scene, Fraction(1, 60), rng)
    write_photo(folder / "dim.dng", 0.08 * scene, Fraction(1, 60), rng, brightest=None, gain=gain)
    write_photo(folder / "bright.dng", 3.2 * scene, Fraction(1, 15), rng, brightest=None,
                gain=gain)
    card = np.full((400, 600, 3), 0.6) * np.linspace(1, 0.8, 600)[:, None]
    write_photo(folder / "card.dng", card, Fraction(1, 60), rng)
    write_png(folder / "p.png", np.ascontiguousarray((255 * np.clip(
        scene / scene.max(), 0, 1)**0.45).astype(np.uint8)))
    return folder


CHART = [("chart.dng",), ("dim.dng",), ("bright.dng",), ("p.png",), ("card.dng",),
         ("chart.dng", "--corners", "1,2 3,4 5,6"), ("chart.dng", "--chart-layout", "Digital SG"),
         ("none.dng",)]


@pytest.mark.parametrize("case", range(len(CHART)), ids=[" ".join(words) for words in CHART])
def test_is_a_chart_photo_good_enough(case, photos, tmp_path, recorded):
    photo, *more = CHART[case]
    answer = said(photos, "chart", f"DIR/{photo}", *more, "--json", "--overlay",
                  str(tmp_path / "o.png"))
    # in a dim photo borders are found within noise, and slopes follow from where they are
    recorded(answer, rtol=0.2 if photo == "dim.dng" else FIT)
    if case in (0, 3):
        recorded(said(photos, "chart", f"DIR/{photo}", *more), rtol=FIT, case="text")
        # round-off moves a drawn line by a pixel
        recorded(content_of(tmp_path / "o.png")["pixels"], rtol=0.02, case="overlay")


DEVELOP = [("chart.dng",), ("bright.dng", "chart.dng"), ("chart.dng", "--flat", "DIR/card.dng"),
           ("chart.dng", "--dark", "DIR/dim.dng"), ("p.png",), ("p.png", "--not-linear"),
           ("chart.dng", "none.dng")]


@pytest.mark.parametrize("case", range(len(DEVELOP)), ids=[" ".join(words) for words in DEVELOP])
def test_photos_become_signals(case, photos, tmp_path, recorded):
    words = [f"DIR/{word}" if word.endswith((".dng", ".png")) and "/" not in word else word
             for word in DEVELOP[case]]
    out = tmp_path / "o.exr"
    recorded(said(photos, "develop", *words, "-o", str(out), "--json", also=[tmp_path]), rtol=FIT)
    if out.exists():
        # the variance in it is measured, from sums in single floats
        recorded(content_of(out, [photos, tmp_path]), rtol=2 * FIT, case="file")
    if case == 1:
        recorded(said(photos, "develop", *words, "-o", str(out), also=[tmp_path]), case="text")


# ---- cameras

@pytest.fixture(scope="module")
def chart(tmp_path_factory):
    """Patch signals of a simulated camera under an LED, that light, curves, and 14 cameras."""
    folder = tmp_path_factory.mktemp("chart")
    surfaces = chart_reflectances("BabelColor Average", GRID)
    curves = on_grid(cameras(1, 90)[0])
    signal = surfaces @ (curves * led() * GRID.weights_nm).T
    signal *= 0.5 / signal.max() * (1 + 0.005 * np.random.default_rng(5).standard_normal(
        signal.shape))
    for name, heading, rows in (
            ("patches", "R,G,B,standard_error R,standard_error G,standard_error B",
             np.hstack([signal, 0.002 + 0.004 * signal])),
            ("light", "wavelength_nm,value", np.column_stack([GRID.nm, led()])),
            ("curves", "nm,R,G,B", np.column_stack([GRID.nm, curves.T]))):
        (folder / f"{name}.csv").write_text(heading + "\n" + "\n".join(
            ",".join(f"{value:.9g}" for value in row) for row in rows) + "\n", encoding="utf-8")
    (folder / "cameras").mkdir()
    for at, each in enumerate(cameras(14, 91)):
        rows = np.column_stack([np.arange(400, 701, 5), each.T])
        (folder / "cameras" / f"camera {at}.csv").write_text("nm,R,G,B\n" + "\n".join(
            ",".join(f"{value:.6g}" for value in row) for row in rows) + "\n", encoding="utf-8")
    (folder / "cameras" / "broken.json").write_text("{", encoding="utf-8")
    return folder


CAMERA_FIT = {"smooth": ("--method", "smooth", "--leave-out", "3,7"),
              "non-negative, no errors given": ("--method", "nonnegative"),
              "file": ("--method", "file", "--curves", "DIR/curves.csv")}


@pytest.mark.parametrize("case", CAMERA_FIT)
def test_sensitivities_from_a_chart(case, chart, tmp_path, recorded):
    words = ("camera", "fit", "--patches", "DIR/patches.csv", "--light", "DIR/light.csv",
             *CAMERA_FIT[case], "--out", str(tmp_path / "c.csv"))
    found = said(chart, *words, "--json")
    found["answer"].pop("file")
    recorded(found, rtol=FIT)
    recorded(content_of(tmp_path / "c.csv", [chart]), rtol=FIT, case="file")
    recorded(said(chart, *words, also=[tmp_path])["answer"], case="text")


FIT_REFUSED = [("--method", "none"), ("--chart", "DIR/x.dng"), ("--method", "file"),
               ("--curves", "DIR/curves.csv"), ("--reference", "a", "--reference", "b"),
               ("--light", "D65"), ("--leave-out", "25"), ("--leave-out", "x"),
               ("--out", "DIR/x.txt"), ("--samples", "DIR/x.csv"), ("--out", "DIR/patches.csv"),
               ("--reference", "no chart"), ("--keep", "../x")]
PREFLIGHT_REFUSED = [("--noise", "0"), ("--noise", "1"), ("--surfaces", "-1"),
                     ("--curves", "DIR/curves.csv", "--prior", "x.npz"), ("--lamps", ",")]


def test_what_commands_on_cameras_refuse(chart, recorded):
    found = [said(chart, "camera", "fit", "--patches", "DIR/patches.csv", "--light",
                  "DIR/light.csv", *words, "--json") for words in FIT_REFUSED]
    found += [said(chart, "camera", "preflight", "--light", "DIR/light.csv", *words)
              for words in PREFLIGHT_REFUSED]
    found += [said(chart, "camera", *words) for words in (
        ("fit", "--light", "D65"), ("prior", "DIR/cameras", "--out", "x.csv"),
        ("prior", "DIR/none", "--out", "x.npz"), ("add", "DIR/none.csv"),
        ("profile", "none", "--camera", "A B"),
        ("profile", "DIR/curves.csv", "--camera", "A B", "-o", "x.icc"))]
    recorded(found)


def test_cameras_before_shooting_profiles_and_names(chart, tmp_path, recorded, monkeypatch):
    monkeypatch.setenv("SPECTRABOX_CAMERAS", str(tmp_path / "kept"))
    recorded(said(chart, "camera", "preflight", "--light", "DIR/light.csv", "--curves",
                  "DIR/curves.csv", "--noise", "0.013", "--surfaces", "2", "--lamps", "D65,A",
                  "--json"), rtol=FIT, case="preflight")
    recorded(said(chart, "camera", "preflight", "--light", "A", "--curves", "DIR/curves.csv",
                  "--surfaces", "0"), rtol=FIT, case="preflight, in words")
    out = [word for name in ("p.json", "p.txt", "p.dcp")
           for word in ("--out", str(tmp_path / name))]
    recorded(said(chart, "camera", "profile", "DIR/curves.csv", "--camera", "Maker One",
                  "--idt-light", "D60", *out, "--json", also=[tmp_path]), rtol=FIT, case="profile")
    recorded([[np.array(NUMBER.findall((tmp_path / name).read_text(encoding="utf-8")), float)
               for name in ("p.json", "p.txt")], (tmp_path / "p.dcp").stat().st_size], rtol=FIT,
             case="profiles")
    made = said(chart, "camera", "add", "DIR/cameras", "--json")
    made["answer"].pop("folder")
    kept = said(tmp_path, "camera", "names", "--json")["answer"]
    recorded([made, kept["own"], len(kept["published"]), kept["published"][:3]], case="names")
    recorded(said(chart, "camera", "prior", "DIR/cameras", "--out", str(tmp_path / "m.npz"),
                  "--leave-out", "camera 3", "--licence", "CC0", also=[tmp_path]), case="prior")


# ---- geometry

@pytest.fixture(scope="module")
def views(tmp_path_factory):
    """A board, a scene, a lens, and photos of the board by it."""
    folder = tmp_path_factory.mktemp("views")
    placed = "origin = [0.1, 0.2, 0.3]\nright = [0, 1, 0]\ndown = [0, 0, -1]\n"
    (folder / "board.toml").write_text(BOARD + placed, encoding="utf-8")
    (folder / "scene.xml").write_text(SCENE, encoding="utf-8")
    write_lens(folder / "lens.json", TRUE)
    for at, tilt in enumerate(TILTS[:4]):
        bent_photo(folder, tilt, f"{at}.exr")
    write_exr(folder / "grey.exr", np.full((480, 640, 3), 0.4, np.float32)
              + np.random.default_rng(2).normal(0, 0.01, (480, 640, 3)).astype(np.float32),
              ["R", "G", "B"], 0.1)
    return folder


GEOMETRY = {
    "board": ("board", "--board", "DIR/board.toml", "-o", "DIR/b.png", "--square-px", "40"),
    "lens": ("lens", "DIR/0.exr", "DIR/1.exr", "DIR/2.exr", "DIR/3.exr", "DIR/grey.exr", "--board",
             "DIR/board.toml", "-o", "DIR/l.json"),
    "pose": ("pose", "DIR/0.exr", "--scene", "DIR/scene.xml", "--board", "DIR/board.toml", "--lens",
             "DIR/lens.json", "-o", "DIR/s.xml"),
    "undistort": ("undistort", "DIR/1.exr", "--lens", "DIR/lens.json", "-o", "DIR/u.exr")}
REFUSED = {
    "board that exists": ("board", "--board", "DIR/board.toml", "-o", "DIR/scene.xml"),
    "over an input": ("undistort", "DIR/1.exr", "--lens", "DIR/lens.json", "-o", "DIR/1.exr"),
    "two views": ("lens", "DIR/0.exr", "DIR/1.exr", "DIR/grey.exr", "--board", "DIR/board.toml",
                  "-o", "DIR/n.json"),
    "neither points nor board": ("pose", "DIR/0.exr", "--scene", "DIR/scene.xml", "-o",
                                 "DIR/n.xml"),
    "no board in it": ("pose", "DIR/grey.exr", "--scene", "DIR/scene.xml", "--board",
                       "DIR/board.toml", "-o", "DIR/n.xml")}


@pytest.mark.parametrize("case", GEOMETRY)
def test_geometry(case, views, recorded):
    words = GEOMETRY[case]
    recorded(said(views, "geometry", *words, "--json"), rtol=0.02 if case == "lens" else FIT,
             case="answer")
    if case != "lens":
        again = said(views, "geometry", *words)
        recorded([again, said(views, "geometry", *words, "--force")], rtol=FIT, case="text")
        out = views / words[words.index("-o") + 1].removeprefix("DIR/")
        recorded(content_of(out, [views]), rtol=FIT, case="file")


def test_what_commands_on_geometry_refuse(views, recorded):
    recorded({case: said(views, "geometry", *words) for case, words in REFUSED.items()})


def test_the_beam_of_a_lamp(tmp_path, recorded):
    write_wall(tmp_path)
    words = ("geometry", "beam", "DIR/wall.exr", "--wall", "DIR/wall.toml", "-o", "DIR/beam.csv")
    recorded(said(tmp_path, *words, "--json"), rtol=FIT, case="answer")
    recorded([said(tmp_path, *words), said(tmp_path, *words[:-1], "DIR/wall.toml"),
              said(tmp_path, *words[:-1], "DIR/x.txt")], case="refused")
    recorded(content_of(tmp_path / "beam.csv", [tmp_path]), rtol=FIT, case="file")


@pytest.mark.parametrize("flat", [True, False])
def test_what_is_said_of_a_beam(flat, tmp_path, recorded):
    """Each warning just below and just above its limit."""
    angle = np.arange(0.0, 48.0)
    found = []
    for share in (0.97, 1.03):
        profile = SimpleNamespace(
            angle_deg=angle, radiance=np.exp(-(angle / 40)**2), standard_error=0.001 + angle / 4e4,
            axis_mm=np.array([12.4, -30.6]), off_axis_deg=3.0 * share, residual_rms=0.0123,
            asymmetry=0.05 * share, band_difference=0.05 * share, spacing_deg=0.4)
        found.append([beam_command._lines(profile, tmp_path / "b.csv", flat),
                      beam_command._facts(profile, tmp_path / "b.csv")])
    assert len(found[1][0]) == len(found[0][0]) + 3
    recorded(json.loads(json.dumps(found).replace(str(tmp_path), "DIR")))


@pytest.mark.parametrize("of_box", [True, False])
def test_what_is_said_of_a_light_that_moved(of_box, recorded):
    found = []
    for misfit in (1.97, 2.0, 2.03):
        estimate = SimpleNamespace(
            light="bulb", offset=np.array([-2.04, 1.5, 0.123]), misfit=misfit, before=8.1,
            standard_error=np.array([0.21, 0.3, 0.04]), outcome=Outcome.CONVERGED,
            scale=LightScale(80.0, 1.2, None, "the fit"))
        found.append(light_position._text(estimate, "scene.xml", of_box).splitlines())
    assert len(found[1]) == len(found[2]) == len(found[0]) + 1
    recorded(found)


def test_the_command_on_a_light(tmp_path, recorded, monkeypatch):
    """What it asks of the fit, writes and says; the fit itself is another test's."""
    (tmp_path / "box.xml").write_text(box_scene((40, 60)), encoding="utf-8")
    rng = np.random.default_rng(2)
    write_exr(tmp_path / "p.exr", rng.uniform(0.1, 0.6, (80, 120, 3)).astype(np.float32),
              ["R", "G", "B"], 0.1)
    (tmp_path / "paints.csv").write_text(
        "# quantity: reflectance\nnm,white,red\n400,0.8,0.1\n700,0.7,0.5\n", encoding="utf-8")
    asked = []

    def fitted(scene, paints, response, photo, light_id, settings, progress):
        asked.append([paints, response, photo.signal, light_id, settings])
        return LightPosition("light", np.array([-1.0, 2.0, 0.5]), np.array([0.2, 0.3, 0.1]),
                             np.diag([0.04, 0.09, 0.01]) + 0.001, LightScale(80.0, 1.2, None, "x"),
                             7.5, 1.3, np.zeros((4, 3)),
                             Outcome.STEP_LIMIT if settings.seed == 4 else Outcome.CONVERGED)
    for name, stand_in in (("scene.light_position.refine_light_position", fitted),
                           ("rendering.renderer.start_mitsuba", lambda device: None)):
        monkeypatch.setattr(f"spectrabox.reconstruct.{name}", stand_in)
    words = ("geometry", "light", "DIR/p.exr", "--scene", "DIR/box.xml", "--light", "A",
             "--sensitivity", "Nikon 5100 (NPL)", "--reflectances", "DIR/paints.csv")
    found = [said(tmp_path, *words, "-o", "DIR/out.xml", "--json"),
             said(tmp_path, *words, "-o", "DIR/out.xml"),
             said(tmp_path, *words, "-o", "DIR/out.xml", "--force", "--width", "24", "--spp", "7",
                  "--seed", "4"),
             said(tmp_path, *words, "-o", "DIR/paints.csv"),
             said(tmp_path, *words, "-o", "DIR/p.xml", "--light-id", "none"),
             said(tmp_path, *words, "-o", "DIR/p.xml", "--device", "x")]
    recorded(found, case="answers")
    recorded(asked, rtol=1e-5, case="what is asked of the fit")         # single floats
    recorded(content_of(tmp_path / "out.xml", [tmp_path]), case="file")


def test_templates_of_flat_photos_are_developed_as_they_are(tmp_path, recorded):
    """A session's own photo, as ``develop`` shows it to a person."""
    write_flat(tmp_path / "s")
    recorded(said(tmp_path, "develop", "DIR/s/photos/sample.dng", "-o", "DIR/o.exr"), rtol=1e-4)
