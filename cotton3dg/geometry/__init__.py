# SPDX-License-Identifier: Apache-2.0
"""Geometry that the stages share: camera orbit and paths, boxes, planes, triangulation, measures of point sets."""
