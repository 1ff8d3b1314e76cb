"""The page of a diagnosis that one can look around in: alone as a file, or served and computing."""
