"""One scaled model of trunk, limbs and box, fitted to all markers of a trial at once, with its covariance.

`anatomy` says what a body is before a marker is seen, `build` makes of a trial's markers the unknowns, what ties them
(`structure`) and a first guess. `fit` finds the most probable unknowns by Gauss-Newton steps on `information` and draws from
their posterior; `pendulums` reads the states and the areas of their basins from them, and does all of it for the file of a
lift.
"""
