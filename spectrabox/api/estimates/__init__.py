"""What public functions return of surfaces: one estimate, several by name, those of a photo."""
