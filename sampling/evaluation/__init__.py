"""Do the bands hold the truth: scores, certificate, cubes made elsewhere."""
