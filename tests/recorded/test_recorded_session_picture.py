"""Light, errors and maps of pictures of spectra, recorded; and what camera commands read."""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_array
from test_recorded_session_stages import (
    BASIS,
    COARSE,
    CURVES,
    GRID,
    LAMPS,
    NM,
    PAINTS,
    RESPONSES,
    spectrum,
)

from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records import Calibration, Outcome, SensitivityFit, SurfaceSignals
from spectrabox.sampling.prior.mixture import GRID as PRIOR_GRID
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.session.camera.inputs import (
    numbers_of_patches,
    read_measured_curves,
    require_outputs,
)
from spectrabox.session.camera.patch_files import read_patches
from spectrabox.session.picture import picture_maps
from spectrabox.session.picture.curve_errors import curve_errors
from spectrabox.session.picture.illumination import brought_by, even_light, illumination
from spectrabox.session.picture.picture_maps import Reduced, maps_of, shown
from spectrabox.session.picture.pixel_errors import PixelErrors, White
from spectrabox.session.picture.unseen import CLIPPED, EDGE, SEEN
from spectrabox.session.stages.error_budget import light_covariance, sensitivity_covariance

TO_PRIOR = interpolation_matrix(PRIOR_GRID.nm, GRID.nm)


def spread(rng, *shape, size):
    root = rng.normal(size=shape) * size
    return root @ np.swapaxes(root, -1, -2)


def calibration(fitted, lamp=0):
    rng = np.random.default_rng(5)
    fit = SensitivityFit(GRID, CURVES, BASIS if fitted else None, np.ones((3, 6)) if fitted
                         else None, spread(rng, 18, 18, size=2e-3) if fitted else None, None, None,
                         None, None, "made", Outcome.CONVERGED)
    return Calibration(fit, spectrum(LAMPS[lamp], True, COARSE), None,
                       spread(rng, 3, 5, size=0.01), ())


@pytest.mark.parametrize("fitted", [True, False])
def test_errors_of_many_signals_are_those_of_each(recorded, fitted):
    """As the error budget of a session has them, signal by signal."""
    made = curve_errors(calibration(fitted), RESPONSES[0], PRIOR_GRID.nm)
    coarse = np.array([np.interp(PRIOR_GRID.nm, NM, paint) for paint in PAINTS])
    signals = coarse @ TO_PRIOR.T @ RESPONSES[0].T * [[1.0], [0.97], [1.04]]
    found = made.covariance(signals, coarse)
    one = SurfaceSignals(("a", "b", "c"), (False,) * 3, GRID, coarse @ TO_PRIOR.T, tuple("RGB"),
                         np.zeros(3, int), RESPONSES[0], signals, ())
    for index in range(3):
        expected = sensitivity_covariance([calibration(fitted)], one, index) \
            + light_covariance([calibration(fitted)], one, index)
        # round-off of sums over 301 wavelengths
        np.testing.assert_allclose(found[index], expected, rtol=1e-8, atol=1e-16)
    recorded({"made": {"by white": (made.by_white**2).sum(), "brightest": made.of_brightest},
              "covariance": found})


def lights():
    """Light at twelve nodes, mixed of two lamps and a little of a third colour."""
    share = np.linspace(0, 1, 12)[:, None]
    return (1 + np.arange(12)[:, None] / 7) * (
        (1 - share) * LAMPS[0] + share * LAMPS[1] + 0.05 * share**2 * PAINTS[0])


def test_light_of_several_colours(recorded):
    to_signals = (CURVES * GRID.weights_nm)[:, :, None] * TO_PRIOR
    light = lights()
    made = illumination(light, to_signals)
    # a few shapes times maps give the light again, within what they may miss
    np.testing.assert_allclose(made.maps @ made.spectra, light, atol=5e-3 * light.max())
    brought = brought_by(made, load_prior())
    coarse = np.array([np.interp(PRIOR_GRID.nm, NM, paint) for paint in PAINTS])
    maps, kind = made.maps[[1, 5, 10]], made.kind[[1, 5, 10]]
    shapes = np.einsum("nq,qkp->nkp", maps, made.shapes)
    signals = np.einsum("nkp,np->nk", shapes, coarse) / shapes.sum(axis=2)
    there = brought.signals(signals, maps, kind)
    exact = np.einsum("nkp,np->nk", made.responses[kind], coarse)
    # nearer to what they would be under the typical light than as they were measured
    assert np.abs(there - exact).max() < 0.7 * np.abs(signals - exact).max()
    order = np.argsort(made.white[:, 0])
    recorded({"white": made.white, "light": made.maps @ made.spectra, "rank": made.maps.shape,
              "order": order, "alike": made.kind[:, None] == made.kind, "signals": there,
              "dark": brought.signals(signals, 0 * maps, kind)}, 1e-5)
    same = even_light(RESPONSES[0] @ TO_PRIOR, 4)
    recorded({"white": same.white, "responses": same.responses,
              "signals": brought_by(same, load_prior()).signals(signals, np.ones((3, 1)),
                                                                np.zeros(3, int))}, case="even")
    steady = illumination(np.ones((5, 1)) * LAMPS[0] * [[1], [2], [3], [4], [0]], to_signals)
    recorded({"kinds": steady.kind, "typical": len(steady.typical), "white": steady.white},
             case="steady")


