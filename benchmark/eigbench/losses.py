"""The losses, by their public name: the door to :mod:`eigbench.scoring.losses`."""

from eigbench.scoring.losses import l1_loss, polar_loss, rpd_loss

__all__ = ["l1_loss", "polar_loss", "rpd_loss"]
