"""Photos as phones and converters write them: linear DNG (ProRAW), lossy ones, JPEG, HEIC."""
import io
import json
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from spectrabox.capture.photo.image_files import require_linear_file
from spectrabox.capture.photo.linear import open_photo
from spectrabox.capture.photo.processed_photos import NotLinearError
from spectrabox.fixtures import dng
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.photos import PhotoKind

from tests.session_runs import call

BITS, WHITE, BLACK = 12, 60000, 2000
TABLE = np.linspace(0, 65535, 2**BITS).round().astype(int)      # DN of each stored value


def lossless_jpeg(pixels):
    """Pixels (H, W, 3) of ``BITS`` bits as a lossless JPEG (ITU-T T.81, Annex H; predictor 1)."""
    height, width, _ = pixels.shape
    values = pixels.astype(int)
    before = np.roll(values, 1, axis=1)
    before[1:, 0], before[0, 0] = values[:-1, 0], 2**(BITS - 1)
    words = []
    for difference in (values - before).ravel().tolist():
        size = abs(difference).bit_length()
        written = difference if difference > 0 else difference + 2**size - 1
        words.append(f"{size:05b}" + (f"{written:0{size}b}" if size else ""))
    bits = "".join(words)
    packed = int(bits + "1" * (-len(bits) % 8), 2).to_bytes(-(-len(bits) // 8), "big")
    # one Huffman table: 17 categories of 5 bits each
    table = b"\xff\xc4" + struct.pack(">HB", 2 + 17 + 17, 0) + bytes(
        [17 if length == 5 else 0 for length in range(1, 17)]) + bytes(range(17))
    frame = b"\xff\xc3" + struct.pack(">HBHHB", 17, BITS, height, width, 3) + b"".join(
        bytes([number, 0x11, 0]) for number in (1, 2, 3))
    scan = b"\xff\xda" + struct.pack(">HB", 12, 3) + b"".join(
        bytes([number, 0]) for number in (1, 2, 3)) + bytes([1, 0, 0])
    return b"\xff\xd8" + table + frame + scan + packed.replace(b"\xff", b"\xff\0") + b"\xff\xd9"


def write_phone_dng(path, shape, samples, compression, bits=BITS, table=TABLE):
    """A DNG as a phone lays it out: a preview, and full-colour pixels in a directory below."""
    preview = bytes(8 * 8 * 3)
    whole = dng._image_directory(shape, len(samples), bits, WHITE, "Apple", "iPhone 15 Pro", "", 1,
                                 "2026:01:02 03:04:05")
    pixels = {tag: value for tag, value in whole.items() if tag < 271 or tag in (277, 278, 279, 284,
                                                                                 50717)}
    pixels |= {259: ("short", [compression]), 262: ("short", [dng.LINEAR_RAW]), 273: ("long", [0]),
               50713: ("short", [1, 1]), 50714: ("long", [BLACK] * 3)}
    if table is not None:
        pixels[50712] = ("short", table.tolist())
    first = {tag: value for tag, value in whole.items() if tag in (271, 272, 274, 306, 50706, 50707,
                                                                   50708)}
    first |= {254: ("long", [1]), 256: ("long", [8]), 257: ("long", [8]), 258: ("short", [8] * 3),
              259: ("short", [1]), 262: ("short", [2]), 277: ("short", [3]), 278: ("long", [8]),
              279: ("long", [len(preview)]), 273: ("long", [0]), 330: ("long", [0]),
              33434: ("ratio", [0.01]),
              **dng._colour_directory(np.zeros(shape, np.uint16), "RGGB", dng.CAMERA_FROM_XYZ)}
    first[262] = ("short", [2])
    below = 8 + len(dng._directory_bytes(first, 8))
    strips = below + len(dng._directory_bytes(pixels, below))
    first |= {330: ("long", [below]), 273: ("long", [strips])}
    pixels[273] = ("long", [strips + len(preview)])
    path.write_bytes(struct.pack("<2sHL", b"II", 42, 8) + dng._directory_bytes(first, 8)
                     + dng._directory_bytes(pixels, below) + preview + samples)
    return path


@pytest.fixture
def stored():
    """Values (32, 48, 3) of 12 bits: a ramp with noise, a factor for each colour."""
    ramp = np.linspace(400, 3000, 48)[None, :, None] * np.array([0.8, 1.0, 0.7])
    noise = np.random.default_rng(1).normal(0, 12, (32, 48, 3))
    return np.clip(ramp + noise, 200, 3900).astype(np.uint16)


def test_the_pixels_of_a_proraw_are_read_through_its_linearisation_table(stored, tmp_path):
    photo = open_photo(write_phone_dng(tmp_path / "IMG_0001.DNG", stored.shape,
                                       lossless_jpeg(stored), 7))
    assert photo.kind is PhotoKind.LINEAR_FILE and photo.camera == "Apple iPhone 15 Pro"
    expected = (TABLE[stored] - BLACK) / (WHITE - BLACK)
    # single precision
    np.testing.assert_allclose(photo.signal, expected, atol=1e-6)


@pytest.mark.parametrize("compression, name", [(34892, "lossy compression"), (52546, "JPEG XL")])
def test_a_compression_that_is_not_read_is_refused_by_its_name(compression, name, stored, tmp_path):
    file = io.BytesIO()
    Image.fromarray((stored // 16).astype(np.uint8)).save(file, "JPEG")
    path = write_phone_dng(tmp_path / "a.dng", stored.shape, file.getvalue(), compression, 8, None)
    with pytest.raises(InputError, match=f"a.dng is a DNG .*{name}.*(convert|choose)"):
        open_photo(path)


def processed(folder, name):
    """A picture of a chart that nobody could calibrate with, of the format of its name."""
    path = folder / name
    starts = {".heic": b"\0\0\0\x18ftypheic\0\0\0\0mif1heic", ".webp": b"RIFF\x24\0\0\0WEBPVP8 ",
              ".avif": b"\0\0\0\x1cftypavif", ".gif": b"GIF89a"}
    if path.suffix in starts:
        path.write_bytes(starts[path.suffix] + zlib.compress(bytes(100)))
    else:
        Image.new("RGB", (64, 48), (90, 120, 60)).save(path)
    return path


@pytest.mark.parametrize("name, what", [
    ("a.jpg", "a JPEG"), ("a.png", "a PNG"), ("a.tif", "an 8-bit TIFF"), ("a.heic", "a HEIC"),
    ("a.webp", "a WebP"), ("a.avif", "an AVIF"), ("a.gif", "a GIF")])
def test_a_processed_photo_is_told_what_to_photograph_instead(name, what, tmp_path):
    path = processed(tmp_path, name)
    for read in (open_photo, require_linear_file):
        with pytest.raises(NotLinearError) as refused:
            read(path)
        said = str(refused.value)
        assert f"photo {name} is {what}, processed by the camera" in said
        assert "not proportional to light" in said and "ProRAW" in said and "Android" in said
        assert ("--not-linear" in said) == (path.suffix in (".jpg", ".png", ".tif"))
    ran = call("flat", path)
    assert ran.exit_code == 3 and "ProRAW" in ran.stderr and "Traceback" not in ran.output


def encoded_picture(path, **options):
    """The chart and paints of the flat examples, encoded as sRGB."""
    from tests.flat_example import picture
    light = np.clip(picture() / picture().max() * 0.9, 0, 1)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light**(1 / 2.4) - 0.055)
    Image.fromarray((255 * encoded).round().astype(np.uint8)).save(path, **options)
    return path


def test_a_picture_that_is_taken_all_the_same_is_never_a_pass(tmp_path):
    from tests.flat_example import rect_of
    path = encoded_picture(tmp_path / "a.png")
    region = "--region", "paint=" + ",".join(map(str, rect_of("red_wall")))
    assert call("flat", path, *region).exit_code == 3
    ran = call("flat", path, *region, "--not-linear", "--json")
    facts = json.loads(ran.stdout)
    assert facts["verdict"] in ("warn", "fail")
    assert "photo.not-linear" in {one["code"] for one in facts["findings"]}
    assert "not_linear = true" in (tmp_path / "a-flat" / "session.toml").read_text()
    assert call("flat", path, "--not-linear").exit_code == 0        # without a region, a look


def test_a_chart_on_a_jpeg_is_judged_as_a_photo_and_not_as_a_measurement(tmp_path):
    path = encoded_picture(tmp_path / "a.jpg", quality=92)
    facts = json.loads(call("chart", path, "--json").stdout)
    # what compression does to the noise of a patch is no dust, and no lack of light
    assert not {one["code"] for one in facts["findings"]} & {"chart.glints", "chart.black-noisy",
                                                             "chart.small"}
    assert facts["kind"] == "image processed by the camera, decoded as sRGB"
    said = call("chart", path).output
    assert " of 255, light even to" in said and "ProRAW" in said
    assert "taken as linear" not in said
