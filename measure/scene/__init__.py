"""Scenes: inverse rendering, draws through the light transport, errors of photos, geometry."""
