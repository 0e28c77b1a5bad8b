"""Every record of sampling stays what it was made as, and is equal to itself alone."""
import dataclasses
import importlib
import inspect
import pkgutil

import numpy as np
import pytest

from spectrabox import sampling
from spectrabox.radiometry.shaped import Record

CHANGING = {"_State"}       # of walks: it changes with every pivot


def dataclasses_of_sampling():
    names = [info.name for info in pkgutil.walk_packages(sampling.__path__, "spectrabox.sampling.")]
    for name in names:
        for _, kind in inspect.getmembers(importlib.import_module(name), inspect.isclass):
            if dataclasses.is_dataclass(kind) and kind.__module__ == name:
                yield kind


@pytest.mark.parametrize("kind", [*dataclasses_of_sampling()], ids=lambda kind: kind.__name__)
def test_a_record_is_not_changed(kind):
    made = object.__new__(kind)
    first = dataclasses.fields(kind)[0].name
    if kind.__name__ in CHANGING:
        setattr(made, first, 1)
        return
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(made, first, np.zeros(2))


@pytest.mark.parametrize("kind", [kind for kind in dataclasses_of_sampling()
                                  if issubclass(kind, Record)], ids=lambda kind: kind.__name__)
def test_a_record_of_arrays_is_not_compared_by_them(kind):
    """Two arrays that are compared are an array, of which nobody asked the truth."""
    assert kind.__eq__ is object.__eq__
    assert kind.__hash__ is object.__hash__
