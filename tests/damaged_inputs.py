"""Every kind of file that the readers and the light commands take, a small one of each, and what
reads it.
"""
from __future__ import annotations

import bz2
import json
import struct
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from spectrabox.calibrate.geometry.board import read_board, read_points
from spectrabox.calibrate.geometry.lens import read_lens
from spectrabox.calibrate.prior.camera_prior import load_camera_prior
from spectrabox.calibrate.prior.learnt_prior import read_camera_database
from spectrabox.capture.meter.measurement_files import read_reading, reading_facts
from spectrabox.capture.photo.image_files import read_encoded_file
from spectrabox.capture.photo.image_rows import open_channels, open_rows
from spectrabox.capture.photo.image_writers import write_exr, write_linear_exr, write_png
from spectrabox.capture.photo.linear import open_photo
from spectrabox.capture.transcripts.transcript import read_transcript
from spectrabox.fixtures.dng import write_dng
from spectrabox.fixtures.spectral_files import write_examples
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.radiometry.spectra.readings import ReadingOutcome, SpectralReading
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum, read_table
from spectrabox.reconstruct.scene.edit_scene import scene_with_light_moved
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.tracer.trace_checkpoint import PassSums, TraceCheckpoint
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import SHIPPED, load_prior
from spectrabox.session.camera.camera_files import read_patches
from spectrabox.session.config.session_file import try_read_session
from spectrabox.session.signals.measurement_file import read_more
from spectrabox.session.signals.signal_options import read_named_signals
from spectrabox.session.store.record_files import load_stage, save_stage, stage_folder

MODELS = Path(load_camera_prior.__code__.co_filename).parent / "models"
TRANSCRIPTS = Path(write_dng.__code__.co_filename).parent / "transcripts"
NM = np.arange(400.0, 701.0, 10.0)
CURVES = np.random.default_rng(1).uniform(0.1, 0.9, (3, NM.size))
OBSERVER = "CIE 1931 2 Degree Standard Observer"
SESSION = """
[session]
name = "box, 3 Nov"
seed = 1
[photos]
object = "photos/box.dng"
chart = ["photos/chart.dng"]
[chart]
scene = "scene/chart.xml"
corners_px = [[1, 2], [3, 4], [5.5, 6], [7, 8]]
[light]
spectrum = { file = "spectra/light.csv", column = 2 }
[scene]
file = "scene/box.xml"
[materials.white]
bsdf = "white"
family = ["paint"]
[views."second light"]
photo = "photos/box2.dng"
[reconstruct]
width = 96
surface_error = 0.01
"""
SCENE = """<?xml version="1.0"?>
<scene version="3.0.0">
    <default name="wide" value="640"/>
    <integrator type="path"><integer name="max_depth" value="6"/></integrator>
    <sensor type="perspective" id="camera">
        <float name="fov" value="20"/>
        <transform name="to_world"><lookat origin="0,0,9" target="0,0,0" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="$wide"/>
        <integer name="height" value="480"/></film>
    </sensor>
    <bsdf type="diffuse" id="white"/>
    <shape type="rectangle" id="wall"><ref id="white"/></shape>
    <shape type="rectangle" id="lamp"><transform name="to_world"><translate x="0" y="1" z="2"/>
        </transform><emitter type="area"><string name="profile" value="lamp.csv"/></emitter></shape>
</scene>
"""
BOARD = """columns = 9
rows = 7
square = 0.03
marker = 0.022
origin = [0, 0, 0]
right = [1, 0, 0]
down = [0, -1, 0]
"""
POINTS = """[points.corner]
scene = [0, 0.5, 1e0]
px = [120.5, 80]
[points."the lamp"]
scene = [1, 0, 0]
px = [7, 9]
"""
MORE = """[[reading]]
nm = 700
reflectance = 0.35
error = 0.01
[[photo]]
light = "A"
signal = [0.3, 0.4, 0.2]
noise = [0.01, 0.01, 0.01]
[[same]]
signal = [0.3, 0.4, 0.2]
"""
LENS = {"format": "spectrabox lens 1", "width": 640, "height": 480,
        "matrix": [[700.0, 0, 325], [0, 702.0, 236], [0, 0, 1]], "source": "made up",
        "distortion": [-0.12, 0.05, 0.001, -0.001, 0], "standard_error": [1, 1, 1, 1],
        "distortion_error": [0, 0, 0, 0, 0], "rms_px": 0.1}


@dataclass(frozen=True)
class Subject:
    """One kind of file: a sound one at ``path``, and what reads it and raises nothing but a
    ``SpectraboxError``. ``text`` says whether words in it can be exchanged.
    """

    name: str
    path: Path
    read: Callable[[Path], Any]
    text: bool


