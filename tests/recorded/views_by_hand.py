"""Views of a box whose surfaces and light transport are given by hand: nothing is traced."""
from __future__ import annotations

import dataclasses

import numpy as np

from spectrabox.fixtures.cornell_box import BLOCKS, MATERIALS, cornell_box_xml
from spectrabox.radiometry.grid import grid_from_nm, visible_grid
from spectrabox.radiometry.interreflection import exponents_up_to
from spectrabox.radiometry.records import (
    Calibration,
    LearntSpectra,
    LightScale,
    LinearImage,
    Outcome,
    PhotoKind,
    Quantity,
    SensitivityFit,
    Spectrum,
)
from spectrabox.reconstruct.engines.transport_engine import nuisances, solve_traced
from spectrabox.reconstruct.fit.traced_view import TracedView
from spectrabox.reconstruct.fit.view_terms import Nuisances
from spectrabox.reconstruct.inverse_rendering import reconstruction_of
from spectrabox.reconstruct.scene.regions import block_regions
from spectrabox.reconstruct.scene.scene_file import scene_of_text
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.tracer.transport import TracedTransport
from spectrabox.reconstruct.view import MaterialSpec, View

GRID = visible_grid(12.5)
SIZE = (28, 20)             # width, height
NAMES = (*MATERIALS, *BLOCKS)
NM = GRID.nm
TRUTH = {"white": 0.72 + 0.1 * np.sin((NM - 400) / 90), "small": 0.35 + 0.2 * np.cos(NM / 55),
         "green": 0.1 + 0.4 * np.exp(-((NM - 530) / 40) ** 2),
         "red": 0.08 + 0.5 / (1 + np.exp((600 - NM) / 15)), "large": 0.3 + (NM - 400) / 900}
LAMP_NM = grid_from_nm(np.arange(395.0, 706, 7.0))
LAMPS = {"warm": 0.4 + ((LAMP_NM.nm - 395) / 260) ** 1.5, "cold": 1.6 - (LAMP_NM.nm - 395) / 280,
         "lines": 0.5 + np.exp(-((LAMP_NM.nm - 545) / 12) ** 2)}
EXPONENTS = exponents_up_to(len(NAMES), 2)
SECOND = ('<emitter type="point" id="second"><point name="position" x="0.3" y="0.5" z="2"/>'
          "</emitter>")
LEARNT = LearntSpectra(np.linspace(400, 700, 9), np.linspace(0.3, 0.5, 9),
                       0.06 * np.exp(-((np.arange(9)[:, None] - np.arange(9)) / 2.5) ** 2)
                       + 0.01 * np.eye(9))


def scene(folder, lights=1, change=lambda text: text):
    """The box with painted blocks, and perhaps a second light."""
    text = cornell_box_xml(SIZE[0], max_depth=3, painted_blocks=True)
    if lights > 1:
        text = text.replace("</scene>", SECOND + "</scene>")
    return scene_of_text(change(text), folder / "box.xml")


def surface_picture():
    """Index (H, W) of seven surfaces of unequal size, with seams that belong to none."""
    picture = np.full(SIZE[::-1], 2)
    picture[:5], picture[15:] = 1, 0
    picture[4:17, :6], picture[3:16, 22:] = 4, 3
    picture[9:18, 8:13], picture[6:16, 15:20] = 5, 6
    picture[:, 21], picture[8] = -1, -1
    return picture


def calibration(lamp="warm", bands=3):
    """A camera under one of three lamps."""
    peaks, widths = np.array([[605.0], [538], [455], [500]])[:bands], np.array(
        [[33.0], [38], [27], [60]])[:bands]
    curves = np.exp(-0.5 * ((GRID.nm - peaks) / widths) ** 2) * np.array([[1.0], [0.8], [0.9],
                                                                         [0.3]])[:bands]
    fit = SensitivityFit(GRID, curves, None, None, None, None, None, None, None, "given",
                         Outcome.CONVERGED)
    return Calibration(fit, Spectrum(LAMP_NM, LAMPS[lamp], Quantity.RADIANCE, lamp), None,
                       np.zeros((bands, bands)), ())


def photo_of(signal, rng, noise=0.004):
    """A noisy photo of a signal (H, W, K) with a few saturated pixels."""
    variance = (noise * signal) ** 2 + 1e-7
    saturated = np.zeros(signal.shape, bool)
    saturated[2, 3], saturated[11, 9, 1] = True, True
    noisy = signal + np.sqrt(variance) * rng.standard_normal(signal.shape)
    return LinearImage(noisy.astype(np.float32), variance.astype(np.float32), saturated, 1.0, 0.02,
                       200.0, 8.0, PhotoKind.LINEAR_FILE, "camera", "box.exr", "")


