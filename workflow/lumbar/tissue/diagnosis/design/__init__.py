"""Design of experiments: what records can show, and the excitation that tells models apart."""
