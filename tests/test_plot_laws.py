"""The report's figures: where marks lie, what numbers and legends say, and what a failure says."""
from __future__ import annotations

import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from spectrabox.session.report import svg
from spectrabox.session.report.svg import MissingDrawing, Plot, nice_ticks, path, rounded


def plot(width=240.0, height=140.0, **fields):
    """Axes from 0 to 10 over 191 points, and from 0 to 2 over 100."""
    return Plot("p", width, height, (0, 10), (0, 2), **fields)


def parsed(drawing):
    """The figure's elements, which are well-formed."""
    return ElementTree.fromstring(str(drawing).replace("&nbsp;", " "))


def named(drawing, tag):
    return [each for each in parsed(drawing).iter() if each.tag == tag]


def points(shape):
    return np.array([[float(one) for one in pair.split()]
                     for pair in re.findall(r"[ML]([-\d. ]+)", shape)])


# ---- where marks lie

def test_points_run_from_the_axes_lower_left_to_their_upper_right():
    one = plot()
    np.testing.assert_allclose(one.x([0, 5, 10]), [40, 135.5, 231])
    np.testing.assert_allclose(one.y([0, 1, 2]), [109, 59, 9])
    other = plot(margins=(10, 20, 30, 40))
    assert (float(other.x(0)), float(other.x(10))) == (10, 220)
    assert (float(other.y(0)), float(other.y(2))) == (110, 40)


def test_a_curve_goes_through_its_points_and_stops_where_there_are_none():
    one = plot()
    one.line([0, 5, 7, 10], np.array([0, 1, np.nan, 2]), "#123456", 1.5, dash="2 1")
    (curve,) = [each for each in named(one.drawn("t", "d"), "path")
                if each.get("stroke") == "#123456"]
    assert curve.get("d") == "M40.00 109.00L135.50 59.00M231.00 9.00"
    assert curve.get("stroke-width") == "1.5" and curve.get("stroke-dasharray") == "2 1"
    assert curve.get("fill") == "none"
    assert path(np.array([np.inf, 1.0, 2.0]), np.array([1.0, 1.0, np.nan])) == "M1.00 1.00"


def test_an_area_lies_between_its_curves():
    one = plot()
    one.areas([0, 10], np.array([0.0, 0.5]), np.array([1.0, 1.5]), "#abcdef", 0.25, label="band")
    drawing = one.drawn("t", "d")
    (area,) = [each for each in named(drawing, "path") if each.get("fill") == "#abcdef"]
    np.testing.assert_allclose(points(area.get("d")),
                               [[40, 109], [231, 84], [231, 34], [40, 59]])
    assert area.get("d").endswith("z") and area.get("fill-opacity") == "0.25"
    several = plot()
    several.areas([[0, 1], [2, 3]], np.zeros((2, 2)), np.ones((2, 2)), "#abcdef", 1)
    (areas,) = [each for each in named(several.drawn("t", "d"), "path")
                if each.get("fill") == "#abcdef"]
    assert areas.get("d").count("z") == 2


def test_dots_rings_and_crosses_lie_at_their_points():
    one = plot()
    one.dots([0, 5, 10], np.array([0, 1, np.nan]), "#111111", 3)
    one.dots([5], np.array([2.0]), "#222222", 2, open_=True)
    one.crosses([10], [1], "#333333")
    drawing = one.drawn("t", "d")
    full = [each for each in named(drawing, "circle") if each.get("fill") == "#111111"]
    assert [(each.get("cx"), each.get("cy"), each.get("r")) for each in full] == [
        ("40.00", "109.00", "3"), ("135.50", "59.00", "3")]
    (ring,) = [each for each in named(drawing, "circle") if each.get("stroke") == "#222222"]
    assert ring.get("fill") == "none" and ring.get("cy") == "9.00"
    (cross,) = [each for each in named(drawing, "path") if each.get("stroke") == "#333333"]
    assert cross.get("d") == "M229.00 57.00l4 4m0 -4l-4 4"


@pytest.mark.parametrize("corners", [(2, 0.5, 4, 1), (4, 1, 2, 0.5)])
def test_rectangles_and_pictures_lie_between_two_corners(corners):
    one = plot()
    one.rectangle(corners, "#123123")
    one.picture(corners, "data:x", kind="photo")
    one.picture(corners, "data:y", smooth=True)
    drawing = one.drawn("t", "d")
    (shape,) = [each for each in named(drawing, "rect") if each.get("fill") == "#123123"]
    place = {"x": "78.20", "y": "59.00", "width": "38.20", "height": "25.00"}
    assert {key: shape.get(key) for key in place} == place
    raw, smooth = named(drawing, "image")
    assert {key: raw.get(key) for key in place} == place and raw.get("class") == "photo"
    assert "pixelated" in raw.get("style") and smooth.get("style") is None
    assert (raw.get("href"), smooth.get("href")) == ("data:x", "data:y")


