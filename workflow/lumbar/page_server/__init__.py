"""The page of a diagnosis served on this machine: it fits, writes and keeps what one asks of it."""
