"""The interactive page of a diagnosis: as a file, or served and computing."""
