"""Recorded: priors on a camera's curves, of measured cameras, of one, and of smoothness alone."""
import dataclasses
import json

import numpy as np
import pytest
from calibrate_cameras import NODES, cameras
from uneven_charts import UNEVEN, bands, camera, on, sizes, small_prior, uneven_photo

from spectrabox.calibrate.prior import learnt_prior
from spectrabox.calibrate.prior.camera_database import cameras_of_file, read_camera_database
from spectrabox.calibrate.prior.camera_prior import load_prior, matern, save_prior, shipped_prior
from spectrabox.calibrate.prior.measured_prior import prior_of_curves
from spectrabox.calibrate.prior.smooth_prior import smooth_prior
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import grid_from_nm

NM = np.array([400.0, 425, 440, 470, 500, 515, 550, 585, 600, 640, 660, 700])
COARSE = grid_from_nm(NM)


def said(call, *arguments, **more):
    try:
        return call(*arguments, **more)
    except InputError as error:
        return str(error)


def facts(prior):
    """All that a prior says; of its factors, whose columns may change sign, the covariances."""
    fields = {field.name: getattr(prior, field.name) for field in dataclasses.fields(prior)}
    for name in ("within", "between"):
        factors = fields.pop(name)
        fields[name] = {"directions": factors.shape[1], **sizes(factors @ factors.T)}
    return fields


# ---- the prior and its file ----------------------------------------------------------------------

@pytest.mark.parametrize("smoothness", [1.5, 2.5])
def test_matern_correlations(recorded, smoothness):
    recorded({length: matern(NM, length, smoothness) for length in (7.0, 30.0, 120.0)})


@pytest.mark.parametrize("floor", [True, False])
def test_a_prior_of_measured_cameras(recorded, floor):
    made, rng = small_prior(floor=floor), np.random.default_rng(21)
    state = made.means[1] + 0.1 * rng.standard_normal((2, made.means.shape[1]))
    curves = np.abs(rng.standard_normal((2, 5))) + 0.1
    recorded({"facts": facts(made), "bands": made.bands, "curves": made.curves(state),
              "slope": made.slope(state), "state": made.state(curves),
              "covariances": [sizes(one) for one in made.covariances()]}, rtol=1e-5)
    np.testing.assert_allclose(made.curves(made.state(curves)), curves, rtol=1e-12)


def test_every_part_of_a_priors_covariance(recorded):
    made = small_prior()
    parts = {}
    for name, change in (
            ("within", {"shares": [[0.7, 0], [1.3, 0], [2.1, 0]]}),
            ("between", {"shares": [[0, 0.7], [0, 1.3], [0, 2.1]]}),
            ("added", {"departures": [[0.02, 15, 0, 1, 0, 1], [0.03, 40, 0, 1, 0, 1]]}),
            ("each", {"departures": [[0, 1, 0.05, 15, 0, 1], [0, 1, 0.03, 40, 0, 1]]}),
            ("all", {"departures": [[0, 1, 0, 1, 0.05, 15], [0, 1, 0, 1, 0.03, 40]]})):
        nothing = {"shares": [[0, 0]] * 3, "departures": [[0, 1, 0, 1, 0, 1]] * 3}
        changed = {key: np.array(value, float) for key, value in (nothing | change).items()}
        count = min(len(value) for value in changed.values())
        only = dataclasses.replace(
            made, jitter_sd=2e-4, localised=(0.4, 55.0, 0.25), widening=np.ones(count),
            level=np.minimum(made.level, count - 1),
            **{key: value[:count] for key, value in changed.items()})
        parts[name] = [sizes(one) for one in only.covariances()]
    recorded(parts, rtol=1e-5)


def test_a_prior_is_read_as_it_was_written(recorded, tmp_path):
    made = small_prior()
    save_prior(tmp_path / "prior.npz", made)
    read = load_prior(tmp_path / "prior.npz")
    recorded(facts(read), rtol=1e-5)
    for field in dataclasses.fields(made):
        ours, theirs = (getattr(one, field.name) for one in (made, read))
        if isinstance(ours, np.ndarray):
            # single precision
            np.testing.assert_allclose(theirs, ours, rtol=1e-6, atol=1e-6)
        elif field.name != "jitter_sd":
            assert theirs == ours, field.name


