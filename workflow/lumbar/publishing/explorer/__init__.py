"""Interactive page of a diagnosis, as a file or from a server that computes."""
