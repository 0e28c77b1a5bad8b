"""Pictures of tiles and chunks: what is read and written does not depend on how they are cut."""
import json
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from flat_example import write_flat
from shaded_images import CAMERA, LIGHT, shaded_image, write_image

from spectrabox.capture.photo.image_rows import exr_rows, open_rows
from spectrabox.measure.pictures import pixel_spectra
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import UNFINISHED, sweep_unfinished, whole_folder
from spectrabox.radiometry.spectra.formats import zarr_array
from spectrabox.radiometry.spectra.formats.zarr_array import open_zarr, zarr_rows
from spectrabox.radiometry.system.strips import read_by_strips, written_by_strips
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.session.commands.requests import UpliftRequest
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages
from spectrabox.session.signals.uplift_answer import uplift_answer
from spectrabox.session.store.record_files import load_stage

zarr = pytest.importorskip("zarr", reason="Zarr is not installed: pip install 'spectrabox[zarr]'")
HEIGHT, WIDTH = 150, 90
NM = np.array([400.0, 500.0, 700.0])


@pytest.fixture(scope="module")
def image():
    return shaded_image(HEIGHT, WIDTH)


def write_zarr(path, image, chunks, **more):
    array = zarr.create_array(str(path), shape=image.shape, dtype=image.dtype, chunks=chunks,
                              **more)
    array[...] = image
    return path


def answer(folder, path, form):
    request = UpliftRequest(image=path, out=folder, sensitivity=CAMERA, light=LIGHT, side=5,
                            to=form)
    facts = uplift_answer(request, lambda *_: None)[0]
    return [stored(Path(facts[name])) for name in ("mean", "standard_deviation")]


def stored(path):
    if path.suffix == ".zarr":
        (height, _, _), read = open_rows(path)
        return read(0, height)
    return np.asarray(oiio.ImageInput.open(str(path)).read_image("half"))


INPUTS = {
    "tiles of 64": lambda path, image: write_image(path.with_suffix(".exr"), image, (64, 64)),
    "flat tiles": lambda path, image: write_image(path.with_suffix(".exr"), image, (16, 32)),
    "TIFF of tiles": lambda path, image: write_image(path.with_suffix(".tif"), image, (32, 16),
                                                       "float"),
    "Zarr": lambda path, image: write_zarr(path.with_suffix(".zarr"), image, (40, 40, 3)),
    "Zarr of one band a chunk": lambda path, image: write_zarr(
        path.with_suffix(".zarr"), image.astype(np.float16), (7, 90, 1)),
    "Zarr of shards": lambda path, image: write_zarr(path.with_suffix(".zarr"), image, (16, 8, 3),
                                                     shards=(32, 64, 3))}


