"""What a finished run becomes: results as records, files beside them, answers of commands."""
