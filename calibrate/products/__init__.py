"""Products of sensitivity and light from chart photos under a light that nobody measured."""
