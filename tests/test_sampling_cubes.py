"""Hyperspectral pictures made elsewhere: every format gives the same spectra; what cannot be right
has its sentence.
"""
import json
import tracemalloc

import numpy as np
import pytest
from sampling_cameras import surface
from spectral.io import envi
from typer.testing import CliRunner

from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.evaluation.cube_regions import (
    CubeRegion,
    point_region,
    read_regions,
    region_spectra,
)
from spectrabox.sampling.evaluation.cubes import cube_of_channels, open_cube, parse_wavelengths
from spectrabox.session.cli import app

NM = np.arange(400, 701, 10.0)
HEADER = """ENVI
samples = {width}
lines = {height}
bands = {bands}
header offset = {offset}
data type = {kind}
interleave = {order}
byte order = {endian}
wavelength units = {unit}
wavelength = {{{wavelengths}}}
"""


@pytest.fixture(scope="module")
def values():
    """A picture (6, 5, 31) of five surfaces, one a column, each row a little brighter."""
    columns = np.array([surface(NM, seed) for seed in range(5)])
    return columns[None] * (1 + 0.02 * np.arange(6))[:, None, None]


def write_envi(folder, values, order="bil", endian=0, kind=4, nm=NM, unit="nm", offset=0, extra=""):
    axes = {"bsq": (2, 0, 1), "bil": (0, 2, 1), "bip": (0, 1, 2)}[order]
    height, width, bands = values.shape
    stored = values.transpose(axes).astype(("<" if endian == 0 else ">")
                                           + {4: "f4", 5: "f8", 12: "u2"}[kind])
    (folder / "cube.img").write_bytes(b"\0" * offset + stored.tobytes())
    (folder / "cube.hdr").write_text(HEADER.format(
                                         width=width, height=height, bands=bands, offset=offset,
                                         kind=kind, order=order, endian=endian, unit=unit,
                                         wavelengths=", ".join(map(str, nm))) + extra)
    return folder / "cube.hdr"


def whole(cube):
    return cube.rows(0, cube.height)


# ---- formats -------------------------------------------------------------------------------------

@pytest.mark.parametrize("order", ["bsq", "bil", "bip"])
@pytest.mark.parametrize("endian, kind, offset", [(0, 4, 0), (1, 5, 128)])
def test_envi_is_read_in_every_order(values, tmp_path, order, endian, kind, offset):
    cube = open_cube(write_envi(tmp_path, values, order, endian, kind, offset=offset))
    np.testing.assert_allclose(whole(cube), values, atol=1e-7)  # float32
    np.testing.assert_array_equal(cube.rows(2, 4), whole(cube)[2:4])
    np.testing.assert_array_equal(open_cube(tmp_path / "cube.img").nm, NM)


@pytest.mark.parametrize("order", ["bsq", "bil", "bip"])
def test_a_picture_that_spy_wrote_is_read(values, tmp_path, order):
    envi.save_image(str(tmp_path / "cube.hdr"), values, dtype=np.float64, interleave=order,
                    metadata={"wavelength": NM.tolist(), "wavelength units": "nm"})
    cube = open_cube(tmp_path / "cube.hdr")
    np.testing.assert_array_equal(cube.nm, NM)
    np.testing.assert_array_equal(whole(cube), values)


def test_envi_counts_are_scaled_and_gaps_marked(values, tmp_path):
    counts = np.round(values * 10000)
    counts[0, 0, 0] = 65535
    cube = open_cube(write_envi(tmp_path, counts, kind=12, nm=NM / 1000, unit="Micrometers",
                                extra="reflectance scale factor = 10000\ndata ignore value = "
                                "65535\n"))
    np.testing.assert_array_equal(cube.nm, NM)
    read = whole(cube)
    assert np.isnan(read[0, 0, 0])
    np.testing.assert_allclose(read[1:], values[1:], atol=5.1e-5)  # half a count


def test_bands_in_falling_order_are_turned(values, tmp_path):
    cube = open_cube(write_envi(tmp_path, values[..., ::-1], nm=NM[::-1]))
    np.testing.assert_array_equal(cube.nm, NM)
    np.testing.assert_allclose(whole(cube), values, atol=1e-7)


