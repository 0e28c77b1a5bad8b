"""What is read from raw photos, and the noise that they are given: recorded."""
import struct

import numpy as np
import pytest
from capture_pictures import (
    BLACK,
    changed,
    counts,
    dng,
    outcome,
    picture,
    raw_frame,
    scene,
)

from spectrabox.capture.photo import binning, black_level, clip_point, linear, noise, preview, raw
from spectrabox.capture.photo.metadata import PhotoMetadata, photo_metadata
from spectrabox.capture.photo.noise import PhotonTransfer
from spectrabox.capture.photo.regions import inside_polygon, pixels_in_polygon, sample_regions
from spectrabox.fixtures.dng import PATTERNS

FILES = {
    "RGGB": {"pattern": "RGGB"}, "GBRG of 14 bits": {"pattern": "GBRG", "bits": 14},
    "X-Trans": {"pattern": "X-Trans", "height": 96, "width": 132},
    "mono": {"pattern": "mono"}, "full colour": {"three": True, "black": (60, 61.5, 59, 0)},
    "turned": {"orientation": 6, "camera_from_xyz": None, "make": "Canon",
               "model": "Canon EOS 5D Mark III", "serial": ""},
    "whole black": {"black": (61, 63, 64, 66), "exposure_s": 2, "iso": 12800, "f_number": 0},
    "odd origin": {"pattern": "BGGR", "active_area": (3, 5, 93, 123), "height": 98, "width": 130},
    "masked": {"pattern": "GRBG", "active_area": (4, 40, 94, 126), "height": 98, "width": 130,
               "masked_areas": (0, 0, 98, 36)},
    "little masked": {"pattern": "GRBG", "active_area": (4, 40, 94, 126), "height": 98,
                      "width": 130, "masked_areas": (0, 0, 20, 36)}}


@pytest.mark.parametrize("case", FILES)
def test_a_raw_file_and_its_linear_image(recorded, tmp_path, case):
    path = dng(tmp_path / "a.dng", **FILES[case])
    recorded({"frame": raw.decode(path), "metadata": _plain(photo_metadata(path)),
              "size": raw.visible_size(path), "photo size": linear.photo_size(path)})
    # single precision, and a fit to a thousand tiles
    recorded(linear.open_photo(path), rtol=1e-5, case="image")


def _plain(metadata):
    found = {name: getattr(metadata, name) for name in metadata.__dataclass_fields__}
    return {name: (float(value) if name in ("exposure_s", "f_number") and value else
                   [float(level) for level in value] if name == "black_level" and value else value)
            for name, value in found.items()} | {"camera": metadata.camera}


def test_the_signal_is_what_the_mosaic_says():
    frame = raw_frame()
    mosaic = frame.mosaic.astype(float)
    share = (mosaic - np.resize(frame.black_level, (2, 2))[np.indices(mosaic.shape)[0] % 2,
                                                           np.indices(mosaic.shape)[1] % 2])
    share /= 4095 - np.tile(frame.black_level, (48, 64))
    tiles = share.reshape(48, 2, 64, 2)
    expected = np.stack([tiles[:, 0, :, 1], (tiles[:, 0, :, 0] + tiles[:, 1, :, 1]) / 2,
                         tiles[:, 1, :, 0]], axis=-1)
    # single precision
    np.testing.assert_allclose(linear.signal_alone(frame), expected, atol=2e-7)


def test_images_of_given_noise_and_dark_frames(recorded):
    given = PhotonTransfer(np.array([2e-6, 3e-6, 5e-6]), np.array([1.5e-4, 1.1e-4, 2.3e-4]))
    rng = np.random.default_rng(8)
    for pattern in ("GRBG", "X-Trans"):
        frame = raw_frame(96, 132, pattern)
        dark = (62 + 3 * rng.random(frame.mosaic.shape)).astype(np.float32)
        variance = (0.2 + rng.random(frame.mosaic.shape)).astype(np.float32)
        for case, image in {
                "its own": linear.linear_image(frame), "given": linear.linear_image(frame, given),
                "dark": linear.linear_image(frame, given, dark),
                "uncertain dark": linear.linear_image(frame, given, dark, variance),
                "dark, its own": linear.linear_image(frame, None, dark, variance)}.items():
            recorded({"signal": image.signal, "variance": image.variance,
                      "saturated": image.saturated, "step": image.sensor_step}, rtol=1e-5,
                     case=f"{pattern} {case}")


