"""Charts as people photograph them: in haze, with a saturated or soiled patch; SPECTRABOX_DATA
names the folder of real ones, in raw_charts/.
"""
import os
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from flat_example import CHART, PAINTS, light_over, picture, rect_of

import spectrabox as sb
from spectrabox.fixtures.flat_sample import write_photo
from spectrabox.fixtures.paints import NM, paint
from spectrabox.radiometry.errors import CheckError, ClippedPhotoError, InputError
from spectrabox.radiometry.findings import faults

REGIONS = {name: rect_of(name) for name in PAINTS}


def real_photo(name):
    if "SPECTRABOX_DATA" not in os.environ:
        pytest.skip("SPECTRABOX_DATA names no folder of real chart photos")
    return Path(os.environ["SPECTRABOX_DATA"]) / "raw_charts" / f"{name}.dng"


def flat(folder, light, brightest=0.75, regions=REGIONS):
    write_photo(folder / "photo.dng", light, Fraction(1, 60), np.random.default_rng(3),
                brightest=brightest)
    return sb.flat(folder / "photo.dng", regions)


def covered(result):
    """Share of wavelengths of all paints that the bands hold."""
    held = []
    for name, each in result.items():
        (lower, upper), truth = each.band(), np.interp(each.nm, NM, paint(name)[1])
        held.append((lower <= truth) & (truth <= upper))
    return np.mean(held)


def test_a_veil_over_the_photo_is_taken_off_and_said(tmp_path):
    light = picture()
    result = flat(tmp_path, light + 0.12 * light.max(axis=(0, 1)))
    assert result.verdict == "warn" and any("veils the chart" in one for one in result.reasons)
    assert any("Veiling glare of 11 %" in reason for reason in result.reasons)
    # about three independent readings of each of four paints: 95 % less 2 standard errors
    assert covered(result) > 0.82


def test_a_saturated_band_is_left_out_and_what_that_costs_is_said(tmp_path):
    light = picture()
    # under a lamp this far the white wall is as bright as the patch, and saturated itself
    darker = {name: rect for name, rect in REGIONS.items() if name != "white_wall"}
    result = flat(tmp_path, light, brightest=1.15, regions=darker)
    assert result.chart_check.saturated == ()       # red and blue of white are not
    assert any("1 of 24 patches are saturated (white 9.5)" in reason
               for reason in result.reasons)
    lost, = [one.values for one in result.calibration.findings
             if one.code == "calibration.patch-clipped"]
    assert (lost["patch"], lost["bands"]) == ("white 9.5", ["G"])
    assert lost["error"] > lost["error_if_used"]
    assert covered(result) > 0.8        # as above, of three paints
    with pytest.raises(ClippedPhotoError, match=r"white 9.5, neutral 8\); halve the exposure"):
        flat(tmp_path, light, brightest=1.5)


@pytest.mark.parametrize("factor, named", [(0.75, True), (1.0, False)])
def test_a_patch_in_a_shadow_is_named_and_others_are_not(tmp_path, factor, named):
    light = light_over()
    pitch = CHART[2] / 6 * light.shape[1]
    x, y = int(CHART[0] * light.shape[1] + 4 * pitch), int(CHART[1] * light.shape[1])
    light[y:y + int(pitch), x:x + int(pitch)] *= factor
    found = flat(tmp_path, picture(light=light)).chart_check.findings
    # a level that is off is evidence, a colour alone is none
    rows = [row for one in faults(found) for row in one.values.get("patches", ())]
    assert [row["patch"] for row in rows] == ["blue flower"] * named
    assert all(row["reason"] == "level" and row["brighter"] < -0.15 for row in rows)


@pytest.mark.parametrize("further", [
    {"also": "unknown"}, {"also": "same"}, {"also": "moved"}, {"filtered": "unknown"}])
def test_a_photo_of_another_scene_is_not_taken_for_one_of_the_same_samples(tmp_path, further):
    first, other = (real_photo(f"industrial_{name}") for name in ("outdoor4", "indoor1"))
    (option, what), = further.items()
    regions = {"chair": (660, 1235, 840, 1285)}
    with pytest.raises(InputError, match=r"with Spectrabox Infinite Outdoor4 SN0001 and "
                       ".*indoor1.dng with Spectrabox Infinite Indoor1 SN0001.*one camera"):
        sb.flat(first, regions, **{option: {other: what}})
    # the same two, as if one camera had taken both
    for name, path in (("first", first), ("other", other)):
        (tmp_path / f"{name}.dng").write_bytes(
            path.read_bytes().replace(b"Outdoor4", b"Outdoors").replace(b"Indoor1\0",
                                                                         b"Outdoors"))
    with pytest.raises(CheckError, match=r"in .*other.dng the chart lies 219 pixels from where it "
                       r"lies in .*first.dng"):
        sb.flat(tmp_path / "first.dng", regions, **{option: {tmp_path / "other.dng": what}})


@pytest.mark.parametrize("reflectance", [0.9, 0.5, 0.15])
def test_a_light_of_another_colour_is_off_by_as_much_however_bright_it_is(reflectance):
    """A wall in the sun, stated to be a grey card, far brighter than the chart's light tells."""
    result = sb.flat(real_photo("industrial_outdoor4"), {"wall": (800, 360, 1050, 400),
                                                         "card": (1060, 360, 1300, 400)},
                     known={"card": reflectance})
    values = next(one.values for one in result.findings if one.code == "flat.known-other-colour")
    assert (values["band"], values["off"] < 0) in ((3, True), (1, False))
    assert abs(values["off"]) == pytest.approx(0.15, abs=0.05)


def test_a_chart_photo_of_another_camera_is_refused():
    with pytest.raises(InputError, match=r"Indoor1 SN0001 and .*Outdoor4 SN0001: curves and"):
        sb.flat(real_photo("industrial_outdoor4"), {"chair": (660, 1235, 840, 1285)},
                chart_photo=real_photo("industrial_indoor1"))


@pytest.mark.parametrize("name", ["canon550d_dusk", "industrial_indoor1", "industrial_outdoor2",
                                  "industrial_outdoor4"])
def test_a_real_chart_is_fitted_and_its_poor_patches_have_reasons(name):
    check = sb.fit_camera(real_photo(name), light="unknown").chart_check
    rmse, inside, expected = check.means
    # as measured, docs/results/flat.md
    assert rmse < 0.032 and inside > expected - 0.04
    assert set(check.poor) == {check.names[patch] for patch in np.flatnonzero(check.inside < 0.85)}
