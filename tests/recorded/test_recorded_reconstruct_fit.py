"""Recorded: agreement, misfit, equations, priors, nodes and meshes of a reconstruction."""
import dataclasses

import numpy as np
import views_by_hand as hand
from recorded_refusals import said

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.records import SurfaceAgreement
from spectrabox.reconstruct import agreement as agree
from spectrabox.reconstruct.engines.gradient import (
    cosine_rate,
    outcome_of,
    reflectance_key,
    stalled,
)
from spectrabox.reconstruct.fit.band_system import compress, huber_weight
from spectrabox.reconstruct.fit.identifiability import (
    band_signals,
    identifiability,
    sentences,
)
from spectrabox.reconstruct.fit.spectrum_prior import (
    greville_abscissae,
    learnt_prior,
    smooth_prior,
    smoothness_precision,
    spectrum_prior,
)
from spectrabox.reconstruct.fit.transport_fit import fit_views
from spectrabox.reconstruct.fit.view_terms import Nuisances, SpectrumModel, ViewFit, ViewTerms
from spectrabox.reconstruct.misfit import SurfaceTest, holm, surface_misfits, surface_tests
from spectrabox.reconstruct.pixels.light_nodes import LightNodes
from spectrabox.reconstruct.pixels.pixel_light import PixelLight, _nodes
from spectrabox.reconstruct.scene.light_position import (
    DEFAULTS,
    PositionSettings,
    _nuisance,
    _solve,
    _whitening,
)
from spectrabox.reconstruct.scene.regions import block_regions, region_means
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.shape.mesh import icosphere, large_steps, subdivided
from spectrabox.reconstruct.shape.shape import ShapeSettings
from spectrabox.reconstruct.tracer import trace_checkpoint, transport
from spectrabox.reconstruct.tracer.path_samples import generating_vector
from spectrabox.reconstruct.tracer.trace_checkpoint import PassSums, TraceCheckpoint
from spectrabox.reconstruct.tracer.transport import TracedTransport, joined

SURFACE = hand.surface_picture()


def pictures(seed=1, noise=0.01, passes=2):
    """A photo, its renderings and what is used of them."""
    rng = np.random.default_rng(seed)
    smooth = 0.3 + 0.2 * rng.uniform(size=(7, 3))[np.maximum(SURFACE, 0)]
    row, column = np.indices(SURFACE.shape)
    smooth = smooth * (1 + 0.01 * row + 0.004 * column)[..., None]
    gains = np.exp(0.02 * rng.standard_normal((7, 3)))[np.maximum(SURFACE, 0)]
    pattern = np.exp(0.02 * np.sin(row / 3 + column / 5))[..., None]
    photo = hand.photo_of(smooth * gains * pattern, rng, noise)
    renderings = smooth * (1 + 0.006 * rng.standard_normal((passes, *smooth.shape)))
    used = (SURFACE >= 0) & (rng.uniform(size=SURFACE.shape) > 0.05)
    return photo, renderings, used


NAMES = ("floor", "ceiling", "back", "left", "right", "small", "large")
PAINTS = ("white", "white", "white", "green", "red", "red", "grey")


def test_usable_pixels(recorded):
    photo, _, _ = pictures()
    signal = photo.signal.copy()
    signal[0, :5] = 1e-4 * np.percentile(signal, 99, axis=(0, 1)) * np.array(
        [0.97, 0.99, 1.01, 1.03, 2])[:, None]
    recorded(agree.usable_pixels(dataclasses.replace(photo, signal=signal), SURFACE))
    steps = {}
    for step in np.linspace(0.5, 0.7, 21):      # (max - min) / mean of nine about a middle
        patch = np.ones((5, 5, 3))
        patch[2, 2] = 1 + step
        found = agree.usable_pixels(dataclasses.replace(
            photo, signal=patch, variance=patch, saturated=patch > 9), np.zeros((5, 5), int))
        steps[f"{step:.2f}"] = found.astype(int)[1:4, 1:4]
    recorded(steps, case="edges")


