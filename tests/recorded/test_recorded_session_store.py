"""What is stored, shared, exported and said of stored results, held to its record."""
import dataclasses
import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import (
    Outcome,
    SignalError,
    SpectrumSamples,
    SpectrumSummary,
    SurfaceSignals,
)
from spectrabox.session.picture.picture_results import PictureOfSpectra, picture_facts
from spectrabox.session.scores import score
from spectrabox.session.store import draws_files
from spectrabox.session.store.colours_table import colour_weights, colours_text
from spectrabox.session.store.draws_files import stored_draws, write_draws
from spectrabox.session.store.record_files import pack, unpack
from spectrabox.session.store.rehearsals import rehearsal_text, too_narrow, verdict_sentence
from spectrabox.session.store.results import AS_INTENDED, MaterialResult
from spectrabox.session.store.shared_stages import made_once, share, shared_name
from spectrabox.session.store.spectra_table import best_spectrum, spectra_columns, spectra_files
from spectrabox.session.store.store import (
    fingerprint,
    load_stage,
    save_stage,
    stage_folder,
    sweep_stage,
    why_stale,
)

FINE, COARSE = visible_grid(1), visible_grid(5)


def draws(seed, outcome=Outcome.FAMILIAR, count=60):
    rng = np.random.default_rng(seed)
    x = (COARSE.nm - 400) / 300
    spectra = 0.3 + 0.1 * seed / 4 + 0.15 * np.sin(3 * x + seed) \
        + 0.05 * rng.standard_normal((count, 1)) * np.cos(4 * x) + 0.01 * rng.random((count, 61))
    return SpectrumSamples(COARSE, spectra, spectra[:, ::8], "learnt prior", 31.5, seed, outcome,
                           "drawn")


def summary(samples):
    mean, spread = samples.spectra.mean(axis=0), samples.spectra.std(axis=0)
    curves = [np.interp(FINE.nm, COARSE.nm, each) for each in (
        mean, spread, mean - 2.1 * spread, mean + 1.9 * spread, mean - 0.2, mean + 0.25)]
    return SpectrumSummary(FINE, *curves, 0.9, "conditional", 465.0)


def material(name, seed, known=False):
    samples = None if known else draws(seed)
    spectrum = 0.2 + 0.1 * seed + 0.05 * np.cos(FINE.nm / 40 + seed)
    return MaterialResult(name, spectrum, np.array([0.2, 0.3, 0.4]), np.eye(3), np.eye(3),
                          None if known else summary(samples), samples, {}, None, None)


def said(call, *arguments):
    try:
        return call(*arguments)
    except SpectraboxError as error:
        return f"{type(error).__name__}: {error}"


def test_scores_against_a_truth(recorded):
    samples = draws(2)
    shown = summary(samples)
    truth = shown.mean + 0.08 * np.sin(FINE.nm / 20)
    found = score(truth, truth + 0.02, shown, samples)
    assert found.rmse_inverse_rendering == pytest.approx(0.02)
    assert found.rmse_mean == pytest.approx(np.sqrt(np.mean((truth - shown.mean) ** 2)))
    recorded([found, score(truth, None, shown, samples)])


def test_tables_of_spectra_and_colours(recorded, tmp_path):
    materials = [material("white, glossy", 1), material('a "b"', 2, known=True), material("c", 3)]
    results = SimpleNamespace(folder=tmp_path, name="a session", materials=materials)
    columns = spectra_columns(results)
    texts = {path.name: text for path, text in spectra_files(results, FINE.nm).items()}
    white = colour_weights(FINE.nm) @ np.ones(FINE.nm.size)
    # white's Y is 1, and it is 1, 1, 1 of ACEScg: six digits of its matrix
    np.testing.assert_allclose(white[[1, 3, 4, 5]], 1, atol=2e-5)
    recorded({"columns": columns, "best": [best_spectrum(each) for each in materials],
              "weights": colour_weights(FINE.nm), "colours": colours_text(materials, FINE.nm),
              "files": {name: [line[:90] for line in text.splitlines()[:9] if "Date" not in line
                               and "spectrabox 0" not in line]
                        for name, text in texts.items()}})


