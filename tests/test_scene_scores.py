"""Scores of the public scenes: known answers, and what is written against what is rendered."""
import numpy as np
import pytest

from benchmarks.scenes import made, render, score

NM = np.arange(380.0, 731.0)
TRUTH = {"wall": 0.2 + 0.3 * (NM - 380) / 350, "ball": np.full(NM.size, 0.5)}


def banded(half_width, off=0.0):
    answer = {}
    for name, values in TRUTH.items():
        answer |= {name: values + off, name + score.LOWER: values + off - half_width,
                   name + score.UPPER: values + off + half_width}
    return answer


def test_the_truth_scores_without_error():
    result = score.scored(NM, banded(0.05), NM, TRUTH)
    assert (result.materials, result.rmse, result.held) == (2, 0, 1)
    # round-off of the fitted factor
    assert result.shape == pytest.approx(0, abs=1e-12)
    assert result.width == pytest.approx(0.1)


def test_an_offset_is_the_rmse_and_leaves_narrow_bands_empty():
    result = score.scored(NM, banded(0.02, off=0.03), NM, TRUTH)
    assert result.rmse == pytest.approx(0.03)
    assert result.held == 0
    assert score.scored(NM, banded(0.04, off=0.03), NM, TRUTH).held == 1


def test_half_of_the_wavelengths_within_the_band_are_half_held():
    answer = banded(0.01)
    below = NM < 550            # 30 of the 61 wavelengths that count
    answer["ball" + score.UPPER] = np.where(below, 0.51, 0.495)
    expected = (61 + 30) / 122
    assert score.scored(NM, answer, NM, TRUTH).held == pytest.approx(expected)


def test_rmse_is_a_mean_over_materials_not_over_squares():
    answer = {"wall": TRUTH["wall"], "ball": TRUTH["ball"] + 0.1}
    assert score.scored(NM, answer, NM, TRUTH).rmse == pytest.approx(0.05)


def test_a_common_level_costs_no_shape_and_another_for_each_does():
    brighter = {name: 1.3 * values for name, values in TRUTH.items()}
    result = score.scored(NM, brighter, NM, TRUTH)
    assert result.rmse > 0.1
    # round-off
    assert result.shape == pytest.approx(0, abs=1e-12)
    assert np.isnan(result.held)
    assert score.scored(NM, brighter | {"ball": TRUTH["ball"]}, NM, TRUTH).shape > 0.02


def test_other_wavelengths_are_interpolated():
    coarse = np.array([390.0, 550.0, 720.0])
    answer = {name: np.interp(coarse, NM, values) for name, values in TRUTH.items()}
    # straight lines, so that interpolation is exact but for round-off
    assert score.scored(coarse, answer, NM, TRUTH).rmse == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("answer, nm, said", [
    ({"wall": TRUTH["wall"]}, NM, "ball"),
    (TRUTH | {"wall" + score.LOWER: TRUTH["wall"]}, NM, "wall upper"),
    (TRUTH, NM + 40, "420"),
], ids=["missing", "half a band", "short"])
def test_what_cannot_be_scored_is_said(answer, nm, said):
    with pytest.raises(score.AnswerError, match=said):
        score.scored(nm, answer, NM, TRUTH)


def test_given_materials_do_not_count_and_files_are_read_as_written(tmp_path, capsys):
    scenes, answers = tmp_path / "scenes", tmp_path / "answers"
    answers.mkdir()
    (scenes / "box").mkdir(parents=True)
    score.write_spectra(scenes / "box" / "truth.csv", NM, TRUTH)
    score.write_spectra(scenes / "box" / "known.csv", NM, {"wall": TRUTH["wall"]})
    score.write_spectra(answers / "box.csv", NM, {"ball": TRUTH["ball"] - 0.02})
    words = ["--scenes", str(scenes), "--answers", str(answers)]
    assert score.main(words) == 0
    assert "| box | 1 | 0.0200 | 0.0000 | - | - |" in capsys.readouterr().out
    (answers / "box.csv").write_text("wavelength_nm,ball\n400,0.5\n400,nan\n", encoding="utf-8")
    assert score.main(words) == 3
    assert "rising" in capsys.readouterr().err


@pytest.mark.parametrize("name", made.SCENES)
def test_the_photo_is_of_the_true_spectra_of_every_material(tmp_path, name):
    """Stated scenes hold placeholders alone; the renderer fills each from the files beside it."""
    made.write(name, tmp_path)
    _, truth = score.read_spectra(tmp_path / "truth.csv")
    assert all(values.min() > 0 and values.max() < 1 for values in truth.values())
    stated, filled = (tmp_path / "scene.xml").read_text(encoding="utf-8"), render.true_xml(tmp_path)
    assert stated.count('value="0.5"/></bsdf>') == len(truth)
    assert 'value="0.5"/></bsdf>' not in filled
    for values in truth.values():
        assert ", ".join(f"{value:.8g}" for value in values) in filled
