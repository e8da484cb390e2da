"""Which effect a model is missing."""
