"""Recorded: models of surfaces, folders of measured reflectances, and how a prior is trained."""
import bz2
import dataclasses
import json
import struct
import zipfile

import numpy as np
import pytest
from sampling_cameras import response, surface
from sampling_inputs import lopsided_prior, result_or_refusal
from test_sampling_libraries import r_file, text

from spectrabox.sampling.prior import low_rank as low_rank_file
from spectrabox.sampling.prior import tables as tables_file
from spectrabox.sampling.prior.calibration import (
    Judgement,
    LeftOut,
    band_figures,
    calibrated,
    certificates,
    judge,
    prior_without,
    train,
)
from spectrabox.sampling.prior.families import dyes, kubelka_munk, plant_tissue, printing
from spectrabox.sampling.prior.families.catalogue import FAMILIES, MIXTURES, Family
from spectrabox.sampling.prior.families.leaves import leaf, surface_transmission
from spectrabox.sampling.prior.families.paint import pigment_mixtures
from spectrabox.sampling.prior.families.truths import true_reflectances
from spectrabox.sampling.prior.libraries import (
    READERS,
    ReflectanceLibrary,
    read_library,
    usable,
    without_near_duplicates,
)
from spectrabox.sampling.prior.low_rank import low_rank, stated_errors
from spectrabox.sampling.prior.mixture import GRID, of_families
from spectrabox.sampling.prior.r_data import read_r_columns
from spectrabox.sampling.prior.tables import (
    build_table,
    build_tables,
    interpolation,
    lattice,
    outside,
    points_around,
    relative_errors,
    table_error,
    uplift_directly,
    uplift_pixels,
    uplift_signals,
)
from spectrabox.sampling.prior.training import (
    LEVELS,
    balanced,
    enriched,
    fit_family,
    fit_mixture,
    fitted_families,
    joined,
    parts_of,
)

MODELS = {model.__name__: model for family in FAMILIES.values()
          for model in (*family.models, *family.stated_models)}


@pytest.mark.parametrize("name", sorted(MODELS))
def test_models_of_surfaces(recorded, name):
    """Enough of each that every branch of chance is taken."""
    made = MODELS[name](np.random.default_rng(7), 60)
    recorded((made, made[:, 5]))
    assert made.min() > -0.03
    assert made.max() < 1.2


def test_the_catalogue(recorded):
    recorded({name: (one.share, one.components, one.smooth, one.stated_components,
                     {model.__name__: count for model, count in one.models.items()},
                     {model.__name__: count for model, count in one.stated_models.items()})
              for name, one in FAMILIES.items()})
    recorded(MIXTURES, case="mixtures")
    assert sum(one.share for one in FAMILIES.values()) == pytest.approx(1)


def test_layers_and_bands(recorded):
    rng = np.random.default_rng(2)
    absorption, reflectance = rng.uniform(0.001, 5, (3, 4)), rng.uniform(0.05, 1, (3, 4))
    inside = kubelka_munk.reflectance_of(absorption)
    np.testing.assert_allclose(kubelka_munk.absorption_of(inside), absorption)
    thick = plant_tissue.layer(absorption, np.full((3, 1), 40.0), 0.3 + 0 * absorption)
    np.testing.assert_allclose(thick, inside, atol=1e-6)     # nothing is seen through it
    recorded((inside, kubelka_munk.absorption_of(reflectance),
              kubelka_munk.behind_surface(reflectance, np.array(0.03), np.array(0.55)),
              kubelka_munk.band(2.3, 0.2), kubelka_munk.band(2.1, 0.1, 0.7),
              plant_tissue.layer(absorption, np.array([[0.3], [1.0], [4.0]]), 0.7 * reflectance),
              [make(rng, 0.02, 0.9, 5) for make in (kubelka_munk.log_uniform,
                                                    kubelka_munk.uniform)],
              kubelka_munk.chance(rng, 0.3, 9)))
    recorded((dyes.dyes(rng, 40, 9.0), dyes.ultraviolet_edge(rng, 360, 400, 9),
              dyes.rutile_absorption(rng, 5), printing.halftone(rng, 30),
              plant_tissue.chlorophyll(rng, 5), plant_tissue.carotenoids(rng, 5),
              plant_tissue.anthocyanins(rng, 15)), case="made")
    recorded((surface_transmission(np.array([1.33, 1.45, 1.5]), 40),
              surface_transmission(np.array([1.33, 1.45, 1.5]), 90),
              leaf(np.array([[1.2], [2.1]]), rng.uniform(0.01, 2, (2, 3)),
                   np.array([1.4, 1.45, 1.5]))), case="plates")
    pigments = np.array([surface(GRID.nm, seed) for seed in range(7)])
    recorded(pigment_mixtures(rng, 60, pigments), case="paints")


