"""Photographs of a calibration board as a problem of points, their light, and what further ones should show."""
