"""Recorded: what functions and records of radiometry and reconstruct take by default, and limits
that no small input reaches.
"""
import dataclasses
import importlib
import inspect
import pkgutil
from pathlib import Path

import pytest

import spectrabox.radiometry
import spectrabox.reconstruct

LIMITS = {
    "radiometry.outside.archives": ("MAX_UNPACKED",), "radiometry.outside.second_process": (
        "PATIENCE_S",), "radiometry.outside.loaded_beside": ("PATIENCE_S",),
    "radiometry.outside.interruption": ("TIDYING_S", "SENT_AGAIN_S"),
    "radiometry.spectra.spectrum_files": ("MAX_FILE_BYTES",),
    "radiometry.spectra.formats.table": ("MAX_VALUES",),
    "radiometry.spectra.formats.csvw": ("MAX_BYTES",),
    "radiometry.spectra.formats.zarr_array": ("MAX_TABLE", "CHUNK_PX", "CHUNKS_A_SHARD"),
    "reconstruct.engines.gradient_engine": ("FINAL_SPP", "FINAL_PASSES"),
    "reconstruct.engines.gradient": ("WINDOW", "TAIL", "LEARNING_RATE", "LAST_RATE"),
    "reconstruct.engines.transport_engine": ("FIRST_SPP", "FEW_SPP", "MAX_SPP", "IMAGE_SPP",
                                             "IMAGES"),
    "reconstruct.fit.transport_fit": ("STEPS", "FINISHED", "MAX_DAMPING"),
    "reconstruct.pixels.pixel_light": ("MOST_NODES", "PATHS_OF_NODE", "PASSES", "BYTES"),
    "reconstruct.rendering.irradiance": ("SAMPLES",),
    "reconstruct.scene.light_position": ("STEP", "MAX_MOVE", "ITERATIONS", "NEW_SLOPES",
                                         "SMALL_MOVE", "MAX_ERROR", "MIN_LIT"),
    "reconstruct.scene.surfaces": ("RAYS_AT_ONCE", "SUBPIXELS"),
    "reconstruct.tracer.path_tracer": ("TRIAL_PATHS", "HEADROOM", "MIN_COUNT", "MAX_BITS"),
    "reconstruct.tracer.path_samples": ("MAX_POINTS",),
    "reconstruct.tracer.trace_checkpoint": ("WRITE_EVERY_S",),
    "reconstruct.tracer.transport": ("MAX_BYTES", "PILOT_PATHS", "BRIGHTEST", "DROPPED",
                                     "MAX_IMAGE_COEFFICIENTS", "PRUNE_ABOVE")}


def modules(package):
    return [importlib.import_module(found.name) for found in pkgutil.walk_packages(
        package.__path__, package.__name__ + ".")]


def simple(default):
    """A default as it is written, or what kind of thing it is."""
    plain = default is None or isinstance(default, bool | int | float | str | tuple)
    return repr(default) if plain else "Path" if isinstance(default, Path) else type(
        default).__name__


def defaults_of(function):
    return ", ".join(f"{each.name}={simple(each.default)}" for each in inspect.signature(
        function).parameters.values() if each.default is not inspect.Parameter.empty)


@pytest.mark.parametrize("package", [spectrabox.radiometry, spectrabox.reconstruct],
                         ids=["radiometry", "reconstruct"])
def test_defaults(recorded, package):
    found = {}
    for module in modules(package):
        for name, value in vars(module).items():
            if getattr(value, "__module__", "") != module.__name__:
                continue
            place = f"{module.__name__.removeprefix(package.__name__ + '.')}.{name}"
            if inspect.isfunction(value) and (said := defaults_of(value)):
                found[place] = said
            elif inspect.isclass(value) and dataclasses.is_dataclass(value):
                parameters = value.__dataclass_params__
                fields = {field.name: simple(field.default) for field in dataclasses.fields(value)
                          if field.default is not dataclasses.MISSING}
                found[place] = f"frozen {parameters.frozen}, eq {parameters.eq}, {fields}"
            elif inspect.isclass(value):
                found |= {f"{place}.{method}": said for method, each in vars(value).items()
                          if inspect.isfunction(each) and (said := defaults_of(each))}
    recorded(found)


def test_limits(recorded):
    recorded({f"{module}.{name}": getattr(importlib.import_module(f"spectrabox.{module}"), name)
              for module, names in LIMITS.items() for name in names})
