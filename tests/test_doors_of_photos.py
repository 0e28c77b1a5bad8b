"""From photo to verdict there is one way: a session and the library enter the same functions and
find the same spectra and verdicts. What a session does besides lays out its report and its answer.
"""
import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from flat_example import HEAD, MEASURED_CHART, PAINTS, picture, rect_of, write_flat
from test_both_doors import command, entered

import spectrabox as sb
from spectrabox.fixtures import lamp
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.report.pictures import plain_values

# a session keeps records under keys, draws its photos and lays out a report
LAYOUT = ("measure/steps/declared_steps.py", "capture/photo/image_writers.py",
          "capture/photo/preview.py", "capture/photo/metadata.py", "measure/words.py",
          "measure/plots.py", "measure/surfaces/colour_comparison.py")
# what the report and files beside it alone show of a result, the choice of a kept one's kind, and
# what its keys ask
NAMED = {"result_of", "lab_error", "srgb", "untested", "mostly_in_doubt", "in_doubt", "words",
         "certified_sentence", "unknown_families", "headline", "doubts", "passed", "light_scale",
         "metamers", "scenes", "place", "bsdf_reflectances", "chart_overlay", "as_intended",
         "spectrum", "grid", "covariances", "noise_and_disagreement"}
# what the demo's session.toml states besides: truths, and where a scene was refined
STATED = {"score", "_rmse", "_share_inside", "refined_placements"}
# what session.toml states, and the keeper in memory
LIBRARY = {"photo_orientation", "raw_orientation", "keep", "read", "records", "light"}
GEL = 1 / (1 + np.exp((NM - 570) / 12))
SMALL = (208, 312)
UNSTATED = HEAD.removeprefix(MEASURED_CHART)    # a chart of which nobody has said anything
WARM = NM**-5.0 / np.expm1(1.438777e7 / NM / 2856)


def take(folder, name, power):
    """A photo of the same paints and chart in other light."""
    write_photo(folder / "photos" / f"{name}.dng", picture(power=power), Fraction(1, 30),
                np.random.default_rng(11))
    return folder / "photos" / f"{name}.dng"


def of_gel(folder):
    photo, file = take(folder, "gel", lamp.radiance(NM) * GEL), folder / "spectra" / "gel.csv"
    file.write_text(table_text(NM, {"value": GEL}, quantity=Quantity.RELATIVE, source="gel"))
    return ('[views.gel]\nphoto = "photos/gel.dng"\nfilter = "spectra/gel.csv"\n',
            {"filtered": {photo: file}})


def of_second_lamp(folder):
    photo = take(folder, "warm", WARM)
    return '[views.warm]\nphoto = "photos/warm.dng"\nlight = "unknown"\n', {
        "also": {photo: "unknown"}}


def of_known_card(folder):
    file = folder / "spectra" / "white_wall.csv"
    return '', {"known": {"white_wall": file}}


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """What is loaded once is loaded, after a photo with all that further ones state."""
    folder = write_flat(tmp_path_factory.mktemp("warm") / "session")
    given = of_gel(folder)[1] | of_second_lamp(folder)[1]
    parts = {"card": rect_of("white_wall"), "wall": rect_of("green_wall")}
    sb.flat(folder / "photos" / "sample.dng", parts, draws=1000, **given,
            known={"card": folder / "spectra" / "white_wall.csv"})


@pytest.mark.usefixtures("warm")
@pytest.mark.parametrize("more", [lambda folder: ("", {}), of_gel, of_second_lamp, of_known_card],
                         ids=["plain", "gel", "second lamp", "known card"])
