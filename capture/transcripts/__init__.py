"""Recorded conversations with instruments: read, played and replayed."""
