"""One large picture, its rows shared out among the workers of a batch."""
