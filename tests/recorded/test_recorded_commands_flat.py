"""A session of flat samples from its template to comparisons: every command's answer and files.

Fits end where their steps are small, not at one bit pattern, and draws are those of the machine's
eigenvectors: what follows from a fit is compared to 1e-3, what is made of draws within chance.
"""
import contextlib
import re
import shutil

import numpy as np
import pytest
from compact_results import NUMBERS, compact
from flat_example import HEAD, regions_toml, write_flat
from said_by_commands import content_of, lines_of, said

from spectrabox.session.batch.manifest import files_behind, made_by
from spectrabox.session.batch.pool import Finished
from spectrabox.session.config.session_file import read_session
from spectrabox.session.report import svg

FIT, CHANCE = 1e-3, 0.06
SESSION = """[session]
name = "paints by a window"
operator = "A. Operator"
notes = "the second of the day"
seed = 5
""" + HEAD.replace("draws = 1000", "draws = 1000\nlevel = 0.9")
# of an answer: what is made of draws
OF_DRAWS = {"mean", "standard_deviation", "lower", "upper", "band_width", "rmse_mean", "coverage",
            "coverage_95", "delta_e00_mean", "scores", "metamers", "every_10_nm", "plots",
            "summary", "next_measurement_nm", "effective_samples", "evidence", "probability",
            "materials", "families",
            "left_out", "variance_shares", "light_map", "check"}
MOVED_LITTLE = {"mean", "lower", "upper", "band_width", "summary", "bound_lower", "bound_upper",
                "level", "name", "regions", "materials", "known", "coverage_bounds"}
NUMBER = re.compile(r"[-+−]?\d+(\.\d+)?(e[-+]?\d+)?")


