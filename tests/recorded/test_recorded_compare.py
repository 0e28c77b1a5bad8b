"""What sessions beside each other are said to show: charts, shifts, surfaces, catalogue."""
import dataclasses
import sqlite3
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from compact_results import compact
from test_error_laws import image

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import LeftOutPatches, PatchSamples, SpectrumSummary
from spectrabox.session.commands import compare as command
from spectrabox.session.compare import quantities as of_session
from spectrabox.session.compare.catalogue import write_catalogue
from spectrabox.session.compare.control_chart import LIMIT, control_chart, verdict_words
from spectrabox.session.compare.lasting_shift import lasting_shifts, shift_words
from spectrabox.session.compare.quantities import (
    Quantity,
    SessionQuantities,
    find_sessions,
    series_by_setting,
)
from spectrabox.session.compare.surfaces import surface_pairs

FINE, COARSE = visible_grid(5.0), visible_grid(20.0)


def summary(grid, middle, deviation, slope=0.1):
    mean = middle + slope * (grid.nm - 550) / 150 + 0.03 * np.sin(grid.nm / 30)
    error = deviation * (1 + 0.4 * np.cos(grid.nm / 45))
    return SpectrumSummary(grid, mean, error, mean - 2 * error, mean + 1.8 * error, 0 * mean,
                           1 + 0 * mean, 0.95, "test", 550.0)


def lab(count=9):
    """Sessions of two cameras under two lights; brightness, a balance and a residual."""
    rng = np.random.default_rng(8)
    sessions = []
    for at in range(count):
        found = {"brightness": Quantity(rng.normal(0.3, 0.011) - 0.13 * (at >= 5), 0.003 + at / 9e3,
                                        0.012),
                 "band 1 against the others": Quantity(rng.normal(-0.1, 0.002), 0.0007, 0.004),
                 "residual": Quantity(0.01 + 0.002 * (at % 3), 0.0, 0.004)}
        if at == 3:
            found["band 1 against the others"] = Quantity(-0.071, 0.0007, 0.004)
        if at == 6:
            del found["residual"]
        spectra = {"red": summary(FINE if at % 2 else COARSE, 0.3 + 0.011 * at, 0.015 + 0.001 * at)}
        if at < 3:
            spectra["green"] = summary(FINE, 0.5 - 0.02 * at, 0.03, -0.2)
        sessions.append(SessionQuantities(Path(f"/lab/{at:02}/s{at}"), f"session {at}",
                                          "Camera B" if at in (1, 7) else "Camera A",
                                          "3200 K" if at == 8 else "lamp.csv", f"2026-0{at + 1}",
                                          found, spectra))
    return sessions


def test_all_that_is_said_of_a_lab(recorded):
    sessions = lab()
    verdicts, shifts, pairs = (control_chart(sessions), lasting_shifts(sessions),
                               surface_pairs(sessions))
    recorded([dataclasses.astuple(each) for each in verdicts], case="verdicts")
    recorded(shifts, case="shifts")
    recorded([[each.surface, each.first, each.second, each.disagree] for each in pairs],
             case="pairs")
    recorded(np.array([[each.delta_e00, each.rms, each.share_out] for each in pairs]),
             case="how far pairs are apart")
    recorded(list(series_by_setting(sessions)), case="series")
    recorded(compact(command._facts(sessions, verdicts, shifts, pairs)), case="facts")
    recorded(command._text(sessions, verdicts, shifts, pairs).splitlines(), case="text")
    few = sessions[:2]
    recorded(command._text(few, control_chart(few), [], surface_pairs(few)), case="two cameras")
    quiet = [sessions[0], sessions[2]]
    recorded(command._text(quiet, control_chart(quiet), [], []), case="as before")


def of_x(at, *quantity):
    """A session of one quantity."""
    return SessionQuantities(Path(f"s{at}"), "", "", "", "", {"x": Quantity(*quantity)}, {})