def errors():
    rng = np.random.default_rng(8)
    white = White(0.5 + rng.random((4, 3)), spread(rng, 4, 3, 4, size=0.01),
                  0.003 * rng.normal(size=(4, 3, 3)))
    weights = csr_array(np.array([[0.5, 0.5, 0, 0], [0, 0.2, 0.7, 0.1], [0, 0, 0, 1.0]]))
    return PixelErrors(
        lambda first, last: weights[first:last], white, even_light(RESPONSES[0] @ TO_PRIOR, 4),
        np.array([0.01, 0.02, 0.005]), spread(rng, 3, 4, size=0.002),
        np.array([0.003, 0.001, 0.004]), spread(rng, 3, 4, size=0.01),
        spread(rng, 3, 4, size=0.012), (calibration(True),), RESPONSES[0][None], load_prior())


def test_errors_of_pixels(recorded):
    made = errors()
    white = made.white_at(made.between(0, 3))
    signals = np.array([[0.2, 0.5, 0.3], [0.7, 0.1, 0.4], [0.05, 0.06, 0.9]])
    variance = 1e-4 * np.arange(1, 10).reshape(3, 3)
    found = made.at_white(signals, white, variance)
    np.testing.assert_allclose(found, found.transpose(0, 2, 1), atol=1e-18)
    less = made.at_white(signals, white, 0 * variance)
    # noise is each pixel's and band's own
    np.testing.assert_allclose(found - less, [np.diag(each) for each in variance / white.signal**2],
                               atol=1e-15)
    recorded({"white": vars(white), "covariance": found, "curves": made.by_curves(signals, 0),
              "repeated": vars(white.repeated(2)), "responses": made.responses})


def test_maps_and_their_reduction(recorded, monkeypatch):
    rng, nm = np.random.default_rng(2), np.arange(400.0, 701.0, 30)
    mean, sd, unlike = rng.random((35, nm.size)), 0.12 * rng.random(35), 2.2 * rng.random(35)
    maps = maps_of(nm, (430, 555), "A", True)
    made = {each.title: each.values(mean, sd, unlike) for each in maps if each.values is not None}
    codes = rng.integers(0, 6, (35, 1))
    coded = {each.title: each.encoded(made.get(each.title, codes)).astype(float) for each in maps}
    recorded({"titles": [(each.title, each.file, each.channels) for each in maps], "values": made,
              "coded": coded})
    monkeypatch.setattr(picture_maps, "REDUCED_PX", 3)
    reduced = Reduced(5, 7, maps)
    seen = rng.random((5, 7)) > 0.45
    kept = {each.file: made.get(each.title, codes).reshape(5, 7, -1) for each in maps}
    for first, last in ((0, 2), (2, 5)):
        reduced.add(first, seen[first:last], {name: value[first:last]
                                              for name, value in kept.items()})
    recorded({"factor": reduced.factor, "means": {name: reduced.mean(name) for name in kept},
              "shown": shown(reduced.mean(maps[0].file), maps[0].encoded).astype(float)},
             case="reduced")
    whole = Reduced(5, 7, maps)
    whole.add(0, np.ones((5, 7), bool), kept)
    for name, value in kept.items():
        if name != picture_maps.MASK:       # of which the first pixel's code is kept
            assert np.isfinite(whole.mean(name)).all()      # also in the smaller blocks at the end
            np.testing.assert_allclose(whole.mean(name)[1, 2], value[3:5, 6:7].mean(axis=(0, 1)),
                                       rtol=1e-6)
    assert {SEEN, CLIPPED, EDGE} == {0, 1, 3}


