"""Which effects a twin lacks: twins as values, candidates tried and taken out, one by one and together, ``verdict()``."""
