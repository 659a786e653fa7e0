"""Frozen recipes: ``<version>.toml``, and the labels pinned for them."""
