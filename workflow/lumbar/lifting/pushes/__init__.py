"""Pushes against simulated bodies of several links, and which measure tells beforehand who must step."""
