"""The paper's network with scale-free encodings, trained on 2.0 under each of its protocols.

Its weights are trained by `python -m baselines.train_scale_free`, by an earlier form of training
than that of `reproduction.py`: meshes are not turned into their principal axes. Of large meshes of
the training set a share is taken.
"""

from gcn.trainings import TrainedRow, load_row, meta

META = meta(__file__, "GCN ALG, scale-free, trained on 2.0")


def load(device: str, seed: int, training: str = "2.0/grouped") -> TrainedRow:
    """Return the network trained on what the protocol of that training set leaves of 2.0.

    It is trained on no other version, and no mesh of 1.0 is in 2.0.
    """
    _, _, protocol = training.partition("/")
    return load_row(__file__, device, seed, f"2.0/{protocol}")
