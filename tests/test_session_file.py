import pytest

from spectrabox.radiometry.errors import InputError
from spectrabox.session.config.session_file import read_session, try_read_session
from spectrabox.session.config.template import SESSION_TEMPLATE

GOOD = """
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
"""


def problems_of(tmp_path, text):
    (tmp_path / "session.toml").write_text(text, encoding="utf-8")
    return try_read_session(tmp_path)[1]


def test_the_template_is_a_valid_session(tmp_path):
    assert problems_of(tmp_path, SESSION_TEMPLATE) == []


def test_a_plain_session_gets_the_documented_defaults(tmp_path):
    (tmp_path / "session.toml").write_text(GOOD, encoding="utf-8")
    config = read_session(tmp_path)
    assert config.sensitivity.from_chart and config.scale.source == "chart"
    assert config.sampling.level == 0.95 and config.session.seed == 1
    assert config.light.spectrum.file == "spectra/light.csv"
    assert config.light.spectrum.column is None


def test_a_spectrum_may_name_its_column(tmp_path):
    text = GOOD.replace('"spectra/light.csv"', '{ file = "spectra/light.csv", column = 2 }')
    (tmp_path / "session.toml").write_text(text, encoding="utf-8")
    assert read_session(tmp_path).light.spectrum.column == 2


@pytest.mark.parametrize("change, sentence", [
                             (("[photos]", "[foto]"), "unknown key 'foto'; did you mean 'photos'"),
                             (("bsdf = ", "bsfd = "), "unknown key 'bsfd' in [materials.white]; "
                              "did you mean 'bsdf'"),
                             (('object = "photos/box.dng"', "object = 3"),
                              "photos.object is 3; str or list or table is needed"),
                             (('object = "photos/box.dng"', ""), "photos.object is missing"),
                             (('object = "photos/box.dng"', "object = []"),
                              "photos.object is empty; name at least one"),
                             (('"photos/chart.dng"', "[]"),
                              "photos.chart is empty; name at least one, or leave it out"),
                             (('"photos/chart.dng"', "{}"),
                              "photos.chart is empty; name at least one, or leave it out"),
                             (('chart = "photos/chart.dng"', ""), "photos.chart is missing, but "
                              "sensitivities or scale are to come from it"), (('[chart]\nscene = '
                                                                               '"scene/chart.xml"',
                                                                               ""), "chart.scene "
                                                                              "is missing"),
                             (("[scene]", '[scale]\nfrom = "moon"\n[scene]'),
                              "scale.from is 'moon'"),
                             (("[scene]", '[scale]\nfrom = "material"\n[scene]'),
                              "no material has a known spectrum"),
                             (("[scene]", "[reconstruct]\nwidth = 5\n[scene]"),
                              "reconstruct.width is 5; 16 to 1024 is possible"),
                             (("[scene]", "[sampling]\nlevel = 2\n[scene]"),
                              "sampling.level is 2; 0.5 to 0.999 is possible"),
                             (("[scene]", "[reconstruct]\nengine = \"warp\"\n[scene]"),
                              "reconstruct.engine is 'warp'; auto, transport, gradient"),
                             (("[scene]", "[sampling]\nmethod = \"dice\"\n[scene]"),
                              "sampling.method is 'dice'; prior, uniform"),
                             (("[scene]", "[chart.x]\n[scene]"), "unknown key 'x' in [chart]"),
                             (('bsdf = "white"', 'bsdf = "white"\nknown = "spectra/w.csv"'),
                              "every material is known"),
                             (('bsdf = "white"',
                               'bsdf = "white"\n[materials.other]\nbsdf = "white"'),
                              "name the same BSDF 'white'"), (('[light]\nspectrum = '
                                                               '"spectra/light.csv"', ""),
                                                              "the table [light] is missing"),
                             (('bsdf = "white"', 'bsdf = "white"\nfamily = ["paint", "jam"]'),
                              "materials.white.family: 'jam' is no family of surfaces"),
                             (("[materials.white]", "[materials"), "is not valid TOML"),
                             (('scene = "scene/chart.xml"',
                               'scene = "scene/chart.xml"\ncorners_px = [[1, 2], [3, 4]]'),
                              "corners_px needs four [x, y] pairs")])
