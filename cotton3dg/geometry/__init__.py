"""Below the rooms of the stages: camera orbit and paths, boxes, planes, triangulation, measures of point sets."""
