"""Around the trainer: what it is given of a capture, and how good the model became."""
