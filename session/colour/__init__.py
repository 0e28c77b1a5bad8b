"""Profiles, pictures and archive pages of finished sessions."""
