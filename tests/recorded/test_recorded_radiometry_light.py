"""Recorded: light scales from exposure to exposure, and the drift of a light."""
import dataclasses

import numpy as np
from recorded_refusals import said

from spectrabox.radiometry.light_drift import drift_between, drift_covariance, scale_after_drift
from spectrabox.radiometry.light_scale import (
    error_of_each_band,
    exposure_product,
    exposure_ratio,
    light_drift,
    rounding_error,
    scale_for_photo,
    scale_from_signals,
    with_common_error,
)
from spectrabox.radiometry.records import CommonError, LightScale, LinearImage, PhotoKind

SCALE = LightScale(2.7, 0.11, np.array([[0.01, -0.02, 0.03]]), "chart",
                   (CommonError("lamp", 0.013), CommonError("other", 0.021)))


def photo(exposure_s, iso=200.0, f_number=5.6, source="a.dng"):
    empty = np.zeros((1, 1, 3))
    return LinearImage(empty, empty, empty.astype(bool), 1.0, exposure_s, iso, f_number,
                       PhotoKind.RAW, "", source, "")


def test_exposures(recorded):
    photos = {"base": photo(1 / 125), "slower": photo(1 / 60), "open": photo(1 / 125, f_number=4.0),
              "fast": photo(0.4, 1600.0, 8.0), "no iso": photo(1 / 60, None),
              "no f": photo(0.3, f_number=None), "no time": photo(None),
              "neither": photo(0.02, None, None), "zero f": photo(0.02, f_number=0.0)}
    recorded({name: said(lambda each=each: exposure_product(each, "b.dng"))
              for name, each in photos.items()})
    recorded({f"{first} {second}": said(lambda one=one, other=other: exposure_ratio(one, other))
              for first, one in photos.items() for second, other in photos.items()}, case="ratios")


def test_rounded_exposures(recorded):
    times = (1 / 8000, 1 / 125, 1 / 60, 1 / 13, 0.1, 0.25, 0.26, 0.27, 0.3, 0.4, 0.5, 0.6, 0.77,
             1.0, 1.3, 1.6, 2.0, 6.0, 6.5, 30.0, 1 / 250 * (1 + 9e-7), 1 / 250 * (1 + 1.1e-6))
    recorded({f"{time:.7g}": rounding_error(photo(1 / 200), photo(time)) for time in times})
    stops = (1.0, 1.1, 1.2, 1.4, 1.8, 2.0, 2.8, 5.6, 6.3, 6.7, 8.0, 11.0, 11.3, 22.0, None)
    recorded({f"{stop}": rounding_error(photo(1 / 60, f_number=4.0), photo(1 / 200, f_number=stop))
              for stop in stops}, case="apertures")
    recorded({"half stops": [rounding_error(photo(1.0, f_number=1.0),
                                            photo(1.0, f_number=2.0 ** (off / 2)))
                             for off in (0.05, 0.097, 0.099, 0.101, 0.103, 0.15, 0.23, 0.24)],
              "no time": rounding_error(photo(None), photo(1 / 60))}, case="limits")


def test_scales_of_other_photos(recorded):
    near = photo(1 / 200 * (1 + 9e-7)), photo(1 / 200 * (1 + 1.2e-6))
    others = {"same": photo(1 / 200), "slower": photo(1 / 60, 320.0, 8.0), "near": near[0],
              "less near": near[1], "half": photo(1 / 100)}
    recorded({f"{name} {compared}": scale_for_photo(SCALE, photo(1 / 200), other, compared)
              for name, other in others.items() for compared in (False, True)})
    bare = dataclasses.replace(SCALE, standard_error=None)
    recorded([scale_for_photo(bare, photo(1 / 200), photo(1 / 60)),
              with_common_error(SCALE, "drift", 0.05), with_common_error(SCALE, "drift", 0.0),
              with_common_error(bare, "drift", 0.05)], case="errors")
    recorded([error_of_each_band(scale) for scale in (
        SCALE, bare, dataclasses.replace(SCALE, standard_error=0.05),
        with_common_error(SCALE, "drift", 0.05))], case="of a band")


def test_scales_of_signals(recorded):
    rng = np.random.default_rng(11)
    predicted = rng.uniform(0.1, 0.9, (5, 3))
    exact = 2.3 * predicted
    scattered = exact * rng.normal(1, 0.004, exact.shape)
    by_region = exact * np.exp(0.05 * rng.normal(size=(5, 1)))
    recorded({name: scale_from_signals(measured, predicted, error, "a chart")
              for name, measured in (("exact", exact), ("scattered", scattered),
                                     ("regions", by_region)) for error in (0.01,)}
             | {"small error": scale_from_signals(scattered, predicted, 0.002, "x"),
                "one region": scale_from_signals(scattered[:1], predicted[:1], 0.01, "y"),
                "one signal": scale_from_signals(scattered[:1, :1], predicted[:1, :1], 0.03, "z")})
    # units: the light is measured against the prediction
    scale = scale_from_signals(scattered, predicted, 0.01, "")
    doubled = scale_from_signals(2 * scattered, predicted, 0.01, "")
    np.testing.assert_allclose([doubled.value, doubled.standard_error],
                               [2 * scale.value, 2 * scale.standard_error], rtol=1e-12)


def test_drifts(recorded):
    rng = np.random.default_rng(12)
    before = rng.uniform(0.2, 0.8, (4, 3)) * [1, 0.8, 0.6]
    noise = rng.normal(0, 0.002, before.shape)
    chart, later = photo(1 / 100, 200.0, 8.0), photo(1 / 60, 400.0, 8.0, "b.dng")
    factor = (100 / 60) * 2
    cases = {"dimmer": ([0.9, 0.9, 0.9], 0.01), "brighter": ([1.12, 1.11, 1.13], 0.002),
             "redder": ([1.2, 1.0, 0.9], 0.003), "stated": ([1.2, 1.0, 0.9], 0.2)}
    for name, (change, error) in cases.items():
        after = before * change * np.exp(noise) * factor
        for rows in (4, 1):
            drift = drift_between(chart, before[:rows], later, after[:rows], error)
            recorded({"drift": drift, "scale": scale_after_drift(SCALE, drift),
                      "covariance": drift_covariance(drift),
                      "plain": light_drift(before[:rows], after[:rows], error)},
                     case=f"{name} {rows}")
    exact = drift_between(chart, before, photo(1 / 100, 200.0, 8.0), before, 0.01)
    recorded({"none": exact, "no error": scale_after_drift(
        dataclasses.replace(SCALE, standard_error=None), exact),
        "other": said(lambda: drift_between(chart, before, later, before[:3], 0.01))}, case="none")


def test_when_a_colour_has_changed(recorded):
    before = np.array([[0.5, 0.4, 0.3], [0.25, 0.21, 0.16]])
    chart = photo(1 / 100)
    found = {}
    for error in (0.01, 0.02):
        for change in np.linspace(0.02, 0.12, 41):
            after = before * [1 + change, 1.0, 1 - change]
            found[f"{error} {change:.4f}"] = drift_between(chart, before, chart, after,
                                                           error).colour_changed
    recorded(found)
    assert 0 < sum(found.values()) < len(found)
