"""Dark frames, brackets, flat fields, bands of several photos, and files of pictures: recorded."""
import numpy as np
import OpenImageIO as oiio
import pytest
import zarr
from capture_pictures import changed, digest, dng, outcome, picture, raw_frame, scene

from spectrabox.capture.develop import bands, bracket, dark, developed, flat_field
from spectrabox.capture.photo import image_files, image_rows
from spectrabox.radiometry.records import PhotoKind


def dark_frame(number, height=96, width=132, pattern="GRBG", hot=6, **facts):
    rng = np.random.default_rng(number)
    frame = raw_frame(height, width, pattern, **facts)
    y, x = np.indices((height, width))
    level = 61 + 3 * (y % 2) + (x % 2) + 0.8 * x / width + 2.2 * rng.standard_normal(y.shape)
    for place in np.random.default_rng(77).choice(height * width, hot, replace=False):
        level.flat[place] += 400
    level[10, 20:22] += 300
    level[12, [20, 22, 24]] += 350
    return changed(frame, mosaic=np.rint(np.clip(level, 0, 4095)).astype(np.uint16),
                   file=f"dark{number}.dng")


@pytest.mark.parametrize("pattern, count, cut", [("GRBG", 1, 0.0), ("GRBG", 5, 0.0),
                                                 ("X-Trans", 3, 0.5)])
def test_dark_frames(recorded, pattern, count, cut):
    frame = raw_frame(96, 132, pattern)
    mean = dark.mean_dark([dark_frame(number, pattern=pattern) for number in range(count)], cut)
    recorded(mean, rtol=1e-5, case="mean")
    recorded(dark.subtract_dark(frame, mean), rtol=1e-5, case="subtracted")
    recorded(dark.common_variance(frame, mean), rtol=1e-5, case="common")


def test_dark_frames_that_do_not_fit(recorded):
    frame, mean = raw_frame(96, 132), dark.mean_dark([dark_frame(1), dark_frame(2)])
    changes = {"iso": changed(mean, iso=320.0), "no iso": changed(mean, iso=None),
               "camera": changed(mean, camera=""), "size": changed(mean, level=mean.level[:-2]),
               **{f"exposure {ratio}": changed(mean, exposure_s=ratio / 60)
                  for ratio in (0.94, 0.951, 0.96, 1.04, 1.049, 1.051, 1.06)},
               "no exposure": changed(mean, exposure_s=None),
               "bright": changed(mean, level=mean.level + 4000)}
    table = {case: outcome(lambda other=other: dark.subtract_dark(frame, other).source)
             for case, other in changes.items()}
    for hot in (100, 118, 121, 124, 130, 400):      # 1 % of 12672 is 126.7, with 5 at least
        table[f"{hot} hot"] = outcome(lambda hot=hot: int(dark.mean_dark(
            [dark_frame(3, hot=hot)]).hot.sum()))
    for case, facts in (("iso", {"iso": 100.0}), ("exposure", {"exposure_s": 0.5}),
                        ("camera", {"camera": "b"}), ("size", {"height": 94})):
        table[f"differs in {case}"] = outcome(
            lambda facts=facts: dark.mean_dark([dark_frame(1), dark_frame(2, **facts)]).source)
    table["none"] = outcome(lambda: dark.mean_dark([]))
    recorded(table)


def exposures(seconds=(0.01, 0.041, 0.11), power=1.0, ratio=1.0, height=72, width=110, level=0.8):
    """Photos of one scene, each with its own noise, clipped at 1."""
    signal = scene(height, width, 3, 1.1)
    images = []
    for number, exposure in enumerate(seconds):
        rng = np.random.default_rng(10 + number)
        lit = signal * exposure / seconds[0] * (ratio if number == 1 else 1.0) * level
        lit = lit ** power if number == 1 else lit
        variance = 1e-6 + np.array([2e-5, 3e-5, 5e-5]) * lit
        seen = lit + np.sqrt(variance) * rng.standard_normal(lit.shape)
        images.append(changed(picture(height, width), signal=np.minimum(seen, 1).astype(np.float32),
                              variance=variance.astype(np.float32), saturated=seen > 0.97,
                              exposure_s=exposure, source=f"{number}.dng"))
    return images


