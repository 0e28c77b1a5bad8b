"""Answers on signals alone, held to their records: samples, plans, more measurements, refusals."""
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from whole_sessions import compact

from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.session.signals.answers import SampleRequest, sample_answer, sample_text
from spectrabox.session.signals.judgement_answers import PlanRequest, plan_answer
from spectrabox.session.signals.lamps_at_hand import lamps_at_hand
from spectrabox.session.signals.request_draws import DrawOptions
from spectrabox.session.signals.signal_options import (
    causes_of_error,
    numbers,
    parse_reading,
    read_signals,
    relative_to_white,
)
from spectrabox.session.signals.spectral_library import read_spectral_libraries

CAMERA, LIGHT = "Nikon 5100 (NPL)", "LED-B3"
FINE = visible_grid(1)
TRUTH = 0.08 + 0.5 / (1 + np.exp(-(FINE.nm - 585) / 14)) + 0.12 * np.exp(
    -((FINE.nm - 460) / 30) ** 2)
WHITE = np.array([0.9, 1.2, 0.7])
NOISE = np.array([0.003, 0.002, 0.004])


def words(values):
    return ",".join(f"{value:.6f}" for value in values)


def seen(light=LIGHT, camera=CAMERA, power=1):
    return relative_response(camera, light, FINE) @ TRUTH**power


OPTIONS = DrawOptions(9, "prior", 1000, 3, "bounded", None, None)
REQUEST = SampleRequest(
    CAMERA, LIGHT, words(seen() * WHITE), None, words(WHITE), words(NOISE), OPTIONS, None, (), 0.9,
    (), (), (), None, None, False, None, None, (), 0.013, 0.008)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Every kind of further measurement in one file, what it names, a truth and signals, in the
    folder where the commands run.
    """
    monkeypatch.chdir(tmp_path)
    filters = np.exp(-0.5 * ((FINE.nm[:, None] - [500, 620]) / [14, 10]) ** 2)
    table = np.column_stack([FINE.nm, filters])
    (tmp_path / "filters.csv").write_text("nm,green,orange\n" + "\n".join(
        words(row) for row in table), encoding="utf-8")
    (tmp_path / "spot.csv").write_text("nm,value,standard_error\n" + "\n".join(
        words(row) for row in zip(FINE.nm[60:], TRUTH[60:], 0.003 + 1e-5 * FINE.nm[60:],
                                  strict=True)), encoding="utf-8")
    (tmp_path / "truth.csv").write_text("nm,other,mine\n" + "\n".join(
        words(row) for row in zip(FINE.nm, TRUTH[::-1], TRUTH, strict=True)), encoding="utf-8")
    curve = filters[:, 1]
    (tmp_path / "more.toml").write_text(f"""