@pytest.fixture(scope="module")
def of_scan_lines(image, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lines")
    return answer(folder / "out", write_image(folder / "picture.exr", image), "exr")


@pytest.mark.parametrize("form", INPUTS)
def test_the_result_does_not_depend_on_how_the_picture_is_cut(form, image, of_scan_lines, tmp_path):
    made = answer(tmp_path / "out", INPUTS[form](tmp_path / "picture", image), "exr")
    for values, others in zip(made, of_scan_lines, strict=True):
        np.testing.assert_array_equal(values, others)


@pytest.mark.parametrize("rows", [1, 48])
@pytest.mark.parametrize("form", ["tiled-exr", "zarr"])
def test_tiles_and_chunks_hold_what_scan_lines_hold(form, rows, image, of_scan_lines, tmp_path,
                                                    monkeypatch):
    monkeypatch.setattr(pixel_spectra, "ROWS_PER_BLOCK", rows)
    monkeypatch.setattr(pixel_spectra, "PIXELS_AT_ONCE", 1)
    monkeypatch.setattr(zarr_array, "CHUNK_PX", 32)
    monkeypatch.setattr(zarr_array, "CHUNKS_A_SHARD", 2)
    path = write_image(tmp_path / "picture.exr", image, (64, 64))
    mean, spread = answer(tmp_path / "out", path, form)
    colours = 3 if form == "zarr" else 0    # of viewers of EXR alone
    np.testing.assert_array_equal(mean, of_scan_lines[0][..., colours:])
    np.testing.assert_array_equal(spread, of_scan_lines[1])
    if form == "tiled-exr":
        spec = oiio.ImageInput.open(str(tmp_path / "out" / "mean.exr")).spec()
        assert (spec.tile_width, spec.tile_height) == (64, 64)
    else:
        group = zarr.open_group(str(tmp_path / "out" / "mean.zarr"), mode="r")
        assert group.attrs["wavelengths_nm"] == PRIOR_GRID.nm[::2].tolist()
        np.testing.assert_array_equal(np.moveaxis(group["0"][...], 0, 2), mean)


@pytest.fixture
def ome_image(tmp_path):
    """An OME-Zarr image of random reflectances, and these (H, W, P)."""
    path, values = tmp_path / "mean.zarr", np.random.default_rng(5).uniform(size=(150, 90, NM.size))
    with zarr_rows(path, 150, 90, NM, False, {}) as write:
        write(0, values.astype(np.float32))
    return path, values.astype(np.float32)


def test_an_ome_image_and_its_array_alone_are_read_back(ome_image):
    path, values = ome_image
    for folder in (path, path / "0"):
        np.testing.assert_array_equal(open_rows(folder)[1](0, 150), values)
        np.testing.assert_array_equal(open_rows(folder)[1](20, 131), values[20:131])


def test_ome_zarr_opens_it_with_wavelengths_as_channels(ome_image):
    """As napari's plugin does: channels by name, axes in the order of the specification."""
    reader = pytest.importorskip("ome_zarr.reader", reason="ome-zarr is not installed")
    from ome_zarr.io import parse_url
    path, values = ome_image
    node = next(iter(reader.Reader(parse_url(str(path)))()))
    assert node.metadata["channel_names"] == [f"{nm:g} nm" for nm in NM]
    assert [axis["name"] for axis in node.metadata["axes"]] == ["c", "y", "x"]
    np.testing.assert_array_equal(np.moveaxis(np.asarray(node.data[0]), 0, 2), values)


@pytest.mark.parametrize("change, words", [
    (lambda image: image["datasets"][0].update(path="../0"), "is no folder in it"),
    (lambda image: image["axes"].reverse(), "with the axes x, y, c; needed are rows")])
def test_an_ome_image_of_another_order_or_elsewhere_is_refused(change, words, ome_image):
    path, _ = ome_image
    about = json.loads((path / "zarr.json").read_text())
    change(about["attributes"]["ome"]["multiscales"][0])
    (path / "zarr.json").write_text(json.dumps(about))
    with pytest.raises(InputError, match=words):
        open_rows(path)


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
def test_integers_of_an_array_are_fractions_of_their_full_scale(kind, tmp_path):
    full = np.iinfo(kind).max
    image = np.full((4, 5, 3), full // 2, kind)
    _, read = open_rows(write_zarr(tmp_path / "a.zarr", image, (2, 2, 3)))
    np.testing.assert_array_equal(read(1, 3), np.float32(full // 2) / np.float32(full))


@pytest.mark.parametrize("height, band", [(10, 3), (9, 3), (2, 5), (1, 1)])
@pytest.mark.parametrize("step", [1, 2, 4, 100])
def test_rows_come_and_go_through_bands_unchanged(height, band, step):
    whole = np.random.default_rng(0).uniform(size=(height, 4, 2)).astype(np.float32)
    read, asked, written = [], [], []

    def read_band(first, last):
        read.append((first, last))
        return whole[first:last]

    rows = read_by_strips(read_band, height, band)
    with written_by_strips(lambda first, pixels: written.append((first, pixels.copy())),
                          whole.shape, band, whole.dtype) as write:
        for first in range(0, height, step):
            part = rows(first, min(first + step, height))
            asked.append(part)
            write(first, part)
    np.testing.assert_array_equal(np.concatenate(asked), whole)
    bands = [(first, min(first + band, height)) for first in range(0, height, band)]
    assert read == bands                    # each once
    assert [(first, first + len(pixels)) for first, pixels in written] == bands
    np.testing.assert_array_equal(np.concatenate([pixels for _, pixels in written]), whole)


# ---- what is refused

def test_codecs_that_may_run_code_are_refused(tmp_path, image):
    path = write_zarr(tmp_path / "a.zarr", image, (64, 64, 3))
    about = json.loads((path / "zarr.json").read_text())
    about["codecs"].insert(0, {"name": "numcodecs.pickle", "configuration": {}})
    (path / "zarr.json").write_text(json.dumps(about))
    with pytest.raises(InputError, match=r"encoded by numcodecs.pickle, which is not read"):
        open_zarr(path)
    inside = {"name": "sharding_indexed", "configuration": {"codecs": [{"name": "evil"}]}}
    (path / "zarr.json").write_text(json.dumps(about | {"codecs": [inside]}))
    with pytest.raises(InputError, match=r"encoded by evil, which is not read"):
        open_zarr(path)


@pytest.mark.parametrize("metadata, message", [
    (None, "no Zarr array of version 3"), ("{", "cannot be read as a Zarr array"),
    ("[]", "cannot be read as a Zarr array"), ("[" * 100_000, "cannot be read as a Zarr array"),
    ('{"node_type": "group", "zarr_format": 3}', "holds a group, not one array"),
    ('{"node_type": "array", "zarr_format": 3, "codecs": []}', "cannot be read as a Zarr array")])
def test_a_folder_that_is_no_array_is_one_sentence(tmp_path, metadata, message):
    (tmp_path / "a.zarr").mkdir()
    if metadata is not None:
        (tmp_path / "a.zarr" / "zarr.json").write_text(metadata, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        open_rows(tmp_path / "a.zarr")


@pytest.mark.parametrize("image, message", [
    (np.zeros((4, 4), np.float32), "needed are rows, columns and bands"),
    (np.zeros((4, 4, 3), bool), "needed are rows, columns and bands"),
    (np.zeros((4, 4, 2), np.float32), "at least 3 are needed")])
def test_an_array_of_another_shape_is_refused(tmp_path, image, message):
    with pytest.raises(InputError, match=message):
        open_rows(write_zarr(tmp_path / "a.zarr", image, image.shape))


def test_a_damaged_chunk_and_a_value_that_is_no_number_are_one_sentence(tmp_path, image):
    path = write_zarr(tmp_path / "a.zarr", image, (64, 64, 3))
    (path / "c" / "1" / "0" / "0").write_bytes(b"damaged")
    _, read = open_rows(path)
    read(0, 64)
    with pytest.raises(InputError, match=r"a.zarr cannot be read as a Zarr array"):
        read(64, 70)
    broken = image.copy()
    broken[3, 3, 1] = np.nan
    with pytest.raises(InputError, match=r"1 of 40500 values that are NaN"):
        open_rows(write_zarr(tmp_path / "b.zarr", broken, (150, 90, 3)))[1](0, 10)


def test_without_zarr_the_answer_is_what_to_install(tmp_path, monkeypatch, image):
    path = write_zarr(tmp_path / "a.zarr", image, (64, 64, 3))
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(EnvironmentProblem, match=r"pip install 'spectrabox\[zarr\]'"):
        open_rows(path)


def test_a_cut_tile_file_is_one_sentence(tmp_path, image):
    path = write_image(tmp_path / "a.tif", image, (32, 16), "float")
    path.write_bytes(path.read_bytes()[:20_000])
    with pytest.raises(InputError):
        _, read = open_rows(path)
        read(0, HEIGHT)


# ---- whole or not at all

@pytest.mark.parametrize("form", ["tiled-exr", "zarr"])
def test_a_picture_that_was_not_written_to_its_end_leaves_nothing(form, tmp_path):
    make = (zarr_rows(tmp_path / "a.zarr", 300, 8, NM, True, {}) if form == "zarr" else
            exr_rows(tmp_path / "a.exr", 300, 8, ["R", "G", "B"], True, tiles=True))
    with pytest.raises(ZeroDivisionError), make as write:
        write(0, np.zeros((200, 8, 3), np.float32))
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_replaced_whole(tmp_path):
    for number in range(2):
        with whole_folder(tmp_path / "a.zarr") as folder:
            folder.mkdir()
            (folder / str(number)).write_text("x", encoding="utf-8")
    assert [path.name for path in (tmp_path / "a.zarr").iterdir()] == ["1"]
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(EnvironmentProblem, match="file cannot be written: it is a file"), \
            whole_folder(tmp_path / "file"):
        pass
    (tmp_path / f"{UNFINISHED}999999999-aa.zarr").mkdir()
    sweep_unfinished(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.zarr", "file"]


def test_a_flat_session_keeps_its_picture_as_an_array(tmp_path):
    (tmp_path / "s").mkdir()
    folder = write_flat(tmp_path / "s", '[picture]\nrect = [250, 30, 330, 90]\nformat = "zarr"\n')
    config = read_session(folder)
    run_stages(config, device="cpu", only=None, force=False, progress=lambda *_: None)
    picture = folder / "results" / "picture"
    assert load_stage(folder / "results", "picture").damage is None
    array = zarr.open_array(str(picture / "mean.zarr" / "0"), mode="r")
    assert array.shape == (31, 30, 40) and np.isfinite(np.asarray(array[...])).all()
