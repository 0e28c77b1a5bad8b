"""One photo file to linear signal with its variance."""
