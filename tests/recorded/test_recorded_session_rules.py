"""What session.toml may say, its defaults, and every sentence about what does not go together."""
from pathlib import Path

import numpy as np
import test_recorded_sessions_box as box
from whole_sessions import compact

from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.session.config.curve_sources import LightTable
from spectrabox.session.config.session_file import session_of_text, try_read_session
from spectrabox.session.config.session_schema import SessionTables
from spectrabox.session.config.template import TEMPLATES, template_names
from spectrabox.session.flat.new_session import FlatOrder, session_of
from spectrabox.session.stages.order import all_stages, stages_in_order, stages_of

SCENE = """
[photos]
object = "photos/box.dng"
chart = "photos/chart.dng"
[chart]
scene = "scene/chart.xml"
[light]
spectrum = "spectra/light.csv"
[scene]
file = "scene/box.xml"
[materials.white]
bsdf = "white"
[materials.red]
"""
FLAT = """
[photos]
object = "photos/sample.dng"
[light]
spectrum = "unknown"
[regions.a]
rect = [1, 2, 30, 40]
[regions.b]
polygon = [[1, 2], [30, 4], [5, 60]]
"""
BOX = box.TOML.format(corners='{ "back top left" = [100, 20], "back top right" = [200, 21], "back '
                      'bottom left" = [100, 150], "back bottom right" = [201, 151], "block front '
                      'top left" = [90, 90], "block front top right" = [140, 92] }')
SECOND = '[views.second]\nphoto = "photos/second.dng"\n'
# old and new text of the session of a scene
OF_SCENE = [
    ("[materials.red]", '[materials.red]\nbsdf = "white"'),
    ("[materials.red]", '[materials.red]\nknown = "r.csv"'),
    ('bsdf = "white"\n[materials.red]', 'known = "w.csv"\n[materials.red]\nknown = "r.csv"'),
    ("[materials.red]", '[materials.red]\nfamily = "paints"'),
    ("[materials.red]", '[materials.red]\nfamily = ["Cloth", "FUR"]'),
    ("[materials.red]", '[materials."white "]'), ("[materials.red]", '[materials.WHITE]'),
    ("[materials.red]", "[materials.-red]"), ("[materials.red]", f"[materials.{'r' * 80}]"),
    ("[materials.red]", f"[materials.{'r' * 81}]"),
    ("[materials.red]", "[sampling]\nthrough = \"transport\"\nmethod = \"uniform\""),
    ("[materials.red]", "[sampling]\nthrough = \"transport\""),
    ("[materials.red]", "[reconstruct]\nwidth = 15"),
    ("[materials.red]", "[reconstruct]\nwidth = 16"),
    ("[materials.red]", "[reconstruct]\nwidths = 20"),
    ("[materials.red]", '[reconstruct]\nengine = "gradient"\n' + SECOND),
    ("[materials.red]", '[reconstruct]\nengine = "gradient"\n[picture]'),
    ("[materials.red]", "[reconstruct]\nlight_error = 0.01\nmixing_error = 0.02\n[picture]"),
    ("[materials.red]", '[scale]\nfrom = "material"'),
    ('bsdf = "white"', 'known = "w.csv"\n[scale]\nfrom = "material"'),
    ("[chart]", "[chart]\ncorners_px = [[1, 2], [3, 4], [5, 6]]"),
    ("[chart]", "[chart]\ncorners_px = [[1, 2], [3, 4], [5, 6], [7, 8]]"),
    ("[chart]", "[chart]\ncorners_px = [[1, 2], [3, 4], [5, 6], [7, 8, 9]]"),
    ("[chart]", f"[chart]\nleave_out = {list(range(1, 17))}"),
    ("[chart]", f"[chart]\nleave_out = {list(range(1, 18))}"),
    ("[chart]", "[chart]\nleave_out = [0]"), ("[chart]", "[chart]\nleave_out = [24, 24]"),
    ("[chart]", "[chart]\nleave_out = [25]"),
    ("[chart]", '[chart]\nlayout = "Digital SG"\nleave_out = [25, 140]'),
    ("[chart]", '[chart]\nlayout = "Digital SG"\nleave_out = [141]'),
    ("[chart]", '[chart]\nlayout = "SpyderCheckr 48"\nleave_out = [48]'),
    ("[chart]", "[drift]\nchart_px = [[[1, 2], [3, 4], [5, 6], [7, 8]]]\n[chart]"),
    ('scene = "scene/chart.xml"', ""), ('chart = "photos/chart.dng"', ""),
    ('chart = "photos/chart.dng"', '[sensitivity]\nfrom = "c.csv"\n[drift]\nchart_px = [[[1, 2]]]\n'
     'object_px = [[[1, 2]]]\n[scale]\nfrom = "material"'),
    ('"photos/box.dng"', '{ r = "r.dng", g = ["g.dng", "g2.dng"] }'), ('"photos/box.dng"', "{ }"),
    ('"photos/box.dng"', '{ r = "r.dng", "R " = "g.dng" }'), ('"photos/box.dng"', "[]"),
    ('chart = "photos/chart.dng"', 'chart = "c.dng"\nflat = { r = "r.dng", x = "x.dng" }'),
    ("[materials.red]", SECOND), ("[materials.red]", SECOND + 'chart = "photos/c2.dng"'),
    ("[materials.red]", SECOND + "turn_deg = 20"),
    ("[materials.red]", SECOND + "camera = { at_mm = [0, 1, 2], look_at_mm = [0, 1, 0], "
     "fov_deg = 40 }"),
    ("[materials.red]", SECOND + 'light = "led"'), ('"spectra/light.csv"', '"halogen"'),
    ('"spectra/light.csv"', '"halogen"\nby_id = { a = "led", b = "b.csv" }'),
    ('"spectra/light.csv"', '"led"\n[sensitivity]\nmethod = "smooth"'),
    ('"spectra/light.csv"', '"led"\n[sensitivity]\nfrom = "c.csv"'),
    ('"spectra/light.csv"', "{ cct = 1499 }"), ('"spectra/light.csv"', "{ cct = 1500 }"),
    ('"spectra/light.csv"', '{ file = "a.csv", word = "led" }'), ('"spectra/light.csv"', "{ }"),
    ("[materials.red]", "[picture]\nrect = [1, 2, 1, 4]"),
    ("[materials.red]", "[picture]\nrect = [1, 2, 3]"),
    ("[materials.red]", '[picture]\nlight = "D66"'),
    ("[materials.red]", "[picture]\nbands_nm = [399.9]"),
    ("[materials.red]", "[picture]\nbands_nm = [400, 700, 700.1]"),
    ("[materials.red]", '[picture]\nfamily = "stones"'),
    ("[materials.red]", "[picture]\nstep_nm = 7"),
    ("[materials.red]", "[regions.a]\nrect = [1, 2, 3, 4]"),
    ("[scene]\nfile = \"scene/box.xml\"", ""),
    ('[materials.white]\nbsdf = "white"\n[materials.red]', ""), ("[scene]", "[scene"),
    ("[light]", "[lights]"), ('object = "photos/box.dng"', ""),
    ("", "[session]\nname = \"a\\nb\"\n"),
    ('file = "scene/box.xml"', 'file = "scene/box.xml"\nbox = { }'), ("[materials.red]",
                                                                     "[camera]\nlens = 3")]
