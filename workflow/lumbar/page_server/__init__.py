"""Server of the pages of diagnoses and lifts on this machine: it fits models and writes files on request."""
