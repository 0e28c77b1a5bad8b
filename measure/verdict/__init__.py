"""Is a measurement good? Criteria with value, limit and sentence, and the verdict over all."""
