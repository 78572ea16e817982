"""compare: models against recordings, and where they fail."""