def test_truths_of_a_prior(recorded):
    prior = lopsided_prior()
    # draws of components come from eigenvectors that are unlike one another
    recorded([true_reflectances(one, 70, np.random.default_rng(3)) for one in
              (prior, of_families(prior, ["paint"]), of_families(prior, ["leaves", "skin"]))])


# ---- folders -------------------------------------------------------------------------------------

def test_curves_that_can_be_trained_on(recorded):
    found, rng = {}, np.random.default_rng(4)
    fine = rng.uniform(0.2, 0.7, (3, 1)) * (1 + 0.2 * np.sin(np.arange(380.0, 721, 4) / 30))
    for start, end in ((405.9, 702), (406.0, 702), (406.1, 702), (390, 694.1), (390, 694.0),
                       (390, 693.9)):
        nm = np.linspace(start, end, 40)
        found[f"{start} {end}"] = usable(nm[::-1], np.interp(
            nm, np.arange(380.0, 721, 4), fine[1])[None, ::-1])
    nm = np.arange(380.0, 721, 4)
    curves = np.vstack([fine, fine[:1], fine[:1], fine[:1]])
    curves[3, 0] = np.nan       # beyond 20 nm of the visible: no gap
    curves[4, 10] = np.inf
    curves[5, 40] = -0.001
    found["gaps"] = usable(nm, curves)
    for level in (1.19, 1.21):
        found[f"{level}"] = usable(nm, np.full((3, nm.size), level))
        high = np.tile(fine[0], (3, 1))
        high[1:, 70:] = level
        found[f"some {level}"] = usable(nm, high)
    found["point"] = usable(nm[:1], curves[:, :1])
    recorded(found)
    row = surface(GRID.nm)
    rows = np.array([row, row + 0.0039, row + 0.0041, row + 0.2, row - 0.0035])
    recorded([without_near_duplicates(rows)[:, 0], without_near_duplicates(rows, 0.01)[:, 0],
              without_near_duplicates(rows, 0.005, rows[3:4] + 0.002)[:, 0]], case="duplicates")


