"""Further photos through filters or under lamps: what they would bring, and a filter measured."""
