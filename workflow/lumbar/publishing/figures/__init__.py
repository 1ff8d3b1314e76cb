"""Pictures of results: the top of the library, drawn from plain data."""
