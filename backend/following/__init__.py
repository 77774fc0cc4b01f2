"""Clicked targets followed from picture to picture: one thread a vehicle beside the estimator's."""
