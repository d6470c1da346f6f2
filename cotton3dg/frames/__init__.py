# SPDX-License-Identifier: Apache-2.0
"""From the video or the photos to frames: how sharp they are, how far the camera went, which to keep."""
