"""Every record that passes between folders, by topic: read these files first.

Shape letters: H, W pixels; I patches of a chart; P wavelengths; N spline coefficients; K camera
bands (3 or more); M materials; R regions; E products of reflectances; T samples; S surfaces.
"signal" is linear, black-subtracted, without white balance, as a fraction of (white - black).
Wavelengths are in nm. Arrays are read-only.
"""