def write(folder):
    """The session of ``flat_example`` with one region known, and settings of its own."""
    write_flat(folder)
    (folder / "session.toml").write_text(SESSION + regions_toml(known=("white_wall",)),
                                         encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder, and what the run said."""
    folder = write(tmp_path_factory.mktemp("flat") / "s")
    before = said(folder, "check", "DIR")
    with pytest.MonkeyPatch.context() as patch:     # no lines in plots: half of a report's time
        patch.setattr(svg, "_svg_text", lambda drawing: '<svg viewBox="0 0 1 1"></svg>')
        return folder, before, said(folder, "run", "DIR", "--json")


@pytest.fixture
def session(finished, figures_undrawn, tmp_path):
    return shutil.copytree(finished[0], tmp_path / "s")


def parted(facts):
    """What follows from the fit, and what is made of draws, of nested answers."""
    if isinstance(facts, list):
        both = [parted(each) for each in facts]
        drawn = {str(at): part for at, (_, part) in enumerate(both) if part}
        return [exact for exact, _ in both], drawn
    if not isinstance(facts, dict):
        return facts, None
    exact = {name: parted(value)[0] for name, value in facts.items() if name not in OF_DRAWS}
    drawn = {name: value for name, value in facts.items() if name in OF_DRAWS}
    drawn |= {name: part for name, value in facts.items() if name not in OF_DRAWS
              and (part := parted(value)[1])}
    return exact, drawn


def words_of(lines):
    """Texts without their numbers."""
    return [NUMBER.sub("#", line) for line in lines]


def numbers_of(facts):
    """Of what is made of draws: the larger numbers, which chance moves little."""
    if isinstance(facts, dict):
        return {name: numbers_of(value) for name, value in facts.items()
                if name in MOVED_LITTLE or name.isdigit()}
    return facts


def test_check_and_run(finished, recorded):
    _, before, run = finished
    recorded(before, case="check")
    exact, drawn = parted(run["answer"])
    assert run["exit code"] == 0
    recorded([exact, words_of(run["told"])], rtol=FIT, case="run")
    recorded(numbers_of(drawn), rtol=CHANCE, case="of draws")


def test_the_report_of_flat_samples(finished, recorded):
    folder = finished[0]
    exact, drawn = parted(content_of(folder / "report.json", [folder]))
    recorded(exact, rtol=FIT, case="data")
    recorded(numbers_of(drawn), rtol=CHANCE, case="of draws")
    lines = content_of(folder / "report.html")
    recorded(words_of(line for line in lines[:lines.index("Provenance")]     # then the machine
                      if not NUMBERS.match(line)), case="page")


def test_files_of_a_run(finished, recorded):
    folder = finished[0]
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*")
                   if path.is_file() and not path.name.startswith("."))
    recorded(names, case="names")
    for name in ("spectra.csv", "materials.csv"):
        if name in names:
            recorded(content_of(folder / name, [folder]), rtol=CHANCE, case=name)


def states(folder, *words):
    """What is done of each stage and why not."""
    answer = said(folder, "status", "DIR", *words)
    return [answer["exit code"], answer["answer"]]


def test_what_a_change_makes_stale(session, recorded):
    """One input after the other is changed; then some stages are run again."""
    found = [states(session, "--json"), [line.partition("TIME")[0] for line in states(session)[1]]]
    toml = session / "session.toml"
    for old, new in (("level = 0.9", "level = 0.8"), ("draws = 1000", "draws = 1200"),
                     ('known = "spectra/white_wall.csv"', 'truth = "spectra/white_wall.csv"'),
                     ("seed = 5", "seed = 6"), ('"A. Operator"', '"B. Operator"'),
                     ("[regions.cube]", "[regions.block]"),
                     ('spectrum = "spectra/light.csv"', 'spectrum = "D65"')):
        text = toml.read_text(encoding="utf-8")
        assert old in text
        toml.write_text(text.replace(old, new), encoding="utf-8")
        found.append([new, states(session, "--json")])
        toml.write_text(text, encoding="utf-8")
    light = session / "spectra" / "light.csv"
    light.write_text(light.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    (session / "report.html").unlink()
    found.append(["another light", states(session, "--json")])
    shutil.rmtree(session / "results" / "calibrate")
    found.append(["no calibration", states(session, "--json")])
    (session / "spectra" / "red_wall.csv").unlink()
    found.append(["no truth", states(session, "--json")])
    recorded(found)


def test_a_second_run_and_single_stages(session, recorded):
    again = said(session, "run", "DIR", "--json")
    stages = again["answer"]["stages"]
    some = said(session, "run", "DIR", "--only", "photo,signals", "--json", "-q")
    text = said(session, "run", "DIR", "--only", "photo")
    wrong = [said(session, "run", "DIR", *words) for words in (
        ("--only", "none"), ("--only", ""), ("--only", "sample,photo"), ("--device", "gpu"))]
    recorded([stages, again["told"], some, words_of(text["answer"]), text["told"], wrong])


def test_a_report_is_written_again_and_held_against_its_data(session, recorded):
    (session / "report.html").unlink()
    found = [said(session, "report", "DIR", "--check", "--json"),
             said(session, "report", "DIR", "--json"), said(session, "report", "DIR", "--check")]
    page = session / "report.html"
    text = page.read_text(encoding="utf-8")
    page.write_text(text.replace(">red_wall<", ">green_wall<"), encoding="utf-8")
    found.append(said(session, "report", "DIR", "--check", "--json"))
    recorded(found)


DRAWS = [("-o", "DIR/x.npz"), ("-o", "DIR/x.csv", "--step", "20", "--draws", "7"),
         ("-o", "DIR/x.txt"), ("-o", "DIR/x.npz", "--draws", "0"), ("-o", "DIR/x.npz", "--step",
                                                                    "101")]


def test_draws_for_other_programs(session, recorded):
    found = [said(session, "draws", "DIR", *words, *form) for words in DRAWS
             for form in (("--json",), ())]
    recorded(found)
    stored = content_of(session / "x.npz")
    recorded({name: [values.shape, values.mean(axis=0)] for name, values in stored.items()
              if isinstance(values, np.ndarray)}, rtol=CHANCE, case="arrays")
    table = content_of(session / "x.csv")
    recorded([table["heading"], len(table["column 0"]), table["column 0"][:9],
              table["column 2"][:40]], case="table")


def test_libraries_and_lamps_for_a_session(session, recorded):
    spectra = [f"DIR/spectra/{name}.csv" for name in ("red_wall", "green_wall", "cube")]
    found = [said(session, "match", "DIR", *spectra, *words) for words in (
        ("--json",), ("--surface", "red_wall", "--variation", "0.02", "--json"),
        ("--surface", "cube", "--ratio", "1000", "--json"), ("--surface", "none"))]
    names = [list(zip(*(each["answer"]["matches"][name] for name in ("surface", "name")),
                      strict=True)) for each in found[:3]]
    recorded([names, found[3], [each["told"] for each in found]], case="match")
    plans = [said(session, "plan", "DIR", *words) for words in (
        ("--json",), ("--lamps", "A,FL11", "--json"), ("--lamps", "none"))]
    for number, each in enumerate(plans[:2]):   # lamps that bring alike may change places
        recorded([each["exit code"], each["answer"]["surfaces"]["surface"],
                  [sorted(lamps["lamp"]) for lamps in each["answer"]["surfaces"]["lamps"]]],
                 case=f"lamps {number}")
        recorded([{name: np.sort(lamps[name]) for name in (
            "width_before", "width_after", "rmse_before", "rmse_after")}
            for lamps in each["answer"]["surfaces"]["lamps"]], rtol=CHANCE, case=f"plan {number}")
    recorded(plans[2], case="no lamp")


def test_sessions_beside_each_other(session, finished, recorded):
    folder = session.parent
    text = (session / "session.toml").read_text(encoding="utf-8")
    (session / "session.toml").write_text(text.replace("paints by a window", "another"),
                                          encoding="utf-8")
    shutil.copytree(finished[0], folder / "t")
    facts = said(folder, "compare", "DIR/s", "DIR/t", "--json")
    recorded(facts["answer"]["sessions"], rtol=FIT, case="quantities")
    recorded([{name: value for name, value in facts["answer"].items() if name != "sessions"},
              words_of(said(folder, "compare", "DIR/s", "DIR/t")["answer"]),
              said(folder, "compare", "DIR/s"), said(folder, "compare", "DIR/s", "DIR/none")],
             case="answers")
    (folder / "empty").mkdir()
    (folder / "empty" / "session.toml").write_text("", encoding="utf-8")
    recorded(said(folder, "catalogue", "DIR/empty"), case="nothing to list")
    made = [said(folder, "catalogue", "DIR", *words) for words in (
        ("--json",), (), ("-o", "DIR/x.csv"), ("-o", "DIR/other.sqlite", "--json"))]
    for each in made:
        if isinstance(each["answer"], dict):
            each["answer"].pop("sessions")
    made[1]["answer"] = words_of(made[1]["answer"])
    recorded(made, case="catalogue")
    recorded(sorted(path.name for path in folder.iterdir()), case="files")


class Here:
    """A pool of this process alone."""

    workers, budget_bytes, largest_bytes, about = 1, None, None, "one worker"

    def start(self, task):
        self.task = task

    def wait(self):
        return [Finished(self.task, self.task())]


def test_a_batch_of_a_finished_session_and_what_is_none(session, recorded, monkeypatch):
    folder = session.parent
    (folder / "list.txt").write_text("s\nnone\n", encoding="utf-8")
    monkeypatch.setattr("spectrabox.session.batch.workers.open_processes",
                        lambda count: contextlib.nullcontext(Here()))
    found = []
    monkeypatch.chdir(folder)       # the table is as wide as the names of sessions
    for words in (("DIR/s", "DIR/none", "--json"), ("--list", "DIR/list.txt", "-q", "--json"),
                  ("DIR/s", "--json"), ("DIR/s",), ("--device", "x"), ()):
        answer = said(folder, "batch", *words, "--out", "DIR/out")
        if isinstance(answer["answer"], list):
            answer["answer"] = words_of(answer["answer"])
        found.append([answer["exit code"], answer["answer"], words_of(answer["told"])])
    recorded(found)
    recorded(words_of(content_of(folder / "out" / "batch.html")), case="page")
    behind = files_behind(read_session(session))
    recorded(sorted(behind), case="files behind")
    assert all(each == ((session / name).stat().st_size, (session / name).stat().st_mtime_ns)
               for name, each in behind.items())
    before = made_by()
    (folder / "kept").mkdir()
    (folder / "kept" / "A.csv").write_text("nm,R,G,B\n400,1,2,3\n700,3,2,1\n", encoding="utf-8")
    monkeypatch.setenv("SPECTRABOX_CAMERAS", str(folder / "kept"))
    assert made_by() != before


BROKEN = {
    "no chart": ("[photos]", "[photos]\nchart = \"photos/none.dng\""),
    "unknown key": ("[light]", "[light]\ncolour = 3"),
    "outside": ("photos/sample.dng", "../sample.dng"),
    "no light": ("spectra/light.csv", "spectra/lihgt.csv"),
    "a region beyond the photo": ("rect = ", "rect = [400, 300, 900, 800]\n# "),
    "a level that is none": ("level = 0.9", "level = 1.9"),
    "no draws": ("draws = 1000", "draws = 10")}


def test_everything_wrong_is_said_by_check(session, recorded):
    toml = session / "session.toml"
    text = toml.read_text(encoding="utf-8")
    found = {}
    for name, (old, new) in BROKEN.items():
        assert old in text
        toml.write_text(text.replace(old, new), encoding="utf-8")
        answer = said(session, "check", "DIR", "--json")
        found[name] = [answer["exit code"], answer["answer"], answer["told"]]
    found["no folder"] = said(session, "check", "DIR/none")
    found["nothing to run"] = said(session, "run", "DIR/none", "--json")
    found["no scene"] = said(session, "relight", "DIR", "--json")
    found["no rehearsal"] = said(session, "rehearse", "DIR", "--times", "3")
    toml.write_text(text, encoding="utf-8")
    for words in (("relight", "DIR"), ("rehearse", "DIR"), ("geometry", "box", "DIR"),
                  ("relight", "DIR", "-o", "x.jpg"), ("relight", "DIR", "--width", "15"),
                  ("relight", "DIR", "--spp", "0"), ("rehearse", "DIR", "--device", "x")):
        found[" ".join(words)] = said(session, *words)
    recorded(found)


@pytest.mark.parametrize("template", [None, "box", "flat", "turntable", "views", "none"])
def test_a_new_session(template, tmp_path, recorded):
    words = () if template is None else ("--template", template)
    found = [said(tmp_path, "new", "DIR/s", *words), said(tmp_path, "new", "DIR/s", *words,
                                                          "--json")]
    toml = tmp_path / "s" / "session.toml"
    text = lines_of(toml.read_text(encoding="utf-8")) if toml.exists() else None
    recorded([found, sorted(path.name for path in tmp_path.rglob("*")),
              None if text is None else [len(text), text[:3], text[-3:]]])


REGION = ("--region", "red=1,2,30,40")
WRONG = [(), ("--region", "red"), ("--region", "red=1,2,3"), ("--region", "red=1,2,3,x"),
         (*REGION, *REGION), (*REGION, "--white-card", "1,2,3,4"),
         (*REGION, "--white-card", "1,2,3=0.9"), (*REGION, "--truth", "blue=x.csv"),
         (*REGION, "--family", "blue=paint"), (*REGION, "--family", "red"),
         (*REGION, "--corners", "1,2,3"), (*REGION, "--picture-light", "A"),
         (*REGION, "--light", "none.csv")]


def test_what_flat_refuses(session, recorded):
    shutil.copy(session / "photos" / "sample.dng", session / "a.dng")
    found = [said(session, "flat", "DIR/a.dng", *words, "--json") for words in WRONG]
    recorded([found, said(session, "flat", "DIR/a.dng")])
    recorded(content_of(session / "a-pixels.png")["pixels"].shape, case="picture")


def test_flat_makes_a_session_of_a_photo(session, recorded):
    from flat_example import rect_of
    rects = {name: ",".join(map(str, rect_of(name))) for name in ("red_wall", "green_wall", "cube")}
    photo = shutil.copy(session / "photos" / "sample.dng", session.parent / "a.dng")
    answer = said(session.parent, "flat", photo, "--region", f"red={rects['red_wall']}", "--region",
                  f"green={rects['green_wall']}", "--white-card",
                  f"{rects['cube']}=DIR/s/spectra/cube.csv", "--family", "red=paint,earth",
                  "--truth", "red=DIR/s/spectra/red_wall.csv", "--light",
                  "DIR/s/spectra/light.csv", "--session", "DIR/new", "--json", "-q")
    assert answer["exit code"] == 0, answer
    exact, drawn = parted(answer["answer"])
    recorded(exact, rtol=FIT, case="answer")
    recorded(numbers_of(compact(drawn)), rtol=CHANCE, case="of draws")
    recorded(content_of(session.parent / "new" / "session.toml", [session.parent]), case="session")
