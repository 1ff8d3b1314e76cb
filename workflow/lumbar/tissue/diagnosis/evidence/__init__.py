"""Evidence for and against a diagnosis: ties, limitations, the experiment that settles it; its files."""
