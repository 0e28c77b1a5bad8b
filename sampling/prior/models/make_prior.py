"""Trains the prior that ships with the project, surface_families.npz; run with python -m.

    python -m spectrabox.sampling.prior.models.make_prior FOLDER

FOLDER holds the libraries that surface_families.md lists, one folder each. What `spectrabox prior
train` does for other libraries, on the same code.
"""
from __future__ import annotations

import sys
from pathlib import Path

from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.sampling.prior.band_calibration import train
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import PRIOR_GRID, SHIPPED, save_prior
from spectrabox.sampling.prior.training import MIXED

LIBRARIES = {"paint": ("kremer_pigments", "ntu_watercolour"), MIXED: ("rawtoaces190",),
             "earth": ("usgs_minerals", "cassava")}
CAMERA, LIGHT, SEED = "Nikon 5100 (NPL)", "D65", 0      # that bands are calibrated with

if __name__ == "__main__":
    libraries = {family: [read_library(Path(sys.argv[1]) / name) for name in names]
                 for family, names in LIBRARIES.items()}
    fine = visible_grid()
    response = relative_response(CAMERA, LIGHT, fine) @ interpolation_matrix(PRIOR_GRID.nm, fine.nm)
    prior, _ = train(libraries, response, SEED)
    save_prior(SHIPPED, prior)
