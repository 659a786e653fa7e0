"""Metrics, losses, and the labels that predictions are scored against."""