def subjects(folder: Path) -> list[Subject]:
    """Sound files of every kind, each in a folder of its own, with their readers.

    Parameters
    ----------
    folder : Path
        Takes the files.
    """
    return [Subject(name, path, read, text) for name, path, read, text in _all(folder)]


Rows = Iterator[tuple[str, Path, Callable[[Path], Any], bool]]


def _all(folder: Path) -> Rows:
    for room in (_spectra, _scenes, _photos, _stored, _priors, _libraries, _tables):
        inside = folder / room.__name__.strip("_")
        inside.mkdir(parents=True)
        yield from room(inside)


def _spectra(folder: Path) -> Rows:
    examples = write_examples(folder)
    examples["ENVI header"] = examples["ENVI"].with_suffix(".hdr")
    for name, path in examples.items():
        yield name, path, _read_spectra, \
            name not in ("ASD", "ENVI", "spectral EXR")


def _read_spectra(path: Path) -> None:
    read_table(path)
    read_spectrum(path, role=Quantity.REFLECTANCE)


def _scenes(folder: Path) -> Rows:
    (folder / "lamp.csv").write_text("angle,radiance\n0,1\n30,0.9\n60,0.5\n90,0\n")
    (folder / "scene.xml").write_text(SCENE)
    yield "scene", folder / "scene.xml", read_scene, True
    yield "scene to pose", folder / "scene.xml", \
        lambda path: scene_with_light_moved(path, 0, np.array([0.0, 0.1, 0.0]), path.parent), True
    yield "lamp profile", folder / "lamp.csv", \
        lambda path: read_scene(path.with_name("scene.xml")), True
    for name, text, read in (("board", BOARD, read_board), ("points", POINTS, read_points)):
        (folder / f"{name}.toml").write_text(text)
        yield name, folder / f"{name}.toml", read, True
    (folder / "session.toml").write_text(SESSION)
    yield "session.toml", folder / "session.toml", lambda path: try_read_session(path.parent), True


def _photos(folder: Path) -> Rows:
    rng = np.random.default_rng(3)
    write_dng(folder / "a.dng", rng.integers(600, 12000, (48, 64)).astype(np.uint16), white=15871)
    yield "DNG", folder / "a.dng", open_photo, False
    pixels = rng.uniform(0.1, 0.9, (40, 48, 3))
    write_exr(folder / "a.exr", pixels, ("R", "G", "B"))
    yield "EXR photo", folder / "a.exr", open_photo, False
    write_linear_exr(folder / "developed.exr", open_photo(folder / "a.exr"))
    yield "developed photo", folder / "developed.exr", open_photo, False
    write_exr(folder / "a.tif", pixels, ("R", "G", "B"))
    yield "TIFF photo", folder / "a.tif", open_photo, False
    write_png(folder / "a.png", np.uint8(255 * pixels))
    yield "PNG", folder / "a.png", read_encoded_file, False
    yield "picture by rows", folder / "a.exr", _read_rows, False
    yield "channels by rows", folder / "a.exr", _read_channels, False


def _read_rows(path: Path) -> None:
    (height, _, _), read = open_rows(path)
    read(0, min(height, 64))


def _read_channels(path: Path) -> None:
    _, height, _, rows = open_channels(path)
    rows(0, min(height, 64))


def _stored(folder: Path) -> Rows:
    grid = visible_grid(10)
    spectrum = Spectrum(grid, np.ones(grid.nm.size), Quantity.RADIANCE, "lamp")
    with stage_folder(folder, "photo") as new:
        save_stage(new, {"settings": {"v": 1}}, {"light": spectrum}, 1.0, {})

    def read(path: Path) -> None:
        stage = load_stage(folder, "photo")
        if stage is not None:
            stage.read(Spectrum, "light")

    for name in ("facts.json", "arrays.npz"):
        yield f"stored {name}", folder / "photo" / name, read, name.endswith("json")
    checkpoint = TraceCheckpoint(folder / "trace.npz", "print")
    checkpoint.write(PassSums(2, (np.ones((2, 3, 4), np.float32),)))
    yield "checkpoint", folder / "trace.npz", lambda path: checkpoint.read(), False


def _priors(folder: Path) -> Rows:
    (folder / "prior.npz").write_bytes(SHIPPED.read_bytes())
    yield "prior", folder / "prior.npz", load_prior, False
    (folder / "camera.npz").write_bytes(next(MODELS.glob("*.npz")).read_bytes())
    yield "camera prior", folder / "camera.npz", load_camera_prior, False
    (folder / "lens.json").write_text(json.dumps(LENS))
    yield "lens", folder / "lens.json", read_lens, True
    database = folder / "cameras"
    database.mkdir()
    facts = {"header": {"manufacturer": "Maker", "model": "One"}, "spectral_data": {
        "data": {"main": {f"{nm:g}": row for nm, row in zip(NM, CURVES.T.tolist(), strict=True)}}}}
    (database / "a.json").write_text(json.dumps(facts))
    cells = np.random.default_rng(2).uniform(0.1, 1, (3, 33))
    (database / "c.txt").write_text("Maker Two\n" + "\n".join(" ".join(f"{value:.4f}" for value
                                                                       in row) for row in cells))
    (database / "b.csv").write_text("wavelength,red,green,blue\n" + "\n".join(
        f"{nm:g}," + ",".join(f"{value:.4f}" for value in row)
        for nm, row in zip(NM, CURVES.T, strict=True)))
    for path in sorted(database.iterdir()):
        yield f"camera database {path.suffix}", path, \
            lambda path: read_camera_database(path.parent), True