@pytest.mark.parametrize("pattern", ["GRBG", "X-Trans", "mono"])
def test_where_a_sensor_clips(recorded, pattern):
    found = {}
    for white, top in ((4095.0, 0.85), (4095.0, 1.6), (3000.0, 1.6)):
        frame = raw_frame(96, 132, pattern, top=top, white=white)
        for stated in (white, white + 40, 4095.0):
            seen = changed(frame, white_level=stated)
            image = linear.linear_image(seen)
            found[f"{white:g} {top} stated {stated:g}"] = [
                clip_point.clip_points(seen), image.saturated.mean(axis=(0, 1))]
    recorded(found, rtol=1e-5)


def test_what_counts_as_a_pile(recorded):
    rng = np.random.default_rng(5)
    spread = rng.integers(2000, 3000, 40_000)
    found = {}
    for piled in (*range(370, 430, 4), 39_000, 39_999, 40_000, 40_002, 41_000):
        samples = np.concatenate([spread, np.full(piled, 3000)])
        found[f"{piled}"] = [clip_point._pile(samples, white) for white in (3000, 3001, 3500)]
    for piled in (20, 48, 49, 50, 51, 60):
        samples = np.concatenate([spread[:2000], np.full(piled, 3000)])
        found[f"{piled} of few"] = clip_point._pile(samples, 3500)
    found["few values"] = clip_point._pile(np.zeros(60, int), 3000)
    for level in (1.5, 1.6):        # noise of just below and above 1.5 DN
        for clip in (1500.0, 3000.0, 3100.0):
            transfer = PhotonTransfer(np.array([1e-9, 2e-9, 1e-9]),
                                      np.array([1.0, (level / 2936)**2 / 0.4893, 2.0]))
            found[f"{level} {clip:g}"] = [clip_point.piles_up(
                changed(raw_frame(), white_level=3000.0), clip, band, transfer)
                for band in range(3)]
    recorded(found)


def test_noise_from_the_photo_itself(recorded):
    found = {}
    for height, width, bands in ((64, 80, 3), (160, 130, 2), (400, 340, 1)):
        image = picture(height, width, bands)
        for quantum, samples in ((1e-4, 1), (np.linspace(1e-4, 9e-4, bands), np.arange(bands) + 1),
                                 (0.05, 1)):
            line = noise.photon_transfer(image.signal, image.saturated, quantum, "a.dng", samples)
            found[f"{height} {np.max(quantum):g}"] = line
    cut = np.maximum(picture(200, 160, 2, top=0.2).signal - 0.012, 0)
    cut = np.round(cut * 500) / 500
    none = np.zeros(cut.shape, bool)
    found["cut off at black"] = noise.photon_transfer(cut, none, 1 / 500)
    found["cut off at black, means of 2"] = noise.photon_transfer(cut, none, 1 / 500, samples=2)
    line = found["cut off at black"]
    found["variance"] = line.variance(scene(7, 9, 2, 1.0) - 0.1)
    recorded(found, rtol=1e-5)      # a line fitted in rounds


@pytest.mark.parametrize("share", [0.70, 0.80, 0.88, 0.92, 0.96, 0.99, 1.0])
def test_a_picture_too_clipped_or_black_to_show_its_noise(recorded, share):
    image = picture(48, 64, 2)
    saturated = np.zeros(image.signal.shape, bool)
    saturated.reshape(-1, 64, 2)[:int(share * 48)] = True
    black = np.where(np.random.default_rng(3).random(image.signal.shape) < share, 0, image.signal)
    none, rows = np.zeros(saturated.shape, bool), int(80 * (1 - share)) + 8
    recorded([outcome(lambda: noise.photon_transfer(image.signal, saturated, 1e-4, "a.dng")),
              outcome(lambda: noise.photon_transfer(black, none, 1e-4)),
              outcome(lambda: noise.photon_transfer(image.signal[:rows, :8], none[:rows, :8],
                                                    1e-4))], rtol=1e-5)


