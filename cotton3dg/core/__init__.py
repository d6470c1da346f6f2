"""Data types that every layer shares: cameras, Gaussians, masks, bolls, scale and traits."""
