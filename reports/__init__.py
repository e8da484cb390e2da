"""Pictures, recordings and pages made from results."""
