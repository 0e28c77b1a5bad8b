"""Simulated boxes: photos that a stock Mitsuba path tracer renders from true spectra at 1 nm.

``box with a card``: chart and box by one camera under one lamp, as
``spectrabox.reconstruct_scene`` measures a box in which a grey card of known spectrum stands.
``box of eggshell``: the same where all paints but the card mirror 2 to 4 % in a broad lobe, of
which the session states nothing.
``box, two lamps``: curves of the camera and one paint known, and a second lamp of a third of the
first one's strength, as the scene file states it.
"""
from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import spectrabox as sb
from spectrabox.fixtures import flat_sample, lamp, paints
from spectrabox.fixtures.demos import box_render, demo_photos, demo_scenes
from spectrabox.fixtures.paints import NM

from benchmarks import bench_scene_faults
from benchmarks.ledger import simulated
from benchmarks.ledger.task import Task

CASES = 3
CHART_SIZE, BOX_SIZE, SPP, WIDTH = (416, 624), (104, 156), 64, 48
WHITE, CARD = "white_wall", 0.35        # paint of the walls; reflectance of the card
SECOND = 0.3                            # strength of the second lamp, of the first
SECOND_LAMP = """\
    <shape type="sphere" id="second">
        <float name="radius" value="{radius}"/>
        <point name="center" value="-17, 20, 30"/>
        <emitter type="area">{radiance}</emitter>
    </shape>
</scene>"""


def tasks(data: Path | None) -> Iterator[Task]:
    """One task for each box."""
    for number in range(CASES):
        yield Task("simulated/box with a card", f"{number:02d}", with_card, (number,))
        yield Task("simulated/box of eggshell", f"{number:02d}", with_card, (number, "eggshell"))
        yield Task("simulated/box, two lamps", f"{number:02d}", two_lamps, (number,))


def with_card(number: int, finish: str = "matt") -> dict[str, float]:
    """Figures of the paints of a box that a card stands in: ``matt``, or ``eggshell``."""
    rng = np.random.default_rng([simulated.SEED, 100, number])
    truth, light, curves = drawn_box(rng)
    shown, roughness = truth, bench_scene_faults.LOBES.get(finish)
    if roughness is not None:
        base = bench_scene_faults.base_of_plastic(roughness)
        shown = {name: np.minimum(one / base, 1) for name, one in truth.items()}
    shown = shown | {"card": np.full(NM.size, CARD)}

    def edited(xml: str) -> str:
        for name in truth if roughness is not None else ():
            xml = bench_scene_faults.plastic(roughness, f'{name}"')(xml)
        return xml
    with tempfile.TemporaryDirectory() as written:
        folder = Path(written)
        chart = demo_photos.chart_light(simulated.owned_chart(rng), light, curves, CHART_SIZE)
        take(folder / "chart.dng", chart, 0.75, rng)
        take(folder / "box.dng", box_render.box_light(
            NM, shown, light, curves, size=BOX_SIZE, spp=SPP, seed=number + 1, edited=edited), 0.7,
            rng)
        (folder / "box.xml").write_text(demo_scenes.box_scene(BOX_SIZE, card=True))
        (folder / "chart.xml").write_text(demo_scenes.chart_scene_xml(CHART_SIZE))
        read = light * (1 + lamp.READING_NOISE * rng.standard_normal(NM.size))
        camera = sb.fit_camera(folder / "chart.dng", light=(NM, read),
                               chart_scene=folder / "chart.xml")
        found = sb.reconstruct_scene(
            folder / "box.dng", scene=folder / "box.xml", camera=camera, light=(NM, read),
            materials=dict.fromkeys(truth) | {"card": (NM, shown["card"])}, width=WIDTH,
            draws=1000, device="cpu", progress=False)
    return figures_of(found, truth)


def two_lamps(number: int) -> dict[str, float]:
    """Figures of the paints of a box, white known, under two lamps."""
    rng = np.random.default_rng([simulated.SEED, 101, number])
    truth, light, curves = drawn_box(rng)

    def lit(xml: str, radiance: str) -> str:
        return xml.replace("</scene>", SECOND_LAMP.format(radius=demo_scenes.LIGHT_RADIUS_CM,
                                                          radiance=radiance))
    with tempfile.TemporaryDirectory() as written:
        folder = Path(written)
        take(folder / "box.dng", box_render.box_light(
            NM, truth, light, curves, size=BOX_SIZE, spp=SPP, seed=number + 1,
            edited=lambda xml: lit(xml, demo_scenes.regular_spectrum(
                "radiance", NM, SECOND * light))), 0.7, rng)
        (folder / "box.xml").write_text(lit(
            demo_scenes.box_scene(BOX_SIZE), f'<spectrum name="radiance" value="{SECOND}"/>'))
        found = sb.reconstruct_scene(
            folder / "box.dng", scene=folder / "box.xml", camera=(NM, curves), light=(NM, light),
            materials=dict.fromkeys(truth) | {"white": (NM, truth["white"])}, width=WIDTH,
            draws=1000, device="cpu", progress=False)
    return figures_of(found, {name: one for name, one in truth.items() if name != "white"})


def drawn_box(rng: np.random.Generator) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Reflectances (P,) of the paints by BSDF, radiance (P,) of the lamp and curves (3, P)."""
    colours = paints.random_paints(3, rng)
    truth = {"white": paints.paint(WHITE)[1]} | dict(zip(("green", "red", "cube"), colours,
                                                         strict=True))
    return (truth, lamp.PEAK_RADIANCE * simulated.drawn_light(rng),
            demo_photos.camera_sensitivities())


def take(path: Path, light: np.ndarray, brightest: float, rng: np.random.Generator) -> None:
    """Write a photo of light (H, W, 3), exposed as its brightest part asks for, by a lens without
    vignetting.
    """
    flat_sample.write_photo(path, light, demo_photos.exposure_for(light, brightest), rng,
                            brightest=None, gain=demo_photos.GAIN)


def figures_of(found: sb.SceneSpectra, truth: dict[str, np.ndarray]) -> dict[str, float]:
    """FIGURES, means over the paints."""
    rows = [simulated.figures_of_one(found[name], spectrum) for name, spectrum in truth.items()]
    return dict(zip(simulated.FIGURES, np.mean(rows, axis=0).tolist(), strict=True))
