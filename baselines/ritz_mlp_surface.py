"""The network of `ritz_mlp.py`, trained for the spectrum of the surface instead of the mesh's.

It corrects the same Rayleigh-Ritz values from the same 28 numbers, and is trained when it is
loaded, on the numbers that `surface_numbers.py` and `more_numbers.py` keep.
"""

from more_numbers import kept
from ritz_features import CORRECTED, NAMES
from ritz_mlp import Corrected, train

META = {
    "name": "Ritz values, degree 4, corrected by an MLP for the surface",
    "kind": "learned",
    "target": "surface",
    "training_data": "the training split, one instance a shape",
    "training_cost": "half a minute on one core at loading, after the numbers of the shapes",
}
EPOCHS = 200


def load(device: str, seed: int, training: str = "1.0/grouped") -> Corrected:
    """Train the network on the shapes of a training split."""
    numbers, logs = kept(training, NAMES)
    return Corrected(train(numbers, logs - numbers[:, :CORRECTED], seed, epochs=EPOCHS))
