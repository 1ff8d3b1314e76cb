"""Sum-of-squares programmes: the thesis's alternation, and the same written in cvxpy."""
