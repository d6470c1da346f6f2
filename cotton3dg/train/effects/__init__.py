# SPDX-License-Identifier: Apache-2.0
"""What the camera does to a photo, found and undone: exposure, motion blur, rolling shutter."""
