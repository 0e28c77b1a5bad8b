"""Recorded: certificates of libraries, pictures made elsewhere, their regions, and judgements."""
import dataclasses
import sys

import numpy as np
import pytest
from sampling_cameras import response, surface
from sampling_inputs import lopsided_measurement, lopsided_prior, result_or_refusal

from spectrabox.radiometry.errors import ConvergenceError, EnvironmentProblem, InputError
from spectrabox.sampling.judge import certificate as certificate_file
from spectrabox.sampling.judge import cube_files
from spectrabox.sampling.judge import cube_regions as regions_file
from spectrabox.sampling.judge.certificate import certificate_page, certify
from spectrabox.sampling.judge.cube_files import open_cube
from spectrabox.sampling.judge.cube_regions import (
    Region,
    point_region,
    read_regions,
    region_spectra,
)
from spectrabox.sampling.judge.cubes import (
    check_sides,
    checked_wavelengths,
    cube_of_array,
    cube_of_channels,
    cube_of_rows,
    parse_wavelengths,
)
from spectrabox.sampling.judge.judgement import (
    baselines,
    beside,
    estimates,
    judged,
    judgement_text,
    means,
)
from spectrabox.sampling.judge.scores import (
    best_scale,
    coverage,
    coverage_error,
    curve_band,
    curve_coverage,
    delta_e00_under,
    rmse,
    sharpness,
    spectral_angle,
    winkler_score,
)
from spectrabox.sampling.methods import METHODS
from spectrabox.sampling.prior.libraries import ReflectanceLibrary
from spectrabox.sampling.prior.mixture import GRID, of_families

NM = np.array([405.0, 432, 470, 511, 560, 602, 655, 690])


def library(count=23, name="leaves of a tree"):
    curves = np.array([surface(GRID.nm, seed) * scale for seed, scale in
                       enumerate(np.linspace(0.4, 1.7, count))])
    return ReflectanceLibrary(name, np.clip(curves, 0, 1), {"gaps": 2})


def test_certificates(recorded, monkeypatch):
    prior, matrix = lopsided_prior(), response(3)[1]
    whole = certify(prior, library(), matrix, 0.013, 4, ("A", "D50"))
    plain = certify(of_families(prior, ["skin", "leaves"]), library(12, "hand"), matrix,
                    lights=("A", "D50"))
    default = certify(prior, library(11, "a few"), matrix, 0.02)
    recorded((whole, plain, default), rtol=2e-5)     # bands are of single precision
    recorded([certificate_page([whole, dataclasses.replace(whole, name="b")], prior, "a camera"),
              certificate_page([plain], of_families(prior, ["skin", "leaves"]), "another"),
              whole.verdict, plain.verdict], rtol=1e-3, case="page")
    monkeypatch.setattr(certificate_file, "BATCH", 5)
    again = certify(prior, library(), matrix, 0.013, 4, ("A", "D50"))
    assert again.coverage == whole.coverage
    assert again.width == pytest.approx(whole.width, rel=1e-5)
    said = {}
    for held in (0.9299, 0.93, 0.9301):
        for trained_on in (False, True):
            one = dataclasses.replace(whole, coverage={0.95: held}, trained_on=trained_on)
            said[f"{held} {trained_on}"] = one.verdict
    recorded((said, result_or_refusal(certify, prior, library(9), matrix),
              certify(prior, library(10), matrix).curves), case="verdicts")


@pytest.mark.parametrize("name, trained_on", [("hand", True), ("and", False), ("leaves", False),
                                              ("hand (812)", False), ("theory", False)])
def test_a_prior_was_learnt_on_libraries_of_whole_names(name, trained_on):
    found = certify(lopsided_prior(), library(10, name), response(3)[1])
    assert found.trained_on is trained_on


def test_a_dark_library_has_no_bright_reflectances(recorded):
    prior = lopsided_prior(familiar_surprise=1.5)
    dark = ReflectanceLibrary("dark", library().reflectances * 0.3, {})
    found = certify(prior, dark, response(4)[1], 0.002)
    recorded((found, certificate_page([found], prior, "four bands")), rtol=1e-3)


