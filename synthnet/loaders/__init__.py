"""A built dataset as PyTorch Geometric, Hugging Face datasets, Croissant and mapped arrays."""
