"""Extrinsics from the arm: the chain of links and its covariance."""
