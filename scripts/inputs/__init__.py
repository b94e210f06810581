"""What stages read: campaigns, experiments, configuration, twins and images of others, and each other's tables."""
