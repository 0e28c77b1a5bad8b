"""Spectroradiometers: serial line, instruments, measurements."""
