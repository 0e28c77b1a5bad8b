"""The stages of a session: inputs, then photos, calibration, reconstruction, sampling."""
