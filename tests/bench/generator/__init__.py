"""Blind campaigns: an image formation of its own, which shares no code with the project's effects.

Call ``generate_campaign`` for one campaign and ``draw_effect`` for the parameters of one hidden effect.
"""

from generator.campaign import generate_campaign
from generator.vocabulary import LIBRARY, OUTSIDE, draw_effect, library_parameters

__all__ = ["LIBRARY", "OUTSIDE", "draw_effect", "generate_campaign", "library_parameters"]
