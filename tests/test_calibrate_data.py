"""The default fit on real measured cameras and lights; needs the folder named by
SPECTRABOX_DATA.
"""
import os
from pathlib import Path

import numpy as np
import pytest
from calibrate_cameras import GRID

from spectrabox.calibrate.prior.camera_database import read_camera_database
from spectrabox.calibrate.prior.camera_prior import shipped_prior
from spectrabox.calibrate.prior.learnt_prior import build_prior


@pytest.fixture(scope="module")
def database():
    folder = os.environ.get("SPECTRABOX_DATA")
    if folder is None:
        pytest.skip("SPECTRABOX_DATA names no folder of measured cameras")
    return read_camera_database(Path(folder) / "cameras")


def test_the_shipped_prior_is_what_the_folder_gives(database):
    keep = [index for index, name in enumerate(database.names) if name != "Nikon D5100"]
    made = build_prior(database.nm, database.curves[keep],
                       tuple(database.names[index] for index in keep), source="", licence="")
    shipped = shipped_prior()
    assert made.members == shipped.members
    # Stored in single precision.
    np.testing.assert_allclose(made.means, shipped.means, atol=1e-5)
    np.testing.assert_allclose(made.covariances(), shipped.covariances(), atol=1e-5)


def test_a_camera_left_out_is_found_within_what_two_laboratories_differ_by(database):
    pytest.importorskip("colour")
    from spectrabox.radiometry.chart import chart_reflectances
    from spectrabox.radiometry.spectra.named_spectra import light
    from spectrabox.radiometry.spectra.spectrum_files import on_grid

    from benchmarks.bench_calibration import Shot, curve_error, fit_one, others, photograph
    surfaces, power = chart_reflectances("BabelColor Average", GRID), light("LED-B3", GRID)
    errors = []
    for index in range(0, len(database.names), 8):
        truth = on_grid(database.nm, database.curves[index], GRID, database.names[index])
        signal, variance = photograph(truth, surfaces, power, 0.01, np.random.default_rng(index),
                                      False)
        curves, _, _ = fit_one("prior", [Shot(signal, variance, power)], surfaces,
                               others(database, index, False), True)
        errors.append(curve_error(curves, truth))
    # One-sided: the median over all cameras is 0.04, two laboratories differ by 0.079.
    assert np.median(errors) < 0.08
