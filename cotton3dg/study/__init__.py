"""What accuracy costs in time: settings that differ in one thing, tried on one plant and laid side by side."""
