"""What a model is made of: motion, parameters, bases, forms, their composition; discrete models of the thesis."""
