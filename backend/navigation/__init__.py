"""Feeds the estimator: one worker thread for each vehicle."""
