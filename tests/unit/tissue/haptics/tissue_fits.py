"""The models that the default study exports at 100 Hz, as identified on its multisine, and how they are rendered."""

from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.model_data import Port
from lumbar.tissue.models.transfer_function import TransferFunction

COEFFICIENTS = {
    "MW": ((0.0, 0.2651), (1.0, -0.3717)),
    "Maxwell": ((3.4163, -3.4163), (1.0, -0.6645)),
    "KB": ((4.638, -4.0663), (1.0, -0.4074)),
    "HO": ((0.0, 21.0468, -50.6104, 48.6095, -18.5602), (1.0, 0.0092, -0.0261, -0.0181, -0.0345, -0.0404)),
    "IL": ((-0.125,), (1.0,)),
}


def fitted(name: str, unit: str = "mm", quantity: str = "position") -> FittedModel:
    """One of them, from a position to a force in N."""
    structure = TransferFunction(*COEFFICIENTS[name])
    return FittedModel(
        name, structure, 0.01, Port(quantity, unit), Port("force", "N"), trained_on="multisine"
    )
