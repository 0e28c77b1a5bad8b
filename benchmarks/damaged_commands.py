"""Every command that takes files, in one process after the other, on damaged ones: subjects of
bench_damaged_inputs.py beside the readers of damaged_inputs.py.

What a command says must be a result, or one sentence with the exit code of an error that was
foreseen.
"""
from __future__ import annotations

import contextlib
import io
import json
import re
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from spectrabox.capture.photo.image_files import write_exr
from spectrabox.fixtures import lamp
from spectrabox.fixtures.demo_photos import camera_sensitivities
from spectrabox.fixtures.dng import write_dng
from spectrabox.fixtures.flat_demo import write_flat_demo
from spectrabox.fixtures.paints import NM as SPECTRA_NM
from spectrabox.fixtures.paints import chart_truth
from spectrabox.fixtures.spectral_files import write_examples
from spectrabox.radiometry.errors import InputError
from spectrabox.session.cli import main
from spectrabox.session.command_line import NO_MEMORY

from benchmarks.damaged_inputs import BOARD, CURVES, LENS, MORE, NM, SCENE, TRANSCRIPTS, Subject
from benchmarks.forked_commands import in_a_child

Rows = Iterator[tuple[str, Path, tuple[object, ...], bool]]
MAX_SAID = 20_000       # bytes of a sentence that say too much


class CommandBrokeError(RuntimeError):
    """A command ended in what nobody foresaw."""


def command_subjects(folder: Path) -> list[Subject]:
    """Sound files, each in a folder of its own, with the commands that take them.

    Parameters
    ----------
    folder : Path
        Takes the files.
    """
    return [Subject(name, path, partial(run_command, words), text)
            # Sessions first: they are run in a fork, which keeps no threads of a library.
            for room in (_sessions, _spectra, _signals, _cameras, _photos, _geometry, _meters)
            for name, path, words, text in room(_made(folder / room.__name__.strip("_")))]


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True)
    return folder