@pytest.mark.parametrize("spills", [False, True])
def test_brackets(recorded, spills):
    for case, seconds in (("three", (0.01, 0.041, 0.11)), ("two alike", (0.02, 0.02)),
                          ("one", (0.05,)), ("flooded", (0.01, 0.09))):
        merged, notes = bracket.merge_exposures(exposures(seconds)[::-1], spills)
        recorded({"image": merged, "notes": notes}, rtol=1e-5, case=case)
    # where one of two alike is saturated and the other is not
    pair = exposures((0.02, 0.02), level=1.6)
    clear = pair[1].saturated.copy()
    clear[:, 95:] = False
    bright, notes = bracket.merge_exposures([pair[0], changed(pair[1], saturated=clear)], spills)
    assert bright.saturated.any() and not bright.saturated[:, 96:].any()
    recorded({"image": bright, "notes": notes}, rtol=1e-5, case="bright")
    image = exposures()[1]
    recorded({"line": bracket.variance_line(image),
              "near": bracket.near_saturated(image.saturated, spills)}, rtol=1e-5, case="line")


def test_brackets_that_disagree(recorded):
    table = {}
    for ratio in (0.94, 0.949, 0.952, 0.96, 1.04, 1.048, 1.052, 1.07):
        table[f"ratio {ratio}"] = outcome(lambda ratio=ratio: bracket.merge_exposures(
            exposures((0.01, 0.03), ratio=ratio))[1])
    for power in (0.95, 0.954, 0.957, 0.96, 0.98, 1.0, 1.02, 1.04, 1.043, 1.046, 1.05):
        table[f"power {power}"] = outcome(lambda power=power: bracket.merge_exposures(
            exposures((0.01, 0.013), power, 1.0))[1])
    first, second, _ = exposures()
    for case, other in (("no exposure", {"exposure_s": None}), ("camera", {"camera": ""}),
                        ("iso", {"iso": None}), ("f-number", {"f_number": 8.0}),
                        ("kind", {"kind": PhotoKind.LINEAR_FILE})):
        table[case] = outcome(lambda other=other: bracket.merge_exposures(
            [first, changed(second, **other)]))
    for lit in (198, 199, 200, 201, 210):           # samples that both see well
        dim = [changed(image, signal=np.where(np.arange(image.signal.size).reshape(
            image.signal.shape) < lit, 0.3 * scale, 0.001).astype(np.float32),
                       saturated=image.saturated & False)
               for image, scale in ((first, 1.0), (second, 1.1))]
        table[f"{lit} shared"] = outcome(lambda dim=dim: bracket.merge_exposures(
            [dim[0], changed(dim[1], exposure_s=0.0111)])[1])
    table["none"] = outcome(lambda: bracket.merge_exposures([]))
    recorded(table, rtol=1e-5)


def card(height=70, width=102, bands=3, rough=0.0, noise=0.001, level=0.6, **facts):
    y, x = np.mgrid[0:height, 0:width]
    v, u = 2 * y / height - 1, 2 * x / width - 1
    shade = np.exp(-0.3 * (u - 0.2)**2 - 0.2 * (v + 0.1)**2 + 0.05 * u * v)
    signal = level * shade[..., None] * (1 - 0.2 * np.arange(bands) / bands)
    signal = signal + noise * np.random.default_rng(2).standard_normal(signal.shape)
    signal[30:36, 40:48] *= 1 - rough
    return changed(picture(height, width, bands), signal=signal.astype(np.float32),
                   saturated=np.zeros(signal.shape, bool), source="card.dng", **facts)


