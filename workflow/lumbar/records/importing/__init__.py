"""Foreign recordings, whatever form a machine wrote them in, as records in time, position and force."""