def test_scores(recorded):
    rng = np.random.default_rng(3)
    truth, estimate = rng.uniform(0.1, 0.9, (6, 61)), rng.uniform(0.1, 0.9, (6, 61))
    lower, upper = estimate - rng.uniform(0.1, 0.3, (6, 61)), estimate + rng.uniform(0.2, 0.5,
                                                                                      (6, 61))
    inside = (truth >= lower) & (truth <= upper)
    lower[2], upper[2] = truth[2], truth[2] + 0.1       # that touch the truth hold it
    drawn = rng.gamma(2, 0.1, (200, 7))
    recorded({
        "rmse": rmse(estimate, truth), "angle": spectral_angle(estimate, truth),
        "black": spectral_angle(np.zeros(5), np.ones(5)), "coverage": coverage(lower, upper, truth),
        "curves": curve_coverage(lower, upper, truth),
        "winkler": [winkler_score(lower, upper, truth), winkler_score(lower, upper, truth, 0.5)],
        "error": [coverage_error(inside), coverage_error(inside[:1])],
        "sharpness": sharpness(drawn), "band": [curve_band(drawn), curve_band(drawn, 0.6)],
        "scale": [best_scale(estimate[0], truth[0]), best_scale(np.zeros(3), np.ones(3))],
        "colour": delta_e00_under(("D65", "FL11", "A"), GRID, estimate, truth)})
    assert coverage(lower[2], upper[2], truth[2]) == 1
    assert best_scale(truth[0] / 3, truth[0]) == pytest.approx(3)


def test_judgements(recorded):
    rng, truth = np.random.default_rng(2), surface(GRID.nm, 4)
    draws = truth + 0.03 * rng.standard_normal((1200, 1)) + 0.02 * rng.standard_normal((1200, 61))
    some = slice(3, 50, 4)
    recorded([judged(GRID.nm[some], truth[some] * 1.03, estimate[some], ("D65", "A"),
                     None if drawn is None else drawn[:, some])
              for estimate, drawn in ((draws.mean(axis=0), draws), (0.8 * truth, draws[:999]),
                                      (truth + 0.1, draws[:1000] + 0.1), (truth, None))])


def test_judgements_of_all_methods(recorded, monkeypatch):
    measured, prior = lopsided_measurement(), lopsided_prior()
    columns = np.array([2, 10, 25, 33, 58])
    found = beside(measured, GRID.nm[columns], surface(GRID.nm, 4)[columns], ("D65", "A"), 1000, 3,
                   7, prior, True)
    other = beside(measured, GRID.nm[columns], surface(GRID.nm, 5)[columns], ("D65", "A"), 200, 3,
                   7, prior, False)
    # colour-science's methods are optimisers
    recorded((found, other), rtol=1e-3)
    rows = [{"region": region, "method": method, **one} for region, judgements in
            (("left", found), ("a long name", other)) for method, one in judgements.items()]
    recorded((means(rows, ("D65", "A")), judgement_text(rows, ("D65", "A"))), rtol=1e-3,
             case="table")
    # where a method has no draws it is left out
    far = dataclasses.replace(measured, signal=np.array([0.2, 0.99, 0.15]))
    recorded((list(estimates(far, ("paper", "uniform", "prior"), 20, 1, 7, prior)),
              [one is None for one in baselines(far, 20, 1, 7).values()]), case="left out")

    def failing(*values):
        raise ConvergenceError("no draws")
    monkeypatch.setitem(METHODS, "uniform", failing)
    assert list(estimates(measured, ("paper", "uniform", "prior"), 20, 1, 7, prior)) \
        == ["paper", "prior"]


# ---- pictures ------------------------------------------------------------------------------------

def picture(height=5, width=4):
    """Values (H, W, 8), every one another."""
    rng = np.random.default_rng(1)
    return rng.uniform(0.05, 0.95, (height, width, NM.size)).round(4)


def envi(folder, values, name="a", order="bil", **changed):
    """A header with what is changed in it, and the values beside."""
    axes = {"bsq": (2, 0, 1), "bil": (0, 2, 1), "bip": (0, 1, 2)}[order]
    height, width, bands = values.shape
    keys = {"samples": width, "lines": height, "bands": bands, "header offset": 7, "data type": 12,
            "interleave": order, "byte order": 1, "wavelength units": "Micrometers",
            "reflectance scale factor": 10000, "data ignore value": 65535,
            "wavelength": "{" + ", ".join(f"{nm / 1000:.4f}" for nm in NM[::-1]) + "}"} | {
                key.replace("_", " "): value for key, value in changed.items()}
    kind = {12: ">u2", 4: ">f4", 5: "<f8"}.get(keys["data type"], ">u2")
    stored = np.round(values * 10000).transpose(axes).astype(kind)
    if kind == ">u2":
        stored[tuple([1] * 3)] = 65535
    (folder / f"{name}.img").write_bytes(b"\1" * 7 + stored.tobytes())
    header = folder / f"{name}.hdr"
    header.write_text("ENVI\n" + "".join(f"{key} = {value}\n" for key, value in keys.items()
                                         if value is not None), encoding="utf-8")
    return header


