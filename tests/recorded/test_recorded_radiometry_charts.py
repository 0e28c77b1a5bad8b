"""Recorded: layouts of charts, their references, and tables that people write."""
import dataclasses

import numpy as np
import pytest
from pydantic import Field
from recorded_refusals import said

from spectrabox.radiometry.chart import (
    CLASSIC,
    chart_reflectances,
    corner_patches,
    grid_chart,
    outlined_chart,
    patch_centres_uv,
    patch_size_uv,
    plane_centres,
    plane_from_picture,
    projected,
    typical_camera_signals,
)
from spectrabox.radiometry.charts.layout_file import read_layout
from spectrabox.radiometry.charts.layout_names import is_layout_file, layout_name
from spectrabox.radiometry.charts.layouts import LAYOUTS, chart_layout
from spectrabox.radiometry.charts.left_out import left_out
from spectrabox.radiometry.charts.references import (
    measured_chart,
    published_signals,
    reference_file,
    reference_reflectances,
)
from spectrabox.radiometry.charts.table_order import order_correlations, table_orders
from spectrabox.radiometry.checked_tables import ListOf, Table, checked, nearest, read_toml
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text

GRID = grid_from_nm(np.array([400.0, 437, 461, 512, 555, 611, 660, 700]))


@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts(recorded, name):
    chart = LAYOUTS[name]
    recorded({"chart": chart, "centres": chart.centres_uv, "sizes": chart.sizes_uv,
              "known": chart.has_known_colours, "corners": chart.corner_words,
              "plane": plane_centres(chart), "uv": patch_centres_uv(chart),
              "size": patch_size_uv(chart), "plain": chart_layout(name.lower()).name})


def test_names_of_layouts(recorded):
    recorded({word: said(lambda word=word: layout_name(word)) for word in (
        "classic", "ColorChecker-Classic", "digital sg", "DIGITALSG", "SpyderCheckr24", "24",
        "nano", "passport video", "")} | {
        word: is_layout_file(word) for word in ("a.toml", "A.TOML", "a.tom", "toml")})


def test_charts_that_are_laid_out(recorded):
    names = tuple("abcdefgh")
    even = grid_chart("even", 2, 4, names, (2.0, 3.0), (2.5, 3.7), ("c", "h"))
    spread = np.array([[0.0, 0], [3, 0.2], [7, 0], [9, 0.1], [0.3, 4], [3, 4.2], [6, 4], [9.5, 5]])
    sizes = np.linspace(1, 2, 16).reshape(8, 2)
    recorded({"even": even, "outlined": outlined_chart("own", 2, 4, names, spread, sizes, ("b",)),
              "corners": corner_patches(3, 5)})
    truth = np.array([[1.1, 0.1, 30], [-0.05, 0.9, 12], [1e-4, 2e-4, 1]])
    centres_px = projected(truth, 40 * spread)
    matrix = plane_from_picture(centres_px, dataclasses.replace(even, centres=spread))
    noisy = centres_px + np.random.default_rng(2).normal(0, 0.5, centres_px.shape)
    recorded({"projected": centres_px, "matrix": matrix,
              "noisy": plane_from_picture(noisy, even)}, case="planes")
    np.testing.assert_allclose(projected(matrix, centres_px),
                               plane_centres(dataclasses.replace(even, centres=spread)), atol=1e-9)


def test_published_references(recorded):
    recorded({
        "reflectances": {name: chart_reflectances(name, GRID) for name in CLASSIC.references},
        "unknown": said(lambda: chart_reflectances("BabelColor", GRID)),
        "other chart": said(lambda: chart_reflectances("PMC", GRID,
                                                       LAYOUTS["SpyderCheckr 24"])),
        "default": reference_reflectances(None, CLASSIC, GRID),
        "chosen": reference_reflectances("ISO 17321-1", CLASSIC, GRID),
        "none": said(lambda: reference_reflectances(None, LAYOUTS["SpyderCheckr 48"], GRID)),
        "signals": published_signals(CLASSIC, GRID),
        "colours": published_signals(LAYOUTS["ColorChecker Digital SG"], GRID),
        "under a light": typical_camera_signals(chart_reflectances("PMC", GRID, dataclasses.replace(
            CLASSIC, references=("PMC",))), GRID, GRID.nm / 400)})


def test_orders_of_tables(recorded):
    signals = published_signals(CLASSIC, GRID)
    turned = signals.reshape(4, 6, 3)[::-1].reshape(24, 3) * [1.5, 0.7, 2.0]
    recorded({"orders": table_orders(2, 3), "right": order_correlations(signals, signals ** 1.1, 4),
              "turned": order_correlations(turned, signals, 4),
              "dark": order_correlations(np.maximum(signals - 0.1, 1e-9), signals, 4),
              "left out": [left_out((1, 24, 7), CLASSIC, "patch"),
                           *(said(lambda n=number: left_out((n,), CLASSIC, "leave_out"))
                             for number in (0, 1, 24, 25))]})


def _written(path, values, names):
    path.write_text(table_text(GRID.nm, dict(zip(names, values, strict=True)),
                               quantity=Quantity.REFLECTANCE, source="ours"), "utf-8")
    return path


