"""The interactive page of a lift: body, balance, pendulums, and a push against the funnel."""
