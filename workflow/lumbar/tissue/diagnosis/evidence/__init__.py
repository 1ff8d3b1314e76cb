"""What is said for and against a verdict: ties, limitations, the experiment that settles it; as files."""
