"""Which effect a model of the joint is missing: every candidate a full fit, one error model, one judgement."""
