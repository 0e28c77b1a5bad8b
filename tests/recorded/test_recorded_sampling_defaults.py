"""Recorded: what functions of sampling take where nobody says otherwise, and its limits and sizes.

Defaults are a promise to callers who leave them out, and many limits act once in a million signals:
whoever moves one says so.
"""
import ast
import importlib
import inspect
import pkgutil
from pathlib import Path

import pytest
from recorded_results import leaves

from spectrabox import sampling

MODULES = [info.name for info in pkgutil.walk_packages(sampling.__path__, "spectrabox.sampling.")
           if not info.ispkg]


def defaults_of(module):
    """Defaults by function and parameter; of one that is no value, its name."""
    found = {}
    for name, function in inspect.getmembers(module, inspect.isfunction):
        if function.__module__ != module.__name__ or name.startswith("<"):
            continue
        for parameter in inspect.signature(function).parameters.values():
            if parameter.default is not inspect.Parameter.empty:
                found[f"{name}({parameter.name})"] = _value(parameter.default)
    return found


def limits_of(module):
    """Constants by name that are values."""
    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    names = [target.id for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign)
             for written in (node.targets if isinstance(node, ast.Assign) else [node.target])
             for target in (written.elts if isinstance(written, ast.Tuple) else [written])
             if isinstance(target, ast.Name) and target.id.isupper()
             and not target.id.startswith("_")]
    return {name: _value(getattr(module, name)) for name in names}


def _value(default):
    try:
        whole = "<function" not in "".join(path for path, _ in leaves(default))
    except TypeError:
        whole = False
    return default if whole else getattr(default, "__name__", type(default).__name__)


@pytest.mark.parametrize("name", MODULES)
def test_defaults_and_limits(recorded, name):
    module = importlib.import_module(name)
    found = defaults_of(module) | limits_of(module)
    if found:
        recorded(found)