OF_FLAT = [
    ("[regions.b]", "[regions.b]\nrect = [1, 2, 3, 4]"), ("rect = [1, 2, 30, 40]", ""),
    ("rect = [1, 2, 30, 40]", "rect = [1, 2, 30]"),
    ("rect = [1, 2, 30, 40]", "rect = [1, 2, 30, 2]"), (", [5, 60]]", "]"), ("[5, 60]", "[5]"),
    ("[regions.b]", '[regions.b]\nphoto = "second"'),
    ("[regions.b]", SECOND + '[regions.b]\nphoto = ["second", "photo"]'),
    ("[regions.b]", SECOND + '[regions.b]\nphoto = "third"'),
    ("[regions.a]", SECOND + '[picture]\n[regions.a]\nphoto = "second"'),
    ("[regions.a]", '[chart]\nscene = "c.xml"\n[camera]\nlens = "l.json"\n[scale]\n[reconstruct]\n'
     "[regions.a]"),
    ("[light]", '[light]\nby_id = { a = "b.csv" }'),
    ("[regions.a]", '[sampling]\nthrough = "transport"\n[sensitivity]\nmethod = "paper"\n'
     "[regions.a]"),
    ("[regions.a]", SECOND + 'scene = "s.xml"\n[regions.a]'),
    ("[regions.a]", SECOND + "light = \"led\"\n[regions.a]"),
    ("rect = [1, 2, 30, 40]", 'rect = [1, 2, 30, 40]\nknown = "a.csv"'),
    ("[regions.b]", '[regions.b]\nknown = "b.csv"'), ("[regions.a]", "[picture]\n[regions.a]")]
