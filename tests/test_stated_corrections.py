"""What a photo file states of its values is applied or named, and bands clip where bright pixels
pile up: files of every kind made here with known truth.
"""
import struct

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import spectrabox as sb
from spectrabox.capture.develop.developed import develop_photos
from spectrabox.capture.photo.image_files import image_of_array
from spectrabox.capture.photo.image_rows import open_rows
from spectrabox.capture.photo.linear import open_photo
from spectrabox.fixtures.chart_scene import mosaic
from spectrabox.fixtures.dng import write_dng
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Severity

SIDE = 320              # of the pictures
ELECTRONS = 20_000      # at full scale: noise of .7 % there
FEW = settings(max_examples=5, deadline=None)
WHITE = 16383
BLACK = (512.0, 514.0, 513.0, 511.0)
OPTIONAL = 1


def patches(brightest=1.4, seed=0):
    """Signal (H, W, 3) of 64 plain patches with a gradient, from dark to beyond full scale."""
    levels = np.geomspace(0.02, brightest, 64)
    np.random.default_rng(seed).shuffle(levels)
    picture = np.kron(levels.reshape(8, 8), np.ones((SIDE // 8, SIDE // 8)))
    picture = picture * np.linspace(0.97, 1.03, SIDE)
    return picture[..., None] * np.array([0.95, 1.0, 0.9])


def noisy(signal, seed=1):
    generator = np.random.default_rng(seed)
    return generator.poisson(np.maximum(signal, 0) * ELECTRONS) / ELECTRONS \
        + generator.normal(0, 5 / ELECTRONS, signal.shape)


def written(folder, kind, values):
    """A photo of linear values up to 1 (H, W, 3), which are cut off in them already."""
    if kind == "array":
        return sb.open_photo(values.astype(np.float32)).image
    path = folder / ("photo." + {"half": "exr", "float": "exr", "dng": "dng"}.get(kind, "tif"))
    if kind == "dng":
        write_dng(path, np.rint(values * 60000).clip(0, 65535).astype(np.uint16), white=65535,
                  black=(0,) * 4)
        return open_photo(path)
    spec = oiio.ImageSpec(SIDE, SIDE, 3, {"half": "half", "float": "float"}.get(kind, "uint16"))
    spec.attribute("oiio:ColorSpace", "linear")
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec)
    assert file.write_image(values.astype(np.float32) if spec.format != "uint16"
                            else np.rint(values * 60000).clip(0, 65535).astype(np.uint16))
    file.close()
    return open_photo(path)


LEVELS = st.tuples(*[st.sampled_from([0.3, 0.45, 0.6, 0.7, None])] * 3)


@FEW
@given(levels=LEVELS, kind=st.sampled_from(["array", "half", "float", "tiff", "dng"]),
       seed=st.integers(0, 1000))
def test_each_band_clips_where_it_piles_up_in_every_format(tmp_path_factory, levels, kind, seed):
    truth = patches(0.9, seed)       # bands without a level of their own lie below full scale
    recorded = noisy(truth, seed)
    for band, level in enumerate(levels):
        if level is not None:
            recorded[..., band] = np.minimum(recorded[..., band], level)
    image = written(tmp_path_factory.mktemp("clip"), kind, recorded)
    for band, level in enumerate(levels):
        lost = image.saturated[..., band]
        if level is None:
            assert not lost.any()
        else:
            # 4 sigma of noise about the level, and the 2 % above which a sensor is not linear
            over = truth[..., band] > level * 1.03       # there always is such a patch
            assert lost[over].mean() > 0.999
            assert not lost[truth[..., band] < 0.92 * level].any()


@FEW
@given(level=st.sampled_from([4000, 9000, 12000, 15000]), hot=st.integers(0, 20),
       pattern=st.sampled_from(["RGGB", "GBRG"]))
def test_a_mosaic_clips_where_it_piles_up_below_its_white_level(tmp_path_factory, level, hot,
                                                                pattern):
    folder, truth = tmp_path_factory.mktemp("clip"), patches(1.2)
    dn = mosaic(np.kron(truth, np.ones((2, 2, 1))), pattern, np.array(BLACK), 65535, 4e4, 4.0,
                np.random.default_rng(4)).astype(float)
    dn = np.minimum((dn - 512) / 65535 * WHITE + 512, level)
    dn.ravel()[np.random.default_rng(5).integers(0, dn.size, hot)] = WHITE - 50      # hot pixels
    write_dng(folder / "photo.dng", np.rint(dn).astype(np.uint16), pattern=pattern,
              black=(512,) * 4, white=WHITE)
    image = open_photo(folder / "photo.dng")
    clip = (level - 512) / (WHITE - 512)
    seen = cv2.resize(truth, image.signal.shape[1::-1], interpolation=cv2.INTER_AREA)
    scaled = seen * WHITE / (WHITE - 512)
    assert image.saturated[scaled > 1.06 * clip].mean() > 0.999
    assert image.saturated[scaled < 0.9 * clip].mean() < 0.001


@pytest.mark.parametrize("plain", [0.3, 0.9])
def test_a_picture_without_noise_has_plain_parts_and_no_clip_point(plain):
    computed = np.full((SIDE, SIDE, 3), plain) * np.array([0.9, 1.0, 0.8])
    computed[:160] = 0.1
    assert not sb.open_photo(computed).image.saturated.any()


def test_green_that_a_developer_balanced_to_half_of_full_scale_clips_there():
    # exposed 2/3 of a stop too high; red and blue are not at their clip point
    balanced = (np.minimum(noisy(patches(1.58) * [0.45, 1, 0.6]), 1) * [1.8, 0.5, 1.4]).astype(
        np.float32)
    saturated = sb.open_photo(balanced).image.saturated
    assert saturated[..., 1][patches(1.58)[..., 1] > 1.03].mean() > 0.999
    assert not saturated[..., [0, 2]].any()


# ---- levels --------------------------------------------------------------------------------------

def write_tiff(path, values, tags):
    """A TIFF of 16 bits (H, W, 3) with further tags: number to (type, values)."""
    codes = {"short": (3, "H"), "long": (4, "L"), "ratio": (5, "LL")}
    height, width, bands = values.shape
    strip = values.astype("<u2").tobytes()
    every = {256: ("long", [width]), 257: ("long", [height]), 258: ("short", [16] * bands),
             259: ("short", [1]), 262: ("short", [2]), 273: ("long", [8]), 277: ("short", [bands]),
             278: ("long", [height]), 279: ("long", [len(strip)]), 339: ("short", [1] * bands),
             **tags}
    at = 8 + len(strip)
    pointer, entries, tail = at + 2 + 12 * len(every) + 4, b"", b""
    for tag, (kind, numbers) in sorted(every.items()):
        code, letters = codes[kind]
        flat = [part for number in numbers for part in (
            (round(number * 1000), 1000) if letters == "LL" else (number,))]
        content = struct.pack(f"<{len(numbers) * len(letters)}{letters[0]}", *flat)
        if len(content) > 4:
            tail, content = tail + content, struct.pack("<L", pointer + len(tail))
        entries += struct.pack("<HHL", tag, code, len(numbers)) + content.ljust(4, b"\0")
    path.write_bytes(struct.pack("<2sHL", b"II", 42, at) + strip
                     + struct.pack("<H", len(every)) + entries + bytes(4) + tail)


@FEW
@given(black=st.lists(st.floats(0, 9000), min_size=3, max_size=3), one=st.booleans(),
       white=st.integers(30000, 65535), tile=st.booleans())
def test_levels_that_a_tiff_states_are_applied(tmp_path_factory, black, one, white, tile):
    path = tmp_path_factory.mktemp("levels") / "photo.tif"
    black = [round(level, 3) for level in (black[:1] * 3 if one else black)]
    truth = patches(0.8)
    level = np.array(black) + np.zeros((2, 2, 1))
    if tile:
        level = level + np.array([[0.0, 40.0], [10.0, 25.0]])[..., None]
    dn = truth * (white - np.tile(level, (SIDE // 2, SIDE // 2, 1))) \
        + np.tile(level, (SIDE // 2, SIDE // 2, 1))
    write_tiff(path, np.rint(dn), {
        50713: ("short", [2, 2] if tile else [1, 1]), 50717: ("long", [white]),
        50714: ("ratio", (level if tile else level[:1, :1]).ravel().tolist())})
    image = open_photo(path)
    # rounding to whole numbers: half a step
    np.testing.assert_allclose(image.signal, truth, atol=0.6 / (white - max(black) - 40))
    np.testing.assert_allclose(open_rows(path)[1](3, 9), image.signal[3:9], atol=1e-5)
    assert [one.code for one in image.findings] == ["file.levels"]


def test_levels_that_contradict_each_other_are_refused(tmp_path):
    dn = np.rint(patches(0.8) * 50000)
    write_tiff(tmp_path / "a.tif", dn, {50714: ("short", [5000]), 50717: ("short", [4000])})
    write_tiff(tmp_path / "b.tif", dn, {50714: ("short", [5000, 5000])})
    for name, what in (("a", "white level of 4000, not above its black level of 5000"),
                       ("b", "2 black levels")):
        with pytest.raises(InputError, match=what):
            open_photo(tmp_path / f"{name}.tif")


@FEW
@given(base=st.integers(0, 300), spread=st.floats(0, 40), columns=st.booleans(),
       masked=st.booleans(), wrong=st.integers(0, 200))
def test_black_that_changes_over_rows_or_columns_is_subtracted(tmp_path_factory, base, spread,
                                                               columns, masked, wrong):
    path = tmp_path_factory.mktemp("delta") / "photo.dng"
    generator, height, width, margin = np.random.default_rng(9), 200, 240, 40
    rows = 256 + generator.normal(0, spread, height)
    across = generator.normal(0, spread, width) if columns else np.zeros(width)
    scene = np.kron(np.geomspace(0.01, 0.8, 25).reshape(5, 5), np.ones((40, 48)))
    dark = base + rows[:, None] + np.concatenate([np.zeros(margin), across])
    light = np.concatenate([np.zeros((height, margin)), scene], axis=1)
    dn = dark + light * 12000 + generator.normal(0, 3, dark.shape)
    # where there are masked pixels, they tell what the stated level is wrong by
    stated = base + (wrong if masked else 0)
    write_dng(path, np.rint(dn.clip(0)).astype(np.uint16), white=12000 + base + 256,
              black=(stated,) * 4, active_area=(0, margin, height, margin + width),
              masked_areas=(0, 0, height, margin - 4) if masked else (),
              further={50716: ("signed ratio", rows.tolist()),
                       50715: ("signed ratio", across.tolist())})
    signal = open_photo(path).signal
    seen = cv2.resize(scene, signal.shape[1::-1], interpolation=cv2.INTER_AREA)
    # noise of 3 DN, one sample of red and blue: 5 sigma of 12000, and the mean's of masked pixels
    off = (signal - seen[..., None]) * 12000
    assert np.abs(off).max() < 6 * 3.5
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.5


def test_deltas_of_another_size_are_refused(tmp_path):
    write_dng(tmp_path / "photo.dng", np.full((64, 64), 900, np.uint16),
              further={50716: ("signed ratio", [1.0, 2.0, 3.0])})
    with pytest.raises(InputError, match="black levels of 3 rows"):
        open_photo(tmp_path / "photo.dng")


# ---- lists of opcodes ----------------------------------------------------------------------------

def opcode_list(*opcodes):
    """OpcodeList of (id, flags, content)."""
    return struct.pack(">L", len(opcodes)) + b"".join(
        struct.pack(">4L", kind, 0x01030000, flags, len(content)) + content
        for kind, flags, content in opcodes)


def gain_map(gains, area, pitch=(1, 1), planes=(0, 1), flags=OPTIONAL):
    """GainMap of gains (V, U, P) that spans the whole picture."""
    v, u, p = gains.shape
    spacing = [1 / (side - 1) if side > 1 else 1.0 for side in (v, u)]
    return 9, flags, struct.pack(">10L4dL", *area, *planes, *pitch, v, u, *spacing, 0.0, 0.0, p) \
        + gains.astype(">f4").tobytes()


def bilinear(gains, size):
    """Gains (V, U) of a map at the centres of pixels, by OpenCV's own interpolation."""
    y, x = ((np.arange(side) + 0.5) / side * (points - 1)
            for side, points in zip(size, gains.shape, strict=True))
    map_x, map_y = np.meshgrid(x, y)
    return cv2.remap(gains.astype(np.float32), map_x.astype(np.float32), map_y.astype(np.float32),
                     cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


SIZES = st.tuples(st.integers(1, 17), st.integers(1, 17))


@FEW
@given(size=SIZES, seed=st.integers(0, 1000), below=st.booleans())
def test_the_four_gain_maps_of_a_phone_are_applied_to_its_mosaic(tmp_path_factory, size, seed,
                                                                 below):
    path = tmp_path_factory.mktemp("gains") / "photo.dng"
    gains = np.random.default_rng(seed).uniform(1, 3, (4, *size, 1))
    flat = 0.1
    shape = (160, 200)
    dn = np.full(shape, 0.0)
    maps = []
    for index, (y, x) in enumerate(np.ndindex(2, 2)):
        full = bilinear(gains[index, ..., 0], shape)
        dn[y::2, x::2] = BLACK[index] + flat * (WHITE - BLACK[index]) / full[y::2, x::2]
        maps.append(gain_map(gains[index], (y, x, *shape), (2, 2)))
    write_dng(path, np.rint(dn).astype(np.uint16), black=BLACK, white=WHITE, below_thumbnail=below,
              further={51009: ("bytes", opcode_list(*maps))})
    image = open_photo(path)
    # rounding to whole DN times gains of 3, and OpenCV's interpolation to a 32nd of a pixel
    np.testing.assert_allclose(image.signal, flat, atol=3 * 0.5 / WHITE + 0.012)
    assert abs(image.signal.mean() / flat - 1) < 0.003
    applied, = image.findings
    assert (applied.code, applied.severity) == ("file.gains-applied", Severity.INFO)
    assert applied.values["largest"] == pytest.approx(gains.max(), rel=1e-6)


@FEW
@given(size=SIZES, planes=st.sampled_from([1, 3]), third=st.booleans(), linear=st.booleans())
def test_maps_of_colours_are_applied_to_their_bands(tmp_path_factory, size, planes, third, linear):
    path = tmp_path_factory.mktemp("gains") / "photo.dng"
    if not linear and not third:        # a mosaic has no colours before it is demosaiced
        planes = 1
    gains = np.random.default_rng(3).uniform(1, 2, (*size, planes))
    shape, flat = (128, 160), np.array([0.3, 0.2, 0.1])
    full = np.stack([bilinear(gains[..., min(band, planes - 1)], shape) for band in range(3)], -1)
    signal, black = flat / full, 0 if linear else 512
    area = (0, 0, *shape)
    if linear:
        content = np.rint(signal * 60000).astype(np.uint16)
    else:
        content = signal[..., 1].copy()
        content[::2, ::2], content[1::2, 1::2] = signal[::2, ::2, 0], signal[1::2, 1::2, 2]
        content = np.rint(content * (60000 - black) + black).astype(np.uint16)
    write_dng(path, content, black=(black,) * 4, white=60000, further={
        51022 if third else 51009: ("bytes", opcode_list(gain_map(
            gains, area, planes=(0, 3 if linear or third else 1))))})
    found = open_photo(path).signal
    np.testing.assert_allclose(found, np.broadcast_to(flat, found.shape), rtol=0.03, atol=1e-4)
    np.testing.assert_allclose(found.mean(axis=(0, 1)), flat, rtol=0.004)


def test_the_noise_grows_with_the_gain(tmp_path):
    gains = np.array([[1.0, 3.0]])[..., None]
    scene = np.full((SIDE, SIDE, 3), 0.2)
    scene[:, :SIDE // 2] *= np.linspace(0.2, 1, SIDE // 2)[:, None]
    dn = np.rint(noisy(scene / bilinear(gains[..., 0], (SIDE, SIDE))[..., None]) * 60000)
    write_dng(tmp_path / "photo.dng", dn.clip(0).astype(np.uint16), black=(0,) * 4, white=60000,
              further={51022: ("bytes", opcode_list(gain_map(gains, (0, 0, SIDE, SIDE),
                                                             planes=(0, 3))))})
    image = open_photo(tmp_path / "photo.dng")
    right = image.signal[:, SIDE - 40:, 1]
    # 40 x 320 values: their variance is known within 1.3 %, the noise line within a few
    assert np.var(right) == pytest.approx(image.variance[:, SIDE - 40:, 1].mean(), rel=0.15)


def test_the_falling_off_of_a_lens_that_a_file_states_is_applied(tmp_path):
    y, x = np.mgrid[:128, :160] + 0.5
    squared = ((y - 64)**2 + (x - 80)**2) / (64**2 + 80**2)
    gain = 1 + 0.6 * squared + 0.3 * squared**2
    dn = np.rint(0.4 / gain[..., None] * np.array([1.0, 0.8, 0.6]) * 60000)
    content = struct.pack(">7d", 0.6, 0.3, 0, 0, 0, 0.5, 0.5)
    write_dng(tmp_path / "photo.dng", dn.astype(np.uint16), black=(0,) * 4, white=60000,
              further={51022: ("bytes", opcode_list((3, OPTIONAL, content)))})
    np.testing.assert_allclose(open_photo(tmp_path / "photo.dng").signal,
                               np.broadcast_to([0.4, 0.32, 0.24], (128, 160, 3)), rtol=3e-4)


@pytest.mark.parametrize("which, kind, flags, code, severity", [
    (51022, 1, OPTIONAL, "file.geometry-left", Severity.NOTE),
    (51022, 2, 0, "file.geometry-left", Severity.NOTE),
    (51008, 4, OPTIONAL, "file.bad-pixels-left", Severity.NOTE),
    (51008, 5, OPTIONAL, "file.bad-pixels-left", Severity.NOTE),
    (51009, 8, 0, "file.values-left", Severity.WARN),
    (51009, 12, OPTIONAL, "file.values-left", Severity.NOTE),
    (51008, 9, 0, "file.values-left", Severity.WARN),
    (51022, 77, 0, "file.values-left", Severity.WARN)])
def test_what_is_not_applied_is_named(tmp_path, which, kind, flags, code, severity):
    write_dng(tmp_path / "photo.dng", mosaic(patches(0.8), "RGGB", np.array(BLACK), WHITE, 4e4, 4.0,
                                             np.random.default_rng(0)), black=BLACK, white=WHITE,
              further={which: ("bytes", opcode_list((kind, flags, bytes(76))))})
    _, findings = develop_photos([tmp_path / "photo.dng"], [], None)
    assert [(one.code, one.severity) for one in findings] == [(code, severity)]


@pytest.mark.parametrize("content", [b"\0\0", struct.pack(">L", 2), struct.pack(
    ">L4L", 1, 9, 0, 0, 400) + bytes(40), opcode_list((9, 0, bytes(200)))])
def test_a_damaged_list_is_refused(tmp_path, content):
    write_dng(tmp_path / "photo.dng", np.full((64, 64), 900, np.uint16),
              further={51009: ("bytes", content)})
    with pytest.raises(InputError, match="damaged list of corrections"):
        open_photo(tmp_path / "photo.dng")


def test_stops_for_display_are_named_and_a_limit_of_linearity_counts_as_clipping(tmp_path):
    dn = mosaic(patches(0.95), "RGGB", np.array(BLACK), WHITE, 4e4, 4.0, np.random.default_rng(0))
    write_dng(tmp_path / "photo.dng", dn, black=BLACK, white=WHITE, further={
        50730: ("signed ratio", [0.35]), 50734: ("ratio", [0.6])})
    image = open_photo(tmp_path / "photo.dng")
    assert {one.code: one.severity for one in image.findings} == {
        "file.baseline-exposure": Severity.NOTE, "file.linear-limit": Severity.INFO}
    above = image.signal > 0.62
    assert image.saturated[above].all() and not image.saturated[image.signal < 0.57].any()


# ---- sensors -------------------------------------------------------------------------------------

@pytest.mark.parametrize("ratio", [2.0, 4.0, 16.0])
@pytest.mark.parametrize("phase", range(4))
def test_rows_of_two_gains_are_refused(tmp_path, ratio, phase):
    dn = mosaic(patches(0.5), "RGGB", np.zeros(4), 16000, 4e4, 4.0, np.random.default_rng(0))
    gains = np.where((np.arange(SIDE) + phase) // 2 % 2, ratio, 1.0)
    dn = np.minimum(dn * gains[:, None] / ratio * 2 + 512, 15000)
    write_dng(tmp_path / "photo.dng", np.rint(dn).astype(np.uint16), black=(512,) * 4, white=15000)
    with pytest.raises(InputError, match="two gains in turn"):
        open_photo(tmp_path / "photo.dng")


def test_a_linear_dng_of_four_planes_is_named_as_that(tmp_path):
    write_dng(tmp_path / "photo.dng", np.full((64, 64, 4), 900, np.uint16))
    with pytest.raises(InputError, match="linear DNG of 4 planes"):
        open_photo(tmp_path / "photo.dng")


def test_one_white_level_a_plane(tmp_path):
    whites = np.array([50000, 30000, 60000])
    dn = np.minimum(np.rint(noisy(patches(1.3)) * whites), whites)
    write_dng(tmp_path / "photo.dng", dn.clip(0).astype(np.uint16), black=(0,) * 4, white=60000,
              further={50717: ("long", whites.tolist())})
    image = open_photo(tmp_path / "photo.dng")
    np.testing.assert_allclose(image.signal.max(axis=(0, 1)), 1, atol=1e-6)
    assert image.saturated[patches(1.3) > 1.03].all()


def test_negative_colours_say_a_converted_colour_space_and_noise_does_not():
    converted = noisy(patches(0.8))
    assert not sb.open_photo(converted).findings
    converted[40:80, 40:80] = noisy(np.full((40, 40, 3), [0.05, 0.4, 0.5])) - [0.09, 0, 0]
    assert [one.code for one in sb.open_photo(converted).findings] == ["file.converted-colours"]


# ---- highlights that are rolled off --------------------------------------------------------------

def rolled(linear, knee):
    """A curve that is linear up to the knee and then comes near to 1 without reaching it."""
    over = np.maximum(linear - knee, 0)
    return np.where(linear < knee, linear, 1 - (1 - knee) * np.exp(-over / (1 - knee)))


def bright_scene(brightest, rng, electrons=20000):
    """Dark parts, a wedge up to this and its photon noise, in one band (H, W)."""
    y, x = np.mgrid[:640, :960]
    scene = 0.03 + 0.12 * (np.sin(x / 71) * np.cos(y / 57) + 1)
    scene[80:480, 80:800] = np.linspace(0.3, brightest, 720)
    return scene + np.sqrt(2e-6 + scene / electrons) * rng.standard_normal(scene.shape)


@pytest.mark.parametrize("knee", [0.9, 0.8, 0.6])
@pytest.mark.parametrize("brightest", [1.3, 2.0])
def test_rolled_off_highlights_count_as_clipped(knee, brightest):
    rng = np.random.default_rng(int(100 * knee + brightest))
    linear = np.stack([bright_scene(one, rng) for one in (0.9, brightest, 0.9)], axis=2)
    values = np.round(65535 * np.clip(np.stack([
        linear[..., 0], rolled(linear[..., 1], knee), linear[..., 2]], axis=2), 0, 1))
    image = image_of_array(values.astype(np.uint16))
    found, = [one for one in image.findings if one.code == "file.rolled-off"]
    assert found.values["bands"] == ["G"]
    assert not image.saturated[..., [0, 2]].any()
    # what is not clipped is off by less than the curve is where its slope is .6; five sigma
    # of photon noise
    kept = ~image.saturated[..., 1]
    off = np.abs(image.signal[..., 1] - linear[..., 1])[kept]
    limit = knee - (1 - knee) * np.log(0.6) - (1 - 0.6 * (1 - knee))
    assert off.max() < limit + 5 * np.sqrt(1 / 20000)
    assert np.mean(image.saturated[..., 1]) > 0.5 * np.mean(linear[..., 1] > 1)


@pytest.mark.parametrize("level", [0.5, 0.9])
@pytest.mark.parametrize("corner", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("electrons", [3000, 100_000])
def test_a_bright_card_that_fills_the_picture_is_not_clipped(level, corner, electrons):
    rng = np.random.default_rng(7)
    y, x = np.mgrid[-1:1:480j, -1:1:640j]
    card = np.repeat((level * (1 - corner * (x**2 + y**2) / 2))[..., None], 3, axis=2)
    card += np.sqrt(1e-6 + card / electrons) * rng.standard_normal(card.shape)
    image = image_of_array(np.round(65535 * np.clip(card, 0, 1)).astype(np.uint16))
    assert not image.findings
    assert not image.saturated[image.signal < 0.98].any()


# ---- several pictures in a file ------------------------------------------------------------------

@pytest.mark.parametrize("first, severity", [(8, Severity.WARN), (1, Severity.NOTE)])
def test_further_pictures_of_a_file_are_named(tmp_path, first, severity):
    picture = np.rint(noisy(patches(0.8)) * 60000).clip(0, 65535).astype(np.uint16)
    pages = [np.ascontiguousarray(picture[::step, ::step]) for step in (first, 9 - first)]
    specs = [oiio.ImageSpec(page.shape[1], page.shape[0], 3, "uint16") for page in pages]
    path, file = tmp_path / "pages.tif", oiio.ImageOutput.create("pages.tif")
    for page, spec, mode in zip(pages, specs, ("Create", "AppendSubimage"), strict=True):
        assert file.open(str(path), spec, mode)
        assert file.write_image(page)
    file.close()
    image = open_photo(path)
    found, = [one for one in image.findings if one.code == "file.further-pictures"]
    assert image.signal.shape == pages[0].shape and found.severity is severity
    assert found.values["count"] == 1 and found.values["largest_width"] == pages[1].shape[1]
