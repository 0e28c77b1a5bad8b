"""What capture refuses and puts back, and cameras of pixels that are not square."""
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_views import TRUE

from spectrabox.calibrate.geometry.lens import pinhole
from spectrabox.calibrate.geometry.pose import lens_of_focal_length, pose_from_points
from spectrabox.capture.chart.patches import require_unclipped
from spectrabox.capture.meter.instruments.errors import LineFaultError, UntrustedReadingError
from spectrabox.capture.meter.instruments.interface import MeterSettings
from spectrabox.capture.meter.instruments.pr655 import Pr655
from spectrabox.capture.meter.measurement import READS, _read_twice
from spectrabox.radiometry.errors import ClippedPhotoError
from spectrabox.radiometry.records import PatchSamples

from tests.test_calibrate_pose import CORNERS, SHIFT, TURN, seen


@pytest.mark.parametrize("band", [0, 1, 2])
def test_a_patch_that_is_clipped_in_one_band_is_refused_by_name(band):
    clipped = np.zeros((4, 3))
    clipped[2, band] = 0.3
    samples = PatchSamples(np.full((4, 3), 0.5), np.zeros((4, 3, 3)), np.full(4, 100), clipped,
                           np.zeros((4, 3)))
    with pytest.raises(ClippedPhotoError, match=r"1 of 4 patches are saturated \(c\)"):
        require_unclipped(samples, "abcd", "chart.dng")
    clipped[2, band] = 0.005        # a dead pixel or two
    require_unclipped(PatchSamples(samples.mean, samples.covariance_of_mean, samples.pixels,
                                   clipped, samples.gradient), "abcd", "chart.dng")


def replying(*replies):
    """An instrument whose held result reads so, one reply after the other."""
    left = iter(replies)

    def read():
        reply = next(left)
        if reply is None:
            raise LineFaultError("port: garbled")
        return SimpleNamespace(raw=(reply,))
    return SimpleNamespace(read=read, line=SimpleNamespace(name="port", drain=lambda _: None))


def test_a_result_counts_once_two_readings_in_a_row_agree():
    assert _read_twice(replying("a", "b", "b", "c")).raw == ("b",)
    # a fault between two readings parts them
    with pytest.raises(LineFaultError, match="garbled"):
        _read_twice(replying("a", None, "a", "b"))
    with pytest.raises(UntrustedReadingError, match="readings of the same result all differ"):
        _read_twice(replying(*map(str, range(READS))))


@pytest.mark.parametrize("exposure, back", [("Adaptive,0 msec", b"SE00000"),
                                            ("Manual,125 msec", b"SE00125")])
def test_a_pr655_gets_its_own_exposure_and_averages_back(monkeypatch, exposure, back):
    said = (f"MS-75,None,None,None,1 deg,SI,{exposure},Normal,3 cycles,2 deg,No Smart Dark,"
            "No Sync,Standard Sensitivity,60.00 Hertz")
    meter, put = Pr655(SimpleNamespace(name="port")), []
    monkeypatch.setattr(meter, "_ask", lambda command: said)
    monkeypatch.setattr(meter, "_set", lambda new, old: put.append(old.encode()))
    meter.settings(MeterSettings(integration_ms=250.0, averages=2))
    assert put == [back, b"SN03"]


def test_an_undistorted_photo_keeps_the_width_of_its_field():
    """Square pixels of the horizontal focal length: what fills the width fills it afterwards."""
    square = pinhole(TRUE)
    assert square[0, 0] == square[1, 1] == TRUE.matrix[0, 0] != TRUE.matrix[1, 1]
    np.testing.assert_array_equal(square[:, 2], TRUE.matrix[:, 2])


def test_the_errors_of_a_pose_are_those_of_repeated_clicks():
    """Eight points, six unknowns: an error by their number alone is a fifth too small."""
    rng, lens = np.random.default_rng(5), lens_of_focal_length(700.0, 640, 480)
    poses = [pose_from_points(CORNERS, seen(CORNERS, TURN, SHIFT, rng, 0.3, lens), lens)
             for _ in range(350)]
    found = np.array([pose.world_to_camera[:3, 3] for pose in poses])
    stated = np.mean([np.diag(pose.covariance)[3:] for pose in poses], axis=0)
    # 350 draws know a variance to 7.6 %: three of them, 3.9 sigma
    np.testing.assert_allclose(stated / found.var(axis=0, ddof=1), 1, atol=0.3)
