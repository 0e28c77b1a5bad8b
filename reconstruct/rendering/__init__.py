"""Mitsuba itself: a usable LLVM, the spectral film, irradiance on the chart."""
