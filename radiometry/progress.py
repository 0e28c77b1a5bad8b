"""How long work reports how far it has come."""
from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, str], None]  # share of the work that is done, 0 to 1; what is being done