def all_of(cube):
    return (cube.file, cube.nm, cube.height, cube.width, cube.rows(0, cube.height),
            cube.rows(1, 3))


@pytest.mark.parametrize("order", ["bsq", "bil", "bip"])
def test_envi_pictures(recorded, tmp_path, order):
    found = all_of(open_cube(envi(tmp_path, picture(), order=order)))
    recorded(found)
    expected = np.round(picture() * 10000)[..., ::-1] / 10000
    np.testing.assert_allclose(np.nan_to_num(found[4]), np.where(np.isnan(found[4]), 0, expected))
    assert np.isnan(found[4]).sum() == 1
    floats = open_cube(envi(tmp_path, picture(), "b", order, data_type=5, byte_order=0,
                            reflectance_scale_factor=None, data_ignore_value=None))
    np.testing.assert_allclose(floats.rows(0, 5), np.round(picture() * 10000)[..., ::-1])


def test_envi_pictures_that_are_refused(recorded, tmp_path):
    cases = {"good": {}, "lines": {"lines": "five"}, "no bands": {"bands": None},
             "order": {"interleave": "bib"}, "type": {"data_type": 6}, "packed":
             {"file_compression": 1}, "unit": {"wavelength_units": "Angstroms"},
             "fewer": {"wavelength": "{0.4, 0.5}"}, "none": {"wavelength": None},
             "factor": {"reflectance_scale_factor": 0}, "negative": {
                 "reflectance_scale_factor": -2}, "one more line": {"lines": 6},
             "offset": {"header_offset": 8}, "many": {"samples": 300_000}, "no offset":
             {"header_offset": None}, "nothing": {"lines": 0}}
    found = {}
    for name, changed in cases.items():
        header = envi(tmp_path, picture(), name.replace(" ", "_"), **changed)
        cube = result_or_refusal(open_cube, header)
        found[name] = cube if isinstance(cube, str) else (cube.nm, cube.height, cube.width)
    alone = envi(tmp_path, picture(), "alone")
    (tmp_path / "alone.img").unlink()
    found["alone"] = result_or_refusal(open_cube, alone)
    (tmp_path / "text.txt").write_text("nothing")
    found["text"] = result_or_refusal(open_cube, tmp_path / "text.txt")
    found["missing"] = str(result_or_refusal(open_cube, tmp_path / "missing")).replace(
        str(tmp_path), "FOLDER")
    recorded(found)
    given = open_cube(envi(tmp_path, picture(), "given", wavelength=None), NM)
    np.testing.assert_array_equal(given.nm, NM)


