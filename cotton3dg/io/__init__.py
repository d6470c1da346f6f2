"""Reading and writing of outside formats: video, images, COLMAP, PLY, tables."""
