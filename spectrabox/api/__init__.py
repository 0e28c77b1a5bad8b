"""The functions and records behind the public names of ``spectrabox``."""
