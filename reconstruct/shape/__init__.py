"""Shape and spectrum of one object from photos around it, by gradient descent in Mitsuba 3."""
