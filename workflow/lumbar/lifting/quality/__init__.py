"""Whether a marker recording can be a person's body: findings, and a quality sheet of each recording."""
