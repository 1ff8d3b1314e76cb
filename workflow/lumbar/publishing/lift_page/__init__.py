"""The page of a lift that one can look around in: body, balance, pendulums, and a push against the funnel."""
