"""Photos and captures made by others: run with SPECTRABOX_DATA=DIR, the folder that holds charts/
and flea3_chart/.
"""
import os
from pathlib import Path

import pytest

from spectrabox.capture.chart.chart_agreement import TYPICAL_SIGNALS
from spectrabox.capture.chart.detection import locate_chart
from spectrabox.capture.photo.image_files import read_encoded_file
from spectrabox.radiometry.errors import ChartNotFoundError, CheckError

CLASSICS = ("ColorChecker_Noise_Est_ISO_100.jpg", "IMG_20140613_203438.jpg",
            "IMG_20140613_203451.jpg", "IMG_20140613_203507.jpg", "Lab_ISO_100.jpg", "classic.png",
            "colorchecker-classic-mini.jpg", "passport.jpg", "source1_img.png")
OTHERS = {"camera-trax.png": (CheckError, "another maker's card"),
          "partial_card_rgb.png": (ChartNotFoundError, "no ColorChecker was found")}


@pytest.fixture
def measured():
    folder = os.environ.get("SPECTRABOX_DATA")
    if folder is None:
        pytest.skip("the environment variable SPECTRABOX_DATA does not name the folder of measured "
                    "data")
    return Path(folder)


@pytest.mark.parametrize("name", CLASSICS)
def test_every_whole_classic_is_found(measured, name):
    detection = locate_chart(read_encoded_file(measured / "charts" / name), TYPICAL_SIGNALS)
    assert not detection.mirrored and detection.confidence > 0.2


@pytest.mark.parametrize("name", OTHERS)
def test_every_other_card_is_refused(measured, name):
    error, message = OTHERS[name]
    with pytest.raises(error, match=message):
        locate_chart(read_encoded_file(measured / "charts" / name), TYPICAL_SIGNALS)
