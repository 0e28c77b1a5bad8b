"""Sessions whose photos are taken band by band."""
import dataclasses
import re

import numpy as np
import pytest

from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo.image_writers import write_linear_exr
from spectrabox.measure.captured import InputFile
from spectrabox.measure.opened_photos import OpenPhotos, develop
from spectrabox.radiometry.errors import InputError
from spectrabox.session.config.session_file import read_session
from spectrabox.session.store.keys import InputFiles, step_keys

from tests.session_runs import edit

BANDS = {"red filter": 0, "green filter": 1, "blue filter": 2}
EXPOSED = (1.0, 0.5, 2.0)   # of each band, times the photo's own


def split_into_bands(folder, photos):
    """Each photo as one linear file a band, exposed differently."""
    text = (folder / "session.toml").read_text(encoding="utf-8")
    for key, stem in photos.items():
        photo = open_any(folder / "photos" / f"{stem}.dng")
        table = []
        for (name, band), factor in zip(BANDS.items(), EXPOSED, strict=True):
            one = np.s_[..., band:band + 1]
            write_linear_exr(folder / "photos" / f"{stem}_{band}.exr", dataclasses.replace(
                photo, signal=photo.signal[one] * factor, variance=photo.variance[one] * factor**2,
                saturated=photo.saturated[one], exposure_s=photo.exposure_s * factor))
            table.append(f'"{name}" = "photos/{stem}_{band}.exr"')
        text = re.sub(rf"(?m)^{key} = .*$", f"{key} = {{ {', '.join(table)} }}", text)
    (folder / "session.toml").write_text(text, encoding="utf-8")
    return read_session(folder)


def one_file(folder, name):
    """The photo of a colour camera in one file."""
    return {"": (InputFile(name, folder / name),)}


def test_bands_are_stacked_at_one_exposure(captured):
    whole, _ = develop(read_session(captured).capture(), one_file(captured, "photos/box.dng"))
    capture = split_into_bands(captured, {"object": "box", "chart": "chart",
                                                     "flat": "flat"}).capture()
    stacked, _ = develop(capture, capture.views[0].photo)
    assert stacked.exposure_s == pytest.approx(whole.exposure_s * min(EXPOSED))
    np.testing.assert_allclose(stacked.signal / min(EXPOSED), whole.signal, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("banded, stale", [(True, {"chart", "photo", "calibrate"}),
                                           (False, {"calibrate"})])
def test_measured_curves_choose_the_channels_of_bands_anew(captured, banded, stale):
    """One curve for each photo, where a chart is fitted in every channel that is not dark."""
    def keys():
        config = read_session(captured)
        return step_keys(config.capture(), InputFiles(config))
    if banded:
        split_into_bands(captured, {"object": "box", "chart": "chart", "flat": "flat"})
    before = keys()
    edit(captured, '[sensitivity]\nfrom = "chart"', '[sensitivity]\nfrom = "Nikon 5100 (NPL)"')
    after = keys()
    assert stale == {name for name in before if {**before[name], "stages": {}}
                     != {**after[name], "stages": {}}}


def test_photos_of_other_bands_are_named(captured):
    with pytest.raises(InputError, match=r"photos\.chart and photos\.object must have the same "
                                         r"bands.*'blue filter'"):
        split_into_bands(captured, {"object": "box"})


def test_every_channel_of_every_photo_is_a_band_unless_it_is_dark(captured):
    text = (captured / "session.toml").read_text(encoding="utf-8")
    for key, stem in (("object", "box"), ("chart", "chart"), ("flat", "flat")):
        photo = open_any(captured / "photos" / f"{stem}.dng")
        for name, gains in (("lamp", (1.0, 1.0, 1.0)), ("blue filter", (0.001, 0.4, 1.0))):
            gain = np.array(gains, np.float32)
            write_linear_exr(captured / "photos" / f"{stem} {name}.exr", dataclasses.replace(
                photo, signal=photo.signal * gain, variance=photo.variance * gain**2))
        text = re.sub(rf"(?m)^{key} = .*$", f'{key} = {{ lamp = "photos/{stem} lamp.exr", '
                      f'"blue filter" = "photos/{stem} blue filter.exr" }}', text)
    (captured / "session.toml").write_text(text, encoding="utf-8")
    capture = read_session(captured).capture()
    photos = OpenPhotos(capture)
    image, _ = photos.developed(capture.views[0].photo)
    assert photos.bands(image) == ("lamp R", "lamp G", "lamp B", "blue filter G",
                                           "blue filter B")
    one, _ = develop(capture, one_file(captured, "photos/box lamp.exr"))
    # half precision of the files
    np.testing.assert_allclose(image.signal[..., 3] * 2.5, image.signal[..., 1], rtol=2e-3,
                               atol=1e-3 * one.signal.max())