@pytest.mark.parametrize("bands_first", [False, True])
def test_arrays_are_read_with_wavelengths_first_or_last(values, tmp_path, bands_first):
    array = values.transpose(2, 0, 1) if bands_first else values
    np.save(tmp_path / "cube.npy", array)
    np.savez_compressed(tmp_path / "cube.npz", cube=array, wavelengths=NM)
    np.testing.assert_array_equal(whole(open_cube(tmp_path / "cube.npy", NM)), values)
    np.testing.assert_array_equal(whole(open_cube(tmp_path / "cube.npz")), values)


def test_matlab_files_are_read(values, tmp_path):
    from scipy.io import savemat
    savemat(tmp_path / "cube.mat", {"cube": values, "bands": NM, "note": "text", "other": {"a": 1}})
    np.testing.assert_array_equal(whole(open_cube(tmp_path / "cube.mat")), values)


def test_channels_of_an_exr_are_their_wavelengths(values, tmp_path):
    from spectrabox.capture.photo.image_rows import open_channels
    from spectrabox.capture.photo.image_writers import write_exr
    write_exr(tmp_path / "cube.exr", values.astype(np.float32), [f"T.{nm:g},000000nm" for nm in NM])
    cube = cube_of_channels("cube.exr", *open_channels(tmp_path / "cube.exr"))
    np.testing.assert_array_equal(cube.nm, NM)
    np.testing.assert_allclose(cube.rows(1, 3), values[1:3], atol=1e-7)  # float32
    content = (tmp_path / "cube.exr").read_bytes()
    (tmp_path / "cut.exr").write_bytes(content[:len(content) // 2])
    with pytest.raises(InputError, match="cannot be read"):
        whole(cube_of_channels("cut.exr", *open_channels(tmp_path / "cut.exr")))
    with pytest.raises(InputError, match="cannot be a hyperspectral picture"):
        cube_of_channels("wide.exr", ["400nm", "500nm"], 2, 10**9, lambda first,
                         last: np.zeros((1, 2, 3)))
    with pytest.raises(InputError, match="is an ordinary picture"):
        cube_of_channels("photo.exr", ["R", "G", "B"], 2, 2, lambda first,
                         last: np.zeros((1, 2, 3)))


def test_a_large_picture_is_read_in_part(tmp_path):
    # 1.2 GB in a sparse file: only the rows of the region may be read.
    side, bands = 3200, 31
    write_envi(tmp_path, np.zeros((1, 1, bands)), "bip")
    text = (tmp_path / "cube.hdr").read_text().replace("samples = 1", f"samples = {side}")
    (tmp_path / "cube.hdr").write_text(text.replace("lines = 1", f"lines = {side}"))
    with (tmp_path / "cube.img").open("r+b") as file:
        file.truncate(4 * side * side * bands)
    cube = open_cube(tmp_path / "cube.hdr")
    tracemalloc.start()
    region_spectra(cube, [CubeRegion("a", None, (0, 0, side, 400), None)])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 200e6  # the region's values alone are 317 MB


# ---- regions -------------------------------------------------------------------------------------

def test_mean_and_scatter_are_those_of_the_pixels(values, tmp_path, monkeypatch):
    # two rows at once
    monkeypatch.setattr("spectrabox.sampling.evaluation.cube_regions.BLOCK_VALUES", 2 * 5 * 31)
    noisy = values + np.random.default_rng(1).normal(0, 0.01, values.shape)
    noisy[3, 1, 4] = np.nan
    np.save(tmp_path / "cube.npy", noisy)
    one, point = region_spectra(open_cube(tmp_path / "cube.npy", NM), [
        CubeRegion("a", None, (1, 1, 4, 6), None), point_region("b=2,5", 5, 6)])
    pixels = noisy[1:6, 1:4].reshape(-1, 31)
    good = pixels[np.all(np.isfinite(pixels), axis=1)]
    assert (one.pixels, one.left_out) == (14, 1)
    np.testing.assert_allclose(one.mean, good.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(one.standard_deviation, good.std(axis=0, ddof=1), rtol=1e-10)
    np.testing.assert_array_equal(np.sort(one.spectra, axis=0), np.sort(good, axis=0))
    np.testing.assert_array_equal(point.mean, noisy[5, 2])
    assert point.region.truth == "b" and point.standard_deviation.max() == 0


def test_masks_choose_pixels_by_their_label(values, tmp_path):
    labels = np.zeros((6, 5), int)
    labels[2:4, 1], labels[5, 4] = 3, 7
    (tmp_path / "r.toml").write_text('[regions.a]\nmask = "m.png"\nlabel = 3\n[regions.b]\nmask = '
                                     '"m.png"\n')
    found = read_regions(tmp_path / "r.toml", 5, 6, lambda path: labels)
    assert [one.box for one in found] == [(1, 2, 2, 4), (1, 2, 5, 6)]
    np.save(tmp_path / "cube.npy", values)
    spectra = region_spectra(open_cube(tmp_path / "cube.npy", NM), found)
    np.testing.assert_allclose(spectra[0].mean, values[2:4, 1].mean(axis=0))
    assert spectra[1].pixels == 3


@pytest.mark.parametrize("text, message", [
    ("[regions.a]\nrect = [0, 0, 9, 2]", "the picture has 5 x 6 pixels"),
    ("[regions.a]\nrect = [0, 0, 2]", "4 whole numbers in brackets"),
    ("[regions.a]\npoint = [0.5, 1]", "a whole number is needed"),
    ("[regions.a]\nrec = [0, 0, 1, 1]", "did you mean 'rect'"),
    ("[regions.a]\nlabel = 2", "needs one of rect"),
    ("[regions.a]\npoint = [0, 1]\ntrue = 'x'",
     r"unknown key 'true' in \[regions.a\]; did you mean 'truth'"),
    ("[regions.a]\nmask = '../m.png'", "lies outside the folder"),
    ("[regions.a]\nmask = 'm.png'\nlabel = 9", "has no pixel for region 'a'; its values are 0, 1"),
    ("[regions.a", "is not valid TOML"),
    ("[region.a]\npoint = [0, 1]", "did you mean 'regions'"),
])
def test_regions_that_cannot_be_are_errors(tmp_path, text, message):
    (tmp_path / "r.toml").write_text(text)
    labels = np.zeros((6, 5), int)
    labels[0, 0] = 1
    with pytest.raises(InputError, match=message):
        read_regions(tmp_path / "r.toml", 5, 6, lambda path: labels)


def test_points_and_wavelengths_are_read_or_refused():
    np.testing.assert_allclose(parse_wavelengths("400:700:10"), NM)
    np.testing.assert_allclose(parse_wavelengths("400,500.5,700"), [400, 500.5, 700])
    for text in ("400:700:0", "700:400:10", "0:1e12:1e-9", "a,b", "none.txt", "0:1e308:1e-300",
                 "1:nan:2"):
        with pytest.raises(InputError, match="cannot be read"):
            parse_wavelengths(text)
    with pytest.raises(InputError, match="not all of them different"):
        parse_wavelengths("400,400,500")
    with pytest.raises(InputError, match="write x,y or NAME=x,y"):
        point_region("3;4", 5, 6)


# ---- damaged and hostile files -------------------------------------------------------------------

def test_pickled_objects_are_refused(tmp_path):
    class Harmful:
        def __reduce__(self):
            return (exec, ("raise SystemExit('executed')",))
    np.save(tmp_path / "a.npy", np.array([[[Harmful()]]], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "a.npz", cube=np.array([[[Harmful()]]], dtype=object))
    for name in ("a.npy", "a.npz"):
        with pytest.raises(InputError, match="more than plain numbers"):
            open_cube(tmp_path / name, NM)


@pytest.mark.parametrize("change, message", [
    (("lines = 6", "lines = 60"), "is cut: its header promises"),
    (("lines = 6", "lines = 999999999999"), "cannot be a hyperspectral picture"),
    (("interleave = bil", "interleave = xyz"), "bsq, bil or bip"),
    (("data type = 4", "data type = 6"), "data type 6"),
    (("bands = 31", "bands = many"), "a whole number is needed"),
    (("wavelength units = nm", "wavelength units = GHz"), "the wavelength unit 'ghz' is not known"),
    (("wavelength = {400.0, ", "wavelength = {"), "30 wavelengths for 31 bands"),
    (("wavelength = {", "wave = {"), "states no wavelengths"),
])
def test_envi_headers_that_cannot_be_are_errors(values, tmp_path, change, message):
    header = write_envi(tmp_path, values)
    header.write_text(header.read_text().replace(*change))
    with pytest.raises(InputError, match=message):
        open_cube(header)


def test_a_size_that_would_not_fit_is_refused_before_it_is_read(tmp_path):
    import io
    import zipfile
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False,
                                                  "shape": (9000, 9000, 31)})
    with zipfile.ZipFile(tmp_path / "cube.npz", "w") as archive:
        archive.writestr("cube.npy", header.getvalue())
    with pytest.raises(InputError, match=r"would need 20\.1 GB of memory"):
        open_cube(tmp_path / "cube.npz", NM)
    (tmp_path / "cube.npy").write_bytes(header.getvalue())
    with pytest.raises(InputError, match="is damaged"):
        open_cube(tmp_path / "cube.npy", NM)


@pytest.mark.parametrize("content, message", [
                             (b"", "is no hyperspectral picture"),
                             (b"hello", "is no hyperspectral picture"),
                             (b"PK\x03\x04broken", "is damaged"),
                             (b"MATLAB 5.0 MAT-file" + b"\0" * 200, "is no MATLAB file"),
                             (b"MATLAB 7.3 MAT-file" + b"\0" * 200, "save the picture again"),
                             (b"\x93NUMPY\x01\x00", "is damaged")])
def test_damaged_files_are_errors(tmp_path, content, message):
    (tmp_path / "cube.bin").write_bytes(content)
    with pytest.raises(InputError, match=message):
        open_cube(tmp_path / "cube.bin", NM)


def test_arrays_of_other_shapes_are_errors(tmp_path):
    np.save(tmp_path / "flat.npy", np.zeros((4, 4)))
    np.savez(tmp_path / "two.npz", a=np.zeros((2, 2, 31)), b=np.zeros((2, 2, 31)))
    np.save(tmp_path / "thin.npy", np.zeros((4, 4, 7)))
    with pytest.raises(InputError, match="2 dimensions"):
        open_cube(tmp_path / "flat.npy", NM)
    with pytest.raises(InputError, match=r"holds 2 arrays of three dimensions \(a, b\); say which"):
        open_cube(tmp_path / "two.npz", NM)
    with pytest.raises(InputError, match="4 x 4 x 7 and 31 wavelengths"):
        open_cube(tmp_path / "thin.npy", NM)
    assert open_cube(tmp_path / "two.npz", NM, "b").width == 2
    with pytest.raises(InputError, match="is missing"):
        open_cube(tmp_path / "none.npy", NM)


# ---- the command ---------------------------------------------------------------------------------

def judge(*arguments, code=0):
    found = CliRunner().invoke(app, ["judge", *map(str, arguments), "--json"])
    assert found.exit_code == code, found.output
    return json.loads(found.stdout)


@pytest.fixture
def folder(tmp_path):
    """A picture of two surfaces under a lamp, 2 % noise, with a white card, and the truths."""
    rng = np.random.default_rng(3)
    truths = {"left": surface(NM, 1), "right": surface(NM, 2), "card": np.full(NM.size, 0.9)}
    lamp = 300 * (1 + 0.5 * (NM - 400) / 300)
    cube = np.concatenate([np.tile(one * lamp, (50, 40, 1)) for one in truths.values()], axis=1)
    np.save(tmp_path / "cube.npy",
            (cube * (1 + 0.02 * rng.standard_normal(cube.shape))).astype(np.float32))
    (tmp_path / "truth.csv").write_text(f"nm,{','.join(truths)}\n" + "\n".join(
                                            ",".join(f"{value:.6g}" for value in row)
                                            for row in zip(NM, *truths.values(), strict=True)))
    (tmp_path / "r.toml").write_text("".join(f"[regions.{name}]\nrect = [{40 * at}, 0, "
                                             f"{40 * at + 40}, 50]\n"
                                             for at, name in enumerate(truths)))
    return tmp_path


def test_judge_puts_a_picture_beside_our_methods(folder):
    facts = judge(folder / "cube.npy", "--wavelengths", "400:700:10", "--regions",
                  folder / "r.toml", "--truth",
                  folder / "truth.csv", "--white-region", "card", "--samples", 1000, "--out",
                  folder / "out.csv")
    assert [one["name"] for one in facts["regions"]] == ["left", "right", "card"]
    left = facts["regions"][0]
    assert left["pixels"] == 2000
    assert list(left["judged"]) == ["imported picture", "prior", "uniform", "paper"]
    mine = left["judged"]["imported picture"]
    # Noise of 2 % over 2000 pixels and the card's: well below 0.001. Interpolation of 10 nm costs
    # more.
    assert mine["rmse"] < 0.004 and mine["spectral_angle"] < 0.02 and mine["whole_curve"]
    assert set(mine["delta_e00"]) == {"D65", "A", "FL11"} and max(mine["delta_e00"].values()) < 0.5
    assert mine["coverage"] > 0.9 and mine["sharpness"] < mine["width"] <= mine["winkler"]
    assert facts["means"]["prior"]["rmse"] == pytest.approx(np.mean([
        one["judged"]["prior"]["rmse"] for one in facts["regions"]]))
    from spectrabox.radiometry.spectra.spectrum_files import read_table
    table = read_table(folder / "out.csv")
    values = dict(zip(table.names, table.values, strict=True))
    share = values["left standard deviation"] / values["left"]
    assert np.mean(share) == pytest.approx(0.02, rel=0.05)      # as was drawn, whatever the unit


def test_judge_says_what_is_missing(folder):
    cube, regions = folder / "cube.npy", folder / "r.toml"
    nm, truth = ("--wavelengths", "400:700:10"), ("--truth", folder / "truth.csv")
    assert "states no wavelengths" in judge(cube, "--regions", regions, code=3)["error"]
    assert "no region was given" in judge(cube, *nm, code=3)["error"]
    assert "no reflectance; give what reflectance 1 reads" in judge(cube, *nm, "--regions", regions,
                                                                    code=3)["error"]
    scaled = (*nm, "--full-scale", 450)
    assert len(judge(cube, *scaled, "--regions", regions)["regions"][0]["judged"]) == 0
    assert "say which with column" in judge(cube, *scaled, "--point", "3,3", *truth,
                                            code=3)["error"]
    assert "is no region" in judge(cube, *nm, "--regions", regions, "--white-region", "x",
                                   code=3)["error"]
    assert "cannot be; give what" in judge(cube, *nm, "--regions", regions, "--full-scale", 0,
                                           code=3)["error"]
    short = ("--wavelengths", "450:750:10", "--full-scale", 450)
    assert "must reach from 420 to 680 nm" in judge(cube, *short, "--point", "left=3,3", *truth,
                                                    code=3)["error"]


def test_our_methods_see_the_signals_that_are_given(folder):
    arguments = (folder / "cube.npy", "--wavelengths", "400:700:10", "--full-scale", 450, "--point",
                 "left=3,3", "--truth", folder / "truth.csv", "--samples", 1000)
    (folder / "signals.csv").write_text("X,Y,Z\n50,50,50\n")
    seen = judge(*arguments, "--signals", folder / "signals.csv", "--white", "100,100,100",
                 "--noise", "0.2,0.2,0.2")
    own = judge(*arguments)
    # a grey of 0.5 is another surface
    assert seen["means"]["prior"]["rmse"] > 3 * own["means"]["prior"]["rmse"]
    (folder / "signals.csv").write_text("X,Y,Z\n50,50,50\n60,60,60\n")
    text = judge(*arguments, "--signals", folder / "signals.csv", "--white", "100,100,100",
                 code=3)["error"]
    assert "2 signals were given for 1 regions" in text


def test_too_few_pixels_give_no_band(folder):
    facts = judge(folder / "cube.npy", "--wavelengths", "400:700:10", "--full-scale", 450,
                  "--point", "left=3,3", "--truth", folder / "truth.csv", "--samples", 1000)
    mine = facts["regions"][0]["judged"]["imported picture"]
    assert mine["coverage"] is None and mine["width"] is None and mine["rmse"] > 0


def test_a_black_picture_is_judged_like_any_other(folder):
    np.save(folder / "black.npy", np.zeros((50, 40, 31)))
    facts = judge(folder / "black.npy", "--wavelengths", "400:700:10", "--point", "left=3,3",
                  "--truth",
                  folder / "truth.csv", "--samples", 1000)
    mine = facts["regions"][0]["judged"]["imported picture"]
    assert mine["spectral_angle"] == pytest.approx(np.pi / 2)
    assert mine["rmse"] == pytest.approx(mine["rmse_best_scale"])


def test_what_uplift_writes_can_be_judged(tmp_path):
    from spectrabox.capture.photo.image_writers import write_exr
    curves = np.tile(surface(NM, 4), (4, 5, 1)).astype(np.float32)
    write_exr(tmp_path / "mean.exr", curves, [f"{nm:g}nm" for nm in NM])
    facts = judge(tmp_path / "mean.exr", "--point", "1,1")
    np.testing.assert_allclose(facts["regions"][0]["mean"], surface(NM, 4), atol=1e-6)  # float32


def test_a_picture_from_matlab_is_judged_against_measured_spectra_by_the_mask_of_its_patches(
        tmp_path):
    """As published captures come: seven filters, a mask of patches, a table of their spectra, light
    that falls off by a factor of two.
    """
    import cv2
    from scipy.io import savemat
    names, nm = ("white", "orange", "blue", "green"), np.arange(400, 701, 50.0)
    fine = np.arange(380, 731, 5.0)
    truth = np.array([np.full(fine.size, 0.9), *(surface(fine, seed) for seed in (3, 5, 9))])
    labels = np.zeros((24, 32), np.uint8)
    picture = np.full((24, 32, 7), 0.05)
    for index, spectrum in enumerate(truth):
        at = np.s_[4:20, 2 + 7 * index:7 + 7 * index]
        labels[at] = index + 1
        picture[at] = np.interp(nm, fine, spectrum)
    light = np.linspace(1.0, 0.5, 32)
    savemat(tmp_path / "chart.mat", {"dHyper": picture * light[:, None]})
    cv2.imwrite(str(tmp_path / "mask.png"), labels)
    (tmp_path / "regions.toml").write_text("".join(
        f'[regions.{name}]\nmask = "mask.png"\nlabel = {index}\n'
        for index, name in enumerate(names, 1)))
    rows = "\n".join(",".join(f"{value:.6f}" for value in (wavelength, *values))
                     for wavelength, values in zip(fine, truth.T, strict=True))
    (tmp_path / "truth.csv").write_text(f"wavelength_nm,{','.join(names)}\n{rows}\n")
    facts = judge(tmp_path / "chart.mat", "--wavelengths", "400:700:50", "--regions",
                  tmp_path / "regions.toml", "--truth", tmp_path / "truth.csv", "--white-region",
                  "white", "--samples", 200)
    judged = {one["name"]: one["judged"]["imported picture"] for one in facts["regions"]}
    for index, name in enumerate(names[1:], 1):
        # the white patch stands in 0.93 of the light, the others in what their columns have of it
        share = light[2 + 7 * index:7 + 7 * index].mean() / light[2:7].mean()
        off = (share - 1) * np.interp(nm, fine, truth[index])
        mine = judged[name]
        # between seven bands a curve is drawn straight, its truth is not
        assert mine["rmse"] == pytest.approx(np.sqrt(np.mean(off**2)), abs=0.02), name
        assert mine["rmse_best_scale"] < 0.025 and mine["spectral_angle"] < 0.09
    # the last stands in a little more than half of the light
    assert mine["rmse_best_scale"] < 0.3 * mine["rmse"]