def test_flat_fields(recorded):
    image = picture(70, 102)
    recorded(flat_field.divide_by_flat(image, card()), rtol=1e-5, case="divided")
    recorded(flat_field.smooth_flat(card(20, 31, 4)), rtol=1e-5, case="small")
    smooth = flat_field.smooth_flat(card(noise=0.0))
    # the logarithm of a block's mean is not the mean of logarithms: by its curvature over a block
    np.testing.assert_allclose(smooth / smooth[35, 51], card(noise=0.0).signal
                               / card(noise=0.0).signal[35, 51], rtol=3e-4)
    table = {f"rough {rough}": outcome(lambda rough=rough: flat_field.smooth_flat(
        card(rough=rough))[33, 44]) for rough in (0.0, 0.045, 0.05, 0.055, 0.06, 0.065, 0.07, 0.2)}
    for level in (0.03, 0.040, 0.043, 0.044, 0.045, 0.046, 0.047, 0.05):
        table[f"level {level}"] = outcome(lambda level=level: flat_field.smooth_flat(
            card(level=level, noise=0.0)).min())
    for columns in (20, 24, 25, 26, 27, 30, 60):
        clipped = np.zeros((70, 102, 3), bool)
        clipped[:, :columns, 1] = True
        table[f"{columns} clipped"] = outcome(lambda clipped=clipped: flat_field.smooth_flat(
            changed(card(), saturated=clipped)).min())
    for case, other in (("size", card(68)), ("bands", card(bands=4)),
                        ("camera", changed(card(), camera="")),
                        ("step", changed(card(), sensor_step=1.0))):
        table[case] = outcome(lambda other=other: flat_field.divide_by_flat(image, other))
    recorded(table, rtol=1e-5)


def test_bands_of_several_photos(recorded):
    images = [changed(picture(30, 44, seed=number), exposure_s=0.01 * (number + 1),
                      source=f"{number}.dng") for number in range(4)]
    images[2] = changed(images[2], signal=images[2].signal[..., ::-1].copy())
    names = ["450 nm", "blue LED", "530", "650"]
    for case, options in (("plain", {}), ("channels", {"channels": [0, 2, 1, 1]}),
                          ("exposures", {"exposures_s": [0.02, 0.02, 0.02, 0.05]}),
                          ("one exposure", {"exposures_s": [0.03] * 4})):
        recorded(bands.stack_bands(images, names, **options), rtol=1e-5, case=case)
    table = {"strongest": [bands.strongest_channel(image) for image in images]}
    asked = {"exposures_s": [0.02] * 4}
    for case, other in (("unknown exposure", {"exposure_s": None}), ("iso", {"iso": None}),
                        ("f-number", {"f_number": 8.0}), ("camera", {"camera": "b"})):
        table[case] = outcome(lambda other=other: bands.stack_bands(
            [*images[:3], changed(images[3], **other)], names, **asked).exposure_s)
        table[f"{case}, not asked"] = outcome(lambda other=other: bands.stack_bands(
            [*images[:3], changed(images[3], **other)], names).exposure_s)
    table["names"] = [outcome(lambda: bands.stack_bands(images, names[:3])),
                      outcome(lambda: bands.stack_bands([], [])),
                      outcome(lambda: bands.stack_bands([*images[:3], picture(30, 40)], names))]
    recorded(table)


def test_photos_developed_together(recorded, tmp_path):
    photos = [dng(tmp_path / f"{number}.dng", seed=number + 1, exposure_s=exposure, top=0.4 * times)
              for number, (exposure, times) in enumerate(((0.02, 1.0), (0.02, 1.0), (0.04, 2.0)))]
    flat = dng(tmp_path / "flat.dng", seed=9, top=0.9, three=False)
    darks = []
    for number, exposure in enumerate((0.02, 0.02, 0.04)):
        darks.append(dng(tmp_path / f"dark{number}.dng", seed=20 + number, exposure_s=exposure,
                         top=0.0001, hot=3 + number))
    for case, arguments in (("one", (photos[:1], [], None)), ("bracket", (photos, [], None)),
                            ("darks", (photos, darks, None)),
                            ("one dark", (photos[:2], darks[:1], None)),
                            ("dark missing", (photos, darks[:1], None)),
                            ("flat", (photos[:1], [], flat))):
        recorded(outcome(lambda arguments=arguments: developed.develop_photos(*arguments)),
                 rtol=1e-5, case=case)


