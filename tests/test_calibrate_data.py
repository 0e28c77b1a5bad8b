"""The default fit on real measured cameras and lights; needs the folder named by
SPECTRABOX_DATA.
"""
import os
from pathlib import Path

import numpy as np
import pytest

from spectrabox.calibrate.prior.camera_prior import shipped_prior
from spectrabox.calibrate.prior.learnt_prior import build_prior, read_camera_database


@pytest.fixture(scope="module")
def database():
    folder = os.environ.get("SPECTRABOX_DATA")
    if folder is None:
        pytest.skip("SPECTRABOX_DATA names no folder of measured cameras")
    return read_camera_database(Path(folder) / "cameras")


def test_the_shipped_prior_is_what_the_folder_gives(database):
    keep = [index for index, name in enumerate(database.names) if name != "Nikon D5100"]
    prior = build_prior(database.nm, database.curves[keep],
                        tuple(database.names[index] for index in keep), source="", licence="")
    shipped = shipped_prior()
    assert prior.members == shipped.members
    # Stored in single precision.
    np.testing.assert_allclose(prior.means, shipped.means, atol=1e-5)
    np.testing.assert_allclose(prior.covariances(), shipped.covariances(), atol=1e-5)
