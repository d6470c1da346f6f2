"""Structure from motion: features, pairs and matches, the mapper, lost images brought back, the lens."""