def test_arrays_in_files(recorded, tmp_path, monkeypatch):
    import h5py
    from scipy.io import savemat

    values, found = picture(), {}
    np.save(tmp_path / "a.npy", values.astype(np.float32))
    np.save(tmp_path / "first.npy", values.transpose(2, 0, 1))
    np.savez(tmp_path / "a.npz", cube=values, wavelengths=NM, other=values[0])
    np.savez(tmp_path / "two.npz", one=values, two=values * 0.9)
    np.savez_compressed(tmp_path / "big.npz", one=np.zeros((40, 40, 8)))
    savemat(tmp_path / "a.mat", {"cube": values, "lambda": NM, "word": "hello"})
    with h5py.File(tmp_path / "h.mat", "w") as file:
        file["cube"], file["wavelength"] = values.transpose(2, 1, 0), NM
        file["there"] = h5py.SoftLink("/cube")
    for name, call in {"a.npy": (NM,), "first.npy": (NM[::-1],), "a.npz": (), "a.mat": (),
                       "h.mat": (), "two.npz": (NM, "two")}.items():
        found[name] = all_of(open_cube(tmp_path / name, *call))
    recorded(found)
    for name in ("a.npz", "a.mat", "h.mat"):
        np.testing.assert_array_equal(found[name][4], values)
    monkeypatch.setattr(cube_files, "MOST_IN_MEMORY", 40 * 40 * 8 * 8 - 1)
    refused = {"two": ("two.npz", NM), "third": ("two.npz", NM, "three"), "none": ("a.npy",),
               "other": ("a.npz", None, "other"), "short": ("a.npy", NM[:7]), "big": ("big.npz",
                                                                                    NM),
               "short h": ("h.mat", NM[:7]), "no npz": ("two.npz", None, "one")}
    said = {name: result_or_refusal(open_cube, tmp_path / call[0], *call[1:])
            for name, call in refused.items()}
    monkeypatch.setattr(cube_files, "MOST_IN_MEMORY", 40 * 40 * 8 * 8)
    said["just"] = open_cube(tmp_path / "big.npz", NM).height
    recorded(said, case="refused")
    for name, said in {"a.npy": "holds more than plain numbers .*; save the picture again with num",
                       "a.npz": "holds more than plain numbers .*; save the picture again with num",
                       "a.mat": r"is no MATLAB file that can be read .*save\(\.\.\., '-v7'\)",
                       "h.mat": "is a damaged MATLAB 7.3 file .*; save it again"}.items():
        broken = tmp_path / f"broken {name}"
        broken.write_bytes((tmp_path / name).read_bytes()[:200])
        with pytest.raises(InputError, match=f"^{broken.name} {said}|^{broken.name} .* {said}"):
            open_cube(broken, NM)
    with pytest.raises(InputError, match=r"^.*folder cannot be read \(Is a directory\); give a"):
        open_cube(_folder(tmp_path), NM)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(EnvironmentProblem, match=r"h.mat is a MATLAB 7.3 \(HDF5\) file, for"):
        open_cube(tmp_path / "h.mat")


def _folder(where):
    (where / "folder").mkdir()
    return where / "folder"


def test_cubes_of_channels_and_wavelengths(recorded, tmp_path):
    values, names = picture(), ["B", "T.602,0nm", "T.432,0nm", "S0.500,0nm", "T.470,0nm", "A", "x",
                                "y"]
    cube = cube_of_channels("a.exr", names, 5, 4, lambda first, last: values[first:last])
    recorded(all_of(cube))
    np.testing.assert_array_equal(cube.rows(0, 5), values[..., [2, 4, 1]])
    (tmp_path / "nm.txt").write_text("400 410;\n430, 470\n")
    texts = ["400:700:10", "400:404:1.5", "700:400:10", "400:400:10", "400:700:0", "400:5400:1",
             "400:5399:1", "500,420,610", "500", "500,500", "99.9,500", "100,500", "1e5,500",
             "100001,500", "a,b", str(tmp_path / "nm.txt"), "400:nan:1", "inf:500:1"]
    recorded([str(result_or_refusal(parse_wavelengths, text)).replace(str(tmp_path), "FOLDER")[:200]
              for text in texts], case="wavelengths")

    def nothing(first, last):
        return values[first:last]
    recorded({
        "ordinary": result_or_refusal(cube_of_channels, "a.exr", ["R", "G", "B", "A", "Z"], 5, 4,
                                      nothing),
        "sides": [result_or_refusal(check_sides, "a", *sides) for sides in
                  ((1, 1, 2), (1, 1, 1), (0, 1, 2), (1, 0, 2), (200_000, 1, 2), (200_001, 1, 2),
                   (1, 200_001, 2), (1, 1, 5000), (1, 1, 5001), (1, 20_000, 5000),
                   (1, 20_001, 5000))],
        "arrays": [str(result_or_refusal(lambda a=array, n=nm: cube_of_array("a", a, n).nm))
                   for array, nm in ((values[0], NM), (values > 0.5, NM), (values, NM[:6]),
                                     (values, None), (values.transpose(2, 0, 1), NM))],
        "checked": [str(result_or_refusal(checked_wavelengths, np.array(nm), "a"))
                    for nm in ([400.0], [400.0, np.nan], [400.0, 410])]}, case="refused")
    ordered = cube_of_rows("a", NM[[3, 0, 2]], 5, 4, lambda a, b: values[a:b, :, [3, 0, 2]])
    np.testing.assert_array_equal(ordered.rows(1, 4), values[1:4][..., [0, 2, 3]])