OF_BOX = [
    ("turntable_mm = [-30, -220]", ""), ("on_turntable = true", ""),
    ("turn_deg = 35", "turn_deg = 361"), ("fov_deg = 40", ""), ("fov_deg = 40", "fov_deg = 151"),
    ("up = [0.05, 1, 0]", "up = [0, 0, 0]"),
    ("radius_mm = 8", ""), ("radius_mm = 8", "radius_mm = 8\nsize_mm = [3, 4]"),
    ("radius_mm = 8", "size_mm = [3, 4]"), ("radius_mm = 8", "radius_mm = 0.09"),
    ("moved_mm = [3, -2, -4]\n", ""), ('name = "block"', 'name = "floor"'),
    ('name = "block"', 'name = "lamp"'), ("size_mm = [120, 120, 120]", "size_mm = [120, 120, 0]"),
    ("size_mm = [120, 120, 120]", "radius_mm = 3"), ('"back top left"', '"back top lift"'),
    ('"back top left" = [100, 20],', ""), ("[scene.box.chart]", "[camera]\nlens = \"l.json\"\n"
                                           "[scene.box.chart]"),
    ("[scene.box.chart]", '[chart]\nscene = "c.xml"\n[scene.box.chart]'),
    ("look_at_mm = [10, 60, 500]", "look_at_mm = [10, 60, 20]"),
    ("leave_out = [9]", 'leave_out = [9]\nscene = "c.xml"'),
    ("[views.turned]", '[views.turned]\nscene = "s.xml"'),
    ("[scene.box.chart]", "[scene.box.other]"), ('shape = "box"', 'shape = "cone"')]


def own_words(sentence):
    """A sentence without what Python's own reader of TOML adds, which changes with its version."""
    return sentence.partition("is not valid TOML:")[0]


def said_of(text, changes, folder):
    """The sentences about each change, its number first."""
    found = {}
    for number, (old, new) in enumerate(changes):
        assert old in text, old
        config, problems = session_of_text(text.replace(old, new, 1), folder)
        found[f"{number} {new.splitlines()[-1] if new else 'without ' + old.splitlines()[0]}"] = \
            own_words(" | ".join(problems))
        assert (config is None) == bool(problems)
    return found


def test_every_sentence_about_what_does_not_go_together(recorded, tmp_path):
    limits = said_of(BOX, [("radius_mm = 8", "radius_mm = 0.09"),
                           ("width_mm = 480", "width_mm = 100001")], tmp_path)
    assert all("0.1 to 100000 is possible" in said for said in limits.values())
    recorded({"scene": said_of(SCENE, OF_SCENE, tmp_path), "flat": said_of(FLAT, OF_FLAT, tmp_path),
              "box": said_of(BOX, OF_BOX, tmp_path)})


def test_what_a_session_says_and_what_it_does_not(recorded, tmp_path):
    for name, text in {"scene": SCENE, "flat": FLAT, "box": BOX}.items():
        config, problems = session_of_text(text + SECOND, tmp_path)
        assert problems == []
        told = {key: getattr(config, key) for key in ("flat", "chart_in_place", "needs_chart")}
        views = [{"name": view.name, "photo": view.photo_files, "chart": view.chart_files,
                  "light": view.light.files, "scene": view.scene, "turn": view.turn_deg,
                  "record": view.record("photo"), "camera": view.camera is not None}
                 for view in config.all_views]
        recorded({"all": compact(config.model_dump(mode="json", exclude={"folder"})), "told": told,
                  "views": views, "with chart": [view.name for view in config.views_with_chart],
                  "photos of regions": [region.photos for region in config.regions.values()],
                  "outlines": [region.outline() for region in config.regions.values()]}, case=name)


def test_limits_of_every_key(recorded):
    def limits(node, path=""):
        if isinstance(node, dict):
            for name, value in node.items():
                if name not in ("description", "title"):
                    yield from limits(value, f"{path}.{name}")
        elif isinstance(node, list):
            for value in node:
                yield from limits(value, f"{path}[]")
        else:
            yield f"{path} {node}"

    made = SessionTables.model_json_schema()
    tables = {"session": {"properties": made["properties"]}} | made["$defs"]
    recorded({name: ";".join(limits(table)) for name, table in tables.items()})


def test_lights_are_stated_or_not(recorded):
    recorded({word: LightTable(word=word).stated for word in (
        "unknown", "daylight", "led", "D65", "A", "FL3.15", "Fluorescent", "LED-B3")})


