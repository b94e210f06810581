"""Marker detectors: one file or folder each, found by being there; contract.py says what a detector is."""
