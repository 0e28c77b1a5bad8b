"""Whether tables, plots and pictures of a report still show its numbers."""
