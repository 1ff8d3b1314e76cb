"""One scaled model of trunk, limbs and box, fitted to all markers of a trial at once, with its covariance.

`anatomy` says what a body is before a marker is seen, `trial_markers` which marker is what, `build` makes the unknowns
(`structure`), what ties them (`measurements`) and a first guess. `fit` finds the most probable unknowns by
Gauss-Newton steps on `information`, a bordered block-tridiagonal matrix (`block_tridiagonal`), and draws from their
posterior; `trunk` reads joints and markers from them, `pendulums` the states, `basin_intervals` the areas, and
`lift_model` does all of it for the file of a lift.
"""
