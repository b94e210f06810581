"""Calibrations in other programs' formats: one file a format, found by being there."""