def _tiff(path, kind, pixels, **attributes):
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    names = attributes.pop("names", None)
    if names:
        spec.channelnames = names
    for name, value in attributes.items():
        spec.attribute(name.replace("_", ":"), value)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec) and file.write_image(np.ascontiguousarray(pixels))
    file.close()
    return path


def test_picture_files(recorded, tmp_path):
    image = picture(40, 52)
    four = picture(40, 52, 4, seed=6).signal.clip(0, 1)
    twelve = np.rint(four * 65535).astype(np.uint16)
    files = {
        "half.exr": _tiff(tmp_path / "half.exr", "half", four[..., :3].astype(np.float16),
                          ExposureTime=0.125, Make="Maker", Model="Nine", FNumber=4.5),
        "beyond.exr": _tiff(tmp_path / "beyond.exr", "float", image.signal * 3),
        "named.exr": _tiff(tmp_path / "named.exr", "float", four, names=("A", "B", "G", "R")),
        "five.exr": _tiff(tmp_path / "five.exr", "float", picture(40, 52, 5).signal.clip(0, 1),
                          names=("v", "w", "Z", "y", "x")),
        "sixteen.tif": _tiff(tmp_path / "sixteen.tif", "uint16", twelve[..., :3],
                             ExposureTime=0.25, Exif_PhotographicSensitivity=400),
        "alpha.tif": _tiff(tmp_path / "alpha.tif", "uint16", twelve),
        "srgb.tif": _tiff(tmp_path / "srgb.tif", "uint16", twelve[..., :3],
                          oiio_ColorSpace="sRGB"),
        "eight.tif": _tiff(tmp_path / "eight.tif", "uint8", (twelve[..., :3] // 257).astype(
            np.uint8)),
        "long.tif": _tiff(tmp_path / "long.tif", "uint32", twelve[..., :3].astype(np.uint32)),
        "plane.tif": _tiff(tmp_path / "plane.tif", "uint16", twelve[..., :1], ExposureTime=0.5,
                           Make="Maker"),
        "two.tif": _tiff(tmp_path / "two.tif", "uint16", twelve[..., :2])}
    nan = image.signal.copy()
    nan[3, 4, 1] = np.nan
    for name, pixels in (("nan.exr", nan), ("large.exr", image.signal * 2e9),
                         ("below.exr", image.signal * 9e8)):
        files[name] = _tiff(tmp_path / name, "float", pixels)
    image_files.write_linear_exr(tmp_path / "developed.exr", image)
    image_files.write_linear_exr(tmp_path / "bands.exr", changed(
        picture(40, 52, 4), exposure_s=None, kind=PhotoKind.LINEAR_FILE, sensor_step=3.5))
    for name in ("developed.exr", "bands.exr"):
        files[name] = tmp_path / name
    rgb8 = np.rint(255 * four[..., :3]).astype(np.uint8)
    image_files.write_png(tmp_path / "a.png", rgb8)
    image_files.write_jpeg(tmp_path / "a.jpg", rgb8)
    files |= {"a.png": tmp_path / "a.png", "a.jpg": tmp_path / "a.jpg", "no.exr": tmp_path / "no"}
    for name, path in files.items():
        # a JPEG is decoded by another library on another machine
        recorded(_without(tmp_path, outcome(lambda path=path: image_files.read_linear_file(path))),
                 rtol=1e-5, case=name)
        recorded([_without(tmp_path, outcome(lambda path=path, of=of: of(path))) for of in (
            image_files.picture_size, _encoded_mean, image_files.read_plane)], rtol=1e-2,
                 case=f"{name} otherwise")
    back = image_files.read_linear_file(files["developed.exr"])
    np.testing.assert_array_equal(back.signal, image.signal)
    np.testing.assert_array_equal(back.variance, image.variance)
    np.testing.assert_array_equal(back.saturated, image.saturated)


