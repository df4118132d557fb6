"""A rectified pair to disparity, disparity to points, each with its uncertainty."""
