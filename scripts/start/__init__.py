"""From a folder of photographs to a campaign: which photographs, what they show, and the files that say so."""
