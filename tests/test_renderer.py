"""The renderer against integrals done by hand, and against itself."""
from __future__ import annotations

import numpy as np
import pytest

from spectrabox.fixtures.cornell_box import cornell_box_xml
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.reconstruct.rendering.renderer import (
    CPU_VARIANT,
    load_scene,
    render,
    start_mitsuba,
)
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.scene.scene_xml import scene_xml

from tests.cornell_problem import GRID, TRUTH, camera

pytestmark = pytest.mark.usefixtures("mitsuba")

CURVES = camera().sensitivity.curves
SKY = """<scene version="3.0.0"><integrator type="path"/>
<sensor type="perspective"><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0,0,3" target="0,0,0" up="0,1,0"/></transform></sensor>
<emitter type="constant"><spectrum name="radiance" value="1"/></emitter></scene>"""


def exact_integral(a, b, nm=GRID.nm):
    """Integral of the product of two piecewise-linear curves: Simpson's rule is exact on every
    interval.
    """
    middle = (a[1:] + a[:-1]) * (b[1:] + b[:-1])
    return np.sum(np.diff(nm) / 6 * (a[:-1] * b[:-1] + middle + a[1:] * b[1:]))


def sky_signal(folder, light, spp=4096, passes=16):
    path = folder / "sky.xml"
    path.write_text(SKY, encoding="utf-8")
    xml = scene_xml(read_scene(path), reflectances={}, light=light,
                    bands=dict(zip("RGB", CURVES, strict=True)), range_nm=(400.0, 700.0),
                    size=(8, 8), integrator="path")
    image, variance = render(load_scene(xml), spp, 3, passes)
    return image.mean(axis=(0, 1)), np.sqrt(variance.mean(axis=(0, 1)) / 64)


LED = 0.05 + np.exp(-0.5 * ((GRID.nm - 460) / 15) ** 2)


@pytest.mark.parametrize("light", [np.ones(61), LED], ids=["flat", "led"])
def test_the_spectral_film_gives_the_integral_of_the_piecewise_linear_spectra(tmp_path, light):
    signal, error = sky_signal(tmp_path, light)
    expected = np.array([exact_integral(curve, light) for curve in CURVES])
    # 4.5 standard errors: 2e-5 for three bands; and 1e-4, the film's own float32 tables.
    np.testing.assert_array_less(np.abs(signal - expected), 4.5 * error + 1e-4 * expected)
    # The test could tell 0.996 from 1 in the strongest band.
    assert 4.5 * error[np.argmax(expected)] < 0.004 * expected.max() or not np.ptp(light)


def test_a_trapezoid_sum_over_coarse_samples_is_not_that_integral():
    coarse = np.array([np.sum(GRID.weights_nm * curve * LED) for curve in CURVES])
    exact = np.array([exact_integral(curve, LED) for curve in CURVES])
    # The product bends between the samples: this is why everything is integrated on a grid of 1 nm.
    assert np.abs(coarse / exact - 1).max() > 1e-3
    fine_nm = np.arange(400.0, 701.0)
    light_fine = np.interp(fine_nm, GRID.nm, LED)
    fine = np.array([np.trapezoid(np.interp(fine_nm, GRID.nm, curve) * light_fine,
                                  fine_nm) for curve in CURVES])
    # Five times finer: 25 times nearer, by the order of the rule.
    assert np.abs(fine / exact - 1).max() < np.abs(coarse / exact - 1).max() / 20


def box(folder, width=16):
    path = folder / "box.xml"
    path.write_text(cornell_box_xml(width), encoding="utf-8")
    return load_scene(scene_xml(read_scene(path), reflectances=TRUTH, light=np.ones(61),
                                size=(width, width), bands=dict(zip("RGB", CURVES, strict=True)),
                                range_nm=(400.0, 700.0)))


def test_the_same_seed_gives_the_same_picture_bit_for_bit(tmp_path):
    scene = box(tmp_path)
    first, variance = render(scene, 16, seed=5, passes=2)
    again, _ = render(scene, 16, seed=5, passes=2)
    other, _ = render(scene, 16, seed=9, passes=2)
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert np.all(variance >= 0) and np.isnan(render(scene, 4, seed=5)[1]).all()


def test_a_scene_that_mitsuba_cannot_load_is_an_input_error():
    with pytest.raises(InputError, match="Mitsuba cannot load the scene"):
        load_scene('<scene version="3.0.0"><shape type="sphere"><float name="radius" '
                   'value="wide"/></shape></scene>')


def test_auto_takes_no_gpu_even_where_there_is_one(mitsuba, monkeypatch):
    import drjit as dr

    monkeypatch.setattr(dr, "has_backend", lambda backend: True)
    assert start_mitsuba("auto").variant() == CPU_VARIANT


def test_a_device_that_is_not_there_is_said(mitsuba):
    import drjit as dr

    if dr.has_backend(dr.JitBackend.CUDA):
        pytest.skip("this machine has a CUDA device")
    with pytest.raises(EnvironmentProblem, match="no CUDA device can be used here"):
        start_mitsuba("cuda")
