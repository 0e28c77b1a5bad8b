"""From photo to verdict there is one way: a session and the library find the same."""
import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from flat_example import HEAD, MEASURED_CHART, PAINTS, picture, rect_of, write_flat
from test_both_doors import command

import spectrabox as sb
from spectrabox.fixtures import lamp
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.report.pictures import plain_values

GEL = 1 / (1 + np.exp((NM - 570) / 12))
SMALL = (208, 312)
UNSTATED = HEAD.removeprefix(MEASURED_CHART)    # a chart of which nobody has said anything
WARM = NM**-5.0 / np.expm1(1.438777e7 / NM / 2856)


def take(folder, name, power):
    """A photo of the same paints and chart in other light."""
    write_photo(folder / "photos" / f"{name}.dng", picture(power=power), Fraction(1, 30),
                np.random.default_rng(11))
    return folder / "photos" / f"{name}.dng"


def test_a_flat_sample(tmp_path):
    """With all that can be stated: a photo through a filter, one under another lamp, a white card,
    a family; a lamp that nobody measured and a chart of which nobody has said anything.
    """
    folder = write_flat(tmp_path / "session")
    gel, warm = take(folder, "gel", lamp.radiance(NM) * GEL), take(folder, "warm", WARM)
    card, file = folder / "spectra" / "white_wall.csv", folder / "spectra" / "gel.csv"
    file.write_text(table_text(NM, {"value": GEL}, quantity=Quantity.RELATIVE, source="gel"))
    parts = {name: rect_of(name) for name in PAINTS}
    stated = {"white_wall": 'known = "spectra/white_wall.csv"\n', "cube": 'family = "paint"\n'}
    (folder / "session.toml").write_text(
        UNSTATED.replace("spectra/light.csv", "unknown")
        + '[views.gel]\nphoto = "photos/gel.dng"\nfilter = "spectra/gel.csv"\n'
        + '[views.warm]\nphoto = "photos/warm.dng"\nlight = "unknown"\n'
        + "".join(f"[regions.{name}]\nrect = {list(parts[name])}\n{stated.get(name, '')}"
                  for name in parts), encoding="utf-8")
    said = command("run", folder)
    photo = sb.open_photo(folder / "photos" / "sample.dng")
    with pytest.raises(sb.InputError, match="there is no region 'moon'"):
        sb.flat(photo, parts, families={"moon": "paint"})
    result = sb.flat(photo, parts, draws=1000, filtered={gel: file}, also={warm: "unknown"},
                     known={"white_wall": card}, families={"cube": "paint"})
    assert result["white_wall"].outcome == "The spectrum was given."
    facts = with_words(result)
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
    np.testing.assert_array_equal(again["cube"].draws(4000, 1), result["cube"].draws(4000, 1))


def with_words(result):
    """What a result says of itself, as JSON has it."""
    assert result.text() and result.methods
    return json.loads(json.dumps(plain_values(result.facts())))


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
def test_a_scene(finished):
    shares = []
    result = sb.reconstruct_scene(
        finished / "photos" / "box.dng", scene=finished / "scene" / "box.xml",
        light=finished / "spectra" / "light.csv", chart_photo=finished / "photos" / "chart.dng",
        chart_scene=finished / "scene" / "chart.xml",
        flat_field=finished / "photos" / "flat.dng",
        materials=["white", "green", "red", "cube"], width=40, draws=1000,
        progress=lambda share, message: shares.append(share))
    assert shares and result.calibration.light_scale is not None
    facts, said = with_words(result), command("run", finished)
    of_library, of_session = (      # which states truths
        [one for one in each["findings"] if not one["code"].startswith("truth.")]
        for each in (facts, said))
    assert of_library == of_session
    assert facts["surfaces"] == said["surfaces"]
    spectra = sb.Session(finished)
    for name in result:
        np.testing.assert_array_equal(spectra[name].mean, result[name].mean)