def test_lines_run_over_the_whole_axes():
    one = plot()
    one.upright(5, "#111111", 1, "", "")
    one.level(1, "#222222", 2)
    shapes = {each.get("stroke"): each.get("d") for each in named(one.drawn("t", "d"), "path")}
    assert shapes["#111111"] == "M135.50 9.00V109.00"
    assert shapes["#222222"] == "M40.00 59.00H231.00"


def test_a_rim_tells_an_outline_from_any_ground():
    one = plot()
    one.outline(np.array([[0, 0], [10, 0], [10, 2]]), "#ffffff", 2)
    rim, line = (each for each in named(one.drawn("t", "d"), "path"))
    assert rim.get("d") == line.get("d") == "M40.00 109.00L231.00 109.00L231.00 9.00z"
    assert (rim.get("stroke"), rim.get("stroke-width")) == ("#000", "3")
    assert (line.get("stroke"), line.get("stroke-width")) == ("#ffffff", "2")


def test_a_part_that_leads_to_a_card_is_pressed_and_named():
    one = plot()
    assert parsed(one.drawn("t", "d")).find("svg").get("role") == "img"
    one.linked("M0 0L1 1z", 'a "<b>"', "card-1", 4, "#fff", 1)
    one.linked("M0 0L1 1z", "plain", "card-2", 5)
    drawing = one.drawn("t", "d")
    assert parsed(drawing).find("svg").get("role") == "group"
    first, second = named(drawing, "a")
    assert first.get("href") == "#card-1" and first.get("data-surface") == "4"
    assert first.get("aria-label") == 'a "<b>"'
    assert len(first) == 3 and len(second) == 1


def test_axes_have_their_ticks_labels_and_names():
    one = plot()
    one.x_axis("nm", [0, 5], grid=False)
    one.y_axis("share", [0, 1, 2], ["none", "half", "all"])
    drawing = one.drawn("t", "d")
    said = {each.text: each for each in named(drawing, "text")}
    assert {"0", "5", "nm", "share", "none", "half", "all"} <= set(said)
    assert (said["5"].get("x"), said["5"].get("text-anchor")) == ("135.50", "middle")
    assert float(said["5"].get("y")) > 109 and said["all"].get("text-anchor") == "end"
    assert float(said["all"].get("y")) == pytest.approx(9, abs=4)
    assert said["share"].get("transform").startswith("rotate(-90")
    grid = [each for each in named(drawing, "path") if each.get("stroke") == svg.GRID]
    assert len(grid) == 3                                       # of the y axis alone
    assert drawing.axes == []                                   # nothing is plotted yet


# ---- numbers, legend, read-out

def test_the_numbers_of_a_figure_are_those_plotted():
    one = plot()
    one.x_axis("nm", [0])
    one.y_axis("share", [0])
    one.line([1, 2], np.array([0.1234567, 0.2]), "#111111", 1, label="curve")
    one.line([1, 2], np.log10([1.0, 10.0]), "#111111", 1, stated=np.array([1.0, 10.0]))
    one.dots([3], np.array([1.0]), "#111111", 1, label="dot")
    one.lines([np.array([[1, 2], [3, 4]])], "#111111", 1, label="many")
    (axes,) = one.drawn("t", "d").axes
    assert (axes["x_name"], axes["y_name"]) == ("nm", "share")
    assert axes["x_limits"].tolist() == [0, 10] and axes["y_limits"].tolist() == [0, 2]
    curve, logarithm, dot = axes["lines"]
    assert curve["label"] == "curve" and curve["y"].tolist() == [0.123457, 0.2]
    assert logarithm["y"].tolist() == [1, 10] and dot["x"].tolist() == [3]
    assert axes["curves"][0]["points"][0].tolist() == [[1, 3], [2, 4]]


def test_a_curve_without_points_stands_in_the_legend_alone():
    one = plot()
    one.line([], np.zeros(0), "#111111", 1, label="here")
    drawing = one.drawn("t", "d")
    assert drawing.axes == [] and [each.text for each in named(drawing, "text")] == ["here"]
    assert named(plot().drawn("t", "d"), "text") == []


def test_a_legend_takes_as_many_rows_as_it_needs_above_the_figure():
    one = plot()
    for number in range(5):
        one.line([0, 1], np.zeros(2), "#111111", 1, label=f"a curve of some name {number}")
    drawing = one.drawn("t", "d")
    places = [[float(value) for value in re.findall(r"[-\d.]+", each.get("transform"))]
              for each in named(drawing, "g") if each.get("transform")]
    rows = sorted({y for _, y in places})
    assert len(rows) == 5 and rows[-1] == -4 and np.allclose(np.diff(rows), svg.LEGEND_ROW)
    top, height = (float(parsed(drawing).find("svg").get("viewBox").split()[index])
                   for index in (1, 3))
    assert (top, height) == (-5 * svg.LEGEND_ROW, 140 + 5 * svg.LEGEND_ROW)
    short = plot()
    for name in "abc":
        short.dots([0], np.zeros(1), "#111111", 1, label=name)
    places = [float(re.findall(r"[-\d.]+", each.get("transform"))[0])
              for each in named(short.drawn("t", "d"), "g") if each.get("transform")]
    wide = svg.SYMBOL + 4 + svg.LETTER_WIDTH * svg.LETTERS + svg.SPACE
    np.testing.assert_allclose(places, [40, 40 + wide, 40 + 2 * wide], atol=0.006)