def test_each_fault_gets_its_sentence(tmp_path, change, sentence):
    assert change[0] in GOOD
    found = problems_of(tmp_path, GOOD.replace(*change))
    assert any(sentence in problem for problem in found), found


def test_all_faults_are_said_at_once(tmp_path):
    text = GOOD.replace("[photos]", "[photos]\nflatt = \"a\"").replace("bsdf = ", "bsfd = ")
    # two unknown keys: a bsdf that is not named has the material's name
    assert len(problems_of(tmp_path, text)) == 2


def test_a_missing_session_says_how_to_start_one(tmp_path):
    with pytest.raises(InputError, match="write one with 'spectrabox new"):
        read_session(tmp_path)


@pytest.mark.parametrize("name", ["../elsewhere.csv", "/etc/hostname", "spectra/../../x.csv"])
def test_a_session_cannot_reach_out_of_its_folder_unasked(tmp_path, name):
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / "session.toml").write_text(GOOD, encoding="utf-8")
    with pytest.raises(InputError, match="lies outside the session folder"):
        read_session(folder).path(name)
    read_session(folder, allow_outside=True).path(name)


def test_a_link_out_of_the_folder_is_outside_too(tmp_path):
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / "session.toml").write_text(GOOD, encoding="utf-8")
    (folder / "link.csv").symlink_to(tmp_path / "secret.csv")
    with pytest.raises(InputError, match="outside"):
        read_session(folder).path("link.csv")


@pytest.mark.parametrize("written, said", [('"unknown"', ("unknown", None, None)),
                                           ('"halogen"', ("halogen", None, None)),
                                           ('"D65"', ("D65", None, None)),
                                           ('"FL3.15"', ("FL3.15", None, None)),
                                           ("{ cct = 3200.0 }", (None, 3200.0, None)),
                                           ('"lamp.csv"', (None, None, "lamp.csv"))])
def test_a_light_may_be_a_word_a_temperature_or_a_file(tmp_path, written, said):
    (tmp_path / "session.toml").write_text(GOOD.replace('"spectra/light.csv"', written),
                                           encoding="utf-8")
    light = read_session(tmp_path).light.spectrum
    assert (light.word, light.cct, light.file) == said
    assert light.stated == (written in ('"D65"', '"FL3.15"', '"lamp.csv"'))


@pytest.mark.parametrize("change, sentence", [
    (('"spectra/light.csv"', '{ cct = 3200.0, word = "led" }'), "a light is either a file, a word"),
    (('"spectra/light.csv"', "{ cct = 300.0 }"), "1500 to 25000 is possible"),
    (('"spectra/light.csv"', '"unknown"\nby_id = { lamp = "spectra/lamp.csv" }'),
     "lamps of several spectra"),
    (('"spectra/light.csv"', '"D65"\nby_id = { lamp = "led" }'), "light.by_id.lamp is not known"),
    (('"spectra/light.csv"', '"unknown"\n[sensitivity]\nmethod = "paper"'),
     "found with the camera from the chart"),
    (('"spectra/light.csv"', '"unknown"\n[views.second]\nphoto = "b.dng"\nlight = "D65"'),
     "give it a chart photo of its own"),
    (("[chart]", "[chart]\nleave_out = [25]"), "leave_out names patch 25"),
    (("[chart]", f"[chart]\nleave_out = {list(range(1, 18))}"),
     "leaves 7 patches; 8 are needed")])
def test_what_an_unknown_light_or_a_left_out_patch_cannot_do_is_said(tmp_path, change, sentence):
    assert any(sentence in said for said in problems_of(tmp_path, GOOD.replace(*change)))


FLAT = """
[photos]
object = "photos/sample.dng"
[light]
spectrum = {first}
[views.b]
photo = "photos/b.dng"
{b}
[views.c]
photo = "photos/c.dng"
{c}
[regions.blue]
rect = [10, 10, 40, 40]
"""
FILTERED = 'filter = "orange.csv"'


