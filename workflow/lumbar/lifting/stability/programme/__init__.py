"""Sum-of-squares programmes: the thesis's alternation and the certified funnels."""