def test_what_is_refused_of_raw_photos(recorded, tmp_path):
    found = {}
    frame = raw_frame()
    for below in np.arange(0.020, 0.027, 0.0005):
        black = frame.black_level + below * 4030 + float(np.percentile(frame.mosaic, 1)) - 64
        found[f"black {below:.4f}"] = outcome(lambda black=black: float(linear.signal_alone(
            changed(frame, black_level=black)).min()))
    for spread in (79, 81, 83):
        path = dng(tmp_path / f"{spread}.dng", black=(60, 60 + spread, 61, 62))
        found[f"spread {spread}"] = outcome(lambda path=path: raw.read_raw(path).black_level)
    path = dng(tmp_path / "w.dng", black=(60, 61, 62, 63))
    found["white"] = [outcome(lambda white=white: raw._require_range(
        np.array([60.0, 63.0]), white, path)) for white in (62.9, 63.0, 63.1)]
    found["full colour"] = outcome(lambda: raw.read_raw(dng(tmp_path / "f.dng", three=True)))
    data = path.read_bytes()
    (tmp_path / "cut.dng").write_bytes(data[:-500])
    (tmp_path / "empty.dng").write_bytes(b"")
    (tmp_path / "text.nef").write_bytes(b"no photo" * 50)
    height_at = data.index(struct.pack("<HHLL", 257, 4, 1, 96))
    (tmp_path / "size.dng").write_bytes(data[:height_at + 8] + struct.pack("<L", 94)
                                        + data[height_at + 12:])
    for name in ("cut.dng", "empty.dng", "text.nef", "size.dng", "none.dng"):
        said = outcome(lambda name=name: raw.decode(tmp_path / name))
        found[name] = str(said).replace(str(tmp_path), "")
        found[f"size of {name}"] = str(outcome(lambda name=name: linear.photo_size(
            tmp_path / name))).replace(str(tmp_path), "")
    for cfa in ([[0, 1], [1, 2]], [[0, 1], [2, 1]], [[0, 0], [1, 2]], [[0, 2], [2, 0]], [[0]],
                [[1, 1], [0, 2]]):
        found[f"tile {cfa}"] = [
            outcome(lambda cfa=cfa: raw._require_plausible_tile(
                np.array(cfa), np.zeros(np.shape(cfa)), 4095, path)),
            outcome(lambda cfa=cfa: linear.tile_step(np.array(cfa), "a.dng"))]
    found["x-trans step"] = linear.tile_step(np.array(PATTERNS["X-Trans"]).reshape(6, 6))
    recorded({key: value.partition("LibRaw")[0] if isinstance(value, str) else value
              for key, value in found.items()})


def test_black_levels_by_position(recorded):
    rng = np.random.default_rng(6)
    whole = rng.normal(64, 3, (70, 90)).round()
    whole += np.array([[0, 4], [9, 2]])[np.indices(whole.shape)[0] % 2,
                                        np.indices(whole.shape)[1] % 2]
    whole[rng.random(whole.shape) < 0.01] = 900
    found = {}
    for areas in (((0, 0, 70, 20),), ((1, 3, 68, 20), (60, 0, 70, 90)), ((0, 0, 32, 32),),
                  ((0, 0, 32, 31),), ((0, 0, 31, 33),), ()):
        for origin in ((0, 0), (1, 0), (3, 5)):
            found[f"{areas} {origin}"] = black_level.masked_black(whole, areas, origin, (2, 2))
    found["quiet"] = black_level._robust_mean(np.array([60] * 500 + [61] * 30 + [62] * 20 + [63]
                                                       + [200] * 10))
    for repeat, count in (((2, 2), 4), ((1, 1), 1), ((2, 1), 2), ((1, 2), 2), ((2, 2), 3)):
        metadata = PhotoMetadata(None, None, None, "", "", "",
                                 tuple(60 + 1.25 * np.arange(count)), repeat, (3, 1))
        found[f"{repeat} {count}"] = [black_level._stated_black(metadata, origin, (2, 2))
                                      for origin in ((3, 1), (4, 1), (3, 2), (5, 4))]
    found["none"] = black_level._stated_black(
        PhotoMetadata(None, None, None, "Maker", "Maker Two", "7", None), (0, 0), (2, 2))
    recorded(found)


