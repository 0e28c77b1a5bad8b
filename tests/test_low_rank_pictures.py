"""Pictures of spectra as a few coefficients a pixel: what they cost is what they state."""
import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from sampling_cameras import response, surface
from shaded_images import CAMERA, LIGHT, shaded_image

from spectrabox.capture.photo.image_files import write_exr
from spectrabox.capture.photo.image_rows import PictureRows
from spectrabox.measure.pictures import pixel_spectra
from spectrabox.measure.pictures.pixel_spectra import KeptWavelengths, merge_surveys, survey_rows
from spectrabox.measure.pictures.spectra_files import PictureLayout
from spectrabox.measure.pictures.uplift import ImageSource, plan_image
from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior.low_rank import LowRank, stated_errors
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.session.commands.requests import UpliftRequest
from spectrabox.session.pictures.low_rank_files import open_low_rank
from spectrabox.session.pictures.row_tasks import load_plan, store_plan
from spectrabox.session.pictures.uplift import uplift_answer

zarr = pytest.importorskip("zarr", reason="Zarr is not installed: pip install 'spectrabox[zarr]'")
HEIGHT, WIDTH = 150, 70
PARTS = ("mean", "standard_deviation")


@pytest.fixture(scope="module", autouse=True)
def _few_surfaces():
    """A basis of fewer surfaces is made sooner, and tests hold for any."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("spectrabox.sampling.prior.low_rank.SURFACES", 300)
        yield


def picture(seed=0):
    return shaded_image(HEIGHT, WIDTH, seed)


def answer(folder, image, form, coefficients=12, *, full=False):
    folder.mkdir(exist_ok=True)
    write_exr(folder / "picture.exr", image, ["R", "G", "B"])
    request = UpliftRequest(image=folder / "picture.exr", out=folder / "out", sensitivity=CAMERA,
                            light=LIGHT, side=5, full=full, to=form, low_rank=coefficients)
    return uplift_answer(request, lambda *_: None)[0]


@pytest.fixture(scope="module")
def spectra(tmp_path_factory):
    """Mean and standard deviation of every pixel, as they are without a low rank."""
    facts = answer(tmp_path_factory.mktemp("all"), picture(), "zarr", None, full=True)
    mean, spread = (np.moveaxis(zarr.open_group(facts[name], mode="r")["0"][...], 0, 2)
                    for name in PARTS)
    return mean[..., ::2], spread[..., ::4]


@pytest.fixture(scope="module")
def low(tmp_path_factory):
    """What a picture of low rank holds, written as a group."""
    facts = answer(tmp_path_factory.mktemp("low"), picture(), "zarr")
    return open_low_rank(facts["low_rank"]), facts


@pytest.mark.parametrize("form", ["zarr", "exr", "tiled-exr"])
def test_what_is_read_is_off_by_what_is_stated(form, spectra, low, tmp_path):
    facts = answer(tmp_path, picture(), form)
    read = open_low_rank(facts["low_rank"])
    assert (read.height, read.width) == (HEIGHT, WIDTH)
    assert read.errors == facts["errors"] == low[1]["errors"]
    assert read.errors["pixels"] == HEIGHT * WIDTH      # few enough for all to be compared
    made = [np.concatenate(parts) for parts in zip(read.read(0, 67), read.read(67, HEIGHT),
                                                   strict=True)]
    for name, values, expected in zip(PARTS, made, spectra, strict=True):
        off, said = np.abs(values.astype(float) - expected), read.errors[name]
        # Stated upwards to three digits; single precision moves a value by 1e-6.
        assert 0.99 * said["rms"] - 1e-6 < np.sqrt(np.mean(off**2)) < said["rms"] + 1e-6
        assert 0.99 * said["largest"] - 1e-6 < off.max() < said["largest"] + 1e-6
        assert said["largest"] <= said["bound"]


def test_all_forms_hold_the_same_coefficients(low, tmp_path):
    expected = low[0].coefficients(0, HEIGHT)
    for form in ("exr", "tiled-exr"):
        read = open_low_rank(answer(tmp_path, picture(), form)["low_rank"])
        np.testing.assert_array_equal(read.coefficients(0, HEIGHT), expected)
        np.testing.assert_array_equal(read.low_rank.basis, low[0].low_rank.basis)


@pytest.mark.parametrize("rows", [1, 48])
def test_coefficients_do_not_depend_on_how_the_picture_is_cut(rows, low, tmp_path, monkeypatch):
    monkeypatch.setattr(pixel_spectra, "ROWS_PER_BLOCK", rows)
    monkeypatch.setattr(pixel_spectra, "PIXELS_AT_ONCE", 1)
    facts = answer(tmp_path, picture(), "zarr")
    read = open_low_rank(facts["low_rank"])
    np.testing.assert_array_equal(read.coefficients(0, HEIGHT), low[0].coefficients(0, HEIGHT))
    assert facts["errors"] == low[1]["errors"]


def test_the_basis_is_that_of_any_picture(low, tmp_path):
    other = open_low_rank(answer(tmp_path, picture(20)[:40], "zarr")["low_rank"])
    np.testing.assert_array_equal(other.low_rank.basis, low[0].low_rank.basis)


def test_more_coefficients_are_less_off(tmp_path):
    image = picture()[:20]
    errors = [answer(tmp_path, image, "zarr", count, full=True)["errors"] for count in (4, 8, 16)]
    for name in PARTS:
        rms = [each[name]["rms"] for each in errors]
        # 16 of 47 random axes would leave sqrt(31 / 43) = 0.85 of what 4 leave
        assert rms[0] > rms[1] > rms[2] and rms[2] < 0.5 * rms[0]


def test_viewers_show_the_colours_of_the_mean(tmp_path):
    image = picture()[:20]
    plain = answer(tmp_path / "plain", image, "exr", None)["mean"]
    low = answer(tmp_path / "low", image, "exr", 30, full=True)["low_rank"]
    shown = [np.asarray(oiio.ImageInput.open(path).read_image("float")) for path in (plain, low)]
    # Half floats of the one, and what 30 coefficients leave out of the other.
    np.testing.assert_allclose(shown[1][..., :3], shown[0][..., :3], atol=2e-3)


def test_others_find_arrays_and_names_in_the_group(low):
    group = zarr.open_group(low[1]["low_rank"], mode="r")
    names = ("coefficients", "mean_basis", "standard_deviation_basis")
    stored, basis, _ = (np.asarray(group[name][...]) for name in names)
    assert stored.dtype == np.float16 and stored.shape == (HEIGHT, WIDTH, 12)
    mean = basis[0] + stored[3].astype(np.float32) @ basis[1:]      # as its attribute says
    # the same sums in another order
    np.testing.assert_allclose(mean, low[0].read(3, 4)[0][0], atol=1e-6)
    assert group.attrs["mean_nm"] == PRIOR_GRID.nm[::2].tolist()
    assert group["coefficients"].metadata.dimension_names == ("y", "x", "component")


def source_of_bands(bands):
    signals = np.array([response(bands)[1] @ surface(PRIOR_GRID.nm, seed) for seed in range(12)])
    image = signals.reshape(3, 4, bands).astype(np.float32)
    rows = PictureRows(3, 4, bands, lambda first, last: image[first:last])
    return ImageSource(rows, np.ones(bands, np.float32), response(bands)[1], load_prior(), 0.01, 5)


@pytest.mark.parametrize("bands", [3, 5])
def test_pixels_that_are_computed_one_by_one_have_a_low_rank_too(bands):
    source, kept = source_of_bands(bands), KeptWavelengths(10)
    survey = merge_surveys([survey_rows(source, 0, 2), survey_rows(source, 2, 3)])
    plan = plan_image(source, kept, survey, 16)
    assert not plan.tables and plan.low_rank is not None
    block = source.block(0, 3)
    made = plan.low_rank.spectra(plan.values(source, block).astype(np.float16))
    off = np.abs(made[:, :31] - source.direct(block).mean[:, kept.mean]).max()
    assert plan.errors["pixels"] == 12 and "bound" not in plan.errors["mean"]
    # stated upwards to three digits
    assert 0.99 * plan.errors["mean"]["largest"] < off <= plan.errors["mean"]["largest"] + 1e-6


@pytest.mark.parametrize("coefficients", [None, 16])
def test_a_plan_of_many_bands_is_the_same_after_it_was_stored(monkeypatch, tmp_path, coefficients):
    monkeypatch.setattr(pixel_spectra, "MAX_CENTRES", 4)        # more than four pixels are many
    source, kept = source_of_bands(5), PictureLayout(10)
    plan = plan_image(source, kept, survey_rows(source, 0, 3), coefficients)
    assert len(plan.tables) == 1
    store_plan(tmp_path, plan, 2)
    loaded, outside = load_plan(tmp_path, kept)
    block = source.block(0, 3)
    assert outside == 2 and loaded.errors == plan.errors
    np.testing.assert_array_equal(loaded.values(source, block), plan.values(source, block))


def test_errors_are_stated_upwards():
    low = LowRank(np.array([[0.0, 0.0], [1.0, 0.0]], np.float32))
    made = stated_errors(low, np.array([[0.5, 0.12344]]), np.array([[0.5]]), 1, None)
    assert made == {"pixels": 1, "mean": {"rms": 0.0, "largest": 0.0},
                    "standard_deviation": {"rms": 0.124, "largest": 0.124}}


# ---- what is refused

@pytest.mark.parametrize("form, coefficients, message", [
    ("envi", 12, "ENVI images have no place for the basis"),
    ("exr", 2, "2 coefficients a pixel are not between 3 and the 47 numbers of its spectra"),
    ("exr", 47, "47 coefficients a pixel are not between 3")])
def test_a_low_rank_that_cannot_be_is_an_error(form, coefficients, message, tmp_path):
    with pytest.raises(InputError, match=message):
        answer(tmp_path, picture()[:4], form, coefficients)


def test_other_files_are_refused(tmp_path, low):
    image = picture()[:4]
    for path in (answer(tmp_path, image, form, None)["mean"] for form in ("exr", "zarr")):
        with pytest.raises(InputError, match=r"EXR with channels coeff|without the arrays"):
            open_low_rank(path)
    with pytest.raises(InputError, match="is no EXR with channels"):
        open_low_rank(tmp_path / "missing.exr")
    path = Path(answer(tmp_path, image, "zarr")["low_rank"])
    about = json.loads((path / "zarr.json").read_text())
    for change, message in (({"form": "another"}, "holds another form than"),
                            ({"mean_nm": [400]}, "parts that do not fit together"),
                            ({"errors": None, "mean_nm": "x"}, "cannot be read as a picture of")):
        (path / "zarr.json").write_text(json.dumps(
            about | {"attributes": about["attributes"] | change}), encoding="utf-8")
        with pytest.raises(InputError, match=message):
            open_low_rank(path)
