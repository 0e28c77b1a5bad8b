"""Arrays in Python whose shape contradicts their wavelengths, and names that are not there."""
import numpy as np
import pytest

import spectrabox as sb

NM = np.arange(400, 701, 10.0)
GREYS = np.linspace(0.1, 0.8, 140)[:, None] * np.ones(NM.size)


@pytest.mark.parametrize("ask", [
    lambda rows: sb.certify(None, rows, nm=NM),
    lambda rows: sb.train_prior({"paint": rows}, nm=NM),
    lambda rows: sb.train_prior({"paint": [rows, GREYS]}, nm=NM)])
@pytest.mark.parametrize("rows", [GREYS.T, GREYS[:, :30], np.full((140, 61), 0.3)])
def test_rows_that_are_not_at_the_wavelengths_are_refused_naming_both_shapes(ask, rows):
    with pytest.raises(sb.InputError) as refused:
        ask(rows)
    assert f"shape {rows.shape} and wavelengths of shape (31,)" in str(refused.value)


@pytest.mark.parametrize("ask", [
    lambda rows: sb.certify(None, rows, nm=NM),
    lambda rows: sb.train_prior({"paint": rows}, nm=NM)])
def test_a_library_in_per_cent_is_called_so(ask):
    with pytest.raises(sb.InputError, match="far above 1: absorbance, or per cent"):
        ask(100 * GREYS)
    with pytest.raises(sb.InputError, match="no array of numbers"):
        ask(np.array([["a", "b"]]))


def judged(regions, truth):
    return sb.judge(np.full((8, 8, NM.size), 0.3), regions, truth, nm=NM, truth_nm=NM)


def test_a_region_without_a_truth_of_its_name_is_not_judged_by_another():
    boxes = {"p": (1, 1, 3, 3), "r": (4, 4, 6, 6)}
    with pytest.raises(sb.InputError, match="no truth is given for 'p', 'r'; there are 'x'"):
        judged(boxes, {"x": np.full(NM.size, 0.3)})
    with pytest.raises(sb.InputError, match=r"truth 'p' of shape \(30,\) and wavelengths of shape"):
        judged({"p": boxes["p"]}, {"p": np.full(30, 0.3)})
    for box in ((1, 1, 3), (1, 1, np.nan, 3), "abcd"):
        with pytest.raises(sb.InputError, match="region 'p'"):
            judged({"p": box}, {"p": np.full(NM.size, 0.3)})
    with pytest.raises(sb.InputError, match="no region is given"):
        judged({}, {"p": np.full(NM.size, 0.3)})
