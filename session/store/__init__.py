"""Stored results of a session, and what is written for others to read."""
