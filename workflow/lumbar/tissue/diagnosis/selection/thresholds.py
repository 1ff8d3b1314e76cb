"""What counts: the levels on which the verdicts of a diagnosis rest."""

LEVEL = 0.01
"""An effect is selected only at this probability of a false alarm."""
UNSEEN = 2.33
"""Standard errors by which the squared error on unseen records must fall (one-sided 1 %)."""
COMPLETE = 1.2
"""Error in noise floors, on training and unseen records, up to which a refined model that nothing further improves counts
as complete: its parameters are estimates, and cost a little on records that they were not fitted to."""
TIED = 9.2
"""Difference in twice the log-likelihood below which two effects cannot be told apart (odds of 100 to 1)."""
STRUCTURED = 0.2
"""What differs between periods and is no noise, in noise floors, from which on a model is not adequate."""
WORTHWHILE = 0.007
"""A further effect must remove this share of what the base leaves to explain of the training record, and as much as
the noise itself: the wrong mathematical form of the first effect leaves a little that any other one can mop up. (On
unseen records, where forms are extrapolated, that little may be a lot.)"""
MOST_OF_REST = 0.5
"""A further effect is worthwhile too where it removes this share of what the model before it leaves to explain: where one
effect dwarfs all others (inertia at high frequency), a share of what the base leaves would hide them."""
BLIND = 0.95
"""Factor on the unseen error below which an effect must bring it where the noise is unknown: the likelihood then takes
what is left for white noise, and colour passes for certainty."""
WORTHWHILE_BLIND = 0.02
"""The same, of the base's squared error, where the noise floor is unknown."""