def test_agreement_of_surfaces(recorded):
    photo, renderings, used = pictures()
    found = agree.surface_agreement(NAMES, PAINTS, photo, renderings, SURFACE, used)
    one = agree.surface_agreement(NAMES, PAINTS, photo, renderings[:1], SURFACE, used)
    three = agree.surface_agreement(NAMES, PAINTS, photo, pictures(passes=3)[1], SURFACE, used)
    dark = renderings * np.where(SURFACE == 2, 1e-6, 1)[..., None]
    none = agree.surface_agreement(NAMES, PAINTS, photo, renderings, SURFACE, used & False)
    recorded({"two": found, "one": one, "three": three, "none": none, "dark": agree.
              surface_agreement(NAMES, PAINTS, photo, dark, SURFACE, used & (SURFACE != 0)).names})
    known = frozenset({"grey"})
    recorded({
        "between": [agree.surface_covariance(found, known, error) for error in (0.0, 0.02)],
        "errors": [agree.scene_errors(found, each, 40) for each in (known, frozenset(PAINTS))],
        "apart": agree.scene_errors(dataclasses.replace(found, materials=tuple(found.names)),
                                    frozenset(), 40),
        "model": {name: agree.model_covariance(found, name, known, 0.02)
                  for name in ("white", "green", "red", "grey", "none")},
        "blocks": [agree.within_to_block(*pair) for pair in ((40, 7), (300, 7), (34, 7), (36, 7))],
        "few": [agree.covariance_from_few(1e-4 * np.array([[4.0, 1, 0.5], [1, 2, -0.3],
                                                           [0.5, -0.3, 1]]), freedom, 0.013)
                for freedom in (0, 1, 2, 5, 40)]}, case="errors")
    known_surface = np.where(used & np.isin(SURFACE, (1, 6)), SURFACE, -1)
    recorded(agree.scale_from_surfaces(photo.signal.astype(float), renderings[0], known_surface,
                                       "known"), case="scale")


def test_shifts_of_photos(recorded):
    rng = np.random.default_rng(3)
    still = np.kron(rng.uniform(0.2, 1, (6, 8)), np.ones((5, 5)))[..., None] * [1.0, 0.8, 0.6]
    found = {}
    for across, down in ((0.0, 0), (0.45, 0), (0.55, 0), (0.4, 0.4), (-3, 2), (0, -4), (19, 3)):
        shift = np.exp(-2j * np.pi * (np.fft.fftfreq(30)[:, None] * down
                                      + np.fft.fftfreq(40) * across))
        moved = np.fft.ifft2(np.fft.fft2(still, axes=(0, 1)) * shift[..., None], axes=(0, 1)).real
        found[f"{across} {down}"] = (agree.edge_shift(moved, still)[0],
                                     agree.shift_sentence(moved, still))
    recorded(found)
    moved = np.roll(still, (2, -3), axis=(0, 1))
    sure = {f"{share:.3f}": agree.shift_sentence(
        share * moved + (1 - share) * still + 0.3 * rng.uniform(size=still.shape), still)
        for share in np.linspace(0.4, 0.75, 36)}
    recorded(sure, case="sure")
    noisy = {f"{noise:.2f}": agree.shift_sentence(
        moved + noise * rng.uniform(size=still.shape), still) for noise in np.linspace(0.2, 2, 37)}
    recorded(noisy, case="noisy")
    assert {bool(each) for each in (*sure.values(), *noisy.values())} == {True, False}
    recorded(agree.shift_sentence(np.ones((9, 9, 3)), np.ones((9, 9, 3))), case="flat")


