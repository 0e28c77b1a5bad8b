"""Joins capture, calibration, light transport and sampling: arrays and records in, records out, no files."""
