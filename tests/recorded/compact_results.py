"""Answers of commands, files and pages in a form that a record keeps small.

What differs from machine to machine, or from one run to the next, is cut out here and nowhere else.
"""
from __future__ import annotations

import csv
import io
import json
import re
from html.parser import HTMLParser

import numpy as np

FEW = 12                # numbers that stay a list
# of an answer or of a written file; what they are is said by their tests, or differs by machine
CUT = frozenset({"seconds", "sha256", "versions", "provenance", "made_from", "finished", "started",
                 "peak_bytes", "machine", "pictures", "made by", "spectrabox", "python", "numpy",
                 "cores", "of", "port", "page_digest", "digest", "taken_at"})
VOID = {"meta", "img", "br", "link", "input", "hr", "col"}
INLINE = {"a", "span", "b", "i", "em", "strong", "code", "sub", "sup", "small", "label", "button",
          "summary", "output", "option"}
TIME = re.compile(r"(?<=took )[\d.]+ s|(?<= in )[\d.]+ s|\b\d+\.\d s$|\b[\d.]+ s(?=;)|"
                  r"\d{4}-\d\d-\d\dT[\d:.+]+Z?",
                  re.MULTILINE)
# rows of a wavelength or of a patch, and the patch's pair of colours
NUMBERS = re.compile(r"\| \{n\} \d{3} \||\| \d+ \| (\{line\}|[\w ]+ \| \{n\})|\{halves|\{\d+ ")
DIGEST = re.compile(r"\b[0-9a-f]{16,64}\b")


def compact(value, folders=()):
    """The same with tables of numbers as arrays, and without times, versions and places.

    Parameters
    ----------
    folders : sequence of Path
        Whose names are cut out of texts.
    """
    if isinstance(value, dict):
        return {without(str(key), folders): compact(item, folders) for key, item in value.items()
                if key not in CUT}
    if isinstance(value, list | tuple):
        if len(value) > 1 and all(isinstance(each, dict) and each.keys() == value[0].keys()
                                  for each in value):       # a table: columns in place of rows
            return {"rows": len(value)} | compact(
                {key: [each[key] for each in value] for key in value[0]}, folders)
        numbers = as_numbers(value)
        return [compact(item, folders) for item in value] if numbers is None else numbers
    return without(value, folders) if isinstance(value, str) else value


def as_numbers(values):
    """Nested lists of many numbers (None being not a number) as an array; None of anything else."""
    flat = list(leaves_of(values))
    if len(flat) <= FEW or not all(each is None or (isinstance(each, int | float)
                                                    and not isinstance(each, bool))
                                   for each in flat):
        return None
    try:
        return np.array(values, dtype=float)
    except (ValueError, TypeError):
        return None


def leaves_of(values):
    for each in values:
        if isinstance(each, list | tuple):
            yield from leaves_of(each)
        else:
            yield each


def without(text, folders=()):
    """A text without names of folders, times and digests."""
    for folder in folders:
        text = text.replace(str(folder), "DIR")
    return DIGEST.sub("DIGEST", TIME.sub("TIME", text))


def table_of(text, folders=()):
    """A CSV: its comments, its heading and its numbers; cells that are none stay words."""
    comments = [line for line in text.splitlines() if line.startswith("#")]
    rows = list(csv.reader(io.StringIO("\n".join(
        line for line in text.splitlines() if not line.startswith("#")))))
    found = {"comments": compact(comments, folders), "heading": rows[0] if rows else []}
    columns = list(zip(*rows[1:], strict=False))
    for number, column in enumerate(columns):
        try:
            found[f"column {number}"] = np.array([float(cell or "nan") for cell in column])
        except ValueError:
            found[f"column {number}"] = [without(cell, folders) for cell in column]
    return found


class Texts(HTMLParser):
    """The visible texts of a page, a line for each block or row of a table, classes and colours
    beside them, and the numbers of its read-outs.
    """

    def __init__(self, page):
        super().__init__()
        self.lines, self.readouts, self._line, self._open = [], [], [], []
        self.feed(page)
        self.close()
        self._end_line()

    def handle_starttag(self, tag, attrs):
        about = dict(attrs)
        if tag not in VOID:
            self._open.append((tag, about.get("class", "")))
        if tag not in INLINE and tag not in ("td", "th"):
            self._end_line()
        marks = [about[name] for name in ("class", "style", "alt", "title", "href", "aria-label",
                                          "value") if about.get(name)]
        if tag in ("td", "th"):
            self._line.append("|")
        if marks and not self._drawn():
            self._line.append("{" + "; ".join(marks) + "}")

    handle_startendtag = handle_starttag

    def handle_endtag(self, tag):
        while self._open and self._open.pop()[0] != tag:
            pass
        if tag not in INLINE and tag not in ("td", "th"):
            self._end_line()

    def handle_data(self, data):
        inside = [tag for tag, _ in self._open]
        if "script" in inside:
            if self._open[-1][1] == "readout":
                self.readouts.append(compact(json.loads(data)))
        elif "style" not in inside and not self._drawn():
            self._line += data.split()

    def _drawn(self):
        return any(tag == "svg" and "plot" in name for tag, name in self._open)

    def _end_line(self):
        if self._line:
            self.lines.append(without(" ".join(self._line)))
        self._line = []


def changes(lines, usual):
    """Lines that a page has and the usual one does not, but for rows of plain numbers, and the
    other way round.
    """
    return {"more": [line for line in lines if line not in usual and not NUMBERS.match(line)],
            "less": [line for line in usual if line not in lines and not NUMBERS.match(line)]}


def different(value, usual):
    """What of some data is not as in the usual ones."""
    if isinstance(value, dict) and isinstance(usual, dict):
        return {key: different(item, usual.get(key)) for key, item in value.items()
                if key not in usual or not same(item, usual[key])}
    return value


def same(one, other):
    """Whether two compact results are equal."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return type(one) is type(other) and np.array_equal(one, other, equal_nan=True)
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other