def run_command(words: tuple[object, ...], path: Path) -> None:
    """What the installed command does with these words.

    Parameters
    ----------
    words : tuple
        ``FILE`` stands for the damaged file.

    Raises
    ------
    InputError
        What it said, where it ended in a sentence.
    CommandBrokeError
        If it ended in anything else.
    """
    sys.argv = ["spectrabox", *(str(path) if word == "FILE" else str(word) for word in words),
                "--json"]
    answered, told, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(answered), contextlib.redirect_stderr(told):
        try:
            main()
        except SystemExit as left:
            code = left.code if isinstance(left.code, int) else 1
    answer, said = answered.getvalue(), told.getvalue()
    broken = [what for what, is_so in (
        ("Traceback", "Traceback" in said), ("unforeseen", "unexpected " in said and code == 1),
        ("memory", NO_MEMORY in said), ("exit code", code not in (0, 2, 3, 4, 5, 6, 7)),
        ("no sentence", code not in (0,) and "spectrabox: " not in said and code != 2
         and not answer),
        ("control characters", re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", said + answer)),
        ("too long", len(said) > MAX_SAID), ("JSON", code != 2 and not _is_json(answer)),
        ("unfinished files", [*path.parent.glob(".spectrabox-*")])) if is_so]
    if broken:
        raise CommandBrokeError(f"{', '.join(broken)}: {said[-300:]}")
    if code:
        raise InputError(said[:4000])


def _is_json(answer: str) -> bool:
    try:
        json.loads(answer, parse_constant=_refuse)
    except ValueError:
        return False
    return True


def _refuse(word: str) -> None:
    raise ValueError(f"{word} is no number of JSON")


def _spectra(folder: Path) -> Rows:
    examples = write_examples(folder)
    examples["ENVI header"] = examples["ENVI"].with_suffix(".hdr")
    for name, path in examples.items():
        text = name not in ("ASD", "ENVI", "spectral EXR")
        shown = path.with_suffix(".hdr") if name == "ENVI" else "FILE"
        yield f"spectrum show {name}", path, ("spectrum", "show", shown), text
        yield f"spectrum convert {name}", path, (
            "spectrum", "convert", shown, "--out", folder / "out.csv"), text


def _signals(folder: Path) -> Rows:
    for name, values in (("cam", CURVES), ("lamp", CURVES[:1])):
        (folder / f"{name}.csv").write_text(
            "wavelength_nm," + ",".join("RGB"[:len(values)]) + "\n" + "\n".join(
                f"{nm:g}," + ",".join(f"{value:.4f}" for value in row)
                for nm, row in zip(NM, values.T, strict=True)))
    (folder / "signals.csv").write_text("R,G,B\n0.2,0.3,0.25\n0.4,0.4,0.3\n")
    (folder / "more.toml").write_text(MORE.partition("[[same]]")[0])
    camera = ("--sensitivity", folder / "cam.csv", "--light", folder / "lamp.csv")
    one = ("--signal", "0.5,0.4,0.45", "--noise", "0.05,0.05,0.05", "--samples", "1000")
    for name in ("cam.csv", "lamp.csv"):
        yield f"sample {name}", folder / name, ("sample", *camera, *one), True
    yield "sample signals", folder / "signals.csv", (
        "sample", *camera, "--signals", "FILE", "--samples", "1000"), True
    yield "sample further", folder / "more.toml", ("sample", *camera, *one, "--more", "FILE"), True
    yield "plan further", folder / "more.toml", (
        "plan", *camera, *one[:4], "--more", "FILE", "--steps", "1"), True
    write_exr(folder / "a.exr", np.random.default_rng(1).uniform(0.1, 0.9, (6, 8, 3)),
              ("R", "G", "B"))
    yield "uplift", folder / "a.exr", (
        "uplift", "FILE", *camera, "-o", folder / "up", "--side", "9"), False
    library = _made(folder / "library")
    (library / "a.csv").write_text("\n".join([",".join(f"{nm:g}" for nm in NM), *(
        ",".join(f"{value:.4f}" for value in row) for row in np.tile(CURVES, (8, 1)))]))
    yield "certify", library / "a.csv", ("certify", library), True
    np.save(folder / "cube.npy", np.random.default_rng(4).uniform(0, 1, (4, 5, NM.size)))
    (folder / "regions.toml").write_text("[regions.a]\nrectangle = [0, 0, 3, 3]\n")
    judge = ("judge", folder / "cube.npy", "--wavelengths", "400:700:10", "--regions",
             folder / "regions.toml")
    for name in ("cube.npy", "regions.toml"):
        yield f"judge {name}", folder / name, judge, name == "regions.toml"


def _cameras(folder: Path) -> Rows:
    light = lamp.radiance(SPECTRA_NM)
    (folder / "lamp.csv").write_text("nm,value\n" + "\n".join(
        f"{nm:g},{value:.5g}" for nm, value in zip(SPECTRA_NM, light, strict=True)))
    cells = chart_truth(np.random.default_rng(6)) @ (camera_sensitivities() * light).T
    cells *= 0.8 / cells.max()
    (folder / "patches.csv").write_text("R,G,B\n" + "\n".join(
        ",".join(f"{value:.4f}" for value in row) for row in cells))
    fit = ("camera", "fit", "--light", folder / "lamp.csv", "--patches", folder / "patches.csv",
           "--out", folder / "curves.csv")
    for name in ("lamp.csv", "patches.csv"):
        yield f"camera fit {name}", folder / name, fit, True
    yield "camera preflight", folder / "lamp.csv", ("camera", "preflight", "--light", "FILE"), True
    database = _made(folder / "cameras")
    for number in range(5):
        (database / f"{number}.csv").write_text("wavelength,red,green,blue\n" + "\n".join(
            f"{nm:g}," + ",".join(f"{value:.4f}" for value in np.roll(row, number))
            for nm, row in zip(NM, CURVES.T, strict=True)))
    yield "camera prior", database / "0.csv", (
        "camera", "prior", database, "--out", folder / "prior.npz"), True


def _photos(folder: Path) -> Rows:
    mosaic = np.random.default_rng(3).integers(600, 12000, (48, 64)).astype(np.uint16)
    write_dng(folder / "a.dng", mosaic, white=15871)
    yield "develop", folder / "a.dng", ("develop", "FILE", "--out", folder / "a.exr"), False
    (folder / "lens.json").write_text(json.dumps(LENS | {"width": 64, "height": 48}))
    for name in ("a.dng", "lens.json"):
        yield f"geometry undistort {name}", folder / name, (
            "geometry", "undistort", folder / "a.dng", "--lens", folder / "lens.json", "--out",
            folder / "straight.exr", "--force"), name == "lens.json"


def _geometry(folder: Path) -> Rows:
    (folder / "board.toml").write_text(BOARD)
    yield "geometry board", folder / "board.toml", (
        "geometry", "board", "--board", "FILE", "--out", folder / "board.png", "--square-px", "20",
        "--force"), True
    (folder / "scene.xml").write_text(SCENE)
    (folder / "lamp.csv").write_text("angle,radiance\n0,1\n30,0.9\n60,0.5\n90,0\n")
    corners = ((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 1), (0.5, -0.5, 1))
    (folder / "points.toml").write_text("".join(
        f"[points.p{number}]\nscene = [{x}, {y}, {z}]\n"
        f"px = [{320 - 1815 * x / (9 - z):.2f}, {240 - 1815 * y / (9 - z):.2f}]\n"
        for number, (x, y, z) in enumerate(corners)))
    write_exr(folder / "a.exr", np.full((480, 640, 3), 0.5), ("R", "G", "B"))
    pose = ("geometry", "pose", folder / "a.exr", "--scene", folder / "scene.xml", "--points",
            folder / "points.toml", "--out", folder / "posed.xml", "--force")
    for name in ("scene.xml", "points.toml", "lamp.csv"):
        yield f"geometry pose {name}", folder / name, pose, True


def _sessions(folder: Path) -> Rows:
    finished = folder / "finished"
    in_a_child(partial(_finished, finished))
    names = ("session.toml", "spectra/white_card.csv", "spectra/truth_sky.csv",
             "photos/painting.dng", "results/calibrate/facts.json", "results/sample/SHA256SUMS",
             "results/photo/arrays.npz")
    for name in names:
        text = not name.endswith(("dng", "npz"))
        for command in ("check", "status"):
            yield f"{command} {Path(name).name}", finished / name, (command, finished), text
    for name in ("session.toml", "results/sample/arrays.npz", "results/signals/facts.json"):
        text = not name.endswith("npz")
        yield f"draws {Path(name).name}", finished / name, (
            "draws", finished, "--out", folder / "draws.npz"), text
        yield f"match {Path(name).name}", finished / name, (
            "match", finished, "BabelColor Average"), text
        yield f"run signals {Path(name).name}", finished / name, (
            "run", finished, "--only", "signals"), text


def _finished(folder: Path) -> None:
    write_flat_demo(folder, 1, size=(416, 624))
    text = (folder / "session.toml").read_text(encoding="utf-8")
    head, *regions = text.split("[regions.")
    (folder / "session.toml").write_text("[regions.".join([head, *regions[:2]]), encoding="utf-8")
    try:
        run_command(("run", folder), folder)
    except InputError as error:
        raise RuntimeError(str(error)) from None


def _meters(folder: Path) -> Rows:
    for transcript in sorted(TRANSCRIPTS.glob("*[0-9].transcript")):
        (folder / transcript.name).write_bytes(transcript.read_bytes())
        yield f"meter replay {transcript.stem}", folder / transcript.name, (
            "meter", "replay", "FILE"), True
