"""The statistics at the best point: noise, misfit, differences between tests, intervals and what they consist of."""
