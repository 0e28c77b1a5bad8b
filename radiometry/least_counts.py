"""How many patches and swatches are needed at least: what rules of a session say before a fit does.
"""

MIN_PATCHES = 8         # of a chart: fewer fix no sensitivities
MIN_SWATCHES = 8        # of a material: of fewer, leave-one-out says next to nothing