[[reading]]
nm = 415
fwhm_nm = 9
reflectance = {float(np.interp(415, FINE.nm, TRUTH)):.6f}
error = 0.012
[[reading]]
nm = 690
reflectance = {float(np.interp(690, FINE.nm, TRUTH)):.6f}
[[band]]
curve = "filters.csv"
column = "orange"
reflectance = {float(curve @ TRUTH / curve.sum()):.6f}
error = 0.006
[[spot]]
file = "spot.csv"
step_nm = 40
[[photo]]
light = "A"
sensitivity = "CIE 1931 2 Degree Standard Observer"
signal = [{words(0.8 * seen("A", "CIE 1931 2 Degree Standard Observer"))}]
white = [0.8, 0.8, 0.8]
noise = [0.003, 0.004, 0.005]
[[same]]
signal = [{words(seen() * 1.004)}]
noise = [0.004, 0.003, 0.006]
""", encoding="utf-8")
    rows = np.array([0.4, 0.7, 1.05])[:, None] * seen() * WHITE + [
        [0.02, 0, 0.01], [0] * 3, [0] * 3]
    (tmp_path / "signals.csv").write_text("r,g,b\n" + "\n".join(map(words, rows)) + "\n",
                                          encoding="utf-8")
    return Path()


def requests(files):
    """Requests by name, each off the others in what it asks for."""
    def drawn(**changes):
        return replace(OPTIONS, **changes)

    more = {"more": files / "more.toml"}
    return {
        "plain": REQUEST,
        "defaults": replace(REQUEST, white=None, noise=None, signal=words(seen()), light_error=0.0,
                            sensitivity_error=0.0, level=0.95),
        "family": replace(REQUEST, families=("paint", "textile"), truth=files / "truth.csv",
                          column="mine", lights=("A", "FL11")),
        "further": replace(REQUEST, **more),
        "options": replace(REQUEST, readings=("640/12:0.57:0.01", "480:0.2"),
                           photos=(f"A={words(seen('A'))}:{words(NOISE)}",),
                           same=(f"{words(seen() * WHITE)}:{words(NOISE)}",
                               f"{words(0.997 * seen() * WHITE)}:{words(2 * NOISE)}")),
        "uniform": replace(REQUEST, options=drawn(method="uniform")),
        "refined": replace(REQUEST, options=drawn(method="uniform", coefficients=7, refine=11)),
        "paper": replace(REQUEST, options=drawn(method="paper")),
        "unbounded": replace(REQUEST, signal=words((0.3 + 0.3 * seen()) * WHITE),
                             options=drawn(method="paper", start="unbounded")),
        "kept": replace(REQUEST, options=drawn(method="paper", keep=600), **more),
        "twice": replace(REQUEST, twice=f"{words(seen(power=2) * WHITE)}:{words(NOISE)}"),
        "bulk": replace(REQUEST, signal=None, signals=files / "signals.csv", keep_draws=False),
        "several": replace(REQUEST, signal=None, signals=files / "signals.csv")}


@pytest.mark.parametrize("name", ["plain", "defaults", "family", "further", "options", "uniform",
                                  "refined", "paper", "unbounded", "kept", "twice", "bulk",
                                  "several"])
def test_answers_of_sample(recorded, files, name):
    request = requests(files)[name]
    facts, arrays = sample_answer(request)
    text = sample_text(facts, request) if name in ("plain", "family", "further", "bulk") else ""
    # a signal that the prior hardly knows is drawn by a chain, which amplifies round-off: a band's
    # end is known to 2 % of it. Of polytopes the corners are searched for
    chain = name in ("options", "several")
    recorded({"facts": compact(facts), "arrays": {} if chain else arrays,
              "text": re.sub(r"[\d.]+ s\b", "some s", text)},
             2e-2 if chain else 1e-6 if request.options.method == "prior" else 1e-4)


PLAN = PlanRequest(CAMERA, LIGHT, words(seen() * WHITE), words(WHITE), words(NOISE), 3, ("A",),
                   ("CIE 1931 2 Degree Standard Observer",), (), (), (), None, 2.5, 4.0, None, 5,
                   lamps_at_hand("D65, LED-RGB1", None))


@pytest.mark.parametrize("name", ["plain", "taken"])
def test_answers_of_plan(recorded, files, name):
    request = PLAN if name == "plain" else replace(
        PLAN, white=None, signal=words(seen()), more=files / "more.toml", readings=("550:0.3",),
        spot_minutes=7.0, steps=2, reading_minutes=1.5,
        hand=lamps_at_hand(None, str(files / "truth.csv")))
    facts, text = plan_answer(request)
    # draws of the smoothness prior, which are of a chain
    recorded({"facts": compact(facts), "text": text}, 1e-6 if name == "plain" else 5e-3)


def test_libraries_of_spectra(recorded, files):
    (files / "folder").mkdir()
    nm = np.arange(390, 711, 10)
    for name, first in (("value", 390), ("short", 450)):
        kept = nm[nm >= first]
        (files / "folder" / f"{name}.csv").write_text(f"nm,{name}\n" + "\n".join(
            f"{at},{0.2 + at / 2000}" for at in kept), encoding="utf-8")
    (files / "folder" / "note.md").write_text("no spectra", encoding="utf-8")
    words = [["truth.csv"], ["folder", "truth.csv"], ["folder/short.csv"], ["no such set"]]
    recorded([said(read_spectral_libraries, each, visible_grid(20)) for each in words])


def said(call, *arguments):
    """What comes out: the answer, or the refusal."""
    try:
        made = call(*arguments)
    except SpectraboxError as error:
        return f"{type(error).__name__}: {error}"
    return "taken" if isinstance(made, tuple) else made


def test_what_requests_are_refused(recorded, files):
    def changed(**changes):
        return said(sample_answer, replace(REQUEST, **changes))

    def drawn(**changes):
        return changed(options=replace(OPTIONS, **changes))

    found = {
        "method": drawn(method="papers"), "start": drawn(start="bound"), "keep": drawn(keep=5),
        "refine": drawn(refine=12), "none": drawn(samples=0),
        "many": drawn(samples=5_000_001), "both": changed(signals=files / "signals.csv"),
        "neither": changed(signal=None),
        "several": changed(signal=None, signals=files / "signals.csv", truth=files / "truth.csv"),
        "bands": changed(signal="0.1,0.2"), "word": changed(signal="0.1,x,0.2"),
        "infinite": changed(signal="0.1,inf,0.2"), "noise": changed(noise="0.1,-0.01,0.1"),
        "white": changed(white="0.5,0,1"), "level": changed(level=1.0),
        "light error": changed(light_error=0.5), "curves' error": changed(sensitivity_error=-0.01),
        "photo": changed(photos=("A:0.1,0.2,0.3",)), "reading": changed(readings=("abc",)),
        "minutes": said(plan_answer, replace(PLAN, photo_minutes=0.0)),
        "lamps": said(lamps_at_hand, " , ", None)}
    recorded(found)


def test_what_is_written_is_read(recorded, tmp_path):
    def reading(text):
        made = said(parse_reading, text)
        return made if isinstance(made, str) else {name: getattr(made, name)
                                                   for name in vars(made)}

    def rows(text):
        (tmp_path / "rows.csv").write_text(text, encoding="utf-8")
        made = said(read_signals, tmp_path / "rows.csv", 3)
        return made.replace(str(tmp_path), "") if isinstance(made, str) else np.array(made)

    written = ("500:0.3", "500:0.3:0.02", "500/1:0.3", "500/0.99:0.3", "500/300:0.3:0.01",
               "500/301:0.3", "500:0.3:0.1:2", "500", "399:0.3", "701:0.2", "400:0.2", "500:1.1",
               "500:0.3:0", "500:0.3:-1")
    recorded({
        "readings": {text: reading(text) for text in written},
        "rows": [rows(text) for text in ("r,g,b\n", "r,g,b\n1,2,3\n\n4,5,6\n", "r;g\n1;2;3\n",
                                         "r,g,b\n1,2\n", "r,g,b\n1,2,c\n", "r,g,b\n1,2,nan\n")],
        "numbers": [said(numbers, text, 3, "signal") for text in ("1;2;3", "1,2", "1,2,3,4", "")],
        "white": [said(relative_to_white, np.array([1.0, -2 * edge, 0.5]), None)
                  for edge in (0.99, 1.0, 1.01)]})


def test_errors_of_a_signal_add_up_by_cause(recorded):
    signals = np.array([[0.2, 0.5, 0.31], [0.7, 0.11, 0.4]])
    noise = np.diag([0.01, 0.02, 0.015]) ** 2
    causes = causes_of_error(signals, noise, 0.03, 0.02)
    # a light's error moves all bands alike, a curve's one alone
    np.testing.assert_allclose(causes["light"][0], 0.03**2 * np.outer(signals[0], signals[0]))
    np.testing.assert_allclose(causes["sensitivities"][1], np.diag((0.02 * signals[1]) ** 2))
    recorded(causes)
    recorded([said(causes_of_error, signals, noise, light, curves) for light, curves in (
        (0.5, 0.0), (-0.001, 0.0), (0.0, 0.51))], case="limits")
