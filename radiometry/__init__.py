"""What all stages share: spectra, records and the algebra of light, with no devices and no
renderer.
"""
