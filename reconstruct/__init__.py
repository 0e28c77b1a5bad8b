"""From a photo, a scene and a calibration to spectra, by inverse rendering in Mitsuba 3."""
