"""Shape and spectrum of one object from several photos."""
