"""Reflectances made by physics, one kind of surface a file, where none may be shipped."""