@pytest.mark.parametrize("first, b, c, lamps", [
    # one word is not one lamp
    ("unknown", 'light = "unknown"', 'light = "unknown"', ["photo", "b", "c"]),
    ("halogen", 'light = "halogen"', 'same_light_as = "b"', ["photo", "b", "b"]),
    ("unknown", "light = {cct = 3200}", "light = {cct = 3200}", ["photo", "b", "c"]),
    # one measured file, or one published spectrum, is
    ("lamp.csv", 'light = "other.csv"', 'light = "lamp.csv"', ["photo", "b", "photo"]),
    ("D65", 'light = "A"', 'light = "A"', ["photo", "b", "b"]),
    # a light left out is that of [photos]; statements follow one another
    ("unknown", "", 'same_light_as = "b"', ["photo", "photo", "photo"]),
    ("unknown", 'same_light_as = "c"', 'light = "unknown"', ["photo", "c", "c"])])
def test_photos_are_under_one_lamp_by_statement_and_never_by_a_word(tmp_path, first, b, c, lamps):
    text = FLAT.format(first=f'"{first}"', b=b, c=c)
    (tmp_path / "session.toml").write_text(text, encoding="utf-8")
    assert [view.lamp_of for view in read_session(tmp_path).all_views] == lamps


@pytest.mark.parametrize("b, c, moved", [
    ('lamp = "moved"', 'same_light_as = "b"', ["", "b", "b"]),
    ('same_light_as = "photo"\nlamp = "moved"', 'lamp = "moved"', ["", "b", "c"]),
    ('lamp = "moved"', 'same_light_as = "b"\nlamp = "moved"', ["", "b", "c"])])
def test_a_lamp_that_was_moved_is_the_same_lamp_elsewhere(tmp_path, b, c, moved):
    text = FLAT.format(first='"unknown"', b=b, c=c)
    (tmp_path / "session.toml").write_text(text, encoding="utf-8")
    views = read_session(tmp_path).all_views
    assert [view.lamp_of for view in views] == ["photo"] * 3
    assert [view.moved_for for view in views] == moved
    assert views[1].chart_files == ("photos/b.dng",)        # whose field of light is its own


@pytest.mark.parametrize("b, c, complaint", [
    ('light = "A"\nlamp = "moved"', "", "views.b.light names one; leave one out"),
    ('same_light_as = "d"', "", "views.b.same_light_as names 'd'; the session's photos are photo, "
     "b, c"),
    ('same_light_as = "c"', 'same_light_as = "b"', "b -> c -> b goes round in a circle"),
    ('same_light_as = "photo"\nlight = "A"', "", "leave one out")])
def test_a_lamp_in_common_must_be_somebodys(tmp_path, b, c, complaint):
    assert any(complaint in problem
               for problem in problems_of(tmp_path, FLAT.format(first='"unknown"', b=b, c=c)))


def test_a_filter_changes_the_light_and_needs_a_chart_of_its_own(tmp_path):
    text = FLAT.format(first='"unknown"', b=FILTERED, c='same_light_as = "b"\nfilter = "unknown"')
    (tmp_path / "session.toml").write_text(text, encoding="utf-8")
    first, b, c = read_session(tmp_path).all_views
    assert first.lamp_of == b.lamp_of == c.lamp_of and first.filter is None
    assert b.filter.file == "orange.csv" and c.filter is not None and c.filter.file is None
    assert [view.chart_files for view in (b, c)] == [("photos/b.dng",), ("photos/c.dng",)]
    assert not b.same_light(first) and not b.same_light(c) and b.same_light(b)


@pytest.mark.parametrize("stated, alike", [('filter = "orange.csv"', True),
                                           ('filter = "unknown"', False)])
def test_two_filters_that_nobody_measured_are_two(tmp_path, stated, alike):
    also = f'same_light_as = "photo"\n{stated}'
    (tmp_path / "session.toml").write_text(FLAT.format(first='"unknown"', b=also, c=also), "utf-8")
    (tmp_path / "orange.csv").write_text("400,0.1\n500,0.2\n700,0.9\n", "utf-8")
    config = read_session(tmp_path)
    for _, b, c in (config.all_views, config.capture().views):
        assert b.same_light(c) is c.same_light(b) is alike and b.same_light(b)
