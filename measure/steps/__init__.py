"""The steps from photos to spectra, of flat samples and of scenes, each a function of records."""
