"""Many sessions: who runs which, what is done, and one page of all verdicts."""
