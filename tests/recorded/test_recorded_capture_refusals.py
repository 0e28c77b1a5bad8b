"""Orders of charts, photos that are not linear, channels and files that are refused: recorded."""
import numpy as np
import OpenImageIO as oiio
from capture_pictures import changed, dng, outcome, picture, raw_frame
from chart_photos import PRINTED, layout_named, photograph, true_reflectances

from spectrabox.capture.chart import agreement, detection
from spectrabox.capture.develop import developed
from spectrabox.capture.photo import image_files, image_rows, linear
from spectrabox.capture.photo.noise import PhotonTransfer
from spectrabox.radiometry.records import LinearImage, PhotoKind


def test_other_orders_of_a_chart_of_own_colours(recorded, tmp_path):
    name = "three rows of five"
    chart, printed = layout_named(name, tmp_path), PRINTED[name]
    spectra = true_reflectances(chart)
    nm = np.linspace(0, 1, spectra.shape[1])
    curves = np.stack([np.exp(-((nm - at) / 0.16) ** 2) for at in (0.78, 0.47, 0.2)])
    signals = 0.7 * spectra @ curves.T / curves.sum(axis=1)
    image = photograph(printed, signals, printed.corners(3.0))
    corners = printed.corners(3.0)
    columns = np.arange(15).reshape(5, 3).T.ravel()
    table = {}
    for case, order, at in (("right", np.arange(15), corners),
                            ("turned", np.arange(15), corners[[2, 3, 0, 1]]),
                            ("mirrored", np.arange(15), corners[[1, 0, 3, 2]]),
                            ("by columns", np.argsort(columns), corners),
                            ("backwards", np.arange(15)[::-1], corners),
                            ("shuffled", np.random.default_rng(1).permutation(15), corners),
                            ("elsewhere", np.arange(15), corners * 0.3)):
        table[case] = outcome(lambda order=order, at=at: detection.find_chart(
            image, signals[order], at, chart).confidence)
    table["not found by itself"] = outcome(lambda: detection.find_chart(image, signals, None,
                                                                        chart))
    table["black"] = agreement.chart_agreement(
        changed(image, signal=np.zeros_like(image.signal)), detection._printed_quads(
            detection.homography(agreement.in_units(chart, chart.fiducials), corners), chart),
        signals, chart)
    recorded(table, rtol=1e-3)      # residuals of single-precision photos


def test_photos_of_one_colour_alone_are_said_to_be_dark(recorded):
    rng = np.random.default_rng(4)
    signal = (0.3 + 0.05 * rng.random((90, 130, 3))).astype(np.float32)
    table = {}
    for blue in (0.0, 0.015, 0.019, 0.021, 0.5):
        lit = signal * np.array([1.0, 0.8, blue], np.float32)
        image = LinearImage(lit, np.full_like(lit, 1e-6), lit > 2, 1.0, 0.1, 100.0, 4.0,
                            PhotoKind.RAW, "a", "a.dng", "ab")
        table[f"{blue}"] = [detection._dark_bands(image),
                            outcome(lambda image=image: detection.find_chart(
                                image, rng.random((24, 3))))]
    recorded(table)


def test_photos_that_are_not_linear(recorded, tmp_path):
    rgb8 = np.rint(255 * picture(80, 110).signal.clip(0, 1)).astype(np.uint8)
    image_files.write_png(tmp_path / "a.png", rgb8)
    other = dng(tmp_path / "a.dng", exposure_s=0.5)
    darks = [dng(tmp_path / f"{number}.dng", exposure_s=exposure, top=0.0001, seed=number)
             for number, exposure in ((1, 0.02), (2, 0.04))]
    image_files.write_linear_exr(tmp_path / "b.exr", picture(30, 40))
    for case, arguments in (("refused", ([tmp_path / "a.png"], [], None)),
                            ("taken", ([tmp_path / "a.png"], [], None, True)),
                            ("raw all the same", ([other], [], None, True)),
                            ("no dark of its exposure", ([other], darks, None)),
                            ("missing", ([tmp_path / "none.png"], [], None, True))):
        said = outcome(lambda arguments=arguments: developed.develop_photos(*arguments))
        if not isinstance(said, str):
            said = [changed(said[0], sha256=""), said[1]]
        recorded(said.replace(str(tmp_path), "") if isinstance(said, str) else said, rtol=1e-4,
                 case=case)
    developed.write_developed(tmp_path / "c.exr", picture(20, 30))
    recorded(changed(linear.open_photo(tmp_path / "c.exr"), sha256=""), rtol=1e-5, case="written")


