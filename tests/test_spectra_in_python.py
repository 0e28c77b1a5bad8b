"""Surfaces in Python: compared with each other and with measured spectra, and written.

Real photos: SPECTRABOX_DATA=DIR, the folder that holds raw_charts/.
"""
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import spectrabox as sb
from spectrabox.api.arguments import as_curves, as_filter, as_light
from spectrabox.radiometry.appearance import ciede2000, reflectance_to_lab
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.spectrum_files import read_table

NAMED = {"camera": "Nikon 5100 (NPL)", "light": "D65", "white": [1, 1, 1]}
NM = np.arange(400.0, 701.0, 5.0)
INDOOR = Path(os.environ.get("SPECTRABOX_DATA", "no-data")) / "raw_charts/industrial_indoor1.dng"


@pytest.fixture(scope="module")
def orange():
    return sb.sample([0.53, 0.24, 0.08], noise=0.003, **NAMED)


@pytest.fixture(scope="module")
def demos(finished_painting):
    """A folder with ``painting``, as the demo command writes it."""
    return finished_painting.parent


@pytest.mark.skipif(not INDOOR.exists(), reason="SPECTRABOX_DATA names no folder of photos")
def test_two_squares_of_one_card_are_not_told_apart_and_two_paints_are():
    """The left and the right half of patches of a real chart."""
    photo = sb.open_photo(INDOOR)
    corners = sb.find_chart(photo).corners
    halves = {}
    for patch in (14, 18, 21):
        (x0, y0), (x1, y1) = corners[patch].min(axis=0), corners[patch].max(axis=0)
        middle = (x0 + x1) / 2
        halves |= {f"{patch} left": (x0 + 1, y0 + 1, middle - 1, y1 - 1),
                   f"{patch} right": (middle + 1, y0 + 1, x1 - 1, y1 - 1)}
    result = sb.flat(photo, halves)
    for patch in (14, 18, 21):
        both = result.compare(f"{patch} left", f"{patch} right")
        value, lower, upper = both.delta_e()
        assert not both.distinct and "cannot tell these colours apart" in both.sentence
        assert lower == 0 and value <= upper and "±" not in repr(both)
        # the same difference either way round
        other = result.compare(f"{patch} right", f"{patch} left")
        np.testing.assert_array_equal(other.spectrum.value, -both.spectrum.value)
        assert other.difference == pytest.approx(both.difference)
    white, red = result["18 left"], result["14 left"]
    both = result.compare("18 left", "14 left")
    value, lower, upper = both.delta_e("A")
    assert both.distinct and 0 < lower < value < upper
    # one posterior, whose draws' mean is a hundredth of their spread from its own
    np.testing.assert_allclose(both.lab().value, white.lab().value - red.lab().value, atol=0.3)
    # two whites share the white level, which is most of what each errs by
    alike = result.compare("18 left", "18 right").lab().standard_error[0]
    assert alike < 0.8 * np.hypot(*(result[f"18 {half}"].lab().standard_error[0]
                                    for half in ("left", "right")))


def test_a_given_spectrum_has_no_error_to_share(demos, monkeypatch):
    monkeypatch.chdir(demos)
    result = sb.flat("painting/photos/painting.dng",
                     {"wall": (986, 462, 1073, 537), "card": (1006, 751, 1165, 806)},
                     known={"card": 0.94})
    with pytest.raises(InputError, match="'card' was not estimated with the learnt prior"):
        result.compare("wall", "card")
    with pytest.raises(KeyError, match="there is no surface 'walls'"):
        result.compare("walls", "wall")
    assert result["wall"].delta_e(result["card"]).value > 20


def test_a_photos_estimates_are_the_results_that_its_facts_tell(demos, monkeypatch):
    monkeypatch.chdir(demos)
    nm = np.arange(400.0, 701.0)
    truth = 0.5 + 0.1 * np.sin(nm / 40)
    result = sb.flat("painting/photos/painting.dng", {"wall": (986, 462, 1073, 537)},
                     truth={"wall": (nm, truth)})
    wall, facts = result["wall"], result.facts()["regions"][0]
    assert json.loads(json.dumps(wall.facts())) == json.loads(json.dumps(facts))
    assert facts["lab_d65"] == wall.lab().value.tolist()
    assert facts["lab_d65_error"] == wall.lab().standard_error.tolist()
    assert facts["variance_shares"] == wall.causes
    off = np.interp(nm, wall.nm, wall.mean) - truth
    assert facts["rmse_mean"] == wall.scores.rmse_mean == pytest.approx(np.sqrt(np.mean(off**2)))
    assert facts["delta_e00_mean"] == pytest.approx(wall.delta_e((nm, truth)).value)


