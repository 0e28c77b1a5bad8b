"""Cameras around a box and the COLMAP model that structure from motion would make of them."""
from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

# an arbitrary world: 1 unit is 137 mm
SCALE = 1 / 137.0
TURN = Rotation.from_euler("xyz", [40, -115, 200], degrees=True).as_matrix()
SHIFT = np.array([0.4, -2.0, 1.3])
CAMERAS = {"SIMPLE_PINHOLE": (460.0, 156.0, 104.0), "PINHOLE": (460.0, 462.0, 157.5, 103.0),
           "SIMPLE_RADIAL": (460.0, 156.0, 104.0, -0.08),
           "RADIAL": (460.0, 156.0, 104.0, -0.08, 0.03),
           "OPENCV": (460.0, 462.0, 157.5, 103.0, -0.08, 0.03, 0.001, -0.002)}
# [x, y, z] in mm of each camera, and what it looks at
PLACES = {"box.jpg": ((0.0, 165.0, 690.0), (0.0, 165.0, 0.0)),
          "left.jpg": ((-280.0, 260.0, 640.0), (-40.0, 160.0, -250.0)),
          "right side.jpg": ((240.0, 230.0, 700.0), (-20.0, 165.0, -250.0))}


def world_to_camera(at, target, up=(0.0, 1.0, 0.0)):
    """Pose of a camera in mm, x to the right, y down, z ahead."""
    at, target = np.array(at, float), np.array(target, float)
    ahead = (target - at) / np.linalg.norm(target - at)
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(ahead, right), ahead])
    return turn, -turn @ at


def as_opencv(model):
    """Camera matrix and distortion of COLMAP's parameters, with OpenCV's centre of a pixel."""
    values = list(CAMERAS[model])
    shared = model.startswith("SIMPLE") or model == "RADIAL"
    focal = [values[0]] * 2 if shared else values[:2]
    centre, rest = (values[1:3], values[3:]) if shared else (values[2:4], values[4:])
    matrix = np.array([[focal[0], 0, centre[0] - 0.5], [0, focal[1], centre[1] - 0.5], [0, 0, 1]])
    return matrix, np.array([*rest, *[0.0] * (5 - len(rest))])


def pixels(model, picture, places):
    """Where a picture shows places (n, 3) in mm."""
    turn, shift = world_to_camera(*PLACES[picture])
    matrix, distortion = as_opencv(model)
    seen, _ = cv2.projectPoints(np.array(places, float), cv2.Rodrigues(turn)[0], shift, matrix,
                                distortion)
    return seen.reshape(-1, 2)


def write_model(folder: Path, model="OPENCV", size=(312, 208)):
    """Write cameras.txt and images.txt as COLMAP does; world = SCALE TURN scene + SHIFT."""
    folder.mkdir(parents=True, exist_ok=True)
    numbers = " ".join(repr(value) for value in CAMERAS[model])
    (folder / "cameras.txt").write_text(
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, "
        f"PARAMS[]\n# Number of cameras: 1\n7 {model} {size[0]} {size[1]} {numbers}\n",
        encoding="utf-8")
    lines = ["# Image list with two lines of data per image:",
             "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"]
    for number, (name, place) in enumerate(PLACES.items(), start=1):
        turn, shift = world_to_camera(*place)
        # scene = TURN^T (world - SHIFT) / SCALE; a camera's coordinates take the world's unit
        turned = turn @ TURN.T
        moved = SCALE * shift - turned @ SHIFT
        x, y, z, w = Rotation.from_matrix(turned).as_quat()
        pose = " ".join(repr(float(value)) for value in (w, x, y, z, *moved))
        lines += [f"{number} {pose} 7 {name}", "" if number == 2 else "10.5 20.25 -1 33 44.5 3"]
    (folder / "images.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
