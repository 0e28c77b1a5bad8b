"""Profiles for colour management: ICC files, CLF files and OpenColorIO configurations."""
