"""How spectra are estimated: traced transport, gradients, or one wavelength at a time."""
