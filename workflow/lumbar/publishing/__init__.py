"""What people read: figures, pages, the thesis's claims against a run."""