def said(call, *arguments):
    try:
        return call(*arguments)
    except SpectraboxError as error:
        return f"{type(error).__name__}: {error}"


def test_what_camera_commands_read(recorded, tmp_path):
    def written(text):
        (tmp_path / "patches.csv").write_text(text, encoding="utf-8")
        made = said(read_patches, tmp_path / "patches.csv")
        return made if isinstance(made, str) else {
            "names": made[1], "mean": made[0].mean, "errors": made[0].covariance_of_mean}

    rows = [f"{0.01 * row:.3f},{0.02 * row + 0.1:.3f},{0.5 - 0.01 * row:.3f}" for row in range(24)]
    named = [f"p{row},{each}" for row, each in enumerate(rows)]
    errored = [f"{each},0.001,0.002,{0.001 * row:.4f}" for row, each in enumerate(rows)]
    head = "standard_error"
    texts = {
        "plain": "\n".join(rows), "names": "\n".join(["r,g,b", *rows]),
        "patches": "\n".join(["patch,r,g,b", *named]), "comment": "\n".join(["# a", "", *rows]),
        "errors": "\n".join([f"r,g,b,{head} r,{head} g,{head} b", *errored]),
        "others": "\n".join([f"r,g,b,{head} b,{head} r,{head} g", *errored]),
        "unnamed": "\n".join([f"r,g,b,{head},{head} 2,{head} 3", *errored]),
        "no band": "\n".join([f"r,g,b,{head} r,{head} g,{head} x", *errored]),
        "two": "\n".join([f"r,g,{head} r,{head} g,{head} 3,{head} 4", *errored]),
        "negative": "\n".join([f"r,g,b,{head} r,{head} g,{head} b",
                               *(each.replace("0.002", "-0.002") for each in errored)]),
        "fewer": "\n".join(rows[:23]), "more": "\n".join([*rows, rows[0]]),
        "alike": "\n".join(["r,g,r", *rows]), "word": "\n".join([*rows[:23], "1,2,x"]),
        "short": "\n".join([*rows[:23], "1,2"]), "large": "\n".join([*rows[:23], "1,2,1e10"]),
        "largest": "\n".join([*rows[:23], "1,2,1e9"]), "empty": ""}
    recorded({name: written(text) for name, text in texts.items()})
    curves = np.array([np.interp(COARSE.nm, NM, curve) for curve in CURVES]).T
    limits = {}
    for low in (0.0, -0.049, -0.051):
        curves[3, 2] = low
        (tmp_path / "curves.csv").write_text("\n".join(["nm,r,g,b", *(
            ",".join(f"{value:.5f}" for value in row)
            for row in np.column_stack([COARSE.nm, curves]))]), encoding="utf-8")
        limits[str(low)] = said(read_measured_curves, tmp_path / "curves.csv", 3, GRID)
    limits["four"] = said(read_measured_curves, tmp_path / "curves.csv", 4, GRID)
    limits["numbers"] = [said(numbers_of_patches, text) for text in ("5, 3,5", "", "a", "1.5",
                                                                     "-1", "0")]
    here = tmp_path / "curves.csv"
    limits["outputs"] = [str(said(require_outputs, [out], [here])).replace(str(tmp_path), "")
                         for out in (here, tmp_path, tmp_path / "new.csv")]
    recorded(limits, case="limits")


def test_expectations_of_a_shoot_are_judged(recorded):
    from spectrabox.session.camera.expected_spectra import Expectation, FamilyExpectation

    def doubts(rmse, known, daylight):
        return Expectation((FamilyExpectation("paint", rmse, 0.2, 0.9, known, 0.1),
                            FamilyExpectation("leaves", 1.1 * rmse, 0.3, 0.95, 1.1 * known, 0.15)),
                           1.05 * daylight, ()).doubts

    recorded({f"{rmse} {known} {daylight}": doubts(rmse, known, daylight)
              for rmse in (0.0109, 0.0111, 0.02) for known in (0.01, 0.0114, 0.0116)
              for daylight in (0.01,)})
    mean = Expectation((FamilyExpectation("a", 0.01, 0.2, 0.9, 0.02, 0.1),
                        FamilyExpectation("b", 0.03, 0.4, 0.8, 0.05, 0.3)), 0.02, ()).mean
    assert dataclasses.astuple(mean) == pytest.approx(("all", 0.02, 0.3, 0.85, 0.035, 0.2))
    assert SimpleNamespace(**vars(mean)).family == "all"