def test_measured_references(recorded, tmp_path):
    rng = np.random.default_rng(9)
    values = chart_reflectances("ISO 17321-1", GRID) * rng.uniform(0.97, 1.03, (24, 1))
    plain = [f"p{number}" for number in range(24)]
    shuffled = rng.permutation(24)
    own = grid_chart("own", 2, 2, ("A01", "b 1", "A2", "B_2"), (1, 1), (2, 2))
    files = {
        "in order": (values, plain, CLASSIC), "error too": (
            np.vstack([values, values[:1] / 50]), [*plain, "standard_error p0"], CLASSIC),
        "named": (values[shuffled], [CLASSIC.names[patch].upper() for patch in shuffled], CLASSIC),
        "lettered": (values[shuffled], [CLASSIC.other_names[0][patch] for patch in shuffled],
                     CLASSIC),
        "numbered": (values[shuffled], [CLASSIC.other_names[1][patch] for patch in shuffled],
                     CLASSIC),
        "columns": (values.reshape(4, 6, -1).swapaxes(0, 1).reshape(24, -1), plain, CLASSIC),
        "mirrored": (values.reshape(4, 6, -1)[:, ::-1].reshape(24, -1), plain, CLASSIC),
        "shuffled": (values[shuffled], plain, CLASSIC), "few": (values[:23], plain[:23], CLASSIC),
        "own unnamed": (values[:4], plain[:4], own),
        "zeros": (values[:4], ["B01", "a 1", "B-2", "A002"], own)}
    found = {}
    for name, (rows, names, chart) in files.items():
        path = _written(tmp_path / "own.csv", rows, names)
        found[name] = said(lambda path=path, chart=chart: measured_chart(path, GRID, chart))
    chart = dataclasses.replace(own, reference_file=tmp_path / "own.csv")
    found["of the layout"] = reference_reflectances(None, chart, GRID)
    found["files"] = [each.name if (each := reference_file(name, chart, tmp_path)) else None
                      for name in (None, "PMC", "other.csv")]
    recorded(found)
    np.testing.assert_allclose(found["named"], values, rtol=1e-6)
    np.testing.assert_allclose(found["zeros"], values[[1, 0, 3, 2]], rtol=1e-6)


def test_how_sure_another_order_must_be(recorded, monkeypatch):
    """A chart that is nearly its own mirror picture, and a table that gradually becomes that."""
    from spectrabox.radiometry.charts import references
    rng = np.random.default_rng(10)
    of_both = rng.normal(size=(4, 3))
    even = np.concatenate([of_both, of_both[:, ::-1]], axis=1).ravel()
    odd = np.concatenate([of_both[::-1], -of_both[::-1, ::-1]], axis=1).ravel()

    def refused(chart_share, noise):
        monkeypatch.setattr(references, "published_signals", lambda *_: np.exp(
            0.3 * np.repeat((even + chart_share * odd)[:, None], 3, axis=1)))
        found = []
        for share in np.linspace(0, -1, 81):
            flat = np.exp(0.3 * (even + share * odd + noise * rng.normal(size=24)))
            values = np.repeat(flat[:, None], GRID.nm.size, axis=1)
            found.append(said(lambda v=values: references._require_order("x", v, GRID, CLASSIC)))
        return [each if each is None else each[40:] for each in found]
    recorded({f"{share} {noise}": refused(share, noise)[::2 if noise else 1]
              for share, noise in ((0.5, 0.0), (1.0, 0.0), (0.8, 0.5))})


LAYOUT = {"name": '"own"', "rows": "2", "columns": "3", "patch": "[10.0, 8.0]",
          "pitch": "[12.0, 9.5]"}
LAYOUT_CHANGES = {
    "plain": {}, "border": {"border": "[1.5, 0.7]", "reference": '"own.csv"'},
    "named": {"names": '["a", "b", "c", "d", "e", "f"]', "neutrals": '["e", "c"]'},
    "neutral": {"neutrals": '["A4"]'}, "few names": {"names": '["a", "b"]'},
    "twice": {"names": '["a", "a", "c", "d", "e", "f"]'}, "wide": {"columns": "29"},
    "flat": {"patch": "[0.0, 8.0]"}, "negative": {"patch": "[10.0, -1.0]"},
    "overlap": {"pitch": "[9.9, 9.5]"}, "touching": {"pitch": "[10.0, 8.0]"},
    "three": {"patch": "[1.0, 2.0, 3.0]"}, "both": {"centres": "[[0.0, 0.0]]"},
    "rows 0": {"rows": "0"}, "rows 100": {"rows": "100"}, "rows 101": {"rows": "101"},
    "columns 1": {"columns": "1"}, "columns 101": {"columns": "101"}, "no name": {"name": '""'},
    "unknown": {"pitsh": "[1.0, 2.0]"}, "word": {"rows": '"two"'},
    "fiducials": {"fiducials": "[[0.0, 0.0], [30.0, 1.0], [29.0, 20.0], [1.0, 21.0]]",
                  "fiducial_names": '["a", "b", "c", "d"]'},
    "three points": {"fiducials": "[[0.0, 0.0], [30.0, 1.0], [29.0, 20.0]]",
                     "fiducial_names": '["a", "b", "c", "d"]'},
    "no words": {"fiducials": "[[0.0, 0.0], [30.0, 1.0], [29.0, 20.0], [1.0, 21.0]]"},
    "three words": {"fiducials": "[[0.0, 0.0], [30.0, 1.0], [29.0, 20.0], [1.0, 21.0]]",
                    "fiducial_names": '["a", "b", "c"]'}}