def materials(known=("large",), learnt=()):
    """The five materials; those named are given their true spectrum, or a family's."""
    return tuple(MaterialSpec(name, name, TRUTH[name] if name in known else None,
                              LEARNT if name in learnt else None) for name in NAMES)


def transport(region, group, lights, rng, noise=0.02):
    """Passes (4, R, L, E) of light that begins at each region's own surface."""
    own = np.array([0, 0, 0, 1, 2, 3, 4])[group]
    share = rng.uniform(0.2, 1.0, (len(group), lights, len(EXPONENTS)))
    share *= 0.4 ** EXPONENTS.sum(axis=1) * (EXPONENTS[:, own].T > 0)[:, None]
    share *= rng.uniform(0.8, 1.2, (len(group), lights, 1))
    share[3, :, 0] = 0.01           # sees the edge of a lamp
    passes = share * (1 + noise * rng.standard_normal((4, *share.shape)))
    return TracedTransport(EXPONENTS, passes.astype(np.float32), 64, 0.0)


def view(folder, name="photo", seed=1, lamp="warm", scale=1.7, lights=1, bands=3, known=("large",),
         gains=0.01, given=None, own_light=False, **chosen):
    """A view and its traced transport, the photo being of the truth.

    ``scale`` is the true light scale; ``given`` the one that the view states.
    """
    rng = np.random.default_rng(seed)
    surface = surface_picture()
    own = {"second": Spectrum(LAMP_NM, LAMPS["lines"], Quantity.RADIANCE, "own")} if own_light \
        else {}
    bare = View(name, scene(folder, lights), photo_of(np.ones((*SIZE[::-1], bands)), rng),
                calibration(lamp, bands), tuple("RGBW"[:bands]), materials(known, **chosen), given,
                own)
    everywhere, group = block_regions(surface, surface >= 0)
    whole = transport(everywhere, group, lights, rng)
    spectra = np.array([TRUTH[each] for each in NAMES])
    products = np.prod(spectra[None] ** EXPONENTS[:, :, None], axis=1)
    signals = np.concatenate([products @ response.T for response in bare.responses])
    signal = scale * whole.coefficients @ signals
    signal *= np.exp(gains * rng.standard_normal((7, bands)))[group]
    picture = np.where((everywhere >= 0)[..., None], signal[np.maximum(everywhere, 0)],
                       signal.mean(axis=0))
    seen = dataclasses.replace(bare, photo=photo_of(picture, rng))
    vars(seen).update(surface=surface)
    region, group = block_regions(surface, seen.used)
    first = np.unique(region[region >= 0], return_index=True)[1]
    passes = whole.passes[:, everywhere[region >= 0][first]]
    return seen, TracedView(seen, dataclasses.replace(whole, passes=passes), region, group,
                            Nuisances())


def stated_scale(value, error=0.02):
    """A light scale that a view states."""
    return LightScale(value, error, None, "chart")


def rendered(traced, fit):
    """Two renderings (2, H, W, K), of the first passes and of the last, for a light scale of 1."""
    passes = traced.traced.passes.reshape(2, 2, len(traced.group), -1).mean(axis=1)
    known = traced.region >= 0
    pictures = [np.where(known[..., None], (half @ fit.signals)[np.maximum(traced.region, 0)],
                         traced.view.measured) for half in passes]
    return np.array(pictures)


SETTINGS = InversionSettings(7, seed=3, surface_error=0.012, engine="transport",
                             brightness_error=0.015, learnt=LEARNT)
# A descent ends where its cost falls by less than 1e-7: round-off moves its end by that much.
ENDS = 1e-4


def solved(traced, settings):
    """The solution of traced views, and its record."""
    given = [dataclasses.replace(each, nuisances=nuisances(each.view, settings))
             for each in traced]
    solution = solve_traced(given, settings, rendered)
    views = [each.view for each in solution.views]
    return solution, reconstruction_of(views, solution.fit, solution.answers, settings)


def told(solution, record):
    """All of a solution but how many steps it took."""
    fit = dataclasses.asdict(solution.fit)
    del fit["cost_history"]
    # how many steps a descent takes is a matter of round-off
    record = dataclasses.replace(record, views=tuple(
        dataclasses.replace(view, loss_history=view.loss_history[:2]) for view in record.views))
    return {"record": record, "fit": fit, "first costs": solution.fit.cost_history[:2],
            "last cost": solution.fit.cost_history[-1],
            "nuisances": [view.nuisances for view in solution.views],
            "scales": [answer.scale for answer in solution.answers]}
