"""The study's configuration, checked as a whole before anything runs."""
