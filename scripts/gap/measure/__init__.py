"""What is measured of an image, real or twin, by the same code: plates, uniform regions, whole captures."""