def test_the_pointer_reads_every_series():
    one = plot(width=500.0)
    assert parsed(one.drawn("t", "d")).get("class") == "plot-box wide"
    assert 'tabindex="0"' in str(one.drawn("t", "d"))       # what scrolls is reached by keyboard
    one.readout(np.array([400.0, 500.00049]), {"mean": np.array([0.12345, np.nan])}, "wavelength",
                "nm", digits=2)
    drawing = one.drawn("t", "d")
    (script,) = named(drawing, "script")
    numbers = json.loads(script.text)
    assert numbers["x"] == [400, 500] and numbers["series"] == [["mean", [0.123, None]]]
    assert (numbers["name"], numbers["unit"], numbers["digits"]) == ("wavelength", "nm", 2)
    assert numbers["box"] == [40, 9, 491, 109] and numbers["limits"] == [0, 10]
    assert "tabindex" not in str(drawing)
    assert parsed(plot().drawn("t", "d")).get("class") == "plot-box"


def test_a_figure_has_a_name_a_title_and_a_description_and_nothing_of_a_stranger_s_in_it():
    one = plot()
    one.words(5, 1, "<script>", rim="#fff", turned=True)
    drawing = one.drawn('"t" <&>', "d<b>")
    root = parsed(drawing)
    picture = root.find("svg")
    assert root.get("id") == drawing.name == "p" and drawing.heading == '"t" <&>'
    assert picture.get("aria-labelledby") == "p-title p-desc"
    assert picture.find("title").text == '"t" <&>' and picture.find("desc").text == "d<b>"
    (text,) = named(drawing, "text")
    assert text.text == "<script>" and text.get("stroke") == "#fff"
    assert text.get("transform") == "rotate(-90 135.50 59.00)"
    (clip,) = named(drawing, "clipPath")
    assert clip.get("id") == "p-clip" and clip[0].get("width") == "191.00"


def test_a_hatch_is_described_once_and_used_as_often_as_it_is_drawn():
    one = plot()
    for start in (0, 5):
        one.hatched((start, 0, start + 2, 2), "#fff", "#000")
    drawing = one.drawn("t", "d")
    assert len(named(drawing, "pattern")) == 1
    assert sum(each.get("fill") == "url(#p-hatch)" for each in named(drawing, "rect")) == 2


def test_a_figure_that_fails_leaves_a_sentence():
    @svg.figure("nothing")
    def draws(fails):
        if fails:
            raise ValueError("no curve")
        return plot().drawn("t", "d")

    assert isinstance(draws(False), svg.Drawing)
    missing = draws(True)
    assert isinstance(missing, MissingDrawing) and "no curve" in missing
    assert "picture of nothing" in missing and missing.failed.code == "extra.failed"


# ---- numbers

@pytest.mark.parametrize("low, high, most, expected", [
    (0, 10, 5, [0, 2, 4, 6, 8, 10]), (0, 1, 4, [0, 0.25, 0.5, 0.75, 1]),
    (-0.3, 0.3, 6, [-0.3, -0.2, -0.1, 0, 0.1, 0.2, 0.3]), (412, 688, 6, [450, 500, 550, 600, 650]),
    (0, 9.99, 1, [0]), (3, 4, 0, [3, 4])])
def test_ticks_are_round_and_no_more_than_wished_for(low, high, most, expected):
    np.testing.assert_allclose(nice_ticks(low, high, most), expected, atol=1e-12)
    assert not np.signbit(nice_ticks(low, high, most)[np.array(expected) == 0]).any()


def test_numbers_are_written_short_and_with_a_minus_sign():
    assert svg.tick_labels([0, 0.25, -1.5, 1e6]) == ["0", "0.25", "−1.5", "1e+06"]


def test_numbers_are_rounded_to_six_digits_and_what_is_none_stays():
    np.testing.assert_array_equal(rounded([0, 123456.7, -0.00123456789, np.nan]),
                                  [0, 123457, -0.00123457, np.nan])


def test_a_line_of_text_is_one_line_and_not_too_long():
    assert svg.plain_line("a\n\tb\x00 c") == "a b c"
    assert svg.plain_line("x" * 60) == "x" * 60
    assert svg.plain_line("x" * 61) == "x" * 59 + "…" and svg.plain_line("abcd", 3) == "ab…"
