"""From masks to Gaussians: which of them each mask of each view shows."""
