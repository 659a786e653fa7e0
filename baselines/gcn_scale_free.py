"""The paper's network with scale-free encodings, trained on 2.0 under its protocols.

Its weights are made by `python -m baselines.train_scale_free`: the row ALG of the paper's Table 2
without a virtual node, as `reproduction.py` has it, trained on 2.0 until it has converged. Of large
meshes of the training set a share is taken.
"""

from gcn.trainings import TrainedRow, load_row, meta

META = meta(__file__, "GCN ALG, scale-free, trained on 2.0")


def load(device: str, seed: int, training: str = "2.0/grouped") -> TrainedRow:
    """Return the network trained on what the protocol of that training set leaves of 2.0.

    It is trained on no other version, and no mesh of 1.0 is in 2.0.
    """
    _, _, protocol = training.partition("/")
    return load_row(__file__, device, seed, f"2.0/{protocol}")