def test_a_colour_difference_takes_whatever_is_a_reflectance(orange, tmp_path):
    colour = pytest.importorskip("colour")
    truth = np.clip(orange.mean + 0.02, 0, 1)
    expected = ciede2000(reflectance_to_lab(NM, orange.mean, "A"),
                         reflectance_to_lab(NM, truth, "A"))
    file = tmp_path / "truth.csv"
    file.write_text("wavelength_nm,reflectance\n" + "\n".join(
        f"{nm:g},{value:.9f}" for nm, value in zip(NM, truth, strict=True)), encoding="utf-8")
    spectrum = colour.SpectralDistribution(dict(zip(NM.tolist(), truth.tolist(), strict=True)))
    for other in (truth, truth.tolist(), (NM, truth), file, str(file), spectrum):
        assert orange.delta_e(other, "A").value == pytest.approx(float(expected), abs=1e-6)
        orange.plot(truth=other)


@pytest.mark.parametrize("arguments", [("D65",), ("D65", np.ones(61)), (np.ones(61), 5)])
def test_a_colour_difference_says_how_it_is_asked_for(orange, arguments):
    with pytest.raises(InputError, match=r"delta_e\(other, light='D65'\)"):
        orange.delta_e(*arguments)


@pytest.mark.parametrize(("other", "says"), [
    (np.ones(31), r"\(31,\) values were given for the 61 wavelengths from 400 to 700 nm"),
    (np.full(61, 40.0), "looks like percent"), (None, "NoneType is no spectrum"),
    ((NM, np.ones(5)), r"wavelengths of shape \(61,\) and values of shape \(5,\)")])
def test_a_colour_difference_says_what_is_wrong_with_a_spectrum(orange, other, says):
    with pytest.raises(InputError, match=says):
        orange.delta_e(other)


def test_spectra_of_colour_science_are_taken_wherever_a_spectrum_is(demos, monkeypatch):
    colour = pytest.importorskip("colour")
    monkeypatch.chdir(demos)

    def distribution(values):
        return colour.SpectralDistribution(dict(zip(NM.tolist(), values.tolist(), strict=True)))
    lamp, passed, card = NM / 560, 0.3 + 0.5 * (NM > 500), np.full(NM.size, 0.94)
    curves = np.exp(-(((NM - np.array([[600], [540], [450]])) / 40) ** 2))
    camera = colour.MultiSpectralDistributions(dict(zip(NM.tolist(), curves.T.tolist(),
                                                        strict=True)), labels=["R", "G", "B"])
    np.testing.assert_array_equal(as_light(distribution(lamp)).values,
                                  as_light((NM, lamp)).values)
    np.testing.assert_array_equal(as_filter(distribution(passed)).transmittance,
                                  as_filter((NM, passed)).transmittance)
    np.testing.assert_array_equal(as_curves(camera), as_curves((NM, curves)))
    one, other = (sb.sample([0.5, 0.4, 0.3], camera=each, light=light, noise=0.01)
                  for each, light in ((camera, distribution(lamp)), ((NM, curves), (NM, lamp))))
    np.testing.assert_array_equal(one.mean, other.mean)
    library = {"grey": distribution(card)}
    assert sb.match(one, library).facts() == sb.match(one, {"grey": card}, nm=NM).facts()
    regions = {"wall": (986, 462, 1073, 537), "card": (1006, 751, 1165, 806)}
    one, other = (sb.flat("painting/photos/painting.dng", regions, known={"card": each},
                          truth={"wall": each})["wall"].mean for each in (distribution(card), 0.94))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


def test_no_function_imports_colour_science_to_take_its_spectra():
    code = ("import sys, numpy as np, spectrabox as sb; from spectrabox.api.arguments import "
            "as_light; as_light((np.arange(400., 701), np.ones(301))); print('colour' in "
            "sys.modules)")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_one_estimate_is_written_as_its_group_is(orange, tmp_path):
    path = orange.to_csv(tmp_path / "orange.csv")
    table = read_table(path)
    assert table.names[:2] == ("signal 1 mean", "signal 1 standard_deviation")
    # six digits are written
    np.testing.assert_allclose(table.values[0], orange.mean, atol=1e-6)
    many = sb.sample([[0.53, 0.24, 0.08]], noise=0.003, **NAMED)
    assert many.to_csv(tmp_path / "many.csv").read_bytes() \
        == many[0].to_csv(tmp_path / "one.csv").read_bytes()


def test_the_table_of_surfaces_has_the_errors_of_their_colours(demos, monkeypatch):
    monkeypatch.chdir(demos)
    result = sb.flat("painting/photos/painting.dng", {"wall": (986, 462, 1073, 537)})
    errors = result.facts()["regions"][0]["lab_d65_error"]
    np.testing.assert_allclose(errors, result["wall"].lab().standard_error, rtol=0.05)
    assert " ".join(f"{error:.1f}" for error in errors) in result.text()
