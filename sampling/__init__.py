"""From one spectrum to all that fit the same measurement."""
