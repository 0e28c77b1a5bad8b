"""How long work reports how far it has come."""
from __future__ import annotations

from collections.abc import Callable

# Of the share of the work that is done, 0 to 1, and of what is being done.
Progress = Callable[[float, str], None]