# ---- regions -------------------------------------------------------------------------------------

REGIONS = """[regions.left]
rectangle = [0, 1, 2, 4]
truth = "paint"
[regions.dot]
point = [3, 2]
[regions.masked]
mask = "mask.png"
[regions.third]
mask = "mask.png"
label = 3
"""
LABELS = np.array([[0, 0, 0, 0], [0, 1, 3, 0], [0, 0, 3, 0], [0, 2, 0, 3], [0, 0, 0, 0]])


def regions_of(folder, text, labels=LABELS):
    (folder / "regions.toml").write_text(text, encoding="utf-8")
    return read_regions(folder / "regions.toml", 4, 5, lambda path: labels)


def test_regions_and_their_spectra(recorded, tmp_path, monkeypatch):
    values = picture() * 4
    values[2, 1, 3] = np.nan
    values[3, 3, 0] = np.inf
    cube = cube_of_array("a.npy", values, NM)
    regions = [*regions_of(tmp_path, REGIONS), point_region("here=2,4", 4, 5),
               point_region("0,0", 4, 5)]
    found = region_spectra(cube, regions, full_scale=4.0)
    recorded(found)
    box = values[1:4, 0:2].reshape(-1, 8) / 4
    whole = box[np.isfinite(box).all(axis=1)]
    np.testing.assert_allclose(found[0].mean, whole.mean(axis=0))
    np.testing.assert_allclose(found[0].standard_deviation, whole.std(axis=0, ddof=1))
    monkeypatch.setattr(regions_file, "BLOCK_VALUES", 4 * 8 * 2)
    monkeypatch.setattr(regions_file, "KEPT", 3)
    parts = region_spectra(cube, regions, 4.0, seed=5)
    recorded(parts, case="in blocks")
    for one, other in zip(found, parts, strict=True):
        np.testing.assert_allclose(one.standard_deviation, other.standard_deviation, atol=1e-12)
        assert {tuple(row) for row in other.spectra} <= {tuple(row) for row in one.spectra}


def test_regions_that_are_refused(recorded, tmp_path):
    texts = {
        "two": '[regions.a]\npoint = [1, 1]\nrectangle = [0, 0, 1, 1]', "no place": "[regions.a]",
        "none": "[regions]", "sides": "[regions.a]\nrectangle = [0, 0, 1]",
        "right": "[regions.a]\nrectangle = [0, 0, 5, 5]", "edge": "[regions.a]\nrectangle = [0, 0, "
        "4, 5]", "empty": "[regions.a]\nrectangle = [2, 1, 2, 4]", "negative":
        "[regions.a]\npoint = [-1, 2]", "last": "[regions.a]\npoint = [3, 4]", "below":
        "[regions.a]\npoint = [3, 5]", "beside": "[regions.a]\npoint = [4, 3]", "label":
        '[regions.a]\nmask = "mask.png"\nlabel = 9', "outside":
        '[regions.a]\nmask = "../mask.png"', "word": "[regions.a]\nplace = 3",
        "half a point": "[regions.a]\npoint = [1]", "a point more":
        "[regions.a]\npoint = [1, 2, 3]",
        "five sides": "[regions.a]\nrectangle = [0, 0, 1, 1, 2]", "whole": "[regions.a]\n"
        "point = [1.5, 2]"}
    recorded({name: str(result_or_refusal(regions_of, tmp_path, text)) if "Error" in
              str(result_or_refusal(regions_of, tmp_path, text)) else "taken"
              for name, text in texts.items()})
    recorded([str(result_or_refusal(regions_of, tmp_path, REGIONS, LABELS.T)),
              *(str(result_or_refusal(point_region, text, 4, 5)) for text in
                ("a", "1,2,3", "4,4", "3,5", "3,4", "b=1.5,2", "c=1,2"))], case="points")
    gaps = picture() * np.nan
    nowhere, huge = cube_of_array("a", gaps, NM), cube_of_array("a", picture() * 1e200, NM)
    region = Region("dot", None, (1, 1, 3, 4), None)
    with np.errstate(all="ignore"):     # squares that no number holds
        recorded([result_or_refusal(region_spectra, cube, [region]) for cube in (nowhere, huge)],
                 case="spectra")
