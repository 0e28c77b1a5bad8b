"""Numbers of many finished sessions, and their catalogue as an SQLite file."""