def test_a_folder_of_all_formats(recorded, tmp_path):
    nm = np.arange(390.0, 711, 10)
    curves = np.array([np.interp(nm, GRID.nm, surface(GRID.nm, seed)) for seed in range(3)])
    curves[2, 4] = 1.3
    (tmp_path / "a.csv").write_text("# a comment\nname," + ",".join(f"{w:g}" for w in nm) + "\n"
                                    + "\n".join("x," + ",".join(f"{v:.6f}" for v in row)
                                                for row in curves) + "\nshort,1,2\n")
    (tmp_path / "b.csv").write_text("nm,one,two\n" + "\n".join(
        f"{w:g},{v:.6f},{u:.6f}" for w, v, u in zip(nm, curves[0], curves[1], strict=True)))
    (tmp_path / "c.csv").write_text("nm,one\n" + "\n".join(
        f"{w:g},{v:.6f}" for w, v in zip(nm[:20], curves[0], strict=False)))
    (tmp_path / "d.csv").write_text("nm;one\n400;0.2\n")
    (tmp_path / "e.rda").write_bytes(bz2.compress(r_file(
        {f"X{w:g}": column for w, column in zip(nm, curves.T, strict=True)} | {"id": [1.0, 2, 3]})))
    (tmp_path / "ikeogu.2017.rda").write_bytes(r_file(
        {f"{w:g}": 0.3 + 0.1 * column for w, column in zip(nm, curves.T, strict=True)}))
    for endian, order in (("<", 0), (">", 1)):
        (tmp_path / f"f{order}.hdr").write_text(
            f"ENVI\nsamples = {nm.size}\nlines = 3\ndata type = {4 + order}\nbyte order = {order}\n"
            f"wavelength = {{{', '.join(map(str, nm))}}}\n")
        (tmp_path / f"f{order}.sli").write_bytes(curves.astype(f"{endian}f{4 + 4 * order}")
                                                 .tobytes())
    from scipy.io import savemat
    library = np.column_stack([nm / 1000, 0.01 + 0 * nm, np.arange(nm.size), curves.T])
    library[3, 4] = -1.23e34
    savemat(tmp_path / "g.mat", {"datalib": library})
    savemat(tmp_path / "h.mat", {"datalib": library[:, :3]})
    recorded(read_library(tmp_path))
    columns = read_r_columns(tmp_path / "e.rda")
    recorded(columns, case="columns")
    with zipfile.ZipFile(tmp_path / "z.zip", "w") as archive:
        archive.writestr("in/b.CSV", (tmp_path / "b.csv").read_bytes())
        archive.writestr("in/a.csv", (tmp_path / "a.csv").read_bytes())
        archive.writestr("in/d.txt", b"nothing")
    (tmp_path / "i.json").write_text(json.dumps({"spectral_data": {"data": {"main": {
        f"{w:g}": column.tolist() for w, column in zip(nm, curves.T, strict=True)}}}}))
    recorded({name: READERS[name[1:]](tmp_path / name) for name in ("z.zip", "i.json")},
             case="more formats")
    (tmp_path / "empty").mkdir()
    (tmp_path / "few").mkdir()
    (tmp_path / "few" / "c.csv").write_bytes((tmp_path / "c.csv").read_bytes())
    recorded([str(result_or_refusal(read_library, tmp_path / name)).replace(str(tmp_path), "FOLDER")
              for name in ("empty", "few", "none")], case="refused")


