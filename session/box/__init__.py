"""A box measured with a tape: its scene, and its camera from corners marked in the photo."""
