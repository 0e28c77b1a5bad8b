"""Plain JSON values of records and arrays, and JSON that cannot end the <script> element it stands
in.
"""
from __future__ import annotations

import json
import math
from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np
from markupsafe import Markup


def plain_values(value: Any) -> Any:
    """``value`` as dicts, lists, strings, numbers and None; a number that is not finite becomes
    None.
    """
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, np.ndarray | np.generic):
        if value.dtype.kind in "biuf" and np.isfinite(value).all():
            return value.tolist()
        return plain_values(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): plain_values(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_values(item) for item in value]
    if isinstance(value, Enum):
        return value.name
    return value.name if isinstance(value, PurePath) else str(value)


def json_for_script(value: Any) -> Markup:
    """JSON text with ``<``, ``>`` and ``&`` written as escapes, so no name can close the element or
    open another.
    """
    text = json.dumps(plain_values(value), allow_nan=False, separators=(",", ":"))
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)