def test_files_that_cannot_be_read_are_said(recorded, tmp_path):
    def said(content):
        (tmp_path / "session.toml").write_bytes(content)
        return [own_words(sentence.replace(str(tmp_path), ""))
                for sentence in try_read_session(tmp_path)[1]]

    missing = [each.replace(str(tmp_path), "") for each in try_read_session(tmp_path)[1]]
    found = {"missing": missing, "latin": said(b'[session]\nname = "\xe9"\n'),
             "mark": said(b"\xef\xbb\xbf" + SCENE.encode()), "windows":
             said(SCENE.replace("\n", "\r\n").encode()), "number": said(b"a = " + b"1" * 5000),
             "empty": said(b"")}
    file = try_read_session(tmp_path / "session.toml")[1]
    recorded(found | {"file": [each.replace(str(tmp_path), "") for each in file]})


def test_stages_stand_in_order(recorded):
    order = list(stages_of(False))
    recorded({"all": all_stages(), "flat": list(stages_of(True)), "scene": order,
              "functions": {name: f"{stage.module} {stage.function}" for flat in (True, False)
                            for name, stage in stages_of(flat).items()},
              "only": [stages_in_order(only, order) for only in (
                  None, "", "sample,chart", " reconstruct , chart ,x", "photo,photo")]})


def test_templates_are_what_they_were(recorded):
    recorded({name: compact({"lines": (TEMPLATES / f"{name}.toml").read_text(
        encoding="utf-8").splitlines()}) for name in template_names()})


def test_a_session_is_written_for_a_flat_photo(recorded, tmp_path):
    files = ("photo.dng", "chart.dng", "card.dng", "light.csv", "a.csv", "reference.csv")
    for file in files:
        (tmp_path / file).write_text(file, encoding="utf-8")
    (tmp_path / "other.dng").write_text("another", encoding="utf-8")
    plain = FlatOrder(tmp_path / "photo.dng", {"a b": (1, 2, 3.5, 4)})
    every = FlatOrder(
        tmp_path / "photo.dng", {"a": (1, 2, 3, 4), "card": (5, 6, 7, 8), "sky": (9, 1, 2, 3)},
        str(tmp_path / "light.csv"), tmp_path / "chart.dng", tmp_path / "card.dng",
        ((1.5, 2), (3, 4), (5, 6), (7, 8)), {"a": ("paint", "textile")}, {"card": "0.9"},
        {"sky": str(tmp_path / "a.csv")}, "SpyderCheckr 24", str(tmp_path / "reference.csv"), True,
        "A")

    def said(order, folder):
        try:
            with session_of(order, folder) as made:
                return made
        except SpectraboxError as error:
            return f"{type(error).__name__}: {error}".replace(str(tmp_path), "")

    found = {}
    for name, order in {"plain": plain, "every": every}.items():
        with session_of(order, tmp_path / name) as made:
            found[name] = (made / "session.toml").read_text(encoding="utf-8")
            found[f"{name} files"] = {
                path.relative_to(made).as_posix(): path.read_text(encoding="utf-8")
                if path.suffix == ".csv" else "" for path in sorted(made.rglob("*"))}
    beside = said(plain, None)
    assert beside == tmp_path / "photo-flat"
    found["again"] = said(plain, tmp_path / "plain")
    found["another photo"] = said(FlatOrder(tmp_path / "other.dng", {}), tmp_path / "plain")
    (tmp_path / "plain" / "session.toml").write_text("edited", encoding="utf-8")
    found["edited"] = said(plain, tmp_path / "plain")
    found["no session"] = said(plain, tmp_path)
    found["a file"] = said(plain, tmp_path / "a.csv")
    found["missing"] = said(FlatOrder(tmp_path / "x.dng", {}), None)
    for number in ("1.0", "1.01", "0", "nan", "b.csv"):
        found[f"known {number}"] = said(FlatOrder(tmp_path / "photo.dng", {"a": (1, 2, 3, 4)},
                                                  known={"a": number}), tmp_path / f"k {number}")
        found[f"left {number}"] = (tmp_path / f"k {number}").exists()
    recorded({name: str(value).replace(str(tmp_path), "") if not isinstance(value, dict) else value
              for name, value in found.items()})


def test_outlines_of_regions_go_round():
    config, _ = session_of_text(FLAT, Path())
    corners = np.array(config.regions["a"].outline())
    x, y = corners.T
    area = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    assert area == 29 * 38
