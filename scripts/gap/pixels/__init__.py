"""What an image of a scene is made of: exact coverage of pixels, and the windows of a frame that are looked at."""
