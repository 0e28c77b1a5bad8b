"""Why a pixel has no spectrum."""


from __future__ import annotations

import numpy as np

SEEN, CLIPPED, DARK, EDGE, PENUMBRA, HIGHLIGHT = range(6)
WORDS = ("has a spectrum", "clipped", "no signal or no light",
         "at an edge, or no surface of the scene",
         "where light changes quickly: penumbra, corners", "highlight, brighter than white")
COLOURS = np.array([(235, 235, 235), (255, 0, 255), (0, 0, 0), (90, 90, 90), (64, 110, 200),
                    (255, 160, 0)], np.uint8)
