"""The training of the Gaussian model: its photos, its start, its steps, and how good the model became."""
