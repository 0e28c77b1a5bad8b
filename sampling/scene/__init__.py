"""Draws of all materials of a scene at once, through its light transport."""
