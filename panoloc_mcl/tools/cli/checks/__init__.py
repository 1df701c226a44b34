"""Commands that run nothing: configurations checked and described, kernels compiled."""