def test_draws_as_files(recorded, tmp_path, monkeypatch):
    records = {"a b": draws(1), 'c,"d"': draws(2, count=45)}
    monkeypatch.setattr(draws_files, "samples_of", lambda stored, name: (records[name], None))
    stored = {"sample": SimpleNamespace(facts={"records": {
        f"{kind} {name}": None for name in records for kind in ("samples", "summary")}})}
    found = {}
    for step, count in ((5, None), (10, 7), (15, 3), (7, 2), (300, 1)):
        found[f"{step} {count}"] = stored_draws(stored, step, count)
    recorded(found)
    few = stored_draws(stored, 100, 2)
    write_draws(tmp_path / "draws.csv", few)
    write_draws(tmp_path / "draws.NPZ", few)
    with np.load(tmp_path / "draws.NPZ") as arrays:
        recorded({"csv": (tmp_path / "draws.csv").read_text(encoding="utf-8"),
                  "npz": {name: arrays[name] for name in arrays.files}}, case="files")
    rows = sum(values.size for _, values in few.values())
    limits = {}
    for most in (rows - 1, rows):
        monkeypatch.setattr(draws_files, "MAX_ROWS", most)
        limits[str(most)] = said(write_draws, tmp_path / "more.csv", few)
    limits["none"] = said(stored_draws, {"sample": SimpleNamespace(facts={"records": {}})}, 5, 1)
    recorded(limits, case="limits")


def signals():
    return SurfaceSignals(("a", "b"), (True, False), COARSE, np.full((2, 61), 0.3), ("R", "G"),
                          np.array([0, 1]), np.full((2, 61), 1 / 61), np.array([[0.1, np.nan],
                                                                                 [0.3, 0.4]]),
                          (SignalError("noise", np.eye(2) * np.ones((2, 1, 1))),))


def test_records_are_packed_and_come_back(recorded):
    made = {"signals": signals(), "samples": draws(1), "notes": ("one", "two"), "none": None,
            "array": np.arange(3), "numbers": (1, 2.5), "outcome": Outcome.CONVERGED}
    arrays = {}
    packed = {name: pack(each, name, arrays) for name, each in made.items()}
    back = unpack(SurfaceSignals, json.loads(json.dumps(packed["signals"])), arrays)
    assert back.names == ("a", "b") and back.known == (True, False)
    again = unpack(SpectrumSamples, json.loads(json.dumps(packed["samples"])), arrays)
    assert again.outcome is Outcome.FAMILIAR and again.effective_samples == 31.5
    recorded({"packed": packed, "arrays": arrays, "back": back})

    def opened(kind, node, of=arrays):
        try:
            return "taken" if unpack(kind, node, of) is not None else "none"
        except (KeyError, TypeError, ValueError) as error:
            return f"{type(error).__name__}"

    node = packed["signals"]
    recorded([opened(SurfaceSignals, node), opened(SurfaceSignals, node | {"names": 3}),
              opened(SurfaceSignals, {name: node[name] for name in list(node)[1:]}),
              opened(SurfaceSignals, node, {}), opened(SurfaceSignals, None),
              opened(SpectrumSamples, packed["samples"] | {"outcome": "WRONG"}),
              opened(np.ndarray, {"array": "other"}), opened(tuple[str, ...], ["a", 3])],
             case="damaged")


KEY = {"files": {"a.dng": "1", "b.dng": "2"}, "settings": {"v": 1, "w": [1, 2]}, "versions": {}}


def save(results, name="chart", key=KEY, value=1.0):
    with stage_folder(results, name) as folder:
        save_stage(folder, key, {"numbers": np.arange(4.0) * value, "notes": ("said",)}, 1.23456,
                   {"stage": name})
    return load_stage(results, name)


def test_why_a_stage_is_stale(recorded):
    others = (KEY, KEY | {"files": {"a.dng": "1"}}, KEY | {"files": {"a.dng": "3", "c.dng": "2"}},
              KEY | {"settings": {"v": 1, "w": [2, 1]}}, KEY | {"code": {"radiometry": "x"}},
              {name: KEY[name] for name in ("files", "settings")}, KEY | {"versions": "1"}, {})
    recorded({"forward": [why_stale(KEY, other) for other in others],
              "backward": [why_stale(other, KEY) for other in others]})
    assert len({fingerprint(other) for other in others}) == len(others)
    assert fingerprint(KEY) == fingerprint(dict(reversed(KEY.items())))


