"""Least squares: compression by QR, priors, reweighting, and the estimate reported."""
