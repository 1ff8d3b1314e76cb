"""Effects: physical mechanisms that are added to a base model, one YAML file each.

From a file to its uses, for example for ``tissue/coulomb_friction.yaml``:

1. `catalogue.TISSUE` lists the names; `notation` defines the keys of a file and builds an `Effect` with its `Form` s from it
   (`lumbar.tissue.models.form`). Equations, parameters, units and starting ranges are in the file only.
2. `lumbar.tissue.models.parameter`: `NonlinearParameter.grid` and `NonlinearParameter.bounds` are starting values and bounds of
   the fit, from ``start``, ``scale`` and ``reach``; a `LinearParameter` only has a sign.
3. `lumbar.tissue.models.expression.parse` reads the equation, `lumbar.tissue.models.equation_check` checks it.
4. `lumbar.tissue.models.equation.Equation` is the equation: `forces` simulates it, `latex` prints it, `c_step` is its C code;
   `lumbar.tissue.models.state_equation` solves its states, `lumbar.tissue.models.spatial_equation` reads it in space.
5. `lumbar.tissue.models.structure.Structure` adds forms to a base; `hooks` has the code of forms without an equation.
"""
