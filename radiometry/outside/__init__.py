"""What comes from outside and what goes there: names, words, archives, interruptions."""
