"""Reflectance: lobes, their parameters by nonlinear search, free coefficients."""
