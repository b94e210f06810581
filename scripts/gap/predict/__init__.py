"""What a twin shows: known plates drawn with exact coverage, effects applied, measured as the real image is."""
