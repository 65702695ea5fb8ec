"""Learning on the environments of `pcm_gym`: training, controllers, evaluation, statistics and reports."""
