"""What every command shares: options and answers, errors, interruptions, progress, JSON."""
