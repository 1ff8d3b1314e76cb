"""Parts of models (motion, parameters, bases, forms, structures) and the discrete models of the thesis."""
