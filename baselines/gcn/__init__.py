"""The paper's graph convolutional networks: encodings, model, training and named configurations."""
