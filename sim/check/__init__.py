"""The gate: does the deck in the training scene decay as it was measured, and if not, why?"""
