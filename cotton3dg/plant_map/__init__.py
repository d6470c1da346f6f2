"""From the Gaussians of a plant to its map: wood, graph, skeleton, branches in order, fruiting positions, thickness."""