def test_misfits_of_surfaces(recorded):
    photo, renderings, used = pictures(noise=0.004)
    measured, rendered = photo.signal.astype(float), renderings.mean(axis=0)
    measured[3:9, 23:] *= 1.35
    measured[SURFACE == 5] *= [0.8, 1.0, 1.0]
    used = used & ~((SURFACE == 6) & (np.indices(SURFACE.shape)[0] > 8))
    tests = surface_tests(NAMES, measured, rendered, SURFACE, used, 0.013)
    recorded(tests)
    recorded({"misfits": surface_misfits(tests, "RGB"), "fits": [test.fits for test in tests],
              "no error": surface_tests(NAMES[:2], rendered, rendered, SURFACE, used, 0.0),
              "dark": [surface_tests(NAMES[:2], measured, rendered * np.array(bands), SURFACE, used,
                                     0.01) for bands in ([0, 0, 0], [1, 0, 1])]},
             case="misfits")
    recorded({"holm": holm(np.array([0.2, 1e-4, 0.04, 0.03, 0.9, 1e-9])),
              "verdicts": {f"{adjusted} {deviation}": SurfaceTest(
                  "a", 0, "level", deviation, 0.01, 0.1, adjusted, 0.0).fits
                  for adjusted in (0.0097, 0.01, 0.0103)
                  for deviation in (0.1, -0.1, 0.0049, -0.0049, 0.0051, -0.0051)}}, case="holm")
    few = {}
    for pixels in (11, 12, 13):
        mask = np.zeros(SURFACE.shape, bool)
        mask[16, :pixels] = True
        few[f"{pixels}"] = len(surface_tests(NAMES, measured, rendered, SURFACE, mask, 0.01))
    recorded(few, case="few")


def test_sentences_of_misfits(recorded):
    rows = [("wall", 2, "level", -0.12, 0.01, 1e-9, 3e-8, -0.2), ("wall", 0, "level", 0.3, 0.02,
                                                                  1e-5, 2e-5, 0.05),
            ("wall", 1, "shape", 0.07, 0.02, 1e-4, 1e-4, 0.4), ("wall", 2, "shape", 0.02, 0.02,
                                                                0.2, 0.9, -0.3),
            ("floor", 1, "shape", 0.06, 0.02, 1e-4, 2e-3, 0.01), ("top", 1, "level", 0.04, 0.003,
                                                                  1e-4, 2e-3, 0.0),
            ("back", 1, "level", 0.06, 0.02, 0.5, 1.0, 0.0)]
    recorded(surface_misfits([SurfaceTest(*row) for row in rows], "RGB"))