def test_channels_by_rows(recorded, tmp_path):
    pixels = picture(23, 31, 5).signal
    names = ("S0.400", "S0.500", "x", "y", "z")
    image_files.write_exr(tmp_path / "a.exr", pixels, names, 0.25, {"words": "as written"})
    read_names, height, width, rows = image_files.open_channels(tmp_path / "a.exr")
    where = [read_names.index(name) for name in names]
    np.testing.assert_array_equal(rows(4, 19)[..., where], pixels[4:19])
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    recorded([read_names, height, width, rows(3, 11), spec.get_float_attribute("ExposureTime"),
              spec.get_string_attribute("words"), spec.get_string_attribute("DateTime"),
              spec.get_string_attribute("compression"),
              outcome(lambda: image_files.write_exr(tmp_path / "b.exr", pixels, names[:4])),
              outcome(lambda: image_files.write_exr(tmp_path / "b.exr", pixels[0], names))])


def test_files_of_pictures_that_are_refused(recorded, tmp_path):
    table = {}
    pixels = picture(20, 26, 9).signal
    for case, names, change in (
            ("variance lacks", ("R", "G", "B", "variance.R", "variance.G", "saturated.R",
                                "saturated.G", "saturated.B", "q"), 1.0),
            ("negative", ("R", "G", "B", "variance.R", "variance.G", "variance.B", "saturated.R",
                          "saturated.G", "saturated.B"), -1.0)):
        image_files.write_exr(tmp_path / f"{case}.exr", change * pixels, names)
        table[case] = outcome(lambda case=case: linear.open_photo(tmp_path / f"{case}.exr"))
    image_files.write_exr(tmp_path / "two.exr", pixels[..., :2], ("a", "b"))
    below = picture(40, 52).signal - 3      # the largest by size is below 0
    image_files.write_exr(tmp_path / "below.exr", below, ("R", "G", "B"))
    recorded(image_files.read_linear_file(tmp_path / "below.exr").variance, rtol=1e-5, case="below")
    for size in (0, 3):
        image_files.require_finite(tmp_path, np.zeros((size, 2, 3)))
    (tmp_path / "text.tif").write_text("no picture")
    for name in ("two.exr", "text.tif"):
        table[name] = [outcome(lambda name=name, of=of: of(tmp_path / name)) for of in (
            linear.open_photo, image_rows.open_rows, image_files.open_channels)]
        table[name] = [each if isinstance(each, str) else "read" for each in table[name]]
    (tmp_path / "folder.png").mkdir()
    recorded({key: [each.replace(str(tmp_path), "").partition(" (")[0] for each in value]
              if isinstance(value, list) else str(value).replace(str(tmp_path), "")
              for key, value in table.items()})
    rows = image_rows.open_rows(dng(tmp_path / "a.dng"))
    recorded([rows.height, rows.width, rows.bands, rows.rows_at_once, rows.read(5, 17)], rtol=1e-5,
             case="raw")


def test_a_pile_that_noise_would_have_spread_is_believed(recorded):
    frame = raw_frame(96, 132, "GRBG", white=3000.0, top=1.6)
    stated = changed(frame, white_level=4095.0)
    shares = {}
    for name, gain in (("quiet", 1e-12), ("just quiet", 5.5e-7 / 4), ("noisy", 1e-4)):
        noise = PhotonTransfer(np.full(3, 1e-12), np.array([1.0, 1.2, 0.9]) * gain)
        image = linear.linear_image(stated, noise)
        shares[name] = [image.saturated.mean(axis=(0, 1)), image.variance.mean(axis=(0, 1))]
    # without noise nothing would spread the pile: it may be a plain part of the picture
    assert np.all(shares["quiet"][0] <= shares["noisy"][0])
    assert shares["quiet"][0][0] < shares["noisy"][0][0]
    recorded(shares, rtol=1e-5)
