"""The computer around the measurement: memory, names of files, words for a terminal, archives."""
