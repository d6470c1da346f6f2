"""cotton3dg: cotton plant traits from a smartphone video."""

__version__ = "0.1.0"