@pytest.mark.parametrize("count", [2, 3, 4, 7])
@pytest.mark.parametrize("error", [0.0, 0.02])
def test_the_limit_of_the_control_chart(count, error, recorded):
    """One session that goes further and further off: where it is out, of how many and how known."""
    found = []
    for off in np.arange(0.0, 0.16, 0.004):
        values = [0.002 * (-1) ** at * at for at in range(count - 1)] + [off]
        sessions = [of_x(at, value, error * (1 + at / 5), 0.01 + 0.001 * at)
                    for at, value in enumerate(values)]
        found.append(control_chart(sessions)[-1])
    out = [each.out for each in found]
    assert not out[0] and out[-1] and out == sorted(out)
    recorded([out.index(True), [[each.middle, each.limit] for each in found[::6]],
              [verdict_words(each, "s") for each in found[::13]]])


def test_a_scatter_that_is_wider_than_stated_widens_the_limits(recorded):
    values = np.array([0.0, 0.05, -0.04, 0.03, -0.06, 0.02])
    sessions = [of_x(at, value, 0.01, 0.001) for at, value in enumerate(values)]
    verdicts = control_chart(sessions)
    middle = np.median(values)
    scatter = 1.4826 * np.median(np.abs(values - middle))
    # sums and a root: round-off
    np.testing.assert_allclose([each.limit for each in verdicts],
                               LIMIT * np.hypot(scatter, 0.01), rtol=1e-12)
    recorded(verdicts)


def shifted(by, count, at, error=0.004):
    rng = np.random.default_rng(3)
    values = rng.normal(0, 0.01, count)
    values[at:] += by
    return [of_x(at, value, error * (1 + at / 9), 0.01 + at / 2e3)
            for at, value in enumerate(values)]


@pytest.mark.parametrize("count, at", [(5, 3), (6, 2), (6, 4), (9, 5), (14, 12)])
def test_from_which_size_a_shift_is_found(count, at, recorded):
    found = []
    for by in np.arange(0.0, 0.2, 0.002):
        shifts = lasting_shifts(shifted(by, count, at)) + lasting_shifts(shifted(-by, count, at))
        found.append([[each.first, each.last_before, each.before, each.after, each.size,
                       each.standard_error] for each in shifts])
    first = next((number for number, each in enumerate(found) if each), None)
    assert first is None or count >= 6
    recorded([first, found[first or 0], found[-1],
              [shift_words(each, "s9") for each in lasting_shifts(shifted(0.19, count, at))]])


def test_an_odd_session_is_clipped_in_the_mean_of_its_part(recorded):
    sessions = shifted(0.09, 10, 5)
    odd = dataclasses.replace(sessions[7], quantities={"x": Quantity(0.5, 0.004, 0.01)})
    recorded(lasting_shifts([*sessions[:7], odd, *sessions[8:]]))


def test_from_which_difference_two_surfaces_disagree(recorded):
    found = []
    for off in np.arange(0.0, 0.12, 0.002):
        one = {"red": summary(FINE, 0.3, 0.012)}
        other = {"red": summary(COARSE, 0.3 + off, 0.02), "blue": summary(FINE, 0.2, 0.01)}
        sessions = [SessionQuantities(Path(str(at)), "", "", str(at), "", {}, spectra)
                    for at, spectra in enumerate((one, other))]
        found += surface_pairs(sessions)
    disagree = [each.disagree for each in found]
    assert disagree == sorted(disagree) and not disagree[0] and disagree[-1]
    recorded([disagree.index(True), np.array([[each.share_out, each.rms, each.delta_e00]
                                              for each in found])])


def samples(rng, count=24, bands=3):
    mean = rng.uniform(0.02, 0.6, (count, bands))
    mean[5], mean[7, 1] = [0.004, 0.3, 0.2], 0.0181     # dark in one band
    spread = rng.normal(0, 1, (count, bands, bands))
    covariance = np.einsum("ikl,iml->ikm", spread, spread) * 1e-6
    return PatchSamples(mean, covariance, np.full(count, 300), np.zeros((count, bands)),
                        np.zeros((count, bands)))


