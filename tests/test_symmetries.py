"""What cannot matter does not: which way up a photo lies, how long it was exposed, and in which
order regions, photos and bands are given.
"""
from dataclasses import replace

import numpy as np
import pytest
from flat_example import CHART, PAINTS, picture, rect_of

import spectrabox as sb
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.fixtures import lamp
from spectrabox.fixtures.flat_sample import chart_corners
from spectrabox.fixtures.paints import NM, paint
from spectrabox.radiometry.interreflection import band_products, exponents_up_to
from spectrabox.reconstruct import transport_engine
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.tracer.transport import shaded_images

from tests.cornell_problem import TRUTH, camera, photo_of, plain_settings, scene, specs, view_of
from tests.session_runs import silent

LIGHT = (NM, lamp.radiance(NM))
NOISE = 0.01        # of a pixel, relative
KNOWN = {"white_wall": (NM, paint("white_wall")[1])}


@pytest.fixture(scope="module")
def photo():
    """A photo (H, W, 3) of a chart and four paints in uneven light."""
    light = picture()
    seen = 0.7 * light / light.max()
    return seen * (1 + NOISE * np.random.default_rng(7).standard_normal(seen.shape))


def outlines(turns, size):
    """Outlines of paints, and of the chart, in a photo of a size after quarter turns."""
    corners = {name: np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)
               for name, (x0, y0, x1, y1) in ((name, rect_of(name)) for name in PAINTS)}
    chart = chart_corners(*CHART) * size[1]
    for _ in range(turns):      # as numpy.rot90 turns: what was right is up
        corners = {name: np.c_[each[:, 1], size[1] - each[:, 0]] for name, each in corners.items()}
        chart = np.c_[chart[:, 1], size[1] - chart[:, 0]]
        size = size[::-1]
    return corners, chart


def measured(folder, photo, turns=0, names=tuple(PAINTS), **more):
    """Spectra of the paints in a photo, turned by quarters."""
    regions, chart = outlines(turns, photo.shape[:2])
    path = folder / f"turned_{turns}.exr"
    write_exr(path, np.rot90(photo, turns).astype(np.float32), "RGB")
    return sb.flat(path, {name: regions[name] for name in names},
                   **{"light": LIGHT, "corners": chart, "known": KNOWN, "draws": 1000} | more)


@pytest.fixture(scope="module")
def upright(photo, tmp_path_factory):
    return measured(tmp_path_factory.mktemp("upright"), photo)


def require_same(found, upright, share):
    """Signals and their errors that differ by no more than a share of the errors."""
    assert set(found) == set(upright) and found.verdict == upright.verdict
    one, other = found.signals, upright.signals
    assert set(one.errors) == set(other.errors)
    place = [one.names.index(name) for name in other.names]
    total = sum(other.errors.values())
    spread = np.sqrt(np.diagonal(total, axis1=1, axis2=2))
    assert np.all(np.abs(one.signal[place] - other.signal) <= share * spread)
    for cause, covariance in other.errors.items():
        assert np.all(np.abs(one.errors[cause][place] - covariance)
                      <= share * spread[:, :, None] * spread[:, None]), cause
    for name in other.names:
        assert found[name].band_width == pytest.approx(upright[name].band_width, rel=0.05)


@pytest.mark.parametrize("turns", [1, 2])
def test_a_photo_that_is_turned_shows_the_same(photo, upright, tmp_path, turns):
    # the noise of single pixels at the edges of patches and regions
    require_same(measured(tmp_path, photo, turns), upright, 0.05)


def test_a_photo_that_was_exposed_for_less_shows_the_same(photo, upright, tmp_path):
    # a file of 32 bits rounds to 24 digits
    require_same(measured(tmp_path, 0.37 * photo), upright, 1e-3)


def test_regions_may_come_in_any_order(photo, upright, tmp_path):
    require_same(measured(tmp_path, photo, names=tuple(PAINTS)[::-1]), upright, 1e-9)


# ---- scenes

BOUNCES = 3
SETTINGS = plain_settings(7, errors_from_scene=True)


@pytest.fixture(scope="module")
def box(mitsuba, tmp_path_factory):
    """A view of a box whose photo shows more light on the right than its scene says."""
    view = view_of(scene(tmp_path_factory.mktemp("box"), max_depth=BOUNCES + 1))
    exponents = exponents_up_to(len(TRUTH), BOUNCES)
    spectra = np.array([TRUTH[each.name] for each in specs()])
    signals = band_products(exponents, spectra, view.response)
    image, = shaded_images(transport_engine.unit_scene(view, BOUNCES), exponents, signals, spp=256,
                           seed=71)
    brighter = np.linspace(0.9, 1.1, image.shape[1])[None, :, None]
    return replace(view, photo=photo_of(image * brighter, (0.01 * image) ** 2 + 1e-10))


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(transport_engine, "MAX_SPP", 64)
    monkeypatch.setattr(transport_engine, "IMAGE_SPP", 64)


@pytest.fixture
def as_stated(box, quick):
    return reconstruct(box, SETTINGS, silent)


def require_same_fit(found, stated, materials, bands):
    """Signals and their errors; ``materials`` and ``bands`` say where those of one are in the
    other.
    """
    spread = np.sqrt(np.diagonal(stated.signal_covariance, axis1=1, axis2=2))
    scale = spread[:, :, None] * spread[:, None]
    np.testing.assert_allclose((found.signal[materials][:, bands] - stated.signal) / spread, 0,
                               atol=0.01)
    np.testing.assert_allclose(
        (found.signal_covariance[materials][:, bands][:, :, bands]
         - stated.signal_covariance) / scale, 0, atol=0.02)
    assert sorted(one.code for one in found.findings) == sorted(
        one.code for one in stated.findings)


def test_materials_of_a_scene_may_come_in_any_order(box, as_stated):
    turned = reconstruct(replace(box, materials=box.materials[::-1]), SETTINGS, silent)
    require_same_fit(turned, as_stated, [turned.materials.index(name)
                                         for name in as_stated.materials], [0, 1, 2])


def test_bands_of_a_scene_may_come_in_any_order(box, as_stated):
    turned, own = [2, 0, 1], camera()
    curves = replace(own.sensitivity, curves=own.sensitivity.curves[turned])
    photo = photo_of(box.photo.signal[..., turned], box.photo.variance[..., turned])
    found = reconstruct(replace(box, photo=photo, bands=tuple(box.bands[each] for each in turned),
                                calibration=replace(own, sensitivity=curves)), SETTINGS, silent)
    require_same_fit(found, as_stated, [0, 1, 2], np.argsort(turned))