def test_a_flat_sample(tmp_path, more):
    folder = write_flat(tmp_path / "session")
    views, given = more(folder)
    parts = {name: rect_of(name) for name in PAINTS}
    (folder / "session.toml").write_text(
        UNSTATED.replace("spectra/light.csv", "unknown") + views
        + "".join(f"[regions.{name}]\nrect = {list(parts[name])}\n"
                  + (f'known = "spectra/{name}.csv"\n' if name in given.get("known", {}) else "")
                  for name in parts), encoding="utf-8")
    def library():
        return sb.flat(folder / "photos" / "sample.dng", parts, draws=1000, **given)

    by_session, said = entered(lambda: command("run", folder))
    by_library, (result, facts) = entered(lambda: with_words(library()))
    assert_one_way(by_library, by_session)
    assert {key: value for key, value in facts.items() if key not in ("regions", "photos")} \
        == {key: said[key] for key in facts if key not in ("regions", "photos")}
    for region in said["regions"]:
        if region["known"]:
            continue
        every = result[region["name"]]
        np.testing.assert_array_equal(every.mean[::5], region["mean"])
        np.testing.assert_array_equal(every.band(0.95)[0][::5], region["lower"])
    again = sb.Session(folder)
    assert again.verdict == result.verdict
    np.testing.assert_array_equal(again["cube"].mean, result["cube"].mean)


def with_words(result):
    """A result, and what it says of itself as JSON has it."""
    assert result.text() and result.methods
    return result, json.loads(json.dumps(plain_values(result.facts())))


def assert_one_way(by_library, by_session):
    """No function is the library's alone, and those of a session alone lay out what it found."""
    assert not {(path, name) for path, name in by_library - by_session if name not in LIBRARY}
    beside = sorted(each for each in by_session - by_library
                    if each[0] not in LAYOUT and each[1] not in NAMED | STATED)
    assert not beside, "\n".join(map(str, beside))


@pytest.mark.usefixtures("light_as_stated")
def test_a_photo_taken_again_and_a_picture_of_every_pixel(tmp_path):
    folder = write_flat(tmp_path / "session")
    for name, seed in (("sample", 3), ("again", 11)):       # small: every pixel is computed twice
        write_photo(folder / "photos" / f"{name}.dng", picture(SMALL), Fraction(1, 60),
                    np.random.default_rng(seed))
    again, parts = folder / "photos" / "again.dng", {name: rect_of(name, SMALL) for name in PAINTS}
    result = sb.flat(folder / "photos" / "sample.dng", parts,
                     light=folder / "spectra" / "light.csv", also={again: "same"},
                     picture=tmp_path / "picture", draws=1000)
    (folder / "session.toml").write_text(
        f'{UNSTATED}[views.again]\nphoto = "photos/again.dng"\n[picture]\n' + "".join(
            f"[regions.{name}]\nrect = {part}\n" for name, part in parts.items()),
        encoding="utf-8")
    session = sb.Session(folder).run()
    for name in PAINTS:
        np.testing.assert_array_equal(session[name].mean, result[name].mean)
    assert session.spectra.picture.files == result.picture.files
    assert all(Path(name).is_file() for name in result.facts()["picture"]["files"])
    assert all((folder / name).is_file() for name in session.spectra.facts()["picture"]["files"])
    assert f"files in {tmp_path / 'picture'}" in result.text()
    for name in result.picture.files:
        assert (folder / "results" / "picture" / name).read_bytes() \
            == (tmp_path / "picture" / name).read_bytes()


@pytest.mark.usefixtures("mitsuba")
def test_a_scene(captured):
    def library():
        return sb.reconstruct_scene(
            captured / "photos" / "box.dng", scene=captured / "scene" / "box.xml",
            light=captured / "spectra" / "light.csv", chart_photo=captured / "photos" / "chart.dng",
            chart_scene=captured / "scene" / "chart.xml",
            flat_field=captured / "photos" / "flat.dng",
            materials=["white", "green", "red", "cube"], width=40, draws=1000)

    library()
    by_session, said = entered(lambda: command("run", captured))
    by_library, (result, facts) = entered(lambda: with_words(library()))
    assert_one_way(by_library, by_session)
    assert facts["verdict"] == said["verdict"] and facts["surfaces"] == said["surfaces"]
    spectra = sb.Session(captured)
    for name in result:
        np.testing.assert_array_equal(spectra[name].mean, result[name].mean)
