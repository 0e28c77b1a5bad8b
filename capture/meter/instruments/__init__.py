"""Spectroradiometers on the serial line: one file per device, one interface in interface.py."""
