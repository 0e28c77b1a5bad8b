"""The prior that ships with the project, what it was learnt on, and the script that trains it."""
