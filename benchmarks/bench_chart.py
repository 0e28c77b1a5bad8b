"""Charts found, refused and wrongly accepted, over synthetic scenes of many kinds; real photos with
--photos.

Every scene has a camera and a light of its own (three bands of varied peaks and widths, a black
body of 2300 to 9000 K), clutter behind the chart, noise, blur, an exposure and a pose. Right is a
find whose 24 centres lie within 0.3 of a patch. Wrongly accepted is a find elsewhere, any find
where there is no whole ColorChecker Classic, and a verdict "good" where the chart is clipped or
glaring. The alternative in the same run is OpenCV alone, accepting what it proposes.
"""
from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from spectrabox.capture.chart.chart_agreement import TYPICAL_SIGNALS
from spectrabox.capture.chart.detection import _mcc_quads, locate_chart
from spectrabox.capture.chart.quality import judge_chart
from spectrabox.capture.photo.image_files import read_encoded_file
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.fixtures.chart_scene import BORDER_MM, GRID_MM, PITCH_MM, chart_scene, homography
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind

HEIGHT, WIDTH = 1000, 1500   # pixels of the linear picture: a sensor of 6 megapixels
FOCAL = 1.3 * WIDTH
UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
FINDABLE = ("plain", "upright", "small 10-15 %")
REFUSABLE = ("absent", "shuffled colours", "six colours exchanged", "other maker", "mirrored",
             "half covered")
SPOILT = ("clipped", "glaring", "tiny 6-10 %")
NEAR = 0.3                   # of a patch
GRID = visible_grid(10.0)


def camera_signals(rng: np.random.Generator, reflectances: np.ndarray) -> np.ndarray:
    """Signals (24, 3) of the chart through a random camera under a random black body; the largest
    is 0.9.
    """
    peaks = np.array([600, 537, 458]) + rng.normal(scale=[9, 6, 7])
    widths = np.array([36, 40, 30]) * rng.uniform(0.75, 1.25, 3)
    metres, kelvin = GRID.nm * 1e-9, 1 / rng.uniform(1 / 9000, 1 / 2300)
    light = metres**-5 / np.expm1(0.014388 / (metres * kelvin))
    bands = np.exp(-0.5 * ((GRID.nm - peaks[:, None]) / widths[:, None]) ** 2)
    bands += rng.uniform(0, 0.06, (3, 3)) @ bands  # leakage
    signals = reflectances @ (bands * light * GRID.weights_nm).T
    return 0.9 * signals / signals.max()


def pose(rng: np.random.Generator, share: float, tilt_deg: float, turn_deg: float) -> np.ndarray:
    """Corners (4, 2) px of the patch grid: ``share`` of the frame's width, tilted and turned,
    inside the frame.
    """
    outer = (UNIT - 0.5) * GRID_MM
    axis, turn, tilt = rng.uniform(0, np.pi), np.deg2rad(turn_deg), np.deg2rad(tilt_deg)
    flat = outer @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    direction = np.array([np.cos(axis), np.sin(axis)])
    across = flat @ np.array([-direction[1], direction[0]])
    points = np.column_stack([flat - np.outer(across, [-direction[1], direction[0]]) * (1
                                                                                        - np.cos(
                                                                                            tilt)),
                              across * np.sin(tilt)])
    distance = FOCAL * GRID_MM[0] / (share * WIDTH)
    for _ in range(60):
        xy = FOCAL * points[:, :2] / (distance + points[:, 2:])
        reach = xy * (1 + 2.2 * BORDER_MM / GRID_MM.min())
        size = np.ptp(reach, axis=0)
        if size[0] < 0.97 * WIDTH and size[1] < 0.97 * HEIGHT:
            break
        distance *= 1.05
    low, high = -reach.min(axis=0), np.array([WIDTH, HEIGHT]) - reach.max(axis=0)
    return xy + rng.uniform(low, high)


