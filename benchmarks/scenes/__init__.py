"""Ten public scenes with measured spectra: made, rendered by stock Mitsuba, inverted, scored."""
