"""A procedural cotton plant filmed by a virtual smartphone, with exact truth."""