def clutter(rng: np.random.Generator) -> np.ndarray:
    """A background (H, W, 3) of smooth shades and sharp rectangles."""
    shade = gaussian_filter(rng.normal(size=(HEIGHT // 20, WIDTH // 20, 3)), (6, 6, 0))
    picture = 0.25 + 0.6 * np.repeat(np.repeat(shade, 20, axis=0), 20,
                                     axis=1) / max(np.abs(shade).max(), 1e-9) * 0.3
    for _ in range(rng.integers(0, 25)):
        y, x = rng.integers(0, HEIGHT), rng.integers(0, WIDTH)
        h, w = rng.integers(15, 250, 2)
        picture[y:y + h, x:x + w] = rng.uniform(0.02, 0.8) * rng.uniform(0.3, 1, 3)
    return np.maximum(picture, 0.01)


def make_scene(kind: str, rng: np.random.Generator, reflectances: np.ndarray) -> tuple[LinearImage,
                                                                                       np.ndarray]:
    """A photo of one kind, and the corners of the chart in it."""
    signals = camera_signals(rng, reflectances)
    share = {"tiny 6-10 %": rng.uniform(0.06, 0.10), "small 10-15 %": rng.uniform(0.10, 0.15)}.get(
        kind, np.exp(rng.uniform(np.log(0.15), np.log(0.9))))
    upright = kind == "upright"
    corners = pose(rng, share, 0 if upright else rng.uniform(0, 45),
                   0 if upright else rng.uniform(0, 360))
    if kind == "shuffled colours":
        signals = rng.permutation(signals)
    if kind == "six colours exchanged":
        chosen = rng.permutation(18)[:6]
        signals[chosen] = signals[np.roll(chosen, 1)]
    if kind == "mirrored":
        corners = corners[[1, 0, 3, 2]]
    background = clutter(rng)
    if kind == "absent":
        scene = background
    else:
        card = chart_scene(HEIGHT, WIDTH, np.column_stack([signals, np.ones(24)]), corners,
                           np.zeros(4), frame=np.array([0.02, 0.02, 0.02, 1.0]) * [*signals[18], 1],
                           subsamples=2, patch_mm=rng.uniform(42.4, 43.0) if kind == "other maker"
                           else 40.0)
        scene = card[..., :3] + (1 - card[..., 3:]) * background
    scene = scene * _light(rng, upright)
    scene = _spoil(kind, rng, scene, corners, signals)
    blur = rng.uniform(0, 1.2) * min(1.0, np.linalg.norm(corners[1] - corners[0]) / 400)
    scene = gaussian_filter(scene, (blur, blur, 0))
    peak = signals[18].max() / 0.9
    exposure = rng.uniform(1.3, 4) if kind == "clipped" else np.exp(rng.uniform(np.log(1 / 50),
                                                                                0)) / max(peak,
                                                                                          1) / 1.1
    noise = 0.002 if upright else rng.uniform(0.001, 0.05) * min(1.0,
                                                                 np.linalg.norm(corners[1]
                                                                                - corners[0]) / 300)
    if kind != "clipped":
        exposure *= min(1.0, 0.95 / float(np.percentile(scene, 99.9)) / exposure)
    return photograph(scene * exposure, noise, exposure, rng), corners


def photograph(scene: np.ndarray, noise: float, white: float,
               rng: np.random.Generator) -> LinearImage:
    variance = noise**2 * white * (np.maximum(scene, 0) + 0.05 * white) + 1e-9
    signal = (scene + np.sqrt(variance) * rng.normal(size=scene.shape)).astype(np.float32)
    return LinearImage(signal=np.minimum(signal, 1), variance=variance.astype(np.float32),
                       saturated=signal >= 0.98, sensor_step=2.0, exposure_s=None, iso=None,
                       f_number=None, kind=PhotoKind.RAW, camera="", source="scene", sha256="")


def _light(rng: np.random.Generator, even: bool) -> np.ndarray:
    stops = 0.3 if even else rng.uniform(0, 3)
    angle = rng.uniform(0, 2 * np.pi)
    y, x = np.mgrid[-0.5:0.5:HEIGHT * 1j, -0.5:0.5:WIDTH * 1j]
    return 2 ** (stops * (np.cos(angle) * x + np.sin(angle) * y))[..., None]


def _spoil(kind: str, rng: np.random.Generator, scene: np.ndarray, corners: np.ndarray,
           signals: np.ndarray) -> np.ndarray:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    side = np.linalg.norm(corners[1] - corners[0]) / GRID_MM[0] * PITCH_MM
    if kind == "glaring":
        weights = rng.dirichlet(np.ones(4))
        centre = weights @ corners
        blob = np.exp(-0.5 * ((x - centre[0]) ** 2 + (y - centre[1]) ** 2)
                      / (side * rng.uniform(0.5, 1.5)) ** 2)
        return scene + rng.uniform(0.15, 0.8) * signals[18] * blob[..., None]
    if kind == "half covered":
        edge, inside = (corners[[0, 3]],
                        corners[[1, 2]]) if rng.random() < 0.5 else (corners[[0, 1]],
                                                                     corners[[3, 2]])
        share = rng.uniform(0.35, 0.65)
        cut = edge + share * (inside - edge)
        normal = np.array([-(cut[1] - cut[0])[1], (cut[1] - cut[0])[0]])
        sign = np.sign((edge.mean(axis=0) - cut[0]) @ normal)
        hidden = sign * ((x - cut[0, 0]) * normal[0] + (y - cut[0, 1]) * normal[1]) > 0
        return np.where(hidden[..., None], rng.uniform(0.05, 0.5) * rng.uniform(0.4, 1, 3), scene)
    return scene


def true_centres(corners: np.ndarray) -> np.ndarray:
    row, column = np.divmod(np.arange(24), 6)
    centres_mm = np.column_stack([column, row]) * PITCH_MM + 20
    mapped = np.column_stack([centres_mm, np.ones(24)]) @ homography(UNIT * GRID_MM, corners).T
    return 2 * (mapped[:, :2] / mapped[:, 2:] + 0.5) - 0.5  # sensor pixels


def in_place(found: np.ndarray, corners: np.ndarray) -> bool:
    truth = true_centres(corners)
    side = min(np.linalg.norm(truth[1] - truth[0]), np.linalg.norm(truth[6] - truth[0]))
    return bool(np.linalg.norm(found - truth, axis=1).max() < NEAR * side)


def run_scene(kind: str, rng: np.random.Generator, reflectances: np.ndarray) -> dict[str, Any]:
    image, corners = make_scene(kind, rng, reflectances)
    reference = TYPICAL_SIGNALS
    start = time.perf_counter()
    outcome, verdict, reason = "refused", "", ""
    try:
        detection = locate_chart(image, reference)
        if detection.mirrored:
            raise CheckError("mirrored")
        verdict = judge_chart(image, detection, reference).verdict
        right = kind not in REFUSABLE and in_place(detection.corners_px.mean(axis=1), corners)
        outcome = "found" if right and not (kind in SPOILT[:2] and verdict == "good") else "wrong"
    except CheckError as error:
        reason = str(error)
    seconds = time.perf_counter() - start
    proposals = _mcc_quads(signal_rgb8(image.signal))
    alone = "refused" if not proposals else "wrong"
    if proposals and kind not in REFUSABLE and in_place(2 * (proposals[0].mean(axis=1) + 0.5) - 0.5,
                                                        corners):
        alone = "found"
    return {"outcome": outcome, "verdict": verdict, "seconds": seconds, "opencv": alone,
            "reason": reason}


def real_photos(folder: Path) -> list[dict[str, str]]:
    rows = []
    for path in sorted(folder.iterdir()):
        try:
            detection = locate_chart(read_encoded_file(path), TYPICAL_SIGNALS)
            rows.append({"photo": path.name, "outcome": f"found ({detection.confidence:.2f})"})
        except CheckError as error:
            rows.append({"photo": path.name, "outcome": f"refused: {error}"})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=10, help="of each kind")
    parser.add_argument("--kinds", nargs="+", default=[*FINDABLE, *REFUSABLE, *SPOILT])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--photos", type=Path, help="folder of real JPEG and PNG photos")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    reflectances = chart_reflectances("BabelColor Average", GRID)
    rows = []
    for kind in arguments.kinds:
        print(f"{kind} ...", file=sys.stderr, flush=True)
        results = [run_scene(kind, np.random.default_rng([arguments.seed, index, len(kind)]),
                             reflectances)
                   for index in range(arguments.scenes)]
        count = {key: sum(result["outcome"] == key for result in results)
                 for key in ("found", "refused", "wrong")}
        rows.append({"kind": kind, **count,
                     "good": sum(result["verdict"] == "good" for result in results),
                     "opencv_found": sum(result["opencv"] == "found" for result in results),
                     "opencv_wrong": sum(result["opencv"] == "wrong" for result in results),
                     "seconds": float(np.median([result["seconds"] for result in results])),
                     "reasons": sorted({result["reason"] for result in results
                                        if kind in FINDABLE and result["reason"]})})
    scenes = arguments.scenes * len(rows)
    wrong = sum(row["wrong"] for row in rows)
    findable = [row for row in rows if row["kind"] in FINDABLE]
    share = sum(row["found"] for row in findable) / max(len(findable) * arguments.scenes, 1)
    photos = real_photos(arguments.photos) if arguments.photos else []
    if arguments.json:
        print(json.dumps({"rows": rows, "found_share": share, "wrongly_accepted": wrong,
                          "scenes": scenes,
                          "photos": photos}))
        return
    print(f"{'kind':<24}{'found':>7}{'refused':>9}{'wrong':>7}{'good':>6}{'OpenCV found':>14}"
          f"{'OpenCV wrong':>14}{'s':>7}")
    for row in rows:
        print(f"{row['kind']:<24}{row['found']:>7}{row['refused']:>9}{row['wrong']:>7}"
              f"{row['good']:>6}"
              f"{row['opencv_found']:>14}{row['opencv_wrong']:>14}{row['seconds']:>7.2f}")
    opencv_wrong = sum(row["opencv_wrong"] for row in rows)
    print(f"found {share:.1%} of charts that should be; wrongly accepted {wrong} of {scenes} "
          f"scenes (OpenCV alone {opencv_wrong}, ratio {opencv_wrong / max(wrong, 1):.0f} or more)")
    for row in rows:
        for reason in row["reasons"]:
            print(f"  {row['kind']}: {reason[:150]}")
    for photo in photos:
        print(f"{photo['photo']:<40}{photo['outcome'][:110]}")


if __name__ == "__main__":
    main()
