"""How spectra are found: traced transport, gradients, or one wavelength at a time."""