def test_what_is_no_prior_is_refused(recorded, tmp_path):
    (tmp_path / "words.npz").write_text("no archive", encoding="utf-8")
    np.savez(tmp_path / "other.npz", nm=NM)
    table = {name: said(load_prior, tmp_path / f"{name}.npz") for name in ("words", "other")}
    missing = said(load_prior, tmp_path / "missing.npz").replace(str(tmp_path), "")
    recorded(table | {"missing": missing})


def test_the_shipped_prior(recorded):
    recorded({"facts": facts(shipped_prior()),
              "covariances": [sizes(one) for one in shipped_prior().covariances()]}, rtol=1e-5)


# ---- learnt from measured cameras ----------------------------------------------------------------

@pytest.mark.parametrize("count", [4, 11, 12, 15])
def test_families_of_few_and_of_many_cameras(recorded, count):
    made = small_prior(count, seed=count)
    recorded({"facts": facts(made), "widening": made.widening}, rtol=1e-5)


def test_a_prior_by_other_constants(recorded):
    constants = learnt_prior.PriorConstants(
        0.31, 0.22, 0.9, 0.07, 0.6, 1.4, (0.3, 45.0, 0.2), 0.15, 0.35,
        (0.01, 25.0, 0.08, 35.0, 0.04, 90.0))
    curves = on(COARSE, cameras(14, 6), NODES)
    names = tuple(f"{'ABCDEFG'[index % 7]} {index}" for index in range(14))
    made = learnt_prior.build_prior(NM, curves * np.linspace(0.2, 3, 14)[:, None, None], names,
                                    source="s", licence="l", constants=constants)
    recorded({"facts": facts(made), "defaults": learnt_prior.CONSTANTS}, rtol=1e-5)
    # cameras of any scale
    plain = learnt_prior.build_prior(NM, curves, names, source="s", licence="l",
                                     constants=constants)
    np.testing.assert_allclose(made.means, plain.means, rtol=1e-9)


def test_parts_of_what_is_learnt(recorded):
    rng = np.random.default_rng(23)
    states = np.repeat(rng.standard_normal((5, 9)), [3, 1, 4, 2, 5], axis=0)
    states = states + 0.1 * rng.standard_normal(states.shape)
    names = ("A 1", "A 2", "B", "C 1", "", "A 3", "B 2", "C", "D", "A 4", "E 1", "E 2", "B 5",
             "F", "A")
    groups = learnt_prior.families(states)
    middle, between = learnt_prior.between_makers(states, names)
    within = learnt_prior.within_families(states, groups)
    recorded({"groups": groups, "few": learnt_prior.families(states[:11]), "middle": middle,
              "between": between, "within": within.T @ within,
              "alone": learnt_prior.within_families(states, []),
              "widening": [learnt_prior._student_widening(tuple(f"{index} x" for index in
                                                                range(count)))
                           for count in (1, 3, 4, 5, 9)]})


def test_too_few_cameras_are_refused(recorded):
    curves = on(COARSE, cameras(4, 6), NODES)
    recorded({count: said(learnt_prior.build_prior, NM, curves[:count], ("A",) * count, source="",
                          licence="") for count in (0, 1, 3)})


# ---- one measured camera, and none ---------------------------------------------------------------

def test_a_prior_about_measured_curves(recorded):
    made = prior_of_curves(UNEVEN, camera(), 0.07)
    recorded({"facts": facts(made), "covariance": sizes(made.covariances()[0])})
    # at its peak a curve is off by its relative error, what is added, and what keeps it invertible
    top = np.argmax(made.means[0])
    assert np.sqrt(made.covariances()[0][top, top]) / made.means[0][top] == pytest.approx(
        np.sqrt(0.07**2 + (0.2 * 0.07) ** 2 + 1e-6), rel=1e-9)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_a_prior_of_smoothness(recorded, count):
    photos = [uneven_photo(11, curves=bands(count), seed=seed) for seed in (1, 2)]
    made = smooth_prior(photos, UNEVEN)
    recorded({"facts": facts(made),
              "covariances": [sizes(made.covariances()[level]) for level in (0, 5)]})
    # a flat curve of the prior's level gives the whole signal of every band
    flat = (photos[0].reflectances * photos[0].power).sum(axis=1) @ photos[0].irradiance / np.pi
    np.testing.assert_allclose(made.means[0].reshape(count, -1)[:, 0] * flat,
                               photos[0].signal.sum(axis=0), rtol=1e-12)


