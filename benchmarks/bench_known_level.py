"""What several known surfaces tell of the light's level, in boxes with faults.

The demo's box with other paints in every case, its back wall, ceiling and floor of known spectrum.
It is rendered as stated and with each fault; photo / rendering of the known surfaces gives the
level, and the other surfaces are then off by their own photo / rendering over that level. The
renderer shares no code with the inversion. "between" and "within" are standard deviations of log
(photo / rendering) of the known surfaces, and of the parts of the median surface; the others are
root mean squares of the other surfaces' errors by the mean of the known surfaces, their median,
and as measured (``known_light.middle``).

    python -m benchmarks.bench_known_level [--cases 12]
"""
from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.box_render import box_light, renderer
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.demos.demo_scenes import BOX_LIGHT_CM, box_scene
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind
from spectrabox.radiometry.records.scenes import SurfaceAgreement
from spectrabox.reconstruct.agreement import surface_agreement, usable_pixels
from spectrabox.reconstruct.known_light import KNOWN_LEVEL_ERROR, LEVEL_OF_PATTERN, middle
from spectrabox.reconstruct.scene.surfaces import surface_map

from benchmarks.bench_scene_faults import lamp_at, paints, wider_box

SIZE, SPP = (104, 156), 16
SURFACES = {"back_wall": "white", "ceiling": "white", "floor": "white", "left_wall": "green",
            "right_wall": "red", "block": "cube"}
KNOWN = "white"
BOX_MIDDLE_CM = np.array([0.0, 16.5, -20.0])


def seen_at() -> tuple[np.ndarray, np.ndarray]:
    """Index (H, W) into ``SURFACES`` and place (H, W, 3) in cm of what each pixel shows."""
    mi = renderer()
    scene = mi.load_string(box_scene(SIZE), optimize=False)
    row, column = np.divmod(np.arange(SIZE[0] * SIZE[1]), SIZE[1])
    ray, _ = scene.sensors()[0].sample_ray(
        0.0, 0.5, mi.Point2f((column + 0.5) / SIZE[1], (row + 0.5) / SIZE[0]), mi.Point2f(0.5))
    places = np.array(scene.ray_intersect(ray).p).T.reshape(*SIZE, 3)
    return surface_map(scene, tuple(SURFACES), SIZE[::-1]), places


def photographs(case: int, surface: np.ndarray,
                places: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Light (H, W, 3) from the box as stated, and under each fault."""
    rng, walls = np.random.default_rng([case, 11]), paints(np.random.default_rng([case, 3]))

    def light(paint: dict[str, np.ndarray] = walls,
              edited: Callable[[str], str] = lambda xml: xml) -> np.ndarray:
        return box_light(NM, paint, lamp.radiance(NM), camera_sensitivities(), size=SIZE, spp=SPP,
                         seed=case, edited=edited)
    plain, direction = light(), rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    away = places - BOX_LIGHT_CM
    axis = BOX_MIDDLE_CM - BOX_LIGHT_CM + 8 * rng.standard_normal(3)
    beam = np.clip(away @ axis / np.linalg.norm(away, axis=2) / np.linalg.norm(axis), 0.05, 1)
    row, column = (np.arange(size) - size / 2 for size in SIZE)
    radius = 4 * (row[:, None]**2 + column**2) / (SIZE[0]**2 + SIZE[1]**2)
    one = surface == rng.integers(list(SURFACES.values()).count(KNOWN))
    factors = {"beam": beam, "narrow beam": beam**3, "vignetting 25 %": 1 - 0.25 * radius,
               "one known surface shaded by 25 %": np.where(one, 0.75, 1.0),
               "one known surface 40 % brighter": np.where(one, 1.4, 1.0)}
    return plain, {
        "lamp moved 2 cm": light(edited=lamp_at(BOX_LIGHT_CM + 2 * direction)),
        "lamp moved 5 cm": light(edited=lamp_at(BOX_LIGHT_CM + 5 * direction)),
        "side 2 % wrong": light(edited=wider_box),
        "gloss 3 %": light({name: np.minimum(each + 0.03, 1) for name, each in walls.items()}),
        "veil 2 %": plain + 0.02 * np.percentile(plain, 99, axis=(0, 1)),
        **{name: plain * factor[..., None] for name, factor in factors.items()},
        "tone curve of exponent .8": plain**0.8, "tone curve of exponent .5": plain**0.5}


def agreement_of(photo: np.ndarray, rendered: np.ndarray, surface: np.ndarray) -> SurfaceAgreement:
    """Photo against rendering of every surface, at the pixels that a session would compare."""
    variance = np.full(photo.shape, 1e-12, np.float32)
    image, stated = (LinearImage(light.astype(np.float32), variance, np.zeros(photo.shape, bool),
                                 1.0, None, None, None, PhotoKind.LINEAR_FILE, "", "box.exr", "")
                     for light in (photo, rendered))
    return surface_agreement(tuple(SURFACES), tuple(SURFACES.values()), image, rendered[None],
                             surface, usable_pixels(stated, surface))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=12)
    cases = parser.parse_args().cases
    surface, places = seen_at()
    rows: dict[str, list[list[float]]] = {}
    for case in range(cases):
        plain, faulty = photographs(case, surface, places)
        for fault, photo in faulty.items():
            seen = agreement_of(photo, plain, surface)
            logs = np.log(seen.ratio).mean(axis=1)
            known = np.array([material == KNOWN for material in seen.materials])
            within = float(np.median(np.sqrt(np.mean(seen.spread**2, axis=1))))
            error = LEVEL_OF_PATTERN * float(np.hypot(KNOWN_LEVEL_ERROR, within))
            levels = logs[known].mean(), np.median(logs[known]), middle(logs[known], error)
            rows.setdefault(fault, []).append(
                [logs[known].std(ddof=1), within,
                 *(np.sqrt(np.mean((logs[~known] - level) ** 2)) for level in levels)])
    print("| fault | between | within | by their mean | median | as measured |\n" + "|--" * 6 + "|")
    for fault, values in rows.items():
        shown = np.sqrt(np.mean(np.square(values), axis=0))
        print(f"| {fault} | " + " | ".join(f"{value:.3f}" for value in shown) + " |")


if __name__ == "__main__":
    main()
