"""What each input file of a session is for."""
from __future__ import annotations

import os

from spectrabox.calibrate.geometry.colmap_model import CAMERAS_NAME, IMAGES_NAME
from spectrabox.measure.captured import Capture
from spectrabox.measure.shoot.inputs import chart_files
from spectrabox.session.config.session_file import SessionConfig


def input_files(config: SessionConfig, capture: Capture) -> list[str]:
    """Names of every file that a session measures with, as seen from its folder.

    Parameters
    ----------
    config : SessionConfig
    capture : Capture
        Of the session.
    """
    files = [*input_roles(config)]
    if config.views_with_chart:
        files += chart_files(config, config.inputs)
    files += [name for name in (config.camera.lens, config.sensitivity.prior) if name is not None]
    if config.box is not None and config.box.colmap is not None:
        folder = config.box.colmap.folder.rstrip("/")
        files += [f"{folder}/{name}" for name in (CAMERAS_NAME, IMAGES_NAME)]
    scenes = [*capture.scenes.values(), capture.chart_scene]
    files += [os.path.relpath(path, config.folder) for scene in scenes if scene is not None
              for path in scene.files]
    return [*dict.fromkeys(files)]


def input_roles(config: SessionConfig) -> dict[str, str]:
    """Every file that a session measures with, by name: its role, of a further photo with its
    name.

    Parameters
    ----------
    config : SessionConfig
    """
    roles: dict[str, str] = {}
    for view in config.all_views:
        for role, names in (("object photo", view.photo_files),
                            ("light spectrum", view.light_files),
                            ("scene", [view.scene] if view.scene else []),
                            ("chart photo", view.chart_files)):
            for name in names:
                roles.setdefault(name, f"{role}, {view.name}" if view.name else role)
    for role, others in (("dark frame", config.photos.dark_files),
                         ("flat-field photo", config.photos.flats.values()),
                         ("chart scene",
                          [name for name in [config.chart.scene] if name is not None])):
        for name in others:
            roles.setdefault(name, role)
    if not config.sensitivity.from_chart and config.sensitivity.source.file is not None:
        roles.setdefault(config.sensitivity.source.file, "sensitivities")
    for material, section in config.surfaces.items():
        if section.measured is not None:
            roles.setdefault(section.measured.file, f"known spectrum of {material}")
    return roles
