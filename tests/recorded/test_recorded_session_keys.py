"""Whatever a session says makes the right stages stale: every key of three sessions, and every file
that they name, is changed in turn.
"""
import copy
import tomllib

import numpy as np
import pytest
import test_recorded_sessions_box as box
import test_recorded_sessions_flat as flat
import test_recorded_sessions_scene as scene
from whole_sessions import shoot

from spectrabox.fixtures.demo_scenes import box_scene, chart_scene_xml
from spectrabox.session import keys
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.keys import as_stored, stage_keys
from spectrabox.session.store.input_files import InputFiles
from spectrabox.session.store.store import fingerprint, why_stale

OF_SESSION = {"scene": scene.TOML, "flat": flat.TOML,
              "box": box.TOML.format(corners=str(box.marks(np.random.default_rng(1))
                                                 ).replace("':", "' =").replace("'", '"'))}
MORE = {"scene": '[picture]\nrect = [3.5, 4.5, 20.5, 21.5]\nlight = "A"\nbands_nm = [450, 600]\n'
                 'step_nm = 20\nformat = "zarr"\nfamily = "paint"\n'
                 '[light.by_id]\nfill = "spectra/lamps.csv"\n',
        "flat": "", "box": ""}
OTHER = {"chart": "spectra/camera.csv", "prior": "smooth", "uniform": "paper", "smooth": "none",
         "transport": "auto", "paint": "leaves", "textile": "skin", "envi": "exr", "zarr": "exr",
         "A": "FL2", "BabelColor Average": "ColorChecker24 - After November 2014", "white": "red",
         "green": "white", "red": "green", "cube": "green", "box": "sphere", "photo": "brief",
         "warm": "photo"}
# what the report alone shows
UNMOVED = ("session.name", "session.operator", "session.notes", ".truth", "sensitivity.truth")


@pytest.fixture
def described(tmp_path, monkeypatch):
    """The folder of a session whose files are there, and what its file says."""
    monkeypatch.setattr(keys, "stage_code", lambda rooms: {room: {} for room in rooms})
    monkeypatch.setattr(keys, "versions", lambda names: {})
    monkeypatch.setattr(keys, "_renderer", dict)

    def made(name):
        said = tomllib.loads(OF_SESSION[name] + MORE[name])
        for value in texts(said):
            if "/" in value:
                file = tmp_path / value
                file.parent.mkdir(exist_ok=True)
                file.write_text(value, encoding="utf-8")
        if name == "scene":
            (tmp_path / "scene" / "box.xml").write_text(box_scene((20, 30)), encoding="utf-8")
            (tmp_path / "scene" / "chart.xml").write_text(chart_scene_xml((20, 30)),
                                                          encoding="utf-8")
            (tmp_path / "lens.json").write_text("{}", encoding="utf-8")
        if name == "box":
            for photo in ("box", "side", "turned"):
                shoot(tmp_path / "photos" / f"{photo}.dng", np.zeros((208, 312, 3)), 1,
                      np.random.default_rng(1))
        return tmp_path, said
    return made


def texts(node):
    """Every text that is said."""
    if isinstance(node, str):
        yield node
    elif isinstance(node, dict | list):
        for value in node.values() if isinstance(node, dict) else node:
            yield from texts(value)


def leaves(node, path=()):
    """Keys and value of everything that is said; of a list its first number or text."""
    if isinstance(node, dict):
        for name, value in node.items():
            yield from leaves(value, (*path, name))
    elif isinstance(node, list) and node:
        yield from leaves(node[0], (*path, 0))
    else:
        yield path, node


def changed(said, path, value, folder):
    """The same with one value changed."""
    other = copy.deepcopy(said)
    at = other
    for name in path[:-1]:
        at = at[name]
    if isinstance(value, str) and (folder / value).is_file() and value != "":
        new = f"{value.rpartition('.')[0]}-other.{value.rpartition('.')[2]}"
        (folder / new).write_bytes((folder / value).read_bytes() + b" ")
    elif isinstance(value, str):
        new = OTHER.get(value, f"{value}s")
    else:
        new = not value if isinstance(value, bool) else value + 1 if value == int(value) \
            else 1.002 * value
    at[path[-1]] = new
    return other


def keys_of(folder, said):
    config = SessionConfig(folder=folder, allow_outside=False, **said)
    return as_stored(stage_keys(config, InputFiles(config)))


def stale(before, after):
    """Why each stage would be run again."""
    return {stage: why for stage in before
            if (why := why_stale(before[stage], after.get(stage, {})))}


def without_digests(key):
    """A key whose digests are of nothing but its files' names."""
    return {part: sorted(value) if part in ("files", "stages") else value
            for part, value in key.items()}


@pytest.mark.parametrize("name", ["scene", "flat", "box"])
def test_every_key_of_a_session_makes_its_stages_stale(recorded, described, name):
    folder, said = described(name)
    before = keys_of(folder, said)
    recorded({stage: without_digests(key) for stage, key in before.items()}, case="keys")
    found, unmoved = {}, []
    for path, value in leaves(said):
        words = ".".join(map(str, path))
        try:
            found[words] = stale(before, keys_of(folder, changed(said, path, value, folder)))
        except ValueError as fault:      # of the schema: another key goes with this one
            found[words] = f"refused: {type(fault).__name__}"
        if not found[words]:
            unmoved.append(words)
    assert [words for words in unmoved if not any(part in words for part in UNMOVED)] == []
    # white cards tell the light on every pixel: their file, column and outline are the picture's
    assert [words for words, why in found.items()
            if ".known." in words and "picture" in before and "picture" not in why] == []
    recorded({words: str(why) for words, why in found.items()}, case="stale")


@pytest.mark.parametrize("name", ["scene", "flat", "box"])
def test_every_file_of_a_session_makes_its_stages_stale(recorded, described, name):
    folder, said = described(name)
    before, found = keys_of(folder, said), {}
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        content = file.read_bytes()
        file.write_bytes(content + b" ")
        found[file.relative_to(folder).as_posix()] = ", ".join(stale(before,
                                                                     keys_of(folder, said)))
        file.write_bytes(content)
    unread = [file for file, stages in found.items() if not stages]
    # curves and paints that results are only compared with
    assert set(unread) <= {"spectra/camera.csv", "spectra/paints.csv"}
    recorded(found)


def test_a_stage_is_what_its_predecessors_are(recorded, described):
    folder, said = described("flat")
    made = keys_of(folder, said)
    for name, stages in {"calibrate": ["chart"], "signals": ["chart", "photo", "calibrate"],
                         "sample": ["signals"], "picture": ["chart", "calibrate"]}.items():
        assert made[name]["stages"] == {before: fingerprint(made[before]) for before in stages}
