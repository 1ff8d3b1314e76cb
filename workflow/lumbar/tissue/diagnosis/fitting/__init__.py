"""Base and effects fitted to records: preparation, joint fit, intervals, identifiability."""