def test_pictures_for_the_eye(recorded):
    signal = picture(43, 61, 5, top=1.2).signal
    found = {f"factor {factor}": preview.signal_rgb8(signal, factor) for factor in (1, 2, 3)}
    found["whites"] = preview.whites(signal)
    found["given white"] = preview.signal_rgb8(signal, 2, (0.5, 0.7, 0.3))
    found["three bands"] = preview.preview_rgb8(picture(20, 30), 2)
    found["dark"] = preview.signal_rgb8(np.zeros((4, 5, 3)))
    found["codes"] = preview.encode_srgb8(np.array([-1, 0, 0.0031, 0.0032, 0.02, 0.18, 0.5, 1, 3]))
    found["bands"] = [preview.shown_bands(bands) for bands in (1, 2, 3, 4, 5, 8)]
    recorded(found)


def test_signals_of_outlined_regions(recorded):
    image = changed(picture(70, 90, 3), sensor_step=2.5)
    outlines = {"wall": [[10, 12], [80, 20], [74, 90], [20, 70]], "strip": [
        [100.0, 5.0], [106.0, 5.0], [106.0, 120.0], [100.0, 120.0]],
        "L": [[120, 20], [170, 20], [170, 40], [140, 40], [140, 90], [120, 90]]}
    recorded(sample_regions(changed(image, saturated=image.saturated & False), outlines),
             rtol=1e-5, case="samples")
    table = {}
    for side in (7.4, 7.6, 9.4, 10.0, 12.4):     # of a square in pixels of the sensor, 2.5 a pixel
        table[f"side {side}"] = outcome(lambda side=side: sample_regions(
            changed(image, saturated=image.saturated & False),
            {"a": [[50, 50], [50 + side, 50], [50 + side, 50 + side], [50, 50 + side]]}).pixels)
    for clipped in (3, 4, 5, 9):            # of 400 pixels
        mask = np.zeros(image.saturated.shape, bool)
        mask[20, 20:20 + clipped, 1] = True
        table[f"clipped {clipped}"] = outcome(lambda mask=mask: sample_regions(
            changed(image, saturated=mask),
            {"a": [[37.5, 37.5], [87.5, 37.5], [87.5, 87.5], [37.5, 87.5]]}).pixels)
    for left in (-0.6, -0.5, 0.0):
        table[f"left {left}"] = outcome(lambda left=left: sample_regions(
            changed(image, saturated=image.saturated & False),
            {"a": [[left, 10], [40, 10], [40, 50]]}).pixels)
    for right in (224.4, 224.5, 224.6):
        table[f"right {right}"] = outcome(lambda right=right: sample_regions(
            changed(image, saturated=image.saturated & False),
            {"a": [[180, 10], [right, 10], [right, 50]]}).pixels)
    recorded(table)


def test_pixels_of_polygons(recorded):
    star = np.array([[3.0, 1.0], [12.0, 2.5], [6.0, 5.0], [11.0, 10.0], [2.0, 8.0]])
    y, x = pixels_in_polygon(star, 9, 11)
    square = np.array([[2.0, 2.0], [5.0, 2.0], [5.0, 4.0], [2.0, 4.0]])
    grid_y, grid_x = np.mgrid[0:7, 0:7]
    # half of the edges are counted in: three times two
    assert inside_polygon(square, grid_x, grid_y).sum() == 6
    recorded({"y": y, "x": x, "outside": [part.size for part in pixels_in_polygon(star + 20, 9, 9)],
              "square": np.argwhere(inside_polygon(square, grid_x, grid_y))})


def test_photos_brought_to_the_size_of_a_render(recorded):
    image = picture(37, 53, 4)
    for width, height in ((53, 37), (20, 14), (17, 11), (9, 9), (1, 1)):
        recorded(binning.bin_image(image, width, height), rtol=1e-5, case=f"{width} {height}")
    weights = binning.area_weights(7, 3)
    np.testing.assert_allclose(weights.sum(axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(weights.sum(axis=0), 3 / 7, rtol=1e-12)
    recorded({"weights": weights, "sizes": [binning.render_size(*size) for size in (
        (6000, 4000, 96), (4032, 3024, 100), (5472, 3648, 131), (1000, 999, 40), (300, 5000, 7),
        (640, 480, 1), (1920, 1080, 33))]})


def test_some_samples_of_a_large_mosaic(monkeypatch, recorded):
    monkeypatch.setattr(clip_point, "SAMPLES", 900)
    frame = raw_frame(pattern="RGGB")
    recorded([clip_point._some_samples(frame, band) for band in range(3)])
    assert counts(8, 8, (0, 1, 1, 2)).dtype == np.uint16 and len(BLACK) == 4