# ---- folders of measured cameras -----------------------------------------------------------------

def rawtoaces(curves, nm, model):
    rows = {f"{wavelength:g}": [round(float(value), 6) for value in values]
            for wavelength, values in zip(nm, curves.T, strict=True)}
    return json.dumps({"header": {"manufacturer": "Maker", "model": model},
                       "spectral_data": {"data": {"main": rows}}})


def camspec(*blocks):
    return "\n\n".join("\n".join([name, *(" ".join(f"{value:.6f}" for value in row)
                                        for row in curves)]) for name, curves in blocks)


def csv(curves, nm):
    names = ",".join("RGBWXYZ"[:len(curves)])
    return "\n".join([f"wavelength_nm,{names}", *(
        ",".join(f"{value:.6f}" for value in (wavelength, *row))
        for wavelength, row in zip(nm, curves.T, strict=True))])


@pytest.fixture
def folder(tmp_path):
    """Cameras in all formats, on grids finer, coarser and wider than the database's."""
    made = cameras(9, 25)
    wide = np.arange(390.0, 731.0, 4.0)
    tens = np.arange(400.0, 721.0, 10.0)
    files = {
        "a.json": rawtoaces(on(grid_from_nm(wide), made[0], NODES), wide, "One"),
        "b.csv": csv(made[1], NODES),
        "c.TXT": camspec(("Spec A", on(grid_from_nm(tens), made[2], NODES)),
                         ("Spec B", 3.7 * on(grid_from_nm(tens), made[3], NODES))),
        "d.json": rawtoaces(made[4], NODES, "One"),
        "e.csv": csv(np.vstack([made[5], made[6][:1]]), NODES),
        "f.csv": csv(made[5] - 0.049 * made[5].max() * (NODES == 500), NODES),
        "g.csv": csv(made[5] * (1 - (NODES == 500)) - 0.051 * made[5].max() * (NODES == 500),
                     NODES),
        "h.csv": csv(made[5] * (1 - (NODES == 500)) - 0.049 * made[5].max() * (NODES == 500),
                     NODES),
        "i.csv": csv(made[5] * [[1], [0], [1]], NODES),
        "j.json": "[1, 2]", "k.json": rawtoaces(made[7][:, ::-1], NODES[::-1], "Down"),
        "l.txt": "Spec C\n1 2 3\n4 5 6\n7 8 9\n", "m.txt": "Spec\nx y",
        "n.json": rawtoaces(made[7][:, :50], NODES[:50], "Short"), "o.md": "words",
        "p.json": rawtoaces(np.where(NODES == 430, np.nan, made[7]), NODES, "Last")}
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def test_a_folder_of_measured_cameras(recorded, folder):
    found = read_camera_database(folder)
    fewer = read_camera_database(folder, leave_out=("b", "Spec A"))
    recorded({"all": found, "by camera": dict(zip(found.names, found.curves, strict=True)),
              "fewer": (fewer.names, fewer.curves, fewer.skipped)})
    np.testing.assert_allclose(found.curves[found.names.index("b")], cameras(9, 25)[1], atol=1e-6)


def test_cameras_of_one_file(recorded, folder):
    recorded({path.name: said(cameras_of_file, path)
              for path in sorted(folder.iterdir()) if path.name != "c.TXT"}
             | {"two": list(cameras_of_file(folder / "c.TXT"))})


def test_folders_that_hold_no_camera_are_refused(recorded, folder, tmp_path_factory):
    empty, broken = (tmp_path_factory.mktemp(name) for name in ("empty", "broken"))
    (broken / "j.json").write_text("{}", encoding="utf-8")
    table = {name: said(read_camera_database, where, **more) for name, where, more in (
        ("missing", empty / "missing", {}), ("empty", empty, {}), ("broken", broken, {}),
        ("not there", folder, {"leave_out": ("Spec D",)}),
        ("unlike any", folder, {"leave_out": ("xyzzy",)}),
        ("none left", folder, {"leave_out": (*read_camera_database(folder).names, "e")}))}
    recorded({name: text.replace(str(empty), "").replace(str(broken), "").replace(str(folder), "")
              for name, text in table.items()})


