"""Light that reaches every pixel of a photo, direct and from all other surfaces."""
