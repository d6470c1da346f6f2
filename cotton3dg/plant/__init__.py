"""Cotton science: finding bolls in images, lifting them into 3D, and measuring the plant. Pure functions on arrays."""