def _libraries(folder: Path) -> Rows:
    across = "\n".join([",".join(f"{nm:g}" for nm in NM),
                        *(",".join(f"{value:.6f}" for value in row) for row in CURVES)])
    files = {"csv": across.encode(), "rda": bz2.compress(r_file()), "json": json.dumps(
        {"spectral_data": {"data": {"main": {f"{nm:g}": row for nm, row in zip(
            NM, CURVES.T.tolist(), strict=True)}}}}).encode()}
    for suffix, content in files.items():
        inside = folder / suffix
        inside.mkdir()
        (inside / f"a.{suffix}").write_bytes(content)
        yield f"library .{suffix}", inside / f"a.{suffix}", \
            lambda path: read_library(path.parent), suffix != "rda"
    for suffix in ("zip", "mat", "sli"):
        (folder / suffix).mkdir()
    with zipfile.ZipFile(folder / "zip" / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("inner/a.csv", across)
    library = np.concatenate([NM[:, None] / 1000, np.ones((NM.size, 2)), CURVES.T], axis=1)
    scipy.io.savemat(folder / "mat" / "a.mat", {"datalib": library})
    (folder / "sli" / "a.hdr").write_text(
        f"ENVI\nsamples = {NM.size}\nlines = 3\ndata type = 4\nbyte order = 0\n"
        f"wavelength = {{ {' , '.join(map(str, NM))} }}\n")
    CURVES.astype("<f4").tofile(folder / "sli" / "a.sli")
    for name in ("zip/a.zip", "mat/a.mat", "sli/a.sli", "sli/a.hdr"):
        yield f"library {name[-4:]}", folder / name, lambda path: read_library(path.parent), \
            name.endswith("hdr")


def r_file() -> bytes:
    """A data frame of ``CURVES`` as R would save it, version 2 of the format."""
    def words(text: str) -> bytes:
        return struct.pack(">ii", 9, len(text)) + text.encode()

    symbol = struct.pack(">i", 1)
    names = struct.pack(">ii", 16, NM.size) + b"".join(words(f"X{nm:g}") for nm in NM)
    values = b"".join(struct.pack(">ii", 14, len(column)) + column.astype(">f8").tobytes()
                      for column in CURVES.T)
    frame = struct.pack(">ii", 19 | 1 << 9, NM.size) + values
    tagged = struct.pack(">i", 2 | 1 << 10) + symbol
    return (b"RDX2\nX\n" + struct.pack(">iii", 2, 0x30402, 0x20300) + tagged + words("frame")
            + frame + tagged + words("names") + names + struct.pack(">ii", 254, 254))


def _tables(folder: Path) -> Rows:
    grid = visible_grid(5)
    response = relative_response(OBSERVER, "D65", grid)
    (folder / "more.toml").write_text(MORE)
    yield "further measurements", folder / "more.toml", \
        lambda path: read_more(path, OBSERVER, response), True
    cells = np.random.default_rng(6).uniform(0.1, 0.9, (24, 3))
    (folder / "patches.csv").write_text("R,G,B\n" + "\n".join(
        ",".join(f"{value:.4f}" for value in row) for row in cells))
    yield "patches", folder / "patches.csv", read_patches, True
    yield "signals", folder / "patches.csv", lambda path: read_named_signals(path, "RGB"), True
    spectrum = Spectrum(grid, np.ones(grid.nm.size), Quantity.RADIANCE, "lamp")
    reading = SpectralReading(
        spectrum=spectrum, quantity=Quantity.RADIANCE, outcome=next(iter(ReadingOutcome)),
        findings=(Finding("meter.no-luminance", Severity.NOTE),), instrument="PR-655",
        serial_number="1", firmware="2", integration_ms=3.0, luminance=4.0,
        taken_at="2026-01-01", transcript="a")
    (folder / "001.json").write_text(json.dumps(reading_facts(reading)))
    yield "reading", folder / "001.json", read_reading, True
    for transcript in sorted(TRANSCRIPTS.glob("*[0-9].transcript")):
        (folder / transcript.name).write_bytes(transcript.read_bytes())
        yield f"transcript {transcript.stem}", folder / transcript.name, read_transcript, True
