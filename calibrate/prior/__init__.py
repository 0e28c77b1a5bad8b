"""What measured cameras teach about a camera's curves."""
