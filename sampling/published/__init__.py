"""What others published: the paper's sampler, its ranking, and baselines of colour science."""