CENTRES = "[[5.0, 5.0], [20.0, 5.5], [40.0, 5.0], [5.0, 20.0], [21.0, 21.0], [40.0, 22.0]]"


def test_layout_files(recorded, tmp_path):
    path = tmp_path / "own.toml"
    found = {}
    changes = LAYOUT_CHANGES | {
        "centres": {"pitch": None, "centres": CENTRES, "border": "[2.0, 1.0]"},
        "centres and points": {"pitch": None, "centres": CENTRES, "neutrals": '["B2"]',
                               **LAYOUT_CHANGES["fiducials"]},
        "few centres": {"pitch": None, "centres": "[[0.0, 0.0]]"},
        "back": {"pitch": None, "centres": CENTRES.replace("20.0, 5.5", "4.0, 5.5")},
        "up": {"pitch": None, "centres": CENTRES.replace("21.0, 21.0", "21.0, 5.4")},
        "neither": {"pitch": None}}
    for name, change in changes.items():
        lines = [f"{key} = {value}" for key, value in (LAYOUT | change).items() if value]
        path.write_text("\n".join(lines) + "\n", "utf-8")
        found[name] = said(lambda: _layout(path), tmp_path)
    found["missing"] = said(lambda: read_layout(tmp_path / "no.toml"), tmp_path)
    recorded(found)


def _layout(path):
    chart = chart_layout(path.name, path.parent)
    return {"chart": chart} if len(chart.names) < 7 else chart.names[-3:]


class Inner(Table):
    """A table in a table."""

    size: float = Field(ge=0.5, le=9.0)
    word: str | None = None


class Whole(Table):
    """All kinds of keys."""

    count: int = Field(ge=1)
    share: float = Field(0.5, le=1.0)
    pair: ListOf[float] = Field((1.0, 2.0), min_length=2, max_length=2)
    names: ListOf[str] = Field(("a",), min_length=1)
    wanted: ListOf[str] = Field(min_length=1)
    inner: Inner | None = None
    parts: dict[str, Inner] = Field(default_factory=dict)
    several: ListOf[Inner] = ()
    either: str | ListOf[str] | None = None
    on: bool = False
    grown: float | None = Field(None, alias="grows")


FINE = {"count": 2, "wanted": ["x"]}
WRITTEN = {
    "fine": {}, "rich": {"share": 1, "pair": [3, 4.5], "inner": {"size": 0.5}, "on": True,
                         "parts": {"p": {"size": 9, "word": "w"}}, "several": [{"size": 2.0}],
                         "either": ["q"], "grows": 2.5},
    "unknown": {"cuont": 3}, "unknown inside": {"inner": {"size": 1, "wrod": "x"}},
    "unknown part": {"parts": {"p": {"size": 1, "zise": 2}}}, "missing inside": {"inner": {}},
    "low": {"count": 0}, "high": {"share": 1.01}, "far": {"inner": {"size": 9.1}},
    "huge": {"share": 1e301}, "whole": {"share": 9 * 10**299},
    "huge whole": {"share": 15 * 10**299}, "nan": {"share": float("nan")}, "word": {"count": "3"},
    "number": {"either": 3}, "list": {"either": [3]}, "half": {"count": 1.5}, "flag": {"on": 1},
    "pair short": {"pair": [1.0]}, "pair long": {"pair": [1.0, 2.0, 3.0]}, "no list": {"pair": 1.0},
    "empty": {"names": []}, "empty wanted": {"wanted": []}, "no table": {"inner": 3},
    "no tables": {"parts": 3}, "one table": {"several": {"size": 1.0}},
    "in several": {"several": [{"size": 1.0}, {"size": 0.1}]}, "two": {"count": 0, "share": 2.0},
    "long": {"count": "x" * 300}}


def test_tables_that_people_write(recorded, tmp_path):
    def whole(change):
        return checked(Whole, FINE | change, "own.toml").model_dump()
    found = {name: said(lambda change=change: whole(change)) for name, change in WRITTEN.items()}
    found["missing"] = said(lambda: checked(Whole, {}, "own.toml"))
    found["nearest"] = [nearest(word, ["count", "share", "names"]) for word in ("cnt", "naem", "q")]
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xef\xbb\xbfa = 1\n")
    found["marked"] = read_toml(path, "write one")
    path.write_text("a = \n", "utf-8")
    found["not toml"] = said(lambda: read_toml(path, "write one"))[:40]   # then Python's words
    found["no file"] = said(lambda: read_toml(tmp_path / "b.toml", "write one"), tmp_path)
    recorded(found)
