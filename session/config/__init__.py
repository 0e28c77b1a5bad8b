"""session.toml: its keys, rules and template."""
