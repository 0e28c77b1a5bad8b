"""Sessions beside each other: what changed between them, and what only scattered."""
