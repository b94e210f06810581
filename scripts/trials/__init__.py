"""Blind trials: campaigns with something hidden, diagnosed without the truth, and counted against it."""