def test_what_is_damaged_is_said(recorded, tmp_path):
    def damaged(change):
        results = tmp_path / change.__name__
        save(results)
        change(results / "chart")
        stage = load_stage(results, "chart")
        return None if stage is None else {"damage": stage.damage, "key": stage.key,
                                           "seconds": stage.seconds}

    def untouched(folder):
        pass

    def arrays_changed(folder):
        (folder / "arrays.npz").write_bytes(b"x")

    def arrays_missing(folder):
        (folder / "arrays.npz").unlink()

    def facts_changed(folder):
        (folder / "facts.json").write_text("[]", encoding="utf-8")

    def facts_without_key(folder):
        (folder / "facts.json").write_text("{}", encoding="utf-8")

    def sums_missing(folder):
        (folder / "SHA256SUMS").unlink()

    def sums_of_less(folder):
        lines = (folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
        (folder / "SHA256SUMS").write_text(lines[0] + "\n", encoding="utf-8")

    def extra_file(folder):
        (folder / "more.txt").write_text("more", encoding="utf-8")

    def gone(folder):
        shutil.rmtree(folder)

    def moved_aside(folder):
        folder.replace(folder.with_name(".chart.old"))

    changes = (untouched, arrays_changed, arrays_missing, facts_changed, facts_without_key,
               sums_missing, sums_of_less, extra_file, gone, moved_aside)
    recorded({change.__name__: damaged(change) for change in changes})
    sweep_stage(tmp_path / "moved_aside", "chart")
    assert load_stage(tmp_path / "moved_aside", "chart").damage is None
    stage = save(tmp_path / "records")
    recorded({"numbers": stage.record(np.ndarray, "numbers"),
              "notes": stage.record(tuple[str, ...], "notes"),
              "missing": said(stage.record, np.ndarray, "other").replace(str(tmp_path), ""),
              "wrong": said(stage.record, SurfaceSignals, "notes").replace(str(tmp_path), ""),
              "files": sorted(path.name for path in stage.folder.iterdir())}, case="records")


def test_what_sessions_share(recorded, tmp_path):
    shared = tmp_path / "shared"
    other = KEY | {"settings": {"v": 2}}
    found = {}

    def there(stage, key, where=shared):
        with made_once(where, stage, key) as copied:
            return None if copied is None else copied.record(np.ndarray, "numbers")

    found["before"] = there("chart", KEY)
    for stage in ("chart", "calibrate", "photo"):
        share(shared, stage, save(tmp_path / "results", stage, value=2.0))
    share(None, "chart", load_stage(tmp_path / "results", "chart"))
    found |= {f"{stage} {number}": there(stage, key) for stage in ("chart", "calibrate", "photo")
              for number, key in enumerate((KEY, other))}
    found["nowhere"] = there("chart", KEY, None)
    (shared / shared_name("chart", KEY) / "arrays.npz").write_bytes(b"x")
    found["damaged"] = there("chart", KEY)
    found["names"] = [shared_name("chart", key) for key in (KEY, other)]
    recorded(found)


def rehearsed(coverage, error, level=0.95):
    return {"times": 40, "level": level, "materials": [
        {"name": "good", "coverage": level, "coverage_standard_error": 0.01, "rmse": 0.02,
         "width": 0.1, "ranks": [1, 2, 3]},
        {"name": "bad", "coverage": coverage, "coverage_standard_error": error, "rmse": 0.031,
         "width": 0.12, "ranks": [3, 0, 1]}]}


def test_whether_rehearsed_bands_are_too_narrow(recorded):
    recorded({f"{coverage} {error}": too_narrow(rehearsed(coverage, error)) for coverage in (
        0.88, 0.9099, 0.9101, 0.9299, 0.9301, 0.95) for error in (0.0, 0.01, 0.02)})
    recorded([verdict_sentence(rehearsed(0.9, 0.005)), verdict_sentence(rehearsed(0.93, 0.01)),
              rehearsal_text(rehearsed(0.9, 0.02, 0.9))], case="said")


def test_what_is_said_of_a_picture(recorded, tmp_path):
    picture = PictureOfSpectra(
        ("results/picture/mean.exr", "results/picture/map.png"), (("Colour", tmp_path / "c.png"),),
        (30, 20), 0.3, (0.7, 0.1, 0.0, 0.05, 0.15, 0.0), 0.01, 0.02, 0.033, ("a note",))
    recorded({"facts": picture_facts(picture), "sentence": picture.sentence,
              "reasons": picture.reasons})


def test_whose_draws_are_doubtful(recorded):
    plain = material("a", 1)
    recorded({outcome.name: dataclasses.replace(plain, samples=draws(1, outcome)).doubtful
              for outcome in Outcome} | {"known": material("a", 1, known=True).doubtful,
                                         "as intended": sorted(each.name for each in AS_INTENDED)})
