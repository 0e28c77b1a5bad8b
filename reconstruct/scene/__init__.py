"""Mitsuba scene files: reading, rewriting, surfaces, lights and camera."""
