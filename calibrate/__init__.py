"""From a chart photo and a light spectrum to a calibration."""
