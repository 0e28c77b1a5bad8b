"""The traced transport against Mitsuba's own renderings, by Z-tests, and against itself."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from scipy.stats import t as student

from spectrabox.fixtures.cornell_box import MATERIALS
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.interreflection import (
    band_products,
    exponents_up_to,
    product_count,
    signal,
)
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.rendering.renderer import load_scene, render
from spectrabox.reconstruct.scene.scene_xml import scene_xml
from spectrabox.reconstruct.tracer import transport
from spectrabox.reconstruct.tracer.transport import (
    images_of_signals,
    joined,
    require_memory,
    shaded_images,
    trace_transport,
)
from spectrabox.reconstruct.tracer.unit_scene import UnitScene
from spectrabox.reconstruct.transport_engine import unit_scene

from tests.cornell_problem import TRUTH, WIDTH, plain_settings, scene, view_of

pytestmark = pytest.mark.usefixtures("mitsuba")

SIZE = (WIDTH, WIDTH)
ALL = np.arange(WIDTH * WIDTH).reshape(WIDTH, WIDTH)
SPECTRA = np.array([TRUTH[name] for name in MATERIALS])


@pytest.fixture(scope="module")
def view(tmp_path_factory):
    return view_of(scene(tmp_path_factory.mktemp("box"), max_depth=5))


def traced(view, region=ALL, spp=64, seed=1, bounces=4, **options):
    unit = unit_scene(view, bounces, options.pop("separate_lights", False))
    return trace_transport(unit, region, spp=spp, seed=seed, **options)


def blocks(image, side=4):
    return image.reshape(WIDTH // side, side, WIDTH // side, side, -1).mean(axis=(1, 3))


def test_the_transport_shows_the_picture_of_mitsuba_s_spectral_film(view):
    """Z-test of 64 blocks and three bands at the 1 % level, Sidak-corrected, with the scatter of 12
    runs of each.
    """
    xml = view.xml(dict(zip(MATERIALS, SPECTRA, strict=True)), integrator="path")
    film = load_scene(xml)
    theirs = np.array([blocks(render(film, 64, 100 + run)[0]) for run in range(12)])
    runs = [traced(view, seed=run, passes=1) for run in range(12)]
    ours = np.array([blocks(signal(run.coefficients, run.exponents, SPECTRA,
                                   view.response).reshape(*SIZE, 3))
                     for run in runs])
    difference = ours.mean(axis=0) - theirs.mean(axis=0)
    z = difference / np.sqrt((ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / 12)
    # t of about 22 degrees of freedom has wider tails than the normal law: its quantile here is
    # 4.9, the normal's 4.1.
    level = 1 - (1 - 0.01) ** (1 / z.size)
    assert np.abs(z).max() < norm.isf(level / 2) * 1.2


def test_a_region_receives_the_mean_of_its_pixels(view):
    """Other paths, so a Z-test of the four regions at the 1 % level, with the scatter of 16 passes
    of each.
    """
    region = np.repeat(np.repeat(np.arange(4).reshape(2, 2), WIDTH // 2, axis=0), WIDTH // 2,
                       axis=1)
    grey = 0.5 ** exponents_up_to(3, 4).sum(axis=1)
    pixels, regions = (traced(view, where, passes=16).passes[:, :, 0] @ grey
                       for where in (ALL, region))
    means = pixels.reshape(16, 2, WIDTH // 2, 2, WIDTH // 2).mean(axis=(2, 4)).reshape(16, 4)
    z = (regions.mean(axis=0) - means.mean(axis=0)) / np.sqrt((regions.var(axis=0, ddof=1)
                                                               + means.var(axis=0, ddof=1)) / 16)
    assert np.abs(z).max() < student.isf(0.01 / 2 / 4, 30)


def test_the_same_seed_gives_the_same_paths(view):
    first, again, other = (traced(view, seed=seed, spp=8).coefficients for seed in (3, 3, 4))
    # Atomic float32 sums may round in another order; other paths differ by far more.
    np.testing.assert_allclose(first, again, rtol=1e-4, atol=1e-6 * first.max())
    assert np.abs(first - other).max() > 0.1 * first.max()


def test_one_bounce_is_linear_and_more_bounces_only_add_light(view):
    one, four = traced(view, bounces=1, seed=2), traced(view, bounces=4, seed=2)
    assert one.exponents.sum(axis=1).max() == 1 and len(four.exponents) == len(exponents_up_to(3,
                                                                                               4))
    direct = four.coefficients[:, four.exponents.sum(axis=1) == 1]
    lit = one.coefficients[:, 1:].sum()
    # Direct light by the same estimator with other random numbers: 0.3 % of noise in each sum over
    # the picture.
    assert direct.sum() == pytest.approx(lit, rel=0.02)
    assert (four.passes >= 0).all() and four.coefficients.sum() > 1.2 * lit


def test_the_shaded_image_is_the_transport_with_signals_put_in(view):
    exponents = exponents_up_to(3, 4)
    signals = band_products(exponents, SPECTRA, view.response)
    image, = shaded_images(unit_scene(view, 4), exponents, signals, spp=256, seed=5)
    plain = traced(view, spp=256, seed=6)
    other = signal(plain.coefficients, plain.exponents, SPECTRA,
                   view.response).reshape(image.shape)
    # Two renderings of 260 000 paths, each mean good to 0.4 %: five standard deviations of their
    # difference.
    np.testing.assert_allclose(image.mean(axis=(0, 1)), other.mean(axis=(0, 1)), rtol=0.03)


def test_one_trace_gives_the_images_of_any_signals(view, monkeypatch):
    exponents = exponents_up_to(3, 4)
    box = unit_scene(view, 4)
    images = images_of_signals(box, exponents, spp=16, seed=5, passes=2)
    for reflectance in (SPECTRA, 0.5 * SPECTRA):
        signals = band_products(exponents, reflectance, view.response)
        shaded = shaded_images(box, exponents, signals, spp=16, seed=5, passes=2)
        # The same paths, their contributions rounded before or after the signals: float32.
        np.testing.assert_allclose(images(signals), shaded, rtol=1e-5, atol=1e-6 * shaded.max())
    monkeypatch.setattr(transport, "MAX_IMAGE_COEFFICIENTS", 0)
    again = images_of_signals(box, exponents, spp=16, seed=5, passes=2)
    np.testing.assert_array_equal(again(signals), shaded)


def test_lights_traced_separately_add_up(tmp_path):
    text = scene_with_two_lamps()
    two = view_of(scene(tmp_path, text))
    separate = traced(two, separate_lights=True, seed=9)
    together = traced(two, seed=9)
    both = separate.coefficients.reshape(ALL.size, 2, -1)
    assert (both.sum(axis=(0, 2)) > 0).all()
    # The same paths, counted into two columns or one.
    np.testing.assert_allclose(both.sum(axis=1), together.coefficients, rtol=1e-3,
                               atol=1e-5 * together.coefficients.max())


def scene_with_two_lamps():
    from spectrabox.fixtures.cornell_box import cornell_box_xml
    bulb = ('<emitter type="point" id="bulb"><point name="position" value="0.3, 0, 0.8"/>'
            '<spectrum name="intensity" value="0.5"/></emitter></scene>')
    return cornell_box_xml(WIDTH, 4).replace("</scene>", bulb)


def test_two_traces_join_to_one_of_more_paths(view):
    first, second = traced(view, spp=16, seed=1), traced(view, spp=48, seed=2)
    whole = joined(first, second)
    assert whole.spp == 16 + 64
    # float32 weights of a fifth and four fifths; 48 paths per pixel become 64, a power of two in
    # each pass.
    np.testing.assert_allclose(whole.coefficients, (first.coefficients + 4 * second.coefficients)
                               / 5, rtol=1e-5, atol=1e-7)


def test_many_products_are_pruned_within_the_stated_bound(view, monkeypatch):
    monkeypatch.setattr(transport, "PRUNE_ABOVE", 10)
    result = traced(view, spp=16)
    assert len(result.exponents) < len(exponents_up_to(3, 4)) or result.dropped == 0
    # What is lost is judged by other paths than those that picked: a little more than they saw.
    assert 0 <= result.dropped <= 2 * transport.DROPPED[0]


def test_a_transport_that_does_not_fit_into_memory_is_refused_beforehand():
    with pytest.raises(InputError, match=r"of 100000 regions and 1287 products .* needs 6\.7 GiB, "
                                         r"more than the 2"):
        require_memory(100_000, 1287, 4, 5, 8)
    # as many blocks as there are, 8 materials, 8 bounces, nothing pruned
    require_memory(1024, 12870, 4, 8, 8)


def test_eight_materials_and_eight_bounces_are_pruned_to_what_is_worth_its_memory(tmp_path):
    """12870 products become few, and what other paths find in the dropped ones is what the pruning
    says.
    """
    names = tuple(f"m{number}" for number in range(8))
    text = eight_materials(names)
    many = load_scene(scene_xml(scene(tmp_path, text),
                                reflectances=dict.fromkeys(names, np.ones(2)), light=np.ones(2),
                                bands={"one": np.ones(2)}, range_nm=(400.0, 700.0), size=SIZE))
    unit = UnitScene(many, {name: name for name in names}, SIZE, 8)
    whole_picture = np.zeros_like(ALL)
    result = trace_transport(unit, whole_picture, spp=64, seed=3)
    assert product_count(8, 8) == 12870 and len(result.exponents) < 10000
    assert transport.DROPPED[0] / 2 < result.dropped < 1e-3
    whole = trace_transport(unit, whole_picture, spp=256, seed=4, exponents=exponents_up_to(8, 8))
    kept = {tuple(row) for row in result.exponents.tolist()}
    bright = whole.coefficients[0] * transport.BRIGHTEST ** whole.exponents.sum(axis=1)
    lost = sum(value for row, value in zip(whole.exponents.tolist(), bright, strict=True)
               if tuple(row) not in kept)
    # Two estimates from 500 000 and 260 000 paths, of which a few hundred end in the dropped
    # products.
    assert lost / bright.sum() == pytest.approx(result.dropped, rel=0.4)


def eight_materials(names):
    """The box with a material for each wall and block, and an eighth on a board in front of the
    back wall.
    """
    from spectrabox.fixtures.cornell_box import cornell_box_xml
    text = cornell_box_xml(WIDTH, 9)
    start, end = text.index("    <bsdf"), text.index('    <shape type="rectangle" id="floor">')
    walls = text[end:].split('<ref id="')
    worn = walls[0] + "".join(f'<ref id="{name}{part[part.index(chr(34)):]}'
                              for name, part in zip(names, walls[1:], strict=False))
    board = ('<shape type="rectangle" id="board"><ref id="m7"/><transform name="to_world"><scale '
             'value="0.3"/><translate y="0.5" z="-0.95"/></transform></shape></scene>')
    bsdfs = "".join(f'<bsdf type="diffuse" id="{name}"><spectrum name="reflectance" '
                    'value="0.5"/></bsdf>'
                    for name in names)
    return text[:start] + bsdfs + worn.replace("</scene>", board)


def test_a_surface_without_a_material_is_refused(view):
    with pytest.raises(InputError, match="the scene's BSDF 'red' has no material"):
        trace_transport(replace(unit_scene(view, 2), material_of_bsdf={"white": "white",
                                                                        "green": "green"}),
                        ALL, spp=4, seed=1)


def test_a_coated_surface_is_sent_to_the_gradient_engine(tmp_path):
    from spectrabox.fixtures.cornell_box import cornell_box_xml
    text = cornell_box_xml(WIDTH).replace('<bsdf type="diffuse" id="red"><spectrum '
                                          'name="reflectance" value="0.5"/>',
                                          '<bsdf type="roughplastic" id="red">')
    with pytest.raises(InputError,
                       match=r"red of box\.xml is coated or glossy.*engine = \"gradient\""):
        reconstruct(view_of(scene(tmp_path, text)), plain_settings(7), lambda done, what: None)
