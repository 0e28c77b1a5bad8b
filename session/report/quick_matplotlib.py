"""Importing this loads matplotlib, without the lists of properties in its own descriptions.

Matplotlib makes them for every kind of artist, in a quarter of the time that loading takes, and
nobody reads them here. Pages of the report import this before what draws.
"""
from __future__ import annotations

import matplotlib.artist

lists_of_properties = matplotlib.artist.kwdoc
matplotlib.artist.kwdoc = lambda artist: ""
try:
    import matplotlib.figure
finally:
    matplotlib.artist.kwdoc = lists_of_properties
