"""The operator's side: session.toml, stored results, pipeline, command line, report."""
