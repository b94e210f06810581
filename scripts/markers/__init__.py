"""Marker types: one file a type, found by being there."""