def _encoded_mean(path):
    image = image_files.read_encoded_file(path)
    return [image.signal.mean(axis=(0, 1)), image.saturated.mean(axis=(0, 1)), image.source]


def _without(folder, found):
    return found.replace(f"{folder}/", "") if isinstance(found, str) else (
        found if not hasattr(found, "sha256") else changed(found, sha256=""))


def test_order_of_bands_and_kinds_of_files(recorded, tmp_path):
    (tmp_path / "png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "exr").write_bytes(b"\x76\x2f\x31\x01\x02")
    (tmp_path / "jpg").write_bytes(b"\xff\xd8\xff\xe0")
    (tmp_path / "tiff").write_bytes(b"II*\x00")
    recorded([{",".join(names): image_files.band_order(names) for names in (
        ("R", "G", "B"), ("B", "G", "R", "A"), ("x", "y", "depth.Z", "w"), ("l.B", "l.R", "l.G"),
        ("G", "x", "R", "B", "alpha"), ("R", "G"))},
        {name: image_files.is_image_file(tmp_path / name)
         for name in ("png", "exr", "jpg", "tiff", "a.TIF", "a.jpeg", "a.dng", "none")}])


def test_pictures_by_rows(recorded, tmp_path):
    signal = picture(150, 130, 4, seed=12).signal.clip(0, 1)
    for tiles in (False, True):
        for half in (False, True):
            name = f"{'tiles' if tiles else 'lines'} {'half' if half else 'single'}.exr"
            with image_rows.exr_rows(tmp_path / name, 150, 130, ("c.p", "c.q", "d", "e"), half,
                                     {"words": "as written"}, tiles=tiles) as write:
                for first in range(0, 150, 50):
                    write(first, signal[first:first + 50])
            rows = image_rows.open_rows(tmp_path / name)
            layers, words = image_rows.open_layers(tmp_path / name, "c.", "words")
            recorded([rows.height, rows.width, rows.bands, rows.rows_at_once, rows.read(3, 90),
                      layers.bands, layers.read(64, 150), words], case=name)
            # channels without a layer come first; a half has 11 bits
            np.testing.assert_allclose(rows.read(0, 150), signal[..., [2, 3, 0, 1]],
                                       atol=2.0**-12 if half else 0)
    with image_rows.png_rows(tmp_path / "a.png", 150, 130, 3) as write:
        write(0, np.rint(255 * signal[:, :, :3]).astype(np.uint8))
    recorded(image_files.read_encoded_file(tmp_path / "a.png").signal, case="png")
    for kind in (np.float32, np.uint16):
        path = tmp_path / f"{np.dtype(kind)}.zarr"
        full = 65535 if kind is np.uint16 else 1
        array = zarr.create_array(str(path), shape=signal.shape, dtype=kind, chunks=(40, 70, 4))
        array[...] = (signal * full).astype(kind)
        rows = image_rows.open_rows(path)
        recorded([rows.height, rows.width, rows.bands, rows.rows_at_once, rows.read(7, 77)],
                 case=f"zarr {np.dtype(kind)}")
    recorded([_without(tmp_path, outcome(lambda name=name: image_rows.open_rows(
        tmp_path / name).bands)) for name in ("a.png", "none.exr")]
        + [_without(tmp_path, outcome(lambda: image_rows.open_layers(
            tmp_path / "lines half.exr", "z.", "words")))], case="refused")
    assert digest(tmp_path / "lines half.exr") == digest(tmp_path / "lines half.exr")
