"""Where boards and markers lie in photographs, and the cameras and poses that follow."""
