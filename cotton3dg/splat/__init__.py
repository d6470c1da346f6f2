"""3D Gaussian splatting on the CPU: the checked face of the native core, and the trainer on top of it."""
