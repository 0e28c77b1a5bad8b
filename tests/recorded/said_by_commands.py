"""What a command answers and writes, in a form that can be recorded."""
from __future__ import annotations

import json
import re

import numpy as np
import OpenImageIO as oiio
from compact_results import Texts, compact, table_of, without
from typer.testing import CliRunner

from spectrabox.session.cli import with_only

TABLES = {".csv", ".sig"}
WORDS = {".toml", ".xml", ".md", ".sp", ".spdx", ".hdr", ".txt", ".log"}


def said(folder, *words, typed=None, env=None, also=()):
    """Exit code, answer and lines on standard error of a command.

    Parameters
    ----------
    folder : Path
        Whose name is cut out, and that ``DIR`` in a word stands for.
    also : sequence of Path
        Whose names are cut out too.
    """
    typed_words = [str(word).replace("DIR", str(folder)) for word in words]
    # without the options of other commands, which take longer than most of these
    result = CliRunner().invoke(with_only(typed_words[0]), typed_words, input=typed, env=env)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    folders = [folder.resolve(), folder, *also]
    try:
        answer = compact(json.loads(result.stdout), folders)
    except ValueError:
        answer = lines_of(result.stdout, folders)
    return {"exit code": result.exit_code, "answer": answer,
            "told": lines_of(result.stderr, folders)}


def lines_of(text, folders=()):
    """Lines of a text, without what differs from run to run, and with single spaces."""
    return [re.sub(r"[ ─━]+", " ", without(line, folders)).strip()
            for line in text.splitlines()
            if line.strip() and not line.startswith(("Usage:", "Try '"))]


def files_of(folder, *names):
    """What lies in files of a folder: tables and arrays as numbers, texts as lines."""
    return {name: content_of(folder / name, [folder.resolve(), folder]) for name in names}


def content_of(path, folders=()):
    """What lies in a file, by its ending."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as stored:
            return {name: stored[name] if stored[name].dtype.kind in "biuf"
                    else lines_of(str(stored[name]), folders) for name in stored.files}
    if path.suffix == ".json":
        return compact(json.loads(path.read_text(encoding="utf-8")), folders)
    if path.suffix in (".png", ".exr"):
        picture = oiio.ImageBuf(str(path))
        spec = picture.spec()
        about = {each.name: each.value for each in spec.extra_attribs
                 if each.name.startswith("spectrabox") or "Exposure" in each.name}
        pixels = np.asarray(picture.get_pixels(oiio.FLOAT))
        return {"pixels": pixels, "type": str(spec.format), "channels": list(spec.channelnames),
                "about": compact(about, folders)}
    if path.suffix == ".html":
        return Texts(path.read_text(encoding="utf-8")).lines
    text = path.read_text(encoding="utf-8")
    if path.suffix in TABLES:
        return table_of(text, folders)
    assert path.suffix in WORDS, path
    return lines_of(text, folders)
