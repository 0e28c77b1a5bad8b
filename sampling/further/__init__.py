"""More measurements of the same material, and what to measure next."""
