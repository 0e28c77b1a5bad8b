"""Lens, pose and projection of a camera."""
