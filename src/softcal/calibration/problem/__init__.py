"""The problem: experiments and what their rigs do to a measurement, free and uncertain parameters, the loss."""
