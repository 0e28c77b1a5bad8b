"""The numbers that paths are drawn from, and traces that are stopped, go on, and use any number of
cores.
"""
from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.radiometry.interreflection import exponents_up_to
from spectrabox.reconstruct.tracer import path_tracer, transport
from spectrabox.reconstruct.tracer.path_tracer import (
    GENERATOR,
    ShiftedLattice,
    Tracer,
    generating_vector,
)
from spectrabox.reconstruct.tracer.trace_checkpoint import trace_fingerprint
from spectrabox.reconstruct.tracer.transport import trace_transport
from spectrabox.reconstruct.transport_engine import unit_scene

from tests.cornell_problem import WIDTH, scene, view_of

pytestmark = pytest.mark.usefixtures("mitsuba")

HALVES = np.repeat([[0], [1]], WIDTH // 2, axis=0) * np.ones((1, WIDTH), int)


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    return unit_scene(view_of(scene(tmp_path_factory.mktemp("box"), max_depth=4)), 3)


@pytest.fixture
def short(monkeypatch):
    """Passes of few paths, so that a trace has many."""
    monkeypatch.setattr(path_tracer, "MAX_POINTS", 1 << 11)


def traced(box, **options):
    return trace_transport(box, HALVES, **({"spp": 32, "seed": 4} | options))


def test_each_coordinate_of_the_lattice_has_one_point_in_each_of_as_many_intervals(mitsuba):
    count = 1 << 10
    lattice = ShiftedLattice(70, 5, count)
    for dimension in (0, 1, 33, len(GENERATOR) - 1, len(GENERATOR), 69):
        coordinate = np.array(lattice.integer(mitsuba.UInt32(dimension)), dtype=np.uint64)
        shifted = (coordinate - np.uint64(coordinate[0])) % np.uint64(1 << 32)
        assert np.array_equal(np.sort(shifted >> np.uint64(22)), np.arange(count))


def test_generators_are_odd_so_that_no_coordinate_repeats():
    assert len(GENERATOR) == 67 and all(value % 2 for value in GENERATOR)
    assert (generating_vector(200) % 2 == 1).all() and np.unique(generating_vector(200)).size == 200


def test_the_lattice_s_integral_is_closer_than_independent_numbers(mitsuba):
    """Shifted rules are unbiased, and even: their error of a smooth integral is a small part of the
    independent one.
    """
    count = 1 << 12
    sums = []
    for seed in range(32):
        lattice = ShiftedLattice(4, seed, count)
        pairs = [np.array(lattice.pair(mitsuba.UInt32(first))).reshape(2, -1) for first in (0, 2)]
        sums.append(np.prod(np.concatenate(pairs), axis=0).mean())
    # The product of four uniform numbers has mean 1/16 and variance 1/81 - 1/256.
    independent = np.sqrt((1 / 81 - 1 / 256) / count)
    assert np.std(sums, ddof=1) < 0.25 * independent
    assert abs(np.mean(sums) - 1 / 16) < 4 * np.std(sums, ddof=1) / np.sqrt(32)


def test_any_number_of_cores_gives_the_same_bits(box, short):
    import drjit as dr

    tracer = Tracer(box, HALVES, exponents_up_to(3, 3))
    runs = []
    try:
        for cores in (1, 2, 3):
            dr.set_thread_count(cores)
            runs.append(tracer.trace(1 << 15, 8))
    finally:
        dr.set_thread_count(1)
    assert np.array_equal(runs[0], runs[1]) and np.array_equal(runs[0], runs[2])


@pytest.mark.parametrize("brightness", [1e-9, 1e9])
def test_contributions_are_counted_in_units_that_suit_the_light(box, brightness):
    """A signal in other units is the same signal: no rounding of a dim scene, no overflow of a
    bright one.
    """
    exponents = exponents_up_to(3, 3)
    signals = np.full((len(exponents), 1), 1.0)
    images = [transport.shaded_images(box, exponents, signals * factor, spp=16, seed=2) / factor
              for factor in (1.0, brightness)]
    # float32 products, and multiples of a unit 2^-30 of the trial's largest sum.
    np.testing.assert_allclose(images[0], images[1], rtol=1e-5, atol=1e-7 * images[0].max())


class Stop(Exception):
    pass


def stopping_after(parts):
    def progress(done):
        progress.left -= 1
        if not progress.left:
            raise Stop
    progress.left = parts
    return progress


@pytest.mark.parametrize("stops", [(1,), (5,), (2, 3, 4)])
def test_a_trace_that_was_stopped_goes_on_with_the_same_bits(box, short, tmp_path, stops):
    path = tmp_path / "results" / "trace.npz"
    whole = traced(box)
    for parts in stops:
        with pytest.raises(Stop):
            traced(box, checkpoint=path, progress=stopping_after(parts))
        assert path.exists()
    seen = []
    finished = traced(box, checkpoint=path, progress=seen.append)
    assert np.array_equal(finished.passes, whole.passes) and finished.spp == whole.spp
    assert len(seen) == 16 - sum(stops)  # what was done is not done again
    assert not list(path.parent.iterdir())


def test_the_checkpoint_of_another_trace_is_not_used(box, short, tmp_path):
    path = tmp_path / "trace.npz"
    with pytest.raises(Stop):
        traced(box, checkpoint=path, progress=stopping_after(3))
    seen = []
    other = traced(box, seed=5, checkpoint=path, progress=seen.append)
    assert len(seen) == 16 and np.array_equal(other.passes, traced(box, seed=5).passes)


def test_a_broken_checkpoint_is_not_used(box, short, tmp_path):
    path = tmp_path / "trace.npz"
    path.write_bytes(b"PK\x03\x04 cut short")
    assert np.array_equal(traced(box, checkpoint=path).passes, traced(box).passes)


def test_a_trace_is_another_where_any_of_its_inputs_is_another(monkeypatch, mitsuba):
    monkeypatch.setattr(mitsuba, "traverse", lambda scene: [("lamp.radiance", scene.radiance)])
    names = SimpleNamespace(id=lambda: "wall", bsdf=lambda: None)
    scene = SimpleNamespace(shapes=lambda: [names], radiance=np.ones(3))
    brighter = SimpleNamespace(shapes=lambda: [names], radiance=2 * np.ones(3))
    arrays = (np.zeros((2, 2)), np.arange(3.0), np.ones(2))
    made = {trace_fingerprint(scene, (1, "a"), arrays), trace_fingerprint(scene, (2, "a"), arrays),
            trace_fingerprint(brighter, (1, "a"), arrays),
            *(trace_fingerprint(scene, (1, "a"), tuple(
                array + (place == changed) for place, array in enumerate(arrays)))
              for changed in range(3))}
    assert len(made) == 6
    assert trace_fingerprint(scene, (1, "a"), tuple(map(np.copy, arrays))) in made
