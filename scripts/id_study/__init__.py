"""All ids of a family through the same views: which are read, which are taken for others, how far apart codes are."""
