"""What cameras saw: markers found in images, cameras calibrated, poses of the markers by bundle adjustment."""
