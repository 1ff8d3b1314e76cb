"""One scaled model of trunk, limbs and box, fitted to all markers of a trial at once, with its covariance."""