def test_tables_of_text_that_hold_spectra(recorded, tmp_path):
    """More than 20 wavelengths between 200 and 3000 nm, across the header or down a column."""
    found = {}
    for start, end, count in ((400, 700, 20), (400, 700, 21), (200, 700, 25), (201, 700, 25),
                              (400, 2999, 25), (400, 3000, 25), (700, 400, 25)):
        nm = np.linspace(start, end, count).round(1)
        values = np.linspace(0.1, 0.3, count).round(4)
        across = ",".join(map(str, nm)) + "\n" + ",".join(map(str, values)) + "\n"
        down = "nm,a,b\n" + "".join(f"{w},{v},x\n" for w, v in zip(nm, values, strict=True))
        for name, content in (("across", across), ("down", down), ("named", "name," + across)):
            (tmp_path / "a.csv").write_text(content)
            found[f"{name} {start} {end} {count}"] = READERS[".csv"](tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("")
    recorded(found)
    assert READERS[".csv"](tmp_path / "a.csv") == []


def test_two_data_frames_of_r(recorded, tmp_path):
    """Version 3: whole numbers, words, attributes of attributes, and a symbol met before."""
    def words(kind, *numbers):
        return struct.pack(f">{1 + len(numbers)}i", kind, *numbers)

    real = words(14, 3) + np.array([0.5, 0.25, -1.5], ">f8").tobytes()
    whole = words(13, 3, 7, 8, 9)
    said = words(16, 3) + text("a") + text("b") + words(9, -1)
    names, end = words(1) + text("names"), words(254)
    first = words(19 | 1 << 9, 3) + real + whole + said + words(2 | 1 << 10) + names \
        + words(16, 3) + text("X400") + text("count") + text("word") + end
    second = words(19 | 1 << 9, 1) + words(10, 2, 1, 0) + words(2 | 1 << 9 | 1 << 10) + end \
        + words(2 << 8 | 255) + words(16, 1) + text("flag") + end
    content = words(2 | 1 << 10) + words(1) + text("a") + first \
        + words(2 | 1 << 10) + words(1) + text("b") + second + end
    (tmp_path / "a.rda").write_bytes(b"RDX3\nX\n" + words(3, 0x40000, 0x30500, 5) + b"UTF-8"
                                     + content)
    found = read_r_columns(tmp_path / "a.rda")
    recorded(found)
    assert {name: column.tolist() for name, column in found.items()} == {
        "X400": [0.5, 0.25, -1.5], "count": [7, 8, 9], "flag": [1, 0]}


def test_damaged_libraries(recorded, tmp_path):
    whole = r_file({"X400": [1.0], "X500": [2.0]})
    files = {"cut.rda": whole[:-40], "item.rda": whole.replace(struct.pack(">i", 14),
                                                               struct.pack(">i", 24), 1),
             "no.rda": b"RDX4\nX\n" + whole[7:], "text.rda": b"RDX2\nA\n" + whole[7:],
             "long.rda": whole.replace(struct.pack(">ii", 14, 1), struct.pack(">ii", 14, 9000), 1),
             "b.json": b'{"spectral_data": {}}', "b.mat": b"MATLAB 5.0 nothing",
             "list.json": b"[1]", "none.rda": r_file({"id": [1.0, 2.0]}),
             "a.zip": b"PK nothing", "a.sli": b"1234", "b.sli": b"1234"}
    found = {}
    (tmp_path / "b.hdr").write_text("ENVI\nsamples = 1\nlines = two\ndata type = 4\n"
                                    "wavelength = {400}\n")
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        found[name] = str(result_or_refusal(READERS[(tmp_path / name).suffix], tmp_path / name)
                          ).partition("(")[0]
    recorded(found)


# ---- training ------------------------------------------------------------------------------------

SMALL = {"paint": Family(0.6, 2, 0.02, {}),
         "leaves": Family(0.3, 2, 0.01, {MODELS["leaves"]: 220, MODELS["petals"]: 240}, 3,
                          {MODELS["green_tissue"]: 210}),
         "skin": Family(0.1, 1, 0.03, {MODELS["skin"]: 230})}


def libraries():
    rng = np.random.default_rng(5)

    def one(name, count, low):
        curves = np.array([surface(GRID.nm, seed + 100 * len(name)) for seed in range(count)])
        return ReflectanceLibrary(name, np.clip(curves * rng.uniform(low, 1.5, (count, 1)), 0.01,
                                                0.98), {})
    return {"paint": [one("oils", 70, 0.3), one("acrylics", 60, 0.5)], "mixed": [one("many", 50,
                                                                                     0.7)]}


def test_a_prior_that_is_trained(recorded):
    prior, left_out = train(libraries(), response(3)[1], 3, SMALL)
    # expectation maximisation stops by a change of its likelihood, and carries rounding that far
    recorded((prior, [(one.name, one.family, one.measured, one.mixed, one.curves, one.stated.rmse,
                       one.unstated is None) for one in left_out]), rtol=1e-4)
    recorded([(one.stated.scores, one.stated.width, one.stated.shares, one.stated.surprise)
              for one in left_out], rtol=1e-3, case="judgements")


def test_parts_and_their_mixtures(recorded):
    parts = parts_of(libraries(), SMALL, 3, 20)
    recorded([dataclasses.replace(part, curves=part.curves[:40]) for part in parts])
    fitted = fitted_families(parts, SMALL, 3)
    recorded((joined(fitted, SMALL, "somewhere"), fit_family(parts[:2], SMALL["paint"], 1)),
             rtol=1e-4, case="joined")
    recorded(prior_without(parts[0], parts, fitted, SMALL, 3), rtol=1e-4, case="without")
    alone = [part for part in parts if part.name == "oils"]
    recorded((result_or_refusal(prior_without, alone[0], alone, fitted, SMALL, 3),
              result_or_refusal(parts_of, {"metal": []}, SMALL, 3, 20),
              [result_or_refusal(fit_mixture, np.full(shape, 0.4)) for shape in
               ((199, 61), (300, 60), (61,))]), case="refused")


def test_what_is_made_of_measured_curves(recorded):
    curves = np.array([surface(GRID.nm, seed) for seed in range(9)])
    recorded((enriched(curves, 4), enriched(curves)))
    rng = np.random.default_rng(1)
    many = np.repeat(np.linspace(0.1, 0.9, 501)[:, None], 2, axis=1)
    recorded([(len(found := balanced(many[:count], rng)), found[:, 0]) for count in
              (80, 124, 125, 126, 249, 250, 251, 499, 500, 501)], case="balanced")
    default = fit_mixture(np.concatenate([MODELS["woods"](np.random.default_rng(2), 210)]))
    recorded(default, rtol=1e-3, case="default")


def judgement(seed, curves, levels=LEVELS.size):
    rng = np.random.default_rng(seed)
    scores = rng.gamma(2, 0.4, (1, curves, 61)) * np.linspace(1.4, 0.7, 61) \
        * np.linspace(1.2, 0.9, levels)[:, None, None]
    return Judgement(rng.uniform(0.01, 0.05), scores, rng.uniform(0.05, 0.2, (levels, 61)),
                     rng.dirichlet([2, 1, 3], curves), rng.chisquare(3, curves))


def test_calibration_by_what_was_left_out(recorded):
    prior = lopsided_prior()
    left_out = [
        LeftOut("oils", "paint", True, False, 30, judgement(1, 30), judgement(2, 30)),
        LeftOut("inks", "paint", True, False, 40, judgement(3, 40), judgement(4, 40)),
        LeftOut("many", "paint", True, True, 25, judgement(5, 25), judgement(6, 25)),
        LeftOut("leaves", "leaves", False, False, 35, judgement(7, 35), judgement(8, 35)),
        LeftOut("petals", "leaves", False, False, 28, judgement(9, 28), judgement(10, 28)),
        LeftOut("tissue", "leaves", False, False, 22, judgement(11, 22), None),
        LeftOut("skin", "skin", False, False, 31, judgement(12, 31), judgement(13, 31))]
    found = calibrated(prior, left_out)
    recorded((found.band_factors, found.stated_factors, found.curve_factor,
              found.familiar_surprise))
    recorded((certificates(found, left_out),
              [band_figures(found, part, kind) for part in left_out
               for kind in ("stated", "unstated") if getattr(part, kind) is not None]),
             case="certificates")
    # factors that are bounded, on either side
    for scale in (0.2, 3.0):
        wide = [dataclasses.replace(one, **{
            kind: dataclasses.replace(values, scores=values.scores * scale)
            for kind in ("stated", "unstated") if (values := getattr(one, kind)) is not None})
            for one in left_out]
        recorded((calibrated(prior, wide).band_factors, calibrated(prior, wide).stated_factors),
                 case=f"scaled {scale}")


def test_judgements_of_a_prior(recorded):
    truths = np.array([surface(GRID.nm, seed) for seed in range(9)])
    recorded(judge(lopsided_prior(), response(3)[1], truths), rtol=2e-5)


# ---- tables --------------------------------------------------------------------------------------

def picture_signals(count=40):
    rng = np.random.default_rng(6)
    signals = rng.uniform(0.02, 0.9, (count, 1)) * np.exp(rng.normal(0, 0.3, (count, 3)))
    signals[:3] = [[0, 0.0004, 0.001], [1.2, 0.9, 0.3], [0.9, 0.001, 0.8]]
    return signals


def test_tables_of_signals(recorded, monkeypatch):
    prior, matrix, signals = lopsided_prior(), response(3)[1], picture_signals()
    wanted = points_around(signals, 7)
    table = build_table(prior, matrix, 0.02, 7, wanted)
    shares = []
    both = build_tables(prior, matrix, lambda s: [relative_errors(s, 0.01),
                                                  np.repeat(np.diag([1e-4, 3e-4, 2e-4])[None],
                                                            len(s), axis=0)],
                        wanted, shares.append)
    recorded((lattice(5), wanted, table.row, relative_errors(signals, 0.03)))
    # kept in single precision
    recorded((table, both), rtol=1e-4, case="tables")
    assert shares[-1] == 1
    recorded((uplift_pixels(table, signals), interpolation(table.row, len(table.mean),
                                                           signals).toarray(),
              outside(np.array([[0, 0.5, 1], [-1e-9, 0.5, 1], [0.2, 1.0001, 0.2]])),
              table_error(table, prior, signals)), rtol=1e-4, case="pixels")
    default = build_table(prior, matrix, wanted=points_around(signals[5:6], 25))
    recorded((default.mean, default.side, int((default.row >= 0).sum())), rtol=1e-4,
             case="default")
    whole = build_table(prior, matrix, 0.02, 7)
    assert np.all(whole.row >= 0)
    np.testing.assert_allclose(whole.mean[whole.row[wanted]], table.mean[table.row[wanted]],
                               atol=1e-4)       # the modes stand still to 1e-4
    callable_noise = build_table(prior, matrix, lambda s: relative_errors(s, 0.02), 7, wanted)
    np.testing.assert_array_equal(callable_noise.mean, table.mean)
    recorded(result_or_refusal(build_table, prior, response(4)[1]), case="refused")
    monkeypatch.setattr(tables_file, "BATCH", 11)
    np.testing.assert_allclose(build_table(prior, matrix, 0.02, 7, wanted).standard_deviation,
                               table.standard_deviation, atol=1e-6)


@pytest.mark.parametrize("bands", [3, 5])
def test_signals_one_by_one(recorded, bands):
    prior, matrix = lopsided_prior(), response(bands)[1]
    signals = np.array([surface(GRID.nm, seed) @ matrix.T for seed in range(7)])
    shares = []
    found = uplift_directly(prior, matrix, signals, 0.015, shares.append)
    recorded((found, shares), rtol=2e-5)
    recorded((uplift_directly(prior, matrix, signals[:1]),
              uplift_signals(prior, matrix, signals, relative_errors(signals, 0.004), still=0.1)),
             rtol=1e-4, case="others")


def test_low_ranks(recorded, monkeypatch):
    prior, matrix = lopsided_prior(), response(3)[1]
    low = low_rank(prior, matrix, 0.02, 5, slice(0, 61, 4), slice(2, 61, 6))
    # kept in single precision; the weakest of the axes differ by what is rounded off
    recorded(low, rtol=1e-3)
    signals = picture_signals(30)[3:]
    mean, spread = uplift_directly(prior, matrix, signals, 0.02)
    spectra = np.hstack([mean[:, ::4], spread[:, 2::6]])
    coefficients = low.coefficients(spectra)
    stored = coefficients.astype(np.float16)
    bound = np.linspace(0.01, 0.03, spectra.shape[1])
    recorded((coefficients, low.spectra(coefficients), low.rounded(coefficients, 2**-11),
              stated_errors(low, spectra, coefficients.round(3), 16, None),
              stated_errors(low, spectra, coefficients.round(3), 16, bound)), rtol=1e-3,
             case="spectra")
    monkeypatch.setattr(low_rank_file, "SURFACES", 40)
    recorded([result_or_refusal(lambda n=n: low_rank(prior, matrix, 0.02, n, slice(0, 4),
                                                     slice(0, 3)).basis.shape)
              for n in (2, 3, 6, 7)], case="refused")
    zero = stated_errors(low, low.spectra(stored), stored, 16, None)
    assert zero["mean"]["rms"] == 0
