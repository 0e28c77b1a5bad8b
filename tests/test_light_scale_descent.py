"""The light's scale by descent through the renderer against the closed form and against the law of
a small sphere.
"""
import numpy as np
import pytest
from cornell_problem import GRID, camera

from spectrabox.fixtures.demo_photos import light_factor
from spectrabox.fixtures.demo_scenes import CHART_CM, chart_scene_xml
from spectrabox.radiometry.chart import chart_reflectances, patch_centres_uv, patch_size_uv
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.light_scale import scale_from_signals
from spectrabox.radiometry.response import response_matrix
from spectrabox.reconstruct.rendering.irradiance import patch_irradiance
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.scene.scene_file import read_scene

from benchmarks.light_scale_descent import chart_in_place, scale_by_descent

TRUE_SCALE, NOISE = 0.37, 0.01


@pytest.fixture(scope="module", autouse=True)
def mitsuba():
    return start_mitsuba("cpu")


def chart_scene(folder, change=lambda text: text):
    path = folder / "chart.xml"
    path.write_text(change(chart_scene_xml((60, 90))), encoding="utf-8")
    return read_scene(path)


def unscaled_signals(curves, light, reflectances):
    """Of the chart under the small sphere, by (R / d)^2 cos of Eq. 17: neither renderer nor
    ``patch_irradiance``.
    """
    centres_cm = (patch_centres_uv() - 0.5) * [1, -1] * CHART_CM
    return reflectances @ response_matrix(GRID, curves, light).T * light_factor(centres_cm)[:, None]


def test_descent_and_closed_form_agree_within_the_standard_error(tmp_path):
    curves, light = camera().sensitivity.curves, camera().light.values
    reflectances = chart_reflectances("BabelColor Average", GRID)
    measured = TRUE_SCALE * unscaled_signals(curves, light, reflectances)
    measured = measured * (1 + NOISE * np.random.default_rng(1).standard_normal(measured.shape))
    scene = chart_scene(tmp_path)
    irradiance = patch_irradiance(scene, patch_centres_uv(), patch_size_uv(), 1)
    predicted = reflectances @ response_matrix(GRID, curves,
                                               light).T * (irradiance / np.pi)[:, None]
    closed = scale_from_signals(measured, predicted, NOISE, "chart photo")
    descended = scale_by_descent(scene, patch_centres_uv(), patch_size_uv(), GRID, reflectances,
                                 light, curves, measured, NOISE, steps=80)
    assert abs(descended.value - closed.value) < closed.standard_error
    # The same parabola: its width differs by the noise of the rendering.
    assert descended.standard_error == pytest.approx(closed.standard_error, rel=0.1)
    # 1 % noise on 72 signals is a standard error of 0.12 %: 4 of them, a significance of 6e-5.
    assert abs(descended.value / TRUE_SCALE - 1) < 4 * NOISE / np.sqrt(72)


def test_the_rendered_patches_lie_where_the_printed_ones_do(tmp_path):
    turned = chart_in_place(chart_scene(tmp_path, lambda text: text.replace(
                                            '<scale x="14.5" y="10.15"/>', '<scale x="14.5" '
                                            'y="10.15"/><rotate x="1" angle="20"/><translate '
                                            'z="3"/>')), patch_centres_uv(), patch_size_uv())
    matrix = np.array(turned.root.find(".//shape[@id='patch_05']/transform/matrix").get(
                          "value").split(), float)
    centre = matrix.reshape(4, 4)[:3, 3]
    x, y = (patch_centres_uv()[5] - 0.5) * [1, -1] * CHART_CM  # bluish green, top right
    # Mitsuba holds matrices in single precision: 1e-7 x 15 cm.
    np.testing.assert_allclose(centre,
                               [x, y * np.cos(np.radians(20)), 3 + y * np.sin(np.radians(20))],
                               atol=1e-5)


def test_a_chart_scene_without_chart_or_light_is_refused(tmp_path):
    some = np.ones((24, 3))
    arguments = (patch_centres_uv(), patch_size_uv(), GRID, np.full((24, GRID.nm.size), 0.5),
                 camera().light.values, camera().sensitivity.curves, some, NOISE)
    with pytest.raises(InputError, match="no shape with the id 'chart'"):
        scale_by_descent(chart_scene(tmp_path, lambda text: text.replace('id="chart"',
                                                                         'id="card2"')), *arguments)
    with pytest.raises(InputError, match="no light reaches some patches"):
        scale_by_descent(chart_scene(tmp_path, lambda text: text.replace("-4, 10, 74",
                                                                         "-4, 10, -74")),
                         *arguments)
