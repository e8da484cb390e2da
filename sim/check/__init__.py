"""The gate: the decay in the training scene beside the measured decay, and the causes of a difference."""
