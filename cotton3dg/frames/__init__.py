"""From the video or the photos to frames: how sharp they are, how far the camera went, which to keep."""
