"""Camera, light, field and glare estimated together from photos of a chart."""