def stored_calibration(predicted, left_out=None):
    def record(kind, name):
        records = {"predicted": predicted} | ({} if left_out is None else {"left out": left_out})
        return records[name]
    return {"calibrate": SimpleNamespace(record=record, facts={})}


def test_brightness_balance_and_residual_of_a_chart(recorded, monkeypatch):
    rng = np.random.default_rng(5)
    of_chart, repeats = samples(rng), SimpleNamespace(repeatability=SimpleNamespace(
        relative_error=0.014))
    photo = dataclasses.replace(image(np.ones((1, 1, 3))), exposure_s=0.04, iso=250.0, f_number=5.6)
    recorded(of_session._of_chart(of_chart, photo, repeats, {}), case="no calibration")
    predicted = of_chart.mean * rng.normal(1, 0.013, of_chart.mean.shape)
    predicted[9, 0] = np.nan
    reference = rng.uniform(0.1, 0.9, (24, FINE.nm.size))
    left_out = LeftOutPatches(FINE, reference + rng.normal(0, 0.02, (24, 1)), reference - 0.1,
                              reference + 0.1, reference, np.zeros(24, bool), np.full(24, 0.9),
                              0.95)
    monkeypatch.setattr(of_session, "left_out_of", lambda stored: None)
    recorded(of_session._of_chart(of_chart, photo, repeats, stored_calibration(predicted)),
             case="calibrated")
    monkeypatch.setattr(of_session, "left_out_of", lambda stored: left_out)
    recorded(of_session._of_chart(of_chart, photo, repeats, stored_calibration(
        of_chart.mean * 1.0004)), case="with patches left out, and a small residual")
    scale = SimpleNamespace(value=1.7, standard_error=0.03)
    for error in (0.03, None):
        scale.standard_error = error
        joint = SimpleNamespace(views=[SimpleNamespace(light_scale=scale)])
        stage = SimpleNamespace(record=lambda kind, name, joint=joint: joint)
        recorded(of_session._of_scale(stage, (None, of_chart, photo), repeats),
                 case=f"scale with an error of {error}")
        assert of_session._of_scale(stage, None, repeats) == {}
    bare = dataclasses.replace(photo, exposure_s=None, iso=None, f_number=None)
    recorded([of_session._exposure(photo), of_session._exposure(bare)], case="exposures")


def test_the_catalogue_holds_every_number(tmp_path, recorded):
    sessions = [dataclasses.replace(each, folder=tmp_path / each.folder.relative_to("/"))
                for each in lab()]
    for _ in range(2):
        write_catalogue(tmp_path / "lab.sqlite", tmp_path, sessions, control_chart(sessions))
    with sqlite3.connect(tmp_path / "lab.sqlite") as file:
        tables = {name: [list(row) for row in file.execute(f"SELECT * FROM {name}")]
                  for name in ("sessions", "quantities")}
    file.close()
    recorded(tables["sessions"], case="sessions")
    recorded([[" | ".join(map(str, (row[0], row[1], row[6]))), *row[2:6]]
              for row in tables["quantities"]], case="quantities")


def test_a_light_in_words(recorded):
    recorded([of_session._light_words(SimpleNamespace(cct=cct, word=word, file=file))
              for cct, word, file in ((3200.0, None, None), (None, "unknown", None),
                                      (None, None, "l.csv"), (6504.5, "x", "y"))])


def test_which_folders_hold_sessions(tmp_path, recorded):
    for name in ("b", "a/one", "a/one/inside", "a/two/deep", "1/2/3/4", "1/2/3/4/5/6", ".hidden/s",
                 "c/d/e/f/g"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "session.toml").write_text("", encoding="utf-8")
    (tmp_path / "plain").mkdir()
    recorded({str(depth): [each.relative_to(tmp_path).as_posix()
                           for each in find_sessions(tmp_path, **more)]
              for depth, more in (("default", {}), (1, {"depth": 1}), (0, {"depth": 0}),
                                  (5, {"depth": 5}))})
    with pytest.raises(InputError, match="is no folder"):
        find_sessions(tmp_path / "none")
