"""Sessions of flat samples: regions of photos with a chart, without a scene or renderer."""