def test_regions(recorded):
    image = np.random.default_rng(1).uniform(size=(*SURFACE.shape, 3))
    used = (SURFACE >= 0) & (image[..., 0] > 0.1)
    region, group = block_regions(SURFACE, used)
    recorded({"region": region, "group": group, "means": region_means(image, region),
              "grey": region_means(image[..., 1], region)})
    wide = np.add.outer(np.arange(150) // 80, np.arange(190) // 100)
    whole, surfaces = block_regions(wide, wide >= 0)
    recorded({"wide": whole, "surfaces": surfaces}, case="wide")


def _equations(seed=4):
    rng = np.random.default_rng(seed)
    group = np.repeat([0, 1, 3], [30, 6, 25])
    rows = rng.uniform(0.1, 1, (61, 10)) * 0.5 ** np.arange(10)
    weight = rng.uniform(50, 200, (61, 1)) * np.array([1.0, 2.0, 0.7])[None] * rng.uniform(
        0.9, 1.1, (61, 3))
    weight[[5, 40]] = 0
    deviations = 0.02 * rng.standard_normal((4, 61, 10)) * rows
    return rows, rng.uniform(0.2, 0.9, (61, 3)), weight, group, deviations


def test_equations_made_small(recorded):
    rows, measured, weight, group, deviations = _equations()
    for name, system in (("with noise", compress(rows, measured, weight, group, deviations)),
                         ("without", compress(rows, measured, weight, group))):
        # of triangular factors the signs are free: what they give is not
        recorded({"rows": system.rows.T @ (system.root[:, :1] ** 2 * system.rows),
                  "target": system.rows.T @ (system.root**2 * system.target),
                  "groups": (system.group, system.noise_group), "roots": (system.root,
                                                                          system.noise_root),
                  "noise": system.noise.T @ (system.noise_root[:, 1:2] ** 2 * system.noise)},
                 case=name)
    residual = np.random.default_rng(2).normal(size=(9, 3))
    recorded({"huber": huber_weight(4 * residual, np.full((9, 3), 0.9)),
              "none": said(lambda: compress(rows, measured, 0 * weight, group)),
              "edge": huber_weight(np.array([[2.97, 0.1], [-3.03, 0.1]]), np.ones((2, 2)))},
             case="huber")


def test_priors_on_spectra(recorded):
    basis = basis_matrix(hand.NM, 6)
    mean = np.linspace(0.2, 0.6, hand.NM.size)
    spread = 0.04 * np.exp(-np.abs(np.subtract.outer(hand.NM, hand.NM)) / 70)
    settings = InversionSettings(6, learnt=hand.LEARNT, smoothness=0.4)
    other = dataclasses.replace(hand.LEARNT, mean=hand.LEARNT.mean / 2)
    recorded({"greville": [greville_abscissae(count) for count in (4, 7)],
              "precision": [smoothness_precision(count, 0.3) for count in (4, 6, 9)],
              "smooth": smooth_prior(5, 0.2), "learnt": learnt_prior(basis, mean, spread),
              "chosen": {name: spectrum_prior(dataclasses.replace(settings, spectrum_prior=name),
                                              hand.GRID) for name in ("learnt", "smooth", "none")},
              "of a family": spectrum_prior(settings, hand.GRID, other),
              "unknown": said(lambda: spectrum_prior(InversionSettings(
                  spectrum_prior="flat"), hand.GRID)),
              "no data": said(lambda: spectrum_prior(InversionSettings(), hand.GRID))})
    # a straight spectrum is as smooth as any
    line = greville_abscissae(9)
    np.testing.assert_allclose((smoothness_precision(9, 0.3) - np.eye(9)) @ line, 0, atol=1e-9)


def test_fits_and_what_decides_them(recorded):
    rows, _, weight, group, deviations = _equations()
    exponents = hand.exponents_up_to(2, 3)
    rng = np.random.default_rng(7)
    response = rng.uniform(0.1, 1, (1, 3, hand.NM.size)) / hand.NM.size
    basis = basis_matrix(hand.NM, 5)
    model = SpectrumModel(exponents, response, basis, {})
    truth = rng.uniform(0.1, 0.9, (2, 5))
    measured = 2.0 * rows @ model.signals(truth) * (1 + 0.01 * rng.standard_normal((61, 3)))
    terms = ViewTerms(compress(rows, measured, 400 * weight, group, deviations), model,
                      Nuisances(None, 0.01, 0.02, 0.03, 0.01))
    fit = fit_views([terms], [(0, 1)], [smooth_prior(5, 0.05)] * 2)
    operator = response[0] @ basis / response[0].sum(axis=1)[:, None]
    decided = identifiability(fit, ("one", "two"), operator)
    recorded({"fit": dataclasses.replace(fit, cost_history=fit.cost_history[:2]),
              "signals": band_signals(fit, operator, 2), "sentences": sentences(decided),
              "decided": [(each.by_photo, each.by_colour, each.by_interreflection, each.by_prior)
                          for each in decided], "ratio": [each.ratio for each in decided],
              "twice": band_signals(fit, np.vstack([operator, operator[:1]]), 2)}, rtol=1e-4)
    held = fit_views([ViewTerms(terms.system, SpectrumModel(exponents, response, basis, {
        0: truth[0] @ basis.T}), Nuisances(2.0))], [(0,)], [smooth_prior(5, 0.05)],
        np.full((1, 5), 1.2))
    recorded(dataclasses.replace(held, cost_history=held.cost_history[:2]), rtol=1e-4, case="held")
    mixing = np.eye(3) + 0.01 * np.arange(9.0).reshape(3, 3)
    mixed = ViewFit(1.0, None, {}, np.array([1.0, 1.034]), mixing, np.zeros((1, 3)))
    plain = ViewFit(1.0, None, {}, np.ones(2), np.eye(3), np.zeros((1, 3)))
    recorded([each.sentences("RGB", ("lamp", "sun")) for each in (mixed, plain)], case="sentences")


def test_light_between_nodes(recorded):
    rng = np.random.default_rng(6)
    row, column = (index.ravel() for index in np.indices(SURFACE.shape))
    found = {}
    for cell in (1, 3, 7):
        nodes = LightNodes(SURFACE, cell)
        weights = nodes.weights(row[::3], column[::3])
        light = rng.uniform(0.5, 1, nodes.keys.shape[1])
        found[f"{cell}"] = {"keys": nodes.keys, "region": nodes.region, "node": nodes.node,
                            "weights": weights.toarray(), "light": weights @ light,
                            "uneven": [nodes.unevenness(light, px) for px in (0.0, 0.6)]}
    recorded(found)
    # where all nodes are alike every pixel of a surface is as they are
    sums = weights.toarray().sum(axis=1)
    np.testing.assert_allclose(sums, (SURFACE[row[::3], column[::3]] >= 0), atol=1e-6)
    recorded([(_nodes(SURFACE, most).cell, _nodes(SURFACE, most).keys.shape[1])
              for most in (6, 7, 40, 90, 600)], case="sizes")
    nodes = LightNodes(SURFACE, 7)
    count = nodes.keys.shape[1]
    own = np.array([0, 0, 0, 1, 2, 3, 4])[nodes.keys[0]]
    coefficients = rng.uniform(size=(count, 2, len(hand.EXPONENTS)))
    coefficients[..., 0] *= np.where(np.arange(count) % 3, 1e-3, 1e-2)[:, None]
    light = PixelLight(nodes, own, hand.EXPONENTS, coefficients, np.full(count, 1e-4))
    recorded({"light": light.on_nodes(rng.uniform(0.1, 0.9, (5, 4)), rng.uniform(size=(2, 4))),
              "lamp": light.lamp}, case="pixels")


def test_steps_towards_a_light(recorded):
    rng = np.random.default_rng(8)
    common, own = rng.uniform(1e-5, 1e-4, 9), rng.uniform(1e-5, 3e-4, (9, 3))
    whiten = _whitening(common, own)
    group, material = np.array([0, 0, 0, 2, 2, 5, 5, 5, 5]), np.array([1, 1, 1, 0, 0, 1, 1, 1, 1])
    settings = PositionSettings(0.02, 0.03, 0.01)
    columns = _nuisance(group, material, 3, settings)
    slopes = rng.normal(size=(3, 9, 1)) * 0.05 + 0.002 * rng.normal(size=(3, 9, 3))
    residual = np.einsum("arb,a->rb", slopes, [0.3, -0.2, 0.5]) + 0.4 + 0.01 * rng.normal(
        size=(9, 3))
    recorded({"whitening": whiten, "nuisance": columns, "defaults": DEFAULTS,
              "step": dataclasses.asdict(_solve(residual, slopes, whiten, columns)),
              "still": dataclasses.asdict(_solve(residual, slopes[:0], whiten, columns)),
              "fits": dataclasses.asdict(_solve(0.001 * residual, slopes, whiten, columns)),
              "blind": said(lambda: _solve(residual, 0 * slopes, whiten, columns))})
    alone = np.linalg.inv(whiten[4] @ (common[4] + np.diag(own[4])) @ whiten[4].T)
    np.testing.assert_allclose(alone, np.eye(3), atol=1e-6)


def test_meshes(recorded):
    vertices, faces = icosphere(1)
    finer, parts = subdivided(vertices * [1.0, 1.1, 0.8], faces)
    to_steps, from_steps = large_steps(faces, len(vertices), 7.5)
    recorded({"vertices": vertices, "faces": faces, "plain": icosphere(0), "finer": finer,
              "parts": parts, "steps": to_steps(finer[:len(vertices)]),
              "back": from_steps(finer[:len(vertices)]), "settings": ShapeSettings()})
    np.testing.assert_allclose(from_steps(to_steps(vertices)), vertices, atol=1e-12)


def test_ends_of_descents(recorded):
    rng = np.random.default_rng(9)
    falling = {f"{slope}": [stalled(list(1 - slope * np.arange(count) + 0.01 * rng.normal(
        size=count))) for count in (59, 60, 61, 90)] for slope in (0.0, 1e-4, 2e-4, 3e-4, 1e-3)}
    recorded(falling | {
        "windows": [stalled([3.0, 2.0, 1.0, 1.0], window) for window in (1, 2, 3)],
        "rates": [cosine_rate(share) for share in (0.0, 0.3, 1.0)],
        "outcomes": {f"{fall}": outcome_of(np.r_[np.ones(12), 1, 1, 1 - fall, 1 - fall])
                     for fall in (0.0, 0.097, 0.103, 0.3)},
        "short": outcome_of(np.array([1.0, 1, 0.5, 0.5, 0.5]))})

    class Parameters:
        """Keys of a scene."""

        def __init__(self, *keys):
            self.keys = lambda: keys
    recorded([said(lambda k=keys: reflectance_key(Parameters(*k), "red")) for keys in (
        ("red.reflectance.values", "redder.reflectance.values"), ("red.bsdf.base_color.values",),
        ("red.reflectance.value",), ("red.a.reflectance.values", "red.b.reflectance.values"))],
        case="keys")


def test_traces_and_their_memory(recorded, tmp_path, monkeypatch):
    rng = np.random.default_rng(10)
    parts = [TracedTransport(hand.EXPONENTS, rng.uniform(size=(3, 4, 2, 21)).astype(np.float32),
                             spp, dropped) for spp, dropped in ((16, 0.01), (48, 0.02))]
    whole = joined(*parts)
    recorded({"joined": whole, "coefficients": whole.coefficients, "deviations": whole.deviations,
              "noise": whole.relative_variance, "single": TracedTransport(
                  hand.EXPONENTS, parts[0].passes[:1], 8, 0.0).deviations,
              "memory": [transport.memory_of(7, 21, passes) for passes in (1, 2, 3, 4, 9)],
              "image": [transport.memory_of_image(pixels, 8) for pixels in (2**20, 2**20 + 1)],
              "schedule": [transport._schedule(*each) for each in (
                  (16, 4, 700), (64, 4, 2 ** 20), (1, 4, 3), (9, 2, 2 ** 18), (400, 3, 2 ** 18))],
              "vector": generating_vector(75).astype(float)})
    variance = whole.passes.reshape(3, 4, -1).var(axis=0, ddof=1) / 3
    np.testing.assert_allclose((whole.deviations**2).sum(axis=0), variance, rtol=1e-4)
    found = {}
    for free in (None, 3 << 30, 1 << 28):
        monkeypatch.setattr(transport, "free_memory", lambda free=free: free)
        for regions in (10_000, 97_000, 780_000):
            found[f"{free} {regions}"] = said(lambda r=regions: transport.require_memory(
                r, 49, 4, 5, 2))
    recorded(found, case="memory")
    sums = PassSums(0, tuple(np.zeros((2, 1, 3), np.float32) for _ in range(3)))
    for number in range(4):
        sums = sums.with_one_more(np.full((2, 1, 3), number + 1, np.float32))
    kept = TraceCheckpoint(tmp_path / "a.npz", "this")
    kept.write(PassSums(0, ()))
    assert not kept.path.exists()
    kept.write(sums)
    recorded({"sums": sums, "read": kept.read(), "other": TraceCheckpoint(kept.path, "that").read(),
              "none": TraceCheckpoint(tmp_path / "b.npz", "this").read()}, case="checkpoint")
    kept.path.write_bytes(b"PK")
    assert kept.read() is None
    kept.remove()
    kept.remove()       # nothing is there any more
    clock = iter([100.0, 119.9, 120.1, 300.0, 310.0, 321.0])
    monkeypatch.setattr(trace_checkpoint.time, "monotonic", lambda: next(clock))
    often = TraceCheckpoint(kept.path, "this")
    written = []
    for _ in range(2):
        often.write_now_and_then(sums)
        written.append(kept.path.exists())
    assert written == [False, True]     # after 20 s


def test_no_two_surfaces_to_compare(recorded):
    alone = SurfaceAgreement(("a / x", "b / y"), ("a", "b"), np.array([5, 9]),
                             np.array([[1.1, 1.0, 0.9], [1.2, 1.3, 1.0]]), np.full((2, 3), 0.01))
    recorded({"none": agree.scene_errors(alone, frozenset(), 9),
              "known": agree.scene_errors(alone, frozenset({"b"}), 9),
              "covariance": [agree.surface_covariance(alone, known, 0.02)
                             for known in (frozenset(), frozenset({"b"}))]})
