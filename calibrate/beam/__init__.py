"""How a lamp's light falls off with the angle, from a photo of a white wall that it shines at."""
