"""Conversion of recordings in any machine's form to records of time, position and force."""
